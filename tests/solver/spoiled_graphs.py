"""Bundled graphs with false loop closures, for the tests of robust estimation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from graphs import bundled

from slamcli.graph import FactorGraph, Factors, is_loop_closure
from slamcli.graph.columns import BoolArray
from slamcli.models.base import Array


def closures(graph: FactorGraph) -> list[BoolArray]:
    """The loop closures of each column."""
    return [is_loop_closure(graph, factors) for factors in graph.factors]


def spoiled(name: str, count: int = 8, seed: int = 0) -> tuple[FactorGraph, Factors]:
    """A bundled graph of relative poses with false closures behind the true ones, and the false ones alone.

    They claim that two poses far apart in the order of ids are at the same place, with the information of a true one.
    """
    graph = bundled(name)
    rng = np.random.default_rng(seed)
    edges = graph.factors[0]
    poses = len(next(iter(graph.variables.values())))
    first = rng.integers(0, poses // 3, count)
    second = rng.integers(2 * poses // 3, poses, count)
    last = int(np.flatnonzero(is_loop_closure(graph, edges))[-1])
    false = Factors(
        kind=edges.kind,
        indices=np.stack([first, second], axis=1),
        measurements=np.tile(edges.kind.variables[0].identity, (count, 1)),
        information=np.repeat(edges.information[last : last + 1], count, axis=0),
        tag=edges.tag,
        lines=np.zeros(count, dtype=np.intp),
    )
    return replace(graph, factors=[edges, false], document=None, report=None), false


def without(graph: FactorGraph, false: Factors) -> FactorGraph:
    """The graph without these factors."""
    return replace(graph, factors=[factors for factors in graph.factors if factors is not false])


def apart(one: Array, other: Array) -> float:
    """Largest difference of two states of one kind."""
    return float(np.abs(one - other).max())
