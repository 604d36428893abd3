"""Symbolic analysis of a Cholesky factorization on the block graph: elimination tree, column counts, nnz(L), flops.

Elimination tree: Liu 1990. Column counts in nearly linear time: Gilbert, Ng, Peyton 1994, with the weight of each row
its number of scalar rows, so that the counts are those of the scalar factor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.graph.columns import IndexArray
from slamcli.solver.pattern import BlockPattern


@dataclass(frozen=True, eq=False)
class SymbolicAnalysis:
    """Structure of the factor of a pattern under an elimination order.

    Attributes
    ----------
    parent
        (n,) elimination tree in the order of elimination, -1 for roots.
    counts
        (n,) scalar rows of L in the first scalar column of each block column, its diagonal block included.
    nnz_factor
        Nonzeros of the scalar factor L.
    flops
        Sum of the squared scalar column counts: CHOLMOD's flop count of the factorization.
    """

    parent: IndexArray
    counts: IndexArray
    nnz_factor: int
    flops: float


@dataclass(frozen=True)
class Sparsity:
    """Sparsity of the linear system.

    Attributes
    ----------
    dimension
        Rows of H.
    nnz_hessian
        Nonzeros of the lower triangle of H, diagonal included (all entries of its dense blocks).
    nnz_factor
        Nonzeros of its Cholesky factor L.
    fill_in
        ``nnz_factor / nnz_hessian``: 1 where elimination creates no new entry.
    factor_flops
        Floating-point operations of the factorization, the sum of the squared column counts of L.
    ordering
        The elimination order.
    density
        Share of the full square matrix H that is not zero.
    """

    dimension: int
    nnz_hessian: int
    nnz_factor: int
    fill_in: float
    factor_flops: float
    ordering: str
    density: float


def analyze(pattern: BlockPattern, order: IndexArray) -> SymbolicAnalysis:
    """Symbolic analysis of a pattern under a block elimination order."""
    count = len(pattern.sizes)
    position = np.empty(count, dtype=np.intp)
    position[order] = np.arange(count)
    sizes = pattern.sizes[order]
    off = pattern.rows != pattern.columns
    a, b = position[pattern.rows[off]], position[pattern.columns[off]]
    low, high = np.minimum(a, b), np.maximum(a, b)
    parent = _elimination_tree(count, low, high)
    counts = np.array(_column_counts(parent, low, high, sizes.tolist()), dtype=np.int64)
    # the scalar columns of a block column have counts c, c - 1, ..., c - size + 1
    below = counts - sizes
    nnz = int((sizes * below + sizes * (sizes + 1) // 2).sum())
    c = counts.astype(np.float64)
    s = sizes.astype(np.float64)
    flops = float((s * c * c - c * s * (s - 1) + (s - 1) * s * (2 * s - 1) / 6).sum())
    return SymbolicAnalysis(np.array(parent, dtype=np.intp), counts, nnz, flops)


def _elimination_tree(count: int, low: IndexArray, high: IndexArray) -> list[int]:
    """Parent of each column; ``low < high`` are the eliminated positions of each edge."""
    parent, ancestor = [-1] * count, [-1] * count
    by_row = np.lexsort((low, high))
    for i, k in zip(low[by_row].tolist(), high[by_row].tolist(), strict=True):
        while i != -1 and i < k:
            following = ancestor[i]
            ancestor[i] = k
            if following == -1:
                parent[i] = k
            i = following
    return parent


def _postorder(parent: list[int]) -> list[int]:
    """Children before parents, each subtree contiguous."""
    head, following = [-1] * len(parent), [-1] * len(parent)
    for node in range(len(parent) - 1, -1, -1):
        if parent[node] >= 0:
            following[node] = head[parent[node]]
            head[parent[node]] = node
    out: list[int] = []
    for root in range(len(parent)):
        if parent[root] >= 0:
            continue
        stack = [root]
        while stack:
            node = stack[-1]
            child = head[node]
            if child < 0:
                out.append(stack.pop())
            else:
                head[node] = following[child]
                stack.append(child)
    return out


def _column_counts(parent: list[int], low: IndexArray, high: IndexArray, weight: list[int]) -> list[int]:
    """Weighted column counts of L by counting the leaves of row subtrees.

    Column j is in the subtree of row i when L_ij is not zero. Each row subtree adds its row's weight at its leaves and
    takes it away at the least common ancestors of consecutive leaves and above its root; summing over each subtree of
    the elimination tree then counts every row once.
    """
    count = len(parent)
    post = _postorder(parent)
    first = [-1] * count  # postorder index of the first descendant
    delta = [0] * count
    for k, j in enumerate(post):
        if first[j] == -1:
            delta[j] = weight[j]  # j is a leaf of the elimination tree
        node = j
        while node != -1 and first[node] == -1:
            first[node] = k
            node = parent[node]
    by_column = np.lexsort((high, low))
    rows = high[by_column].tolist()
    pointer = np.concatenate([[0], np.cumsum(np.bincount(low, minlength=count))]).tolist()
    highest_first, previous_leaf, ancestor = [-1] * count, [-1] * count, list(range(count))
    for j in post:
        if parent[j] != -1:
            delta[parent[j]] -= weight[j]  # the subtree of row j ends at j
        for i in rows[pointer[j] : pointer[j + 1]]:
            if first[j] <= highest_first[i]:
                continue  # j is not a leaf of the subtree of row i
            highest_first[i] = first[j]
            delta[j] += weight[i]
            leaf = previous_leaf[i]
            previous_leaf[i] = j
            if leaf == -1:
                continue
            root = leaf
            while root != ancestor[root]:
                root = ancestor[root]
            while leaf != root:
                ancestor[leaf], leaf = root, ancestor[leaf]
            delta[root] -= weight[i]
        if parent[j] != -1:
            ancestor[j] = parent[j]
    for j in range(count):  # a parent comes after its children in the order of elimination
        if parent[j] != -1:
            delta[parent[j]] += delta[j]
    return delta
