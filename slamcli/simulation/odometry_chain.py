"""The odometry of a graph as a chain: poses in the order of their ids and the measured steps between neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.errors import InputError
from slamcli.graph import FactorGraph, Factors
from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.graph.topology import is_loop_closure
from slamcli.models import RELATIVE_POSE_2D, RELATIVE_POSE_3D, SE2, FactorKind, VariableKind
from slamcli.models.base import Array
from slamcli.simulation.portable import portable


@dataclass(frozen=True, eq=False)
class OdometryChain:
    """Poses by number: their position in the order of the ids.

    Attributes
    ----------
    kind
        SE2 or SE3; of a graph with both, the one with more relative poses.
    rows
        (n,) row of each pose in its column of variables.
    number
        (n,) number of the pose in each row.
    steps
        (n - 1, kind.size) pose k + 1 seen from pose k as the odometry measured it, the identity where it did not.
    driven
        (n - 1,) where it did.
    """

    kind: VariableKind
    rows: IndexArray
    number: IndexArray
    steps: Array
    driven: BoolArray

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def factor_kind(self) -> FactorKind:
        """The kind of factor that joins two of these poses."""
        return RELATIVE_POSE_2D if self.kind is SE2 else RELATIVE_POSE_3D

    def windows(self, length: int) -> IndexArray:
        """Poses from which the odometry goes on for ``length`` steps."""
        if len(self) <= length:
            return np.empty(0, dtype=np.intp)
        missing = np.concatenate([[0], np.cumsum(~self.driven)])
        return np.flatnonzero(missing[length:] == missing[: len(self) - length])

    def path(self, starts: IndexArray, length: int) -> Array:
        """Dead reckoning: poses start, ..., start + length seen from each start, (c, length + 1, kind.size).

        Behind the end of the chain, its last step again.
        """
        out = portable(np.empty((len(starts), length + 1, self.kind.size)))
        out[:, 0] = self.kind.identity
        for k in range(length):
            step = portable(self.steps[np.minimum(starts + k, len(self.steps) - 1)])
            out[:, k + 1] = self.kind.normalize(self.kind.compose(out[:, k], step))
        return np.asarray(out)


def odometry_chain(graph: FactorGraph) -> OdometryChain:
    """The chain of a graph's poses.

    Raises
    ------
    InputError
        If the graph has no poses.
    """
    poses = [column for column in graph.variables.values() if column.kind.is_pose]
    if not poses:
        raise InputError("the graph has no poses")
    relative = [factors for factors in graph.factors if factors.kind.relative_pose]
    column = max(poses, key=lambda c: (sum(len(f) for f in relative if f.kind.variables[0] is c.kind), len(c)))
    steps = np.tile(np.array(column.kind.identity), (max(len(column) - 1, 0), 1))
    driven = np.zeros(len(steps), dtype=bool)
    for factors in reversed(relative):  # of several measurements of a step, the first one of the first column counts
        if factors.kind.variables[0] is column.kind:
            rank = column.rank[factors.indices[:, :2]]
            for backward, rows in enumerate((rank[:, 1] - rank[:, 0] == 1, rank[:, 0] - rank[:, 1] == 1)):
                measured = factors.measurements[rows][::-1]
                at = rank[rows].min(axis=1)[::-1]
                steps[at] = column.kind.inverse(measured) if backward else measured
                driven[at] = True
    return OdometryChain(column.kind, np.argsort(column.rank), column.rank, steps, driven)


def is_odometry(graph: FactorGraph, factors: Factors) -> BoolArray:
    """Which factors are steps of the odometry: relative poses of neighbours in the order of ids."""
    if not factors.kind.relative_pose:
        return np.zeros(len(factors), dtype=bool)
    return ~is_loop_closure(graph, factors) & (factors.indices[:, 0] != factors.indices[:, 1])


def is_observation(factors: Factors) -> BoolArray:
    """Which factors are observations of a landmark by a pose."""
    kinds = factors.kind.variables
    return np.full(len(factors), len(kinds) == 2 and kinds[0].is_pose and kinds[1].is_point)
