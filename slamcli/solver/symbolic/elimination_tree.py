"""The elimination tree (Liu 1990): the parent of a column is the first row below the diagonal in its column of L.

The loops run over Python lists: a step of a few list accesses is ten times faster there than on numpy's scalars, and
the trees of 10 000 blocks take milliseconds.
"""

from __future__ import annotations

import numpy as np

from slamcli.graph.columns import IndexArray


def elimination_tree(count: int, low: IndexArray, high: IndexArray) -> list[int]:
    """Parent of each column, -1 for roots; ``low < high`` are the eliminated positions of each edge."""
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


def postorder(parent: list[int], weight: list[int] | None = None) -> list[int]:
    """Children before parents, each subtree contiguous.

    The children of a node come in ascending order, or by ascending ``weight`` (n,): with the column counts as weights
    the largest child comes right before its parent, as CHOLMOD arranges it, since the two may become one supernode.
    """
    head, following = [-1] * len(parent), [-1] * len(parent)
    nodes = range(len(parent))
    for node in reversed(nodes if weight is None else sorted(nodes, key=weight.__getitem__)):
        if parent[node] >= 0:
            following[node] = head[parent[node]]
            head[parent[node]] = node
    out: list[int] = []
    for root in nodes:
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


def depths(parent: IndexArray) -> IndexArray:
    """(n,) nodes on the way from each node to its root, itself included; parents come after their children."""
    depth = [1] * len(parent)
    for node, above in zip(range(len(parent) - 1, -1, -1), parent[::-1].tolist(), strict=True):
        if above >= 0:
            depth[node] = depth[above] + 1
    return np.array(depth, dtype=np.intp)
