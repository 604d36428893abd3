"""What a loop closure or a marginalized variable does to the pattern: the blocks of H and L that appear."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slamcli.errors import UsageError
from slamcli.graph import FactorGraph
from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.solver.gauge import Held
from slamcli.solver.ordering.adjacency import edges
from slamcli.solver.ordering.reduction import reduced_edges
from slamcli.solver.pattern import BlockPattern, block_numbers
from slamcli.solver.symbolic import SymbolicAnalysis, analyze
from slamcli.solver.symbolic.cells import factor_blocks, factor_cells

#: Blocks of L up to which those that appear are told one by one.
_MOST = 20_000_000


@dataclass(frozen=True, eq=False)
class Change:
    """A pattern after a change, with the variables numbered as before.

    Attributes
    ----------
    pattern
        After the change; a variable that is gone keeps its block on the diagonal and no other.
    gone
        (n,) which blocks were marginalized out.
    """

    pattern: BlockPattern
    gone: BoolArray


@dataclass(frozen=True)
class BlockCounts:
    """Blocks of a matrix (of its triangle, the diagonal included) before and after a change.

    Attributes
    ----------
    before, after
        How many.
    appeared
        Those that were not there before; None where there are too many to compare.
    """

    before: int
    after: int
    appeared: int | None


def change(
    graph: FactorGraph,
    held: Held,
    pattern: BlockPattern,
    closures: Sequence[tuple[int, int]],
    marginalized: Sequence[int],
) -> Change:
    """The pattern with loop closures added between variables (by ids) and, after that, variables marginalized out.

    Raises
    ------
    UsageError
        If there is no variable with such an id, or more than one, or one that is held is to be marginalized out.
    """
    count = len(pattern.sizes)
    low, high = edges(pattern)
    blocks = np.array(
        [[_block(graph, held, i, "--add-closure") for i in pair] for pair in closures], dtype=np.intp
    ).reshape(-1, 2)
    blocks = np.sort(blocks[(blocks >= 0).all(axis=1)], axis=1)  # a closure with what is held adds no block
    low, high = np.concatenate([low, blocks[:, 0]]), np.concatenate([high, blocks[:, 1]])
    gone = np.zeros(count, dtype=bool)
    for wanted in marginalized:
        block = _block(graph, held, wanted, "--marginalize")
        if block < 0:
            raise UsageError(f"variable {wanted} is held (the gauge): it is not part of H", ("  --fix another one",))
        gone[block] = True
    if gone.any():
        low, high = reduced_edges(low, high, gone)
    return Change(_pattern(pattern, low, high), gone)


def hessian_counts(pattern: BlockPattern, after: Change) -> BlockCounts:
    """Blocks of H."""
    count = max(len(pattern.sizes), 1)
    new = np.setdiff1d(
        after.pattern.columns * count + after.pattern.rows, pattern.columns * count + pattern.rows, assume_unique=True
    )
    return BlockCounts(len(pattern.rows), len(after.pattern.rows) - int(after.gone.sum()), len(new))


def factor_counts(pattern: BlockPattern, analysis: SymbolicAnalysis, after: Change) -> BlockCounts:
    """Blocks of L under the same order (from which what is gone is left out)."""
    changed = analyze(after.pattern, analysis.order)
    before, now = factor_blocks(pattern, analysis), factor_blocks(after.pattern, changed)
    appeared = None
    if not after.gone.any():
        appeared = now - before  # an edge more takes no entry away
    elif before + now <= _MOST:
        appeared = len(np.setdiff1d(cell_keys(after.pattern, changed), cell_keys(pattern, analysis)))
    return BlockCounts(before, now - int(after.gone.sum()), appeared)


def cell_keys(pattern: BlockPattern, analysis: SymbolicAnalysis) -> IndexArray:
    """(k,) one number for each block of L: column times n plus row, in positions of the order."""
    count = len(pattern.sizes)
    return np.concatenate([columns * count + rows for rows, columns in factor_cells(pattern, analysis)])


def _pattern(pattern: BlockPattern, low: IndexArray, high: IndexArray) -> BlockPattern:
    """The diagonal and these edges."""
    count = len(pattern.sizes)
    keys = np.unique(np.concatenate([high * count + low, np.arange(count) * (count + 1)]))
    columns, rows = np.divmod(keys, max(count, 1))
    return BlockPattern(pattern.sizes, rows, columns, pattern.pose_rank)


def _block(graph: FactorGraph, held: Held, wanted: int, option: str) -> int:
    """Number of the block of a variable, -1 if it is held."""
    number, _ = block_numbers(graph, held)
    rows = {name: column.row_of(wanted) for name, column in graph.variables.items()}
    found = [name for name, row in rows.items() if row >= 0]
    if not found:
        ids = ", ".join(f"{n} {c.ids.min()} to {c.ids.max()}" for n, c in graph.variables.items() if len(c))
        raise UsageError(f"{option}: no variable has the id {wanted}", (f"  ids in this graph: {ids}",))
    if len(found) > 1:
        raise UsageError(f"{option}: {len(found)} variables have the id {wanted}: {', '.join(found)}")
    return int(number[found[0]][rows[found[0]]])
