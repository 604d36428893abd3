"""Where the optimization starts: the file's values, the integrated odometry, a spanning tree, a chordal relaxation.

For odometry and tree, poses are chained along the edges of a tree. The chain of thousands of poses is composed by
pointer jumping: in each round every pose composes its relative pose with its parent's and takes over the grandparent,
so that log2(depth) batched compositions suffice.
"""

from __future__ import annotations

import numpy as np

from slamcli.errors import NumericalError
from slamcli.graph import FactorGraph, Variables
from slamcli.graph.columns import BoolArray, IndexArray, Values
from slamcli.models import VariableKind
from slamcli.models.base import Array
from slamcli.solver.backends import NotPositiveDefiniteError
from slamcli.solver.gauge import Held
from slamcli.solver.initialization import camera_points, chordal, spanning_tree
from slamcli.solver.robust import switchable

#: Poses that ``chordal-anchors`` holds in turn. On M3500c 8 of 16 lead to the lowest minimum.
_ANCHORS = 16
#: How the words begin where values of the graph count.
FROM_FILE = "values of the file"
_WORDS = {"odometry": "integrated odometry", "spanning-tree": "spanning tree"}


def initialize(graph: FactorGraph, method: str, held: Held, *, complete: bool = True) -> tuple[Values, str]:
    """Start values by a method of ``options.INITS`` but ``auto``, and in words where they come from.

    ``file`` keeps the file's values and chains what the file does not give; the other methods chain every pose
    from the held ones and hang the landmarks off them; ``chordal`` solves for all at once (see ``chordal``). Switches
    keep what they have, the file's value or 1, and loop closures count with that weight. Landmarks that their edges do
    not determine keep the graph's values; without ``complete`` also those that have none, whatever stands there.

    Raises
    ------
    NumericalError
        If a variable has no estimate and its edges cannot place it.
    """
    if graph.switches:
        plain = switchable.at_their_switches(graph)
        values, words = initialize(plain, method, {name: held[name] for name in plain.variables}, complete=complete)
        return {**graph.values, **values}, words
    missing = sum(int(np.count_nonzero(~column.known)) for column in graph.variables.values())
    if method == "file" and missing == 0:
        return graph.values, FROM_FILE
    if method == "chordal":
        values, placed, words = _relaxed(graph, held)
    elif method == "chordal-anchors":
        values, placed, words = _relaxed(graph, held, anchors=_ANCHORS)
    else:
        values, placed = _along_edges(graph, method, held)
        words = _WORDS.get(method, f"{FROM_FILE}; {missing} without one placed by their edges")
    if graph.landmarks:
        from slamcli.solver.initialization import landmarks  # most graphs do without

        landmarks.place(graph, values, placed)
    if triangulated := camera_points.place_points_from_cameras(graph, values, placed):
        words = f"{words.partition(';')[0]}; {triangulated} points triangulated from images"
    if complete:
        _require_all(graph, placed)
    return values, words


def _relaxed(graph: FactorGraph, held: Held, *, anchors: int = 1) -> tuple[Values, dict[str, BoolArray], str]:
    """The chordal start, or a spanning tree where its numbers overflow."""
    try:
        with np.errstate(all="ignore"):
            return chordal.relax(graph, held, anchors=anchors)
    except (NotPositiveDefiniteError, np.linalg.LinAlgError):
        values, placed = _along_edges(graph, "spanning-tree", held)
        return values, placed, "spanning tree, since the chordal relaxation cannot be solved"


def _along_edges(graph: FactorGraph, method: str, held: Held) -> tuple[Values, dict[str, BoolArray]]:
    """Poses chained along edges; landmarks as far as they are given. And which of them are placed."""
    values = dict(graph.values)
    placed: dict[str, BoolArray] = {}
    for name, column in graph.variables.items():
        if column.kind.is_pose:
            roots = column.known if method == "file" else column.known & (column.fixed | held[name])
            values[name], placed[name] = _chained(graph, column, roots, method)
        else:
            placed[name] = column.known if method == "file" else column.known & (column.fixed | held[name])
            placed[name] = placed[name].copy()
    return values, placed


