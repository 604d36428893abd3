"""Links: the factors between variables of a blanket, or of one with the world, by which a marginal can be written.

A link's factor has its measurement at the estimate, so that its residual is zero there, and the Jacobian J_0. What
files can hold are relative poses, points seen from poses, differences of points, and priors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slamcli import models
from slamcli.graph.columns import IndexArray
from slamcli.models import FactorKind, VariableKind
from slamcli.models.base import Array
from slamcli.solver.marginalization.nodes import Nodes

_PAIRS: dict[tuple[str, ...], FactorKind] = {
    ("SE2", "SE2"): models.RELATIVE_POSE_2D,
    ("SE3", "SE3"): models.RELATIVE_POSE_3D,
    ("SE2", "XY"): models.POINT_OBSERVATION_2D,
    ("SE3", "XYZ"): models.POINT_OBSERVATION_3D,
    ("XY", "XY"): models.POINT_DIFFERENCE_2D,
    ("XYZ", "XYZ"): models.POINT_DIFFERENCE_3D,
    ("SE2",): models.POSE_PRIOR_2D,
    ("SE3",): models.POSE_PRIOR_3D,
    ("XY",): models.POINT_PRIOR_2D,
    ("XYZ",): models.POINT_PRIOR_3D,
}


def kind_of(variables: Sequence[VariableKind]) -> FactorKind | None:
    """The kind of factor that joins variables of these kinds, or ties one to the world; None if there is none."""
    return _PAIRS.get(tuple(kind.name for kind in variables))


def no_offset(kind: FactorKind, count: int) -> Array | None:
    """The constant parameter (a sensor at the body's origin) of new factors of a kind, if it has one."""
    return None if kind.parameter is None else np.tile(np.array(kind.parameter.identity), (count, 1))


def measure(kind: FactorKind, x: tuple[Array, ...]) -> Array:
    """The measurements (m, size) at which the residual is zero."""
    first = x[0]
    if kind.relative_pose:
        return kind.normalize(kind.variables[0].compose(kind.variables[0].inverse(first), x[1]))
    if len(x) == 1:
        return first.copy()
    return kind.residual(x, np.zeros((len(first), kind.measurement_size)), no_offset(kind, len(first)))


@dataclass(frozen=True, eq=False)
class Links:
    """Links of one kind.

    Attributes
    ----------
    kind
        Of the factors.
    ends
        (m, slots) positions of the variables in the blanket.
    columns
        (m, w) their columns in matrices over the blanket.
    jacobian
        (m, d, w) J_0.
    """

    kind: FactorKind
    ends: IndexArray
    columns: IndexArray
    jacobian: Array

    def __len__(self) -> int:
        return len(self.ends)

    def covariance(self, sigma: Array) -> Array:
        """J Sigma J^T of each link, (m, d, d), for a matrix over the blanket."""
        part = sigma[self.columns[:, :, None], self.columns[:, None, :]]
        return np.matmul(np.matmul(self.jacobian, part), self.jacobian.transpose(0, 2, 1))

    def part(self, rows: IndexArray) -> Links:
        """Some of them."""
        return Links(self.kind, self.ends[rows], self.columns[rows], self.jacobian[rows])


def between(nodes: Nodes, blanket: Sequence[int], anchored: bool) -> list[Links]:
    """All links that a blanket may have: every pair, and the world where that is known.

    Two points have one only where there is no pose: their difference is not that of a rotated world.
    """
    members = np.array(blanket, dtype=np.intp)
    starts = np.concatenate([[0], np.cumsum(nodes.dimension[members])])
    poses, points = np.flatnonzero(nodes.is_pose[members]), np.flatnonzero(~nodes.is_pose[members])
    pairs = []
    if len(poses):
        pairs += [_all_pairs(poses), np.stack(np.meshgrid(poses, points, indexing="ij"), axis=-1).reshape(-1, 2)]
    else:
        pairs.append(_all_pairs(points))
    if anchored:
        pairs += [poses[:, None], points[:, None]]
    return [_links(nodes, members, starts, ends) for ends in pairs if len(ends)]


def _all_pairs(positions: IndexArray) -> IndexArray:
    a, b = np.triu_indices(len(positions), 1)
    return np.stack([positions[a], positions[b]], axis=1)


def _links(nodes: Nodes, members: IndexArray, starts: IndexArray, ends: IndexArray) -> Links:
    kinds = [nodes.kinds[int(nodes.kind[members[position]])] for position in ends[0]]
    kind = kind_of(kinds)
    assert kind is not None
    x = tuple(nodes.values(members[ends[:, slot]]) for slot in range(len(kinds)))
    jacobian = np.concatenate(kind.linearize(x, measure(kind, x), no_offset(kind, len(ends)))[1], axis=2)
    columns = np.concatenate([starts[ends[:, [s]]] + np.arange(k.dimension) for s, k in enumerate(kinds)], axis=1)
    return Links(kind, ends, columns, jacobian)
