"""A trajectory: the poses of one robot in order, as evaluation and drawing want them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.geometry import so3
from slamcli.graph.columns import IdArray, IndexArray, Variables
from slamcli.graph.factor_graph import FactorGraph
from slamcli.models import SE2, SE3, VariableKind
from slamcli.models.base import Array


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses in the order in which they were driven, with what identifies each.

    Attributes
    ----------
    kind
        SE2 or SE3.
    poses
        (n, kind.size) poses in the world frame: metres, radians or unit quaternions x y z w.
    ids
        (n,) ids of the poses in their graph, None where the file gives none.
    stamps
        (n,) seconds, None where the file gives none.
    source
        Where it comes from, for messages and legends.
    graph
        The graph it was taken from, None for trajectory files. Its landmarks and edges are found there.
    notes
        What the reader of a trajectory file skipped or assumed, one sentence each.
    """

    kind: VariableKind
    poses: Array
    ids: IdArray | None = None
    stamps: Array | None = None
    source: str = ""
    graph: FactorGraph | None = None
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def positions(self) -> Array:
        """(n, kind.space) positions in metres."""
        return self.poses[:, : self.kind.space]

    def lifted(self) -> Array:
        """(n, 7) the poses as elements of SE(3): planar ones lie in z = 0 and turn about z."""
        if self.kind is SE3:
            return self.poses
        half = 0.5 * self.poses[:, 2]
        zero = np.zeros(len(self))
        return np.stack([self.poses[:, 0], self.poses[:, 1], zero, zero, zero, np.sin(half), np.cos(half)], axis=1)

    def matrices(self) -> Array:
        """(n, 4, 4) the poses as homogeneous matrices, planar ones lifted."""
        out = np.zeros((len(self), 4, 4))
        lifted = self.lifted()
        out[:, :3, :3] = so3.to_matrix(lifted[:, 3:])
        out[:, :3, 3] = lifted[:, :3]
        out[:, 3, 3] = 1.0
        return out

    def headings(self) -> Array:
        """(n,) rotation about the world's z axis, in radians."""
        if self.kind is SE2:
            return self.poses[:, 2]
        return so3.to_euler(self.poses[:, 3:])[:, 2]

    @property
    def length(self) -> float:
        """Length of the path in metres."""
        return float(np.sqrt(np.square(np.diff(self.positions, axis=0)).sum(axis=1)).sum())


def of_graph(graph: FactorGraph, source: str = "") -> Trajectory:
    """The poses of a graph in the order of their ids.

    Where a graph holds planar and spatial poses, those of the kind with more poses are taken.
    """
    columns = [column for column in graph.variables.values() if column.kind.is_pose]
    if not columns:
        return Trajectory(SE2, np.empty((0, 3)), np.empty(0, dtype=np.int64), source=source, graph=graph)
    column = max(columns, key=len)
    order = _by_id(column)
    kind = column.kind if column.kind is SE2 else SE3  # the values of cameras begin with a pose
    return Trajectory(kind, column.values[order, : kind.size], column.ids[order], source=source, graph=graph)


def _by_id(column: Variables) -> IndexArray:
    """Rows of the variables that have a value, by id."""
    rows = np.flatnonzero(column.known)
    return rows[np.argsort(column.rank[rows])]