def _chained(graph: FactorGraph, column: Variables, roots: BoolArray, method: str) -> tuple[Array, BoolArray]:
    """Poses chained from the roots (one is chosen in each component without)."""
    kind = column.kind
    first, second, relative = _relative_poses(graph, kind)
    order = np.argsort(column.rank).tolist()
    if method == "odometry":
        first, second, relative = _odometry_first(column.rank, first, second, relative)
    edges = spanning_tree.Edges.of(len(column), first, second)
    if method == "spanning-tree":
        parent, edge = spanning_tree.least_uncertain(edges, _uncertainty(graph, kind), roots, order)
    else:
        parent, edge = spanning_tree.breadth_first(edges, roots, order)
    start = np.where(column.known[:, None], column.values, _from_priors(graph, column))
    step = np.tile(kind.identity, (len(column), 1))
    moved = np.flatnonzero(edge >= 0)
    along = relative[edge[moved]]
    backward = first[edge[moved]] == moved  # the edge runs from the child to the parent
    along[backward] = kind.inverse(along[backward])
    step[moved] = along
    while True:
        upper = parent[parent]
        if np.array_equal(upper, parent):
            break
        step = kind.normalize(kind.compose(step[parent], step))
        parent = upper
    is_root = edge < 0
    out = start.copy()
    out[~is_root] = kind.normalize(kind.compose(start[parent[~is_root]], step[~is_root]))
    return out, np.ones(len(column), dtype=bool)


def _relative_poses(graph: FactorGraph, kind: VariableKind) -> tuple[IndexArray, IndexArray, Array]:
    """All relative-pose edges of a kind of pose: rows of both poses, and the measured relative pose."""
    columns = [f for f in graph.factors if f.kind.relative_pose and f.kind.variables[0] is kind]
    none = np.empty((0, 2), dtype=np.intp)
    indices = np.concatenate([none, *(f.indices for f in columns)])
    relative = np.concatenate([np.empty((0, kind.size)), *(f.measurements for f in columns)])
    return indices[:, 0], indices[:, 1], relative


def _uncertainty(graph: FactorGraph, kind: VariableKind) -> Array:
    """Trace of the covariance (m,) of each relative pose, in metres and radians; large where there is none."""
    columns = [f.information for f in graph.factors if f.kind.relative_pose and f.kind.variables[0] is kind]
    information = np.concatenate([np.empty((0, kind.dimension, kind.dimension)), *columns])
    floor = 1e-9 * np.abs(np.trace(information, axis1=1, axis2=2))[:, None, None] + np.finfo(np.float64).tiny
    with np.errstate(all="ignore"):
        covariance = np.linalg.inv(information + floor * np.eye(kind.dimension))
    total = np.trace(covariance, axis1=1, axis2=2)
    return np.where(total > 0.0, total, np.inf)


def _odometry_first(
    rank: IndexArray, first: IndexArray, second: IndexArray, relative: Array
) -> tuple[IndexArray, IndexArray, Array]:
    """The edges of a forest that takes the edges between neighbouring ids before all others (Kruskal)."""
    off_chain = np.abs(rank[first] - rank[second]) != 1
    order = np.argsort(off_chain, kind="stable")
    chosen = order[spanning_tree.kruskal(len(rank), first[order], second[order])]
    return first[chosen], second[chosen], relative[chosen]


def _from_priors(graph: FactorGraph, column: Variables) -> Array:
    """Values at the variables' priors where these determine one, the identity elsewhere."""
    out = np.tile(column.kind.identity, (len(column), 1))
    for factors in graph.factors:
        if factors.kind.variables == (column.kind,):
            rows = factors.indices[:, 0]
            value = factors.kind.place(out[rows], factors.measurements, factors.parameters)
            if value is not None:
                out[rows] = value
    return out


def _require_all(graph: FactorGraph, placed: dict[str, BoolArray]) -> None:
    """Every variable needs a start: its own from the file, or a place."""
    for name, column in graph.variables.items():
        lost = ~placed[name] & ~column.known
        if lost.any():
            ids = ", ".join(str(i) for i in column.ids[lost][:5])
            more = ", ..." if lost.sum() > 5 else ""
            who = "1 landmark has" if lost.sum() == 1 else f"{lost.sum()} landmarks have"
            raise NumericalError(
                f"{who} no estimate and no edge that determines one: {ids}{more}",
                ("  give vertices for them, or more edges: a single bearing or range places none",),
            )
