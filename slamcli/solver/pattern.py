"""The block pattern of the Hessian and its expansion to a compressed-column matrix: built once, filled many times.

Only blocks on and above the diagonal are stored, each as a dense block; the blocks of a column are stacked, so that
all scalar columns of a block column have the same rows. Diagonal blocks are stored in full, although the
factorizations read only their upper triangles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from slamcli.graph import FactorGraph
from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.models.base import Array
from slamcli.solver.gauge import Held


@dataclass(frozen=True, eq=False)
class BlockPattern:
    """Upper block pattern of a symmetric matrix.

    Attributes
    ----------
    sizes
        (n,) rows of each block variable.
    rows, columns
        (e,) block coordinates of the stored blocks, ``rows <= columns``, sorted by column, then row.
    pose_rank
        (n,) place of each pose when all variables are sorted by id, -1 for what is no pose; None where that is not
        known. Only orders with constraints ask for it.
    """

    sizes: IndexArray
    rows: IndexArray
    columns: IndexArray
    pose_rank: IndexArray | None = None

    @cached_property
    def offsets(self) -> IndexArray:
        """(n + 1,) first scalar row of each block variable, and the dimension."""
        return np.concatenate([[0], np.cumsum(self.sizes)])

    @property
    def dimension(self) -> int:
        """Scalar rows."""
        return int(self.offsets[-1])

    @cached_property
    def heights(self) -> IndexArray:
        """(n,) stored scalar rows of each block column."""
        return np.bincount(self.columns, self.sizes[self.rows], minlength=len(self.sizes)).astype(np.intp)

    @cached_property
    def base(self) -> IndexArray:
        """(e,) position of the first entry of each block in the array of values."""
        column_start = np.concatenate([[0], np.cumsum(self.heights * self.sizes)])
        stacked = np.concatenate([[0], np.cumsum(self.sizes[self.rows])])
        first = np.concatenate([[0], np.cumsum(np.bincount(self.columns, minlength=len(self.sizes)))])
        return column_start[self.columns] + stacked[:-1] - stacked[first[self.columns]]

    @cached_property
    def diagonal_base(self) -> IndexArray:
        """(n,) position of the first entry of each diagonal block in the array of values."""
        return self.base[self.rows == self.columns]

    @cached_property
    def stored(self) -> int:
        """Number of stored values."""
        return int((self.heights * self.sizes).sum())

    @property
    def nnz(self) -> int:
        """Nonzeros of the upper triangle, diagonal included."""
        return self.stored - int((self.sizes * (self.sizes - 1) // 2).sum())

    @cached_property
    def scalar_columns(self) -> IndexArray:
        """(stored,) scalar column of each stored value."""
        return np.repeat(np.arange(self.dimension), np.repeat(self.heights, self.sizes))

    @cached_property
    def scalar_rows(self) -> IndexArray:
        """(stored,) scalar row of each stored value."""
        sizes = self.sizes[self.rows]
        within = np.arange(int(sizes.sum())) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        one_column = (
            np.repeat(self.offsets[self.rows], sizes) + within
        )  # rows of one scalar column of each block column
        start = np.concatenate([[0], np.cumsum(self.heights)])[:-1]
        return one_column[_repeated_ranges(start, self.heights, self.sizes)]

    @cached_property
    def diagonal(self) -> IndexArray:
        """(dimension,) positions of the diagonal entries in the array of values."""
        blocks = np.flatnonzero(self.rows == self.columns)
        sizes, heights = self.sizes[self.columns[blocks]], self.heights[self.columns[blocks]]
        within = np.arange(self.dimension) - np.repeat(self.offsets[:-1], sizes)
        return np.repeat(self.base[blocks], sizes) + within * (np.repeat(heights, sizes) + 1)

    @cached_property
    def weight(self) -> Array:
        """(stored,) how often each stored value counts in the full symmetric matrix: 2 off the diagonal blocks."""
        on_diagonal = np.repeat(self.rows == self.columns, self.sizes[self.rows])
        start = np.concatenate([[0], np.cumsum(self.heights)])[:-1]
        return np.where(on_diagonal[_repeated_ranges(start, self.heights, self.sizes)], 1.0, 2.0)

    def quadratic_form(self, values: Array, x: Array) -> float:
        """x^T H x for the matrix of these stored values."""
        return float((self.weight * values * x[self.scalar_rows] * x[self.scalar_columns]).sum())


def _repeated_ranges(start: IndexArray, length: IndexArray, times: IndexArray) -> IndexArray:
    """The ranges ``start[k] : start[k] + length[k]``, each repeated ``times[k]`` times, one after the other."""
    start, length = np.repeat(start, times), np.repeat(length, times)
    ends = np.cumsum(length)
    return np.arange(int(ends[-1]) if len(ends) else 0) + np.repeat(start - ends + length, length)


#: For a column of factors and each of its slots: where the entries of the slot's products go.
EntryTargets = list[IndexArray]


@dataclass(frozen=True, eq=False)
class BlockTargets:
    """Where the blocks of factors with two slots go, block by block.

    Attributes
    ----------
    blocks
        For each slot the number (m,) of its block variable, -1 where it is held.
    entries
        For each slot, and for both together, which stored block (m,) takes the product; -1 for none.
    flipped
        (m,) whether the block of both is stored transposed.
    """

    blocks: list[IndexArray]
    entries: tuple[IndexArray, IndexArray, IndexArray]
    flipped: BoolArray


#: For each column of factors: where its products go.
Targets = list[EntryTargets | BlockTargets]


def build(graph: FactorGraph, held: Held, blockwise: Sequence[bool] = ()) -> tuple[BlockPattern, Targets]:
    """Block pattern of the Hessian of a graph, and where each factor's contributions go.

    Block variables are the free variables, kind by kind in the order of the graph's columns.

    Parameters
    ----------
    graph
        The graph.
    held
        Which variables do not move.
    blockwise
        For each column of factors, whether its targets are wanted as ``BlockTargets``; none are by default.

    Returns
    -------
    pattern
        Of H.
    targets
        For each column of factors ``BlockTargets``, or for each slot s, (m, d_s, w) positions of the entries of
        ``J_s^T Omega [J_s ... J_last, e]``: the blocks of H of this slot and all later ones, and the gradient.
        Positions below ``pattern.stored`` are stored values of H, the next ``pattern.dimension`` are the gradient,
        and one more takes what belongs to held variables.
    """
    number, sizes = block_numbers(graph, held)
    count = len(sizes)
    keys = []
    for factors in graph.factors:
        blocks = [number[kind.name][factors.indices[:, s]] for s, kind in enumerate(factors.kind.variables)]
        keys += [np.where(use, high * count + low, -1) for s, t, low, high, use in _slot_pairs(blocks) if s != t]
    keys.append(np.arange(count) * (count + 1))  # every free variable has a diagonal block
    unique, inverse = np.unique(np.concatenate(keys), return_inverse=True)
    skipped = int(len(unique) > 0 and unique[0] < 0)
    columns, rows = np.divmod(unique[skipped:], max(count, 1))
    pattern = BlockPattern(sizes, rows, columns, _pose_rank(graph, held))
    *crossing, diagonal = np.split(inverse - skipped, np.cumsum([len(k) for k in keys])[:-1])
    diagonal = np.append(diagonal, -1)  # of what is held, whose number is -1
    entries = iter(crossing)
    targets: Targets = []
    for column, factors in enumerate(graph.factors):
        kinds = factors.kind.variables
        blocks = [number[kind.name][factors.indices[:, s]] for s, kind in enumerate(kinds)]
        if blockwise and blockwise[column]:
            used = [
                np.where(use, diagonal[blocks[s]] if s == t else next(entries), -1)
                for s, t, _, _, use in _slot_pairs(blocks)
            ]
            targets.append(BlockTargets(blocks, (used[0], used[2], used[1]), blocks[0] > blocks[1]))
            continue
        widths = [kind.dimension for kind in kinds]
        slots = [np.empty((len(factors), d, sum(widths[s:]) + 1), dtype=np.intp) for s, d in enumerate(widths)]
        for s, t, _, high, use in _slot_pairs(blocks):
            start = sum(widths[s:t])
            part = slots[s][:, :, start : start + widths[t]]
            entry = diagonal[high] if s == t else next(entries)
            _block_targets(part, pattern, entry, high, blocks[s] > blocks[t], use)
        for s, own in enumerate(blocks):
            _gradient_targets(slots[s][:, :, -1], pattern, own)
        targets.append(slots)
    return pattern, targets


def _block_targets(
    out: IndexArray, pattern: BlockPattern, entry: IndexArray, high: IndexArray, flipped: BoolArray, use: BoolArray
) -> None:
    """Write positions (m, d_s, d_t) of the entries of the slots' blocks: as they stand, or transposed where flipped."""
    first, height = pattern.base[entry], pattern.heights[high]
    down, right = np.where(flipped, height, 1), np.where(flipped, 1, height)
    for a in range(out.shape[1]):
        for b in range(out.shape[2]):
            out[:, a, b] = first + a * down + b * right
    if not use.all():
        out[~use] = pattern.stored + pattern.dimension


