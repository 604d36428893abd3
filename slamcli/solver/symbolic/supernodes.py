"""Supernodes: runs of columns of L with one row structure, which a factorization treats as one dense front.

Fundamental supernodes hold no entry that L has not: a column joins the one before it if that is its only child and has
its rows and one more. Relaxed ones are what CHOLMOD's supernodal code works with (Chen, Davis, Hager, Rajamanickam
2008, its default parameters): a child is merged into the parent that follows it if that brings few explicit zeros.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from slamcli.graph.columns import IndexArray
from slamcli.solver.symbolic.analysis import SymbolicAnalysis
from slamcli.solver.symbolic.elimination_tree import depths, postorder

#: CHOLMOD's nrelax and zrelax: up to 4 scalar columns are always merged, up to 16 with less than 80 % of zeros, up to
#: 48 with less than 10 %, any number with less than 5 %.
_ALWAYS, _RELAXATION = 4, ((16, 0.8), (48, 0.1), (np.inf, 0.05))


@dataclass(frozen=True, eq=False)
class Supernodes:
    """A partition of the columns of L into supernodes.

    Positions are those of ``order``, a postorder of the elimination tree: it makes supernodes contiguous and creates
    the same L as the order it was made from, up to the numbering.

    Attributes
    ----------
    order
        (n,) block elimination order.
    first
        (s + 1,) position of the first block column of each supernode, and n.
    columns
        (s,) scalar columns of each.
    front
        (s,) scalar rows of each front: its columns and the rows below them.
    parent
        (s,) assembly tree, -1 for roots: the supernode of the first row below the columns.
    """

    order: IndexArray
    first: IndexArray
    columns: IndexArray
    front: IndexArray
    parent: IndexArray

    def __len__(self) -> int:
        return len(self.columns)

    @cached_property
    def stored(self) -> int:
        """Entries of the lower trapezoids of all fronts: nnz(L) and the explicit zeros."""
        return int((self.columns * self.front - self.columns * (self.columns - 1) // 2).sum())

    @cached_property
    def largest_front(self) -> int:
        """Scalar rows of the largest front."""
        return int(self.front.max(initial=0))

    @cached_property
    def height(self) -> int:
        """Height of the assembly tree: supernodes on the longest way from a leaf to a root."""
        return int(depths(self.parent).max(initial=0))

    @cached_property
    def of_column(self) -> IndexArray:
        """(n,) supernode of each block column."""
        return np.repeat(np.arange(len(self)), np.diff(self.first))


def supernodes(analysis: SymbolicAnalysis, *, relaxed: bool = True) -> Supernodes:
    """Supernodes of a factor.

    Parameters
    ----------
    analysis
        Of a pattern under an elimination order.
    relaxed
        Merge as CHOLMOD does; False gives the fundamental supernodes.
    """
    below = analysis.counts - analysis.sizes
    post = np.array(postorder(analysis.parent.tolist(), below.tolist()), dtype=np.intp)
    count = len(post)
    position = np.empty(count, dtype=np.intp)
    position[post] = np.arange(count)
    above = analysis.parent[post]
    parent = np.where(above >= 0, position[above], -1)
    sizes, counts, below = analysis.sizes[post], analysis.counts[post], below[post]
    children = np.bincount(parent[parent >= 0], minlength=count)
    starts = np.ones(count, dtype=bool)
    starts[1:] = (parent[:-1] != np.arange(1, count)) | (below[:-1] != counts[1:]) | (children[1:] > 1)
    first = np.flatnonzero(starts)
    columns = np.add.reduceat(sizes, first) if count else sizes
    front = counts[first]
    above = parent[np.append(first[1:], count)[: len(first)] - 1]
    above = np.where(above >= 0, (np.cumsum(starts) - 1)[above], -1)
    if relaxed:
        first, columns, front, above = _relaxed(first, columns, front, above)
    return Supernodes(analysis.order[post], np.append(first, count), columns, front, above)


def _relaxed(
    first: IndexArray, columns: IndexArray, front: IndexArray, parent: IndexArray
) -> tuple[IndexArray, IndexArray, IndexArray, IndexArray]:
    """First block columns, scalar columns, fronts and parents after merging, from the last supernode to the first."""
    width, height = columns.tolist(), front.tolist()
    zeros = [0] * len(width)
    into = list(range(len(width)))  # what each was merged into
    above = parent.tolist()
    for s in range(len(width) - 2, -1, -1):
        root = above[s]
        if root < 0:
            continue
        while into[root] != root:
            root = into[root]
        if root != s + 1:
            continue  # another child of the parent follows
        merged = width[s] + width[s + 1]
        total = zeros[s + 1]
        if merged > _ALWAYS:
            new = width[s] * (height[s + 1] + width[s] - height[s])
            if new > 0:
                total += new
                size = merged * (merged + 1) / 2 + merged * (height[s + 1] - width[s + 1])
                if not any(merged <= most and total / size < share for most, share in _RELAXATION):
                    continue
        zeros[s] = total
        height[s] = width[s] + height[s + 1]
        width[s] = merged
        into[s + 1] = s
    kept = [s for s, target in enumerate(into) if s == target]
    number = np.cumsum([s == target for s, target in enumerate(into)], dtype=np.intp) - 1
    # a merged supernode lies before the ones it took in, so that its last member has its parent
    last = np.append(np.array(kept[1:], dtype=np.intp), len(width))[: len(kept)] - 1
    outer = parent[last]
    outer = np.where(outer >= 0, number[outer], -1)
    chosen = np.array(kept, dtype=np.intp)
    return first[chosen], np.array(width, dtype=np.intp)[chosen], np.array(height, dtype=np.intp)[chosen], outer
