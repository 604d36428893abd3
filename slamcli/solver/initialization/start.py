"""A start of an optimization, and those that the automatic start knows."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

from slamcli.graph import FactorGraph
from slamcli.graph.columns import Values
from slamcli.solver.gauge import Held
from slamcli.solver.initialization.initialize import initialize


@dataclass(frozen=True, eq=False)
class Start:
    """A start.

    Attributes
    ----------
    name
        Short: ``file``, ``odometry``, ``spanning-tree``, ``chordal`` or ``chordal-anchors``.
    values
        Of all variables.
    words
        Where they come from.
    """

    name: str
    values: Values
    words: str


def make(graph: FactorGraph, method: str, held: Held) -> Start:
    """The start of a method (see ``initialize``)."""
    return Start(method, *initialize(graph, method, held))


def automatic(graph: FactorGraph, held: Held, *, trust_closures: bool = True) -> Iterator[Callable[[], Start]]:
    """The starts of ``auto``, made when they are called: the file's values, and the chordal relaxation.

    The file may leave landmarks out: these are placed. A graph without poses is linear or nearly so: its values, or a
    tree, will do. Where closures may be false (a robust kernel is on them), the relaxation, which takes them all at
    their word, gives way to the odometry.
    """
    if graph.poses == 0 or all(c.known.all() for c in graph.variables.values() if not c.kind.is_point):
        yield partial(make, graph, "file", held)
    if graph.poses:
        yield partial(make, graph, "chordal" if trust_closures else "odometry", held)


def in_doubt(graph: FactorGraph, held: Held) -> Iterator[Callable[[], Start]]:
    """Further starts: the relaxation with several poses held in turn."""
    if graph.poses:
        yield partial(make, graph, "chordal-anchors", held)