def _gradient_targets(out: IndexArray, pattern: BlockPattern, blocks: IndexArray) -> None:
    """Write positions (m, d_s) of the gradient's entries."""
    for a in range(out.shape[1]):
        out[:, a] = pattern.stored + pattern.offsets[blocks] + a
    out[blocks < 0] = pattern.stored + pattern.dimension


def block_numbers(graph: FactorGraph, held: Held) -> tuple[dict[str, IndexArray], IndexArray]:
    """Number of each variable's block (-1 if held), by kind, and the sizes of all blocks."""
    number, sizes, total = {}, [], 0
    for name, column in graph.variables.items():
        free = ~held[name]
        blocks = np.full(len(column), -1, dtype=np.intp)
        blocks[free] = total + np.arange(np.count_nonzero(free))
        total += int(np.count_nonzero(free))
        number[name] = blocks
        sizes.append(np.full(np.count_nonzero(free), column.kind.dimension, dtype=np.intp))
    return number, np.concatenate(sizes)


def _pose_rank(graph: FactorGraph, held: Held) -> IndexArray:
    """Place of each free pose among the poses by id, -1 for other free variables, in the order of the blocks."""
    columns = list(graph.variables.items())
    order = np.argsort(np.concatenate([column.ids for _, column in columns]), kind="stable")
    rank = np.empty(len(order), dtype=np.intp)
    rank[order] = np.arange(len(order))
    is_pose = np.concatenate([np.full(len(column), column.kind.is_pose) for _, column in columns])
    return np.where(is_pose, rank, -1)[np.concatenate([~held[name] for name, _ in columns])]


def _slot_pairs(blocks: list[IndexArray]) -> list[tuple[int, int, IndexArray, IndexArray, BoolArray]]:
    """For each pair of slots s <= t: lower and higher block, and which factors contribute.

    A factor that joins a variable with itself does not depend on it, for relative measurements; these two slots
    contribute nothing.
    """
    proper = []
    for s, own in enumerate(blocks):
        use = own >= 0
        for t, other in enumerate(blocks):
            if t != s:
                use = use & (own != other)
        proper.append(use)
    pairs = []
    for s in range(len(blocks)):
        for t in range(s, len(blocks)):
            low, high = np.minimum(blocks[s], blocks[t]), np.maximum(blocks[s], blocks[t])
            pairs.append((s, t, low, high, proper[s] & proper[t]))
    return pairs
