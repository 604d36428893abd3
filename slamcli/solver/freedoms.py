"""The gauge freedoms of what cameras see, and which tangent dimensions to hold so that none is left.

Images determine a scene up to a similarity of space: seven directions in which everything moves and no image changes.
Held variables, priors and everything that measures metres (a stereo baseline, a relative pose) take some of them away.
With N the tangent directions of the variables along the seven, and J those of the residuals by the variables, the
freedoms are the null space of [N_held; J N]. Holding a tangent dimension takes one away that has a part along it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.geometry import so3
from slamcli.graph import FactorGraph, Factors
from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.graph.topology import node_offsets
from slamcli.models import Projection, SbaStereoProjection
from slamcli.models.base import Array

FREEDOMS = 7  # three of place, three of orientation, scale
_RANK = 1e-9  # a direction with less of its square than this is none
_ALONG = 1e-6  # least part of a freedom (in units of the scene) along a dimension that is to hold it

#: Which tangent dimensions (n, d) of the variables of a kind do not move.
Frozen = dict[str, BoolArray]
#: One of them: name of the kind, row, dimension.
Place = tuple[str, int, int]


@dataclass(frozen=True, eq=False)
class Scene:
    """One component with cameras.

    Attributes
    ----------
    rows
        Rows of its variables in the column of each kind.
    directions
        (n, d, 7) of each of them: how their tangent dimensions move along the seven, places in units of the scene's
        size.
    size
        Of the scene in metres: the spread of its cameras (of its points, where all cameras are at one place).
    """

    rows: dict[str, IndexArray]
    directions: dict[str, Array]
    size: float

    def in_metres(self, name: str) -> Array:
        """The directions of the variables of a kind, places in metres."""
        out = self.directions[name].copy()
        out[:, :3] *= self.size
        return out


def scene(graph: FactorGraph, label: IndexArray, component: int) -> Scene:
    """The variables of a component and their seven directions."""
    offsets = node_offsets(graph)
    rows = {
        name: np.flatnonzero(label[first : first + len(graph.variables[name])] == component)
        for name, first in offsets.items()
    }
    rows = {name: found for name, found in rows.items() if len(found)}
    places = {name: graph.variables[name].values[found, :3] for name, found in rows.items()}
    poses = [place for name, place in places.items() if graph.variables[name].kind.is_pose]
    with np.errstate(all="ignore"):
        centre = np.concatenate(poses).mean(axis=0)
        spread = [
            float(np.sqrt(np.square(np.concatenate(some) - centre).sum(axis=1).mean()))
            for some in (poses, list(places.values()))
        ]
    size = next((s for s in spread if np.isfinite(s) and s > 0.0), 1.0)
    directions = {name: _directions(graph, name, found, centre, size) for name, found in rows.items()}
    return Scene(rows, directions, size)


def _directions(graph: FactorGraph, name: str, rows: IndexArray, centre: Array, size: float) -> Array:
    """See ``Scene``: d = t + w x (p - c) + s (p - c) in the world; a pose has it, and w / 2, in its own frame."""
    column = graph.variables[name]
    values = column.values[rows]
    out = np.zeros((len(rows), column.kind.dimension, FREEDOMS))
    with np.errstate(all="ignore"):
        arm = (values[:, :3] - centre) / size
    x, y, z = np.nan_to_num(arm, posinf=0.0, neginf=0.0).T
    moved = np.zeros((len(rows), 3, FREEDOMS))
    moved[:, :, :3] = np.eye(3)
    moved[:, 1, 3], moved[:, 2, 3] = -z, y  # e_x x arm
    moved[:, 0, 4], moved[:, 2, 4] = z, -x
    moved[:, 0, 5], moved[:, 1, 5] = -y, x
    moved[:, :, 6] = np.stack([x, y, z], axis=1)
    if not column.kind.is_pose:
        out[:, :3] = moved
        return out
    back = so3.to_matrix(so3.inverse(values[:, 3:7]))
    out[:, :3] = back @ moved
    out[:, 3:6, 3:6] = 0.5 * back
    return out


def remaining(graph: FactorGraph, one: Scene, held: dict[str, BoolArray]) -> Array:
    """Orthonormal basis (7, k) of the freedoms that held variables and measurements in metres leave."""
    gram = np.zeros((FREEDOMS, FREEDOMS))
    for name, rows in one.rows.items():
        fixed = one.directions[name][held[name][rows]].reshape(-1, FREEDOMS)
        gram += _normed(fixed)
    for factors in graph.factors:
        kind = factors.kind
        if isinstance(kind, Projection) and not isinstance(kind, SbaStereoProjection):
            continue  # a single image is the same along all seven
        gram += _normed(_seen_by(graph, one, factors))
    values, vectors = np.linalg.eigh(gram)
    return np.asarray(vectors[:, values <= _RANK * max(float(values[-1]), 1.0)])


def _seen_by(graph: FactorGraph, one: Scene, factors: Factors) -> Array:
    """J N (m, 7) of some factors of the scene."""
    names = [kind.name for kind in factors.kind.variables]
    if any(name not in one.rows for name in names):
        return np.empty((0, FREEDOMS))
    mine = np.isin(factors.indices[:, 0], one.rows[names[0]])
    part = factors.part(np.flatnonzero(mine))
    with np.errstate(all="ignore"):
        jacobians = part.linearize(graph.values)[1]
        total = sum(
            jacobian @ one.in_metres(name)[np.searchsorted(one.rows[name], part.indices[:, slot])]
            for slot, (name, jacobian) in enumerate(zip(names, jacobians, strict=True))
        )
    return np.asarray(total).reshape(-1, FREEDOMS)


def _normed(rows: Array) -> Array:
    """Gram matrix of rows (m, 7), each divided by the largest of them."""
    rows = rows[np.isfinite(rows).all(axis=1)]
    largest = float(np.abs(rows).max(initial=0.0))
    return np.zeros((FREEDOMS, FREEDOMS)) if largest == 0.0 else (rows / largest).T @ (rows / largest)


def freeze(graph: FactorGraph, one: Scene, basis: Array, held: dict[str, BoolArray]) -> list[Place]:
    """Tangent dimensions (kind, row, component) that take all freedoms away, as far as cameras can.

    The pose of the camera with the lowest id comes first; then one coordinate of the place of the camera farthest from
    it, in its own frame the one most along the freedom that is left.
    """
    first = _first_camera(graph, one)
    out: list[Place] = []
    cameras = [first, *_farthest(graph, one, first)]
    for name, row in cameras:
        directions = one.directions[name][int(np.searchsorted(one.rows[name], row))]
        wide = 6 if (name, row) == first else 3
        while basis.shape[1] and not held[name][row]:
            parts = directions[:wide] @ basis
            strength = np.sqrt(np.square(parts).sum(axis=1))
            best = int(strength.argmax())
            if not strength[best] > _ALONG or (name, row, best) in out:
                break
            out.append((name, row, best))
            rotation = np.linalg.svd(parts[best][None], full_matrices=True)[2]
            basis = basis @ rotation[1:].T  # what is orthogonal to it
    return out


def _first_camera(graph: FactorGraph, one: Scene) -> tuple[str, int]:
    """The camera with the lowest id."""
    found = [
        (int(graph.variables[name].ids[row]), name, int(row))
        for name, rows in one.rows.items()
        if graph.variables[name].kind.is_pose
        for row in rows[[int(graph.variables[name].ids[rows].argmin())]]
    ]
    return min(found)[1:]


def _farthest(graph: FactorGraph, one: Scene, first: tuple[str, int]) -> list[tuple[str, int]]:
    """The camera farthest from one."""
    place = graph.variables[first[0]].values[first[1], :3]
    best: list[tuple[float, str, int]] = []
    for name, rows in one.rows.items():
        if graph.variables[name].kind.is_pose:
            with np.errstate(all="ignore"):
                distance = np.square(graph.variables[name].values[rows, :3] - place).sum(axis=1)
            k = int(np.nan_to_num(distance, posinf=0.0).argmax())
            best.append((float(distance[k]), name, int(rows[k])))
    return [max(best)[1:]]
