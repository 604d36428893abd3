"""Column counts of L without L, in nearly linear time (Gilbert, Ng, Peyton 1994)."""

from __future__ import annotations

import numpy as np

from slamcli.graph.columns import IndexArray


def column_counts(
    parent: list[int], post: list[int], low: IndexArray, high: IndexArray, weight: list[int]
) -> list[int]:
    """Weighted column counts of L by counting the leaves of row subtrees.

    Column j is in the subtree of row i when L_ij is not zero. Each row subtree adds its row's weight at its leaves and
    takes it away at the least common ancestors of consecutive leaves and above its root; summing over each subtree of
    the elimination tree then counts every row once.

    Parameters
    ----------
    parent, post
        The elimination tree and a postorder of it.
    low, high
        (e,) eliminated positions of each edge, ``low < high``.
    weight
        (n,) of each row: with the number of scalar rows of each block row, the counts are those of the scalar factor.

    Returns
    -------
    list
        For each column, the weights of the rows of L in it, its own included.
    """
    count = len(parent)
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
