"""What a map shows of each input: a path, landmarks, and edges as segments. Positions are metres, planar ones at z = 0.

Nothing here knows about matplotlib.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from slamcli.evaluation.alignment import Alignment
from slamcli.graph import FactorGraph, is_loop_closure
from slamcli.graph.columns import BoolArray, IndexArray, finite_rows
from slamcli.graph.trajectory import Trajectory
from slamcli.models.base import Array
from slamcli.reporting.text import plural

#: Roles of edges: along the odometry chain, loop closures, and what joins a pose and a landmark (or two landmarks).
ODOMETRY, CLOSURE, OBSERVATION = range(3)
#: Paths with at most so many poses show each pose with its heading.
FEW = 60


@dataclass(frozen=True, eq=False)
class Edges:
    """Edges between two variables that have finite positions.

    Attributes
    ----------
    segments
        (m, 2, 3) both ends.
    role
        (m,) ``ODOMETRY``, ``CLOSURE`` or ``OBSERVATION``.
    chi2
        (m,) e^T Omega e.
    outlier
        (m,) which of them labels call outliers.
    """

    segments: Array
    role: IndexArray
    chi2: Array
    outlier: BoolArray

    def __len__(self) -> int:
        return len(self.role)


@dataclass(frozen=True, eq=False)
class Estimate:
    """One input of a map.

    Attributes
    ----------
    name
        For the legend.
    space
        2 or 3.
    path
        (n, 3) positions in order; rows of NaN between parts that nothing joins.
    forward
        (n, 3) direction of the body's x axis at each position of few poses, else empty.
    landmarks
        (k, 3) positions.
    edges
        Those that can be drawn.
    counts
        Poses, edges, loop closures as the file has them.
    chi2
        Sum over all edges; None where that is not known or there are no edges.
    notes
        What is not drawn.
    """

    name: str
    space: int
    path: Array
    forward: Array
    landmarks: Array
    edges: Edges
    counts: dict[str, int]
    chi2: float | None
    notes: list[str] = field(default_factory=list)

    @property
    def points(self) -> Array:
        """All finite positions, of poses and landmarks."""
        every = np.concatenate([self.path, self.landmarks])
        return every[finite_rows(every)]

    def moved(self, alignment: Alignment) -> Estimate:
        """In another frame."""
        segments = alignment.points(self.edges.segments.reshape(-1, 3)).reshape(-1, 2, 3)
        return replace(
            self,
            path=alignment.points(self.path),
            forward=np.matmul(self.forward, alignment.rotation.T),
            landmarks=alignment.points(self.landmarks),
            edges=replace(self.edges, segments=segments),
        )


def estimate_of(trajectory: Trajectory, name: str, outliers: list[BoolArray] | None = None) -> Estimate:
    """What to draw of a trajectory and of the graph that it comes from.

    Parameters
    ----------
    trajectory
        In the world frame.
    name
        For the legend.
    outliers
        One mask for each column of the graph's factors, if labels are given.
    """
    graph = trajectory.graph
    positions = spatial(trajectory.positions)
    finite = finite_rows(positions)
    notes = []
    if not finite.all():
        positions = np.where(finite[:, None], positions, np.nan)
        notes.append(f"{name}: not drawn: {plural(int(np.count_nonzero(~finite)), 'pose')} without a finite position")
    forward = np.empty((0, 3))
    if len(trajectory) <= FEW:
        forward = trajectory.matrices()[:, :3, 0]
    counts = {"poses": len(trajectory)}
    landmarks, edges, chi2 = np.empty((0, 3)), _no_edges(), None
    gaps = np.empty(0, dtype=np.intp)
    if graph is not None:
        landmarks, left_out = _landmarks(graph)
        edges, chi2 = _edges(graph, outliers)
        closures = sum(int(np.count_nonzero(is_loop_closure(graph, factors))) for factors in graph.factors)
        counts = {"poses": graph.poses, "landmarks": graph.landmarks, "edges": graph.edges, "closures": closures}
        gaps = _gaps(trajectory, graph)
        without = graph.poses - len(trajectory)
        if without:
            notes.append(f"{name}: not drawn: {plural(without, 'pose')} without an estimate or of another kind")
        if left_out:
            notes.append(f"{name}: not drawn: {plural(left_out, 'landmark')} without an estimate")
    path = np.insert(positions, gaps, np.nan, axis=0)
    if len(forward):
        forward = np.insert(forward, gaps, np.nan, axis=0)
    return Estimate(name, _space(trajectory), path, forward, landmarks, edges, counts, chi2, notes)


def _space(trajectory: Trajectory) -> int:
    if trajectory.graph is not None and len(trajectory.graph.variables):
        return trajectory.graph.space
    return trajectory.kind.space


def spatial(positions: Array) -> Array:
    """(n, 3) positions of planar or spatial ones."""
    return positions if positions.shape[1] == 3 else np.pad(positions, ((0, 0), (0, 1)))


def _landmarks(graph: FactorGraph) -> tuple[Array, int]:
    """Positions of the landmarks that have one, and how many have none."""
    points = [column for column in graph.variables.values() if column.kind.is_point]
    every = np.concatenate([np.empty((0, 3)), *(spatial(column.values[column.known]) for column in points)])
    finite = finite_rows(every)
    return every[finite], graph.landmarks - int(np.count_nonzero(finite))


def _no_edges() -> Edges:
    none = np.empty(0)
    return Edges(np.empty((0, 2, 3)), none.astype(np.intp), none, none.astype(bool))


def _edges(graph: FactorGraph, outliers: list[BoolArray] | None) -> tuple[Edges, float | None]:
    """The edges that join two placed variables, and chi2 of all if every variable is placed."""
    places = {}
    for name, column in graph.variables.items():
        places[name] = spatial(np.where(column.known[:, None], column.values, np.nan)[:, : column.kind.space])
    costs = graph.edge_chi2()
    parts = [_no_edges()]
    for k, factors in enumerate(graph.factors):
        kinds = factors.kind.variables
        if len(kinds) < 2:
            continue
        ends = [places[kinds[slot].name][factors.indices[:, slot]] for slot in (0, 1)]
        segments = np.stack(ends, axis=1)
        drawn = finite_rows(segments)
        role = np.where(
            is_loop_closure(graph, factors), CLOSURE, ODOMETRY if factors.kind.relative_pose else OBSERVATION
        )
        spoiled = outliers[k] if outliers is not None else np.zeros(len(factors), dtype=bool)
        parts.append(Edges(segments[drawn], role[drawn], costs[k][drawn], spoiled[drawn]))
    names = ("segments", "role", "chi2", "outlier")
    edges = Edges(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
    placed = all(column.known.all() for column in graph.variables.values())
    total = float(sum(float(cost.sum()) for cost in costs))
    return edges, total if graph.edges and placed and np.isfinite(total) else None


def _gaps(trajectory: Trajectory, graph: FactorGraph) -> IndexArray:
    """Rows before which the path is interrupted: ids that leap where no edge joins the two poses.

    So several robots in one graph, whose ids are far apart, do not look like one that jumps.
    """
    ids = trajectory.ids
    if ids is None or len(ids) < 2 or graph.edges == 0:
        return np.empty(0, dtype=np.intp)
    leap = np.diff(ids) > 1
    if not leap.any():
        return np.empty(0, dtype=np.intp)
    column = graph.variables[trajectory.kind.name]
    joined = np.zeros(len(column), dtype=bool)  # by rank: an edge joins it and the next pose
    for factors in graph.factors:
        if factors.kind.relative_pose and factors.kind.variables[0] is trajectory.kind:
            ranks = np.sort(column.rank[factors.indices[:, :2]], axis=1)
            joined[ranks[ranks[:, 1] - ranks[:, 0] == 1, 0]] = True
    ranks_of_path = column.rank[column.rows_of(ids)]
    return np.flatnonzero(leap & ~joined[ranks_of_path[:-1]]) + 1
