"""Rotations of all poses at once, by linear relaxation.

Over the relative poses Z_ij with isotropic weights w_ij,

    minimize  sum_ij w_ij || R_j - R_i Z_ij ||_F^2

with the R_i as unconstrained matrices, those of the held poses given. The rows of the matrices separate into
least-squares problems with one matrix; each R_i is then projected onto the nearest rotation (Martinec, Pajdla, "Robust
Rotation and Translation Estimation in Multiview Reconstruction", CVPR 2007; Carlone, Tron, Daniilidis, Dellaert,
"Initialization Techniques for 3D SLAM", ICRA 2015). In the plane one row says it all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.geometry import so2, so3
from slamcli.graph import FactorGraph, Factors, Variables
from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.graph.topology import component_labels
from slamcli.models import VariableKind
from slamcli.models.base import Array
from slamcli.solver.initialization.block_system import BlockSystem, Nodes, Terms

#: A weight below this share of the largest is raised to it: an edge without information on rotation still connects.
_LEAST_WEIGHT = 1e-9
#: Energy of a component, as a share of the sum of its weights, below which its solution counts as exact.
_LEAST_ENERGY = 1e-15


@dataclass(frozen=True, eq=False)
class Rotations:
    """Rotations of all poses of one kind.

    Attributes
    ----------
    matrices
        (n, d, d), body to world.
    adrift
        (n,) component number where nothing but the pose that the system held by itself orients the component, else -1.
    system
        A system whose pattern may serve again, if there is one.
    """

    matrices: Array
    adrift: IndexArray
    system: BlockSystem | None


def relax(graph: FactorGraph, poses: Variables, held: BoolArray, share: float = 0.5) -> Rotations:
    """Rotations of the poses of one kind by the linear relaxation, projected; the anchor at a share of the poses."""
    relaxation = Relaxation(graph, poses, held)
    return relaxation.rotations(relaxation.anchored(share))


def best_of(graph: FactorGraph, poses: Variables, held: BoolArray, anchors: int, keep: int) -> list[Rotations]:
    """Those of the relaxations with several anchors that fit the relative rotations best, the best first."""
    relaxation = Relaxation(graph, poses, held)
    found = [relaxation.anchored((k + 0.5) / anchors) for k in range(anchors)]
    order = np.argsort([relaxation.cost(matrices) for matrices in found], kind="stable")
    return [relaxation.rotations(found[k]) for k in order[:keep]]


class Relaxation:
    """The relaxation of the poses of one kind, solved once.

    Where nothing but the gauge orients a component, its solution depends on which pose is held: away from it the
    matrices shrink, and what is small is projected badly. With the factor at hand, the solution with any other pose
    held (the anchor) is one solve away: with X the solution for the held pose h and S = sum w r^T r of its residuals r,
    the inverse of the matrix of all poses has the column

        G_k = [L_ff^-1 E_k; 0] + X S^-1 X_k^T

    by block elimination of h, and the solution anchored at k is G_k G_kk^-1. In the plane the same holds with complex
    numbers. The middle pose is the anchor by default, which makes the start independent of the gauge, too.
    """

    def __init__(self, graph: FactorGraph, poses: Variables, held: BoolArray) -> None:
        kind = poses.kind
        self._space, self._rank, self._given = kind.space, poses.rank, held
        relative = [f for f in graph.factors if f.kind.relative_pose and f.kind.variables[0] is kind]
        self._edges, measured, weight = _stacked(relative, [f.measurements for f in relative], kind, 2)
        priors, at_priors = pose_priors(graph, kind)
        singles, prior_values, prior_weight = _stacked(priors, at_priors, kind, 1)
        largest = max(float(weight.max(initial=0.0)), float(prior_weight.max(initial=0.0))) or 1.0
        self._weight, prior_weight = (np.maximum(w, _LEAST_WEIGHT * largest) for w in (weight, prior_weight))
        self._nodes = Nodes.joined(self._space, poses.rank, held, self._edges, singles)
        self._system = self._nodes.system()
        self._matrices = rotation_matrices(kind, np.where(poses.known[:, None], poses.values, kind.identity))
        self._z = rotation_matrices(kind, measured)
        self._rows = 1 if self._space == 2 else 3
        wanted = rotation_matrices(kind, prior_values)[:, : self._rows].transpose(0, 2, 1)
        self._solved = self._solution(singles, wanted, prior_weight)
        self._label = component_labels(self._nodes.points)
        held_there = np.bincount(self._label, self._nodes.held)
        oriented = np.bincount(self._label[singles[:, 0]], minlength=len(held_there))
        self._free = (held_there == 1) & (oriented == 0)  # components that only the gauge orients
        self._free_parts = np.flatnonzero(self._free)

    def _solution(self, singles: IndexArray, wanted: Array, prior_weight: Array) -> Array:
        """The matrices (n, d, rows), their rows as columns, with the held poses given."""
        weight, eye = self._weight[:, None, None], np.eye(self._space)
        held, rows = self._nodes.held[:, None, None], self._matrices[:, : self._rows].transpose(0, 2, 1)
        start = np.where(held, rows, 0.0)
        residual = self._residual(start)
        hessian, scaled = weight * eye, weight * self._z
        between = Terms(hessian, weight * residual, hessian, -scaled @ residual, -scaled)
        prior_gradient = prior_weight[:, None, None] * (start[singles[:, 0]] - wanted)
        terms = [between, Terms(prior_weight[:, None, None] * eye, prior_gradient)]
        return start + self._system.solve(terms)[self._nodes.name]

    def _residual(self, solution: Array) -> Array:
        return solution[self._edges[:, 1]] - self._z.transpose(0, 2, 1) @ solution[self._edges[:, 0]]

    def anchored(self, share: float) -> Array:
        """Rotations (n, d, d) with the anchor at this share of the poses of each component, by their ids."""
        found = self._projected(self._solved)
        if len(self._free_parts) == 0:
            return found
        part = np.full(len(self._free), -1)
        part[self._free_parts] = np.arange(len(self._free_parts))
        rows = np.flatnonzero(part[self._label] >= 0)
        part = part[self._label[rows]]
        anchor = self._at_share(share)[self._free_parts]
        solved, response = self._solved, self._system.responses(anchor, self._rows)
        if self._space == 2:
            solved, response = _complex(solved), _complex(response)
        weight = np.linalg.inv(self._energy()[self._free_parts]) @ solved[anchor].conj().transpose(0, 2, 1)
        column = response[rows] + solved[rows] @ weight[part]
        place = np.searchsorted(rows, anchor)
        matrices = column @ np.linalg.inv(column[place])[part]
        moved = projected((_real(matrices) if self._space == 2 else matrices).transpose(0, 2, 1))
        root = np.flatnonzero(self._nodes.held & self._free[self._label])
        root = root[np.argsort(self._label[root])]
        turn = self._matrices[root] @ moved[np.searchsorted(rows, root)].transpose(0, 2, 1)
        found[rows] = turn[part] @ moved
        found[root] = self._matrices[root]
        return found

    def _at_share(self, share: float) -> IndexArray:
        """One node of each component."""
        order = np.lexsort((self._rank, self._label))
        sizes = np.bincount(self._label)
        return order[np.cumsum(sizes) - sizes + np.minimum((share * sizes).astype(np.intp), sizes - 1)]

    def _energy(self) -> Array:
        """S (components, rows, rows); raised a little, since an exact graph has none."""
        residual = np.sqrt(self._weight)[:, None, None] * self._residual(self._solved)
        count = int(self._label.max()) + 1
        energy = np.zeros((count, self._rows, self._rows))
        np.add.at(energy, self._label[self._edges[:, 1]], residual.transpose(0, 2, 1) @ residual)
        least = _LEAST_ENERGY * np.bincount(self._label[self._edges[:, 1]], self._weight, minlength=count)
        return energy + np.maximum(least, np.finfo(np.float64).tiny)[:, None, None] * np.eye(self._rows)

    def _projected(self, solution: Array) -> Array:
        matrices = self._matrices.copy()
        free = ~self._nodes.held
        matrices[free] = projected(solution[free].transpose(0, 2, 1))
        return matrices

    def cost(self, matrices: Array) -> float:
        """Sum w || R_j - R_i Z ||^2 of rotations (n, d, d)."""
        residual = matrices[self._edges[:, 1]] - matrices[self._edges[:, 0]] @ self._z
        return float((self._weight * np.square(residual).sum(axis=(1, 2))).sum())

    def rotations(self, matrices: Array) -> Rotations:
        """With what the positions need."""
        adrift = np.isin(self._label, self._label[self._nodes.held & ~self._given])
        return Rotations(matrices, np.where(adrift, self._label, -1), self._system)


def _complex(columns: Array) -> Array:
    """Columns (n, 2, 1) of the plane as numbers (n, 1, 1)."""
    return np.asarray(columns[:, :1] + 1j * columns[:, 1:])


def _real(numbers: Array) -> Array:
    """The inverse of ``_complex``."""
    return np.concatenate([numbers.real, numbers.imag], axis=1)


def _stacked(
    factors: list[Factors], values: list[Array], kind: VariableKind, slots: int
) -> tuple[IndexArray, Array, Array]:
    """Indices (m, slots), pose values (m, size) and rotation weights (m,) of several columns of factors."""
    return (
        np.concatenate([np.empty((0, slots), dtype=np.intp), *(f.indices for f in factors)]),
        np.concatenate([np.empty((0, kind.size)), *values]),
        np.concatenate([np.empty(0), *(rotation_weight(f.information, kind.space) for f in factors)]),
    )


def pose_priors(graph: FactorGraph, kind: VariableKind) -> tuple[list[Factors], list[Array]]:
    """Priors that determine a pose, and the poses that they want."""
    found, values = [], []
    for factors in graph.factors:
        if factors.kind.variables == (kind,):
            nothing = np.empty((len(factors), kind.size))
            value = factors.kind.place(nothing, factors.measurements, factors.parameters)
            if value is not None:
                found.append(factors)
                values.append(value)
    return found, values


def rotation_matrices(kind: VariableKind, values: Array) -> Array:
    """Rotation matrices (n, d, d) of poses (n, size)."""
    return so2.to_matrix(values[:, 2:]) if kind.space == 2 else so3.to_matrix(values[:, 3:])


def rotation_weight(information: Array, space: int) -> Array:
    """Isotropic weight (m,) with the same mean cost over all axes: the trace of Omega_R over its size."""
    return np.trace(information[:, space:, space:], axis1=1, axis2=2) / (information.shape[-1] - space)


def projected(matrices: Array) -> Array:
    """The rotations nearest to matrices, from their first row in the plane."""
    if matrices.shape[-1] == 2:
        return so2.to_matrix(np.arctan2(-matrices[:, 0, 1], matrices[:, 0, 0])[:, None])
    u, _, v = np.linalg.svd(matrices)
    u[:, :, 2] *= np.where(np.linalg.det(u @ v) < 0.0, -1.0, 1.0)[:, None]
    return u @ v
