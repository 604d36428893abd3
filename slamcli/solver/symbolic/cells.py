"""Which blocks of H and of L are there, and what each stands for: the content of a spy plot."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from slamcli.graph import FactorGraph
from slamcli.graph.columns import IndexArray
from slamcli.graph.topology import is_loop_closure
from slamcli.solver.gauge import Held
from slamcli.solver.pattern import BlockPattern, block_numbers
from slamcli.solver.symbolic.analysis import SymbolicAnalysis, analyze
from slamcli.solver.symbolic.structure import row_structure
from slamcli.solver.symbolic.supernodes import supernodes

#: Kinds of blocks: a pose or the odometry between two, whatever has a landmark in it, a loop closure.
POSE, LANDMARK, CLOSURE = range(3)
_CHUNK = 2_000_000


def hessian_kinds(graph: FactorGraph, held: Held, pattern: BlockPattern) -> IndexArray:
    """(e,) kind of each stored block of the pattern of a graph.

    A block of two poses that an odometry edge joins is odometry, also where a loop closure joins them, too.
    """
    count = len(pattern.sizes)
    number, _ = block_numbers(graph, held)
    is_pose = np.concatenate([np.full(int((~held[n]).sum()), c.kind.is_pose) for n, c in graph.variables.items()])
    kinds = np.where(is_pose[pattern.rows] & is_pose[pattern.columns], CLOSURE, LANDMARK)
    kinds[(pattern.rows == pattern.columns) & is_pose[pattern.rows]] = POSE
    keys = pattern.columns * count + pattern.rows
    for factors in graph.factors:
        if not factors.kind.relative_pose:
            continue
        ends = [number[kind.name][factors.indices[:, s]] for s, kind in enumerate(factors.kind.variables[:2])]
        low, high = np.minimum(*ends), np.maximum(*ends)
        chain = (low >= 0) & (low < high) & ~is_loop_closure(graph, factors)
        kinds[np.searchsorted(keys, (high * count + low)[chain])] = POSE
    return kinds


def factor_blocks(pattern: BlockPattern, analysis: SymbolicAnalysis) -> int:
    """Number of blocks of L, those of the diagonal included: its nonzeros if every block were a number."""
    numbers = BlockPattern(np.ones_like(pattern.sizes), pattern.rows, pattern.columns)
    return analyze(numbers, analysis.order).nnz_factor


def factor_cells(pattern: BlockPattern, analysis: SymbolicAnalysis) -> Iterator[tuple[IndexArray, IndexArray]]:
    """Row and column of each block of L, in pieces.

    Positions are those of ``analysis.order``; row >= column.
    """
    parts = supernodes(analysis, relaxed=False)
    structure = row_structure(pattern, parts)
    count = len(parts.order)
    place = np.empty(count, dtype=np.intp)
    place[analysis.order] = np.arange(count)
    given = place[parts.order]
    owner = parts.of_column
    own = parts.first[owner + 1] - np.arange(count)  # from each column to the end of its supernode
    below = np.diff(structure.pointer)[owner]
    ends = np.cumsum(own + below)
    start = 0
    while start < count:
        done = ends[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(ends, done + _CHUNK, side="right")))
        columns = np.arange(start, stop)
        yield given[_ranges(columns, own[columns])], given[np.repeat(columns, own[columns])]
        rows = structure.rows[_ranges(structure.pointer[owner[columns]], below[columns])]
        yield given[rows], given[np.repeat(columns, below[columns])]
        start = stop


def _ranges(start: IndexArray, length: IndexArray) -> IndexArray:
    """The ranges ``start[k] : start[k] + length[k]``, one after the other."""
    ends = np.cumsum(length)
    return np.arange(int(ends[-1]) if len(ends) else 0) + np.repeat(start - ends + length, length)
