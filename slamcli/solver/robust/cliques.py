"""Sets of closures in which no two contradict each other, as large as can be found.

Given the pairs that contradict each other, a consistent set is a clique of the graph of all other pairs. Small ones are
solved exactly by branch and bound with greedy colours as the bound (E. Tomita, T. Kameda, "An efficient
branch-and-bound algorithm for finding a maximum clique", 2007); of the others, whoever contradicts the most of those
that are left is removed until no contradiction is left (the greedy independent set in the graph of contradictions),
and whoever contradicts nobody kept comes back. Compact, for want of a library: networkx takes minutes where this takes
milliseconds, since true closures form dense graphs of thousands of nodes.
"""

from __future__ import annotations

import numpy as np

from slamcli.graph.columns import BoolArray, IndexArray

#: Up to so many nodes the largest set is found exactly, within this budget of branches.
EXACT = 64
_BRANCHES = 20_000


def consistent_set(count: int, first: IndexArray, second: IndexArray) -> BoolArray:
    """A largest set of nodes 0 ... count - 1 without a contradicting pair (first[k], second[k]).

    Exact for up to ``EXACT`` nodes with contradictions, greedy otherwise; nodes without any are always in.
    """
    torn = np.unique(np.concatenate([first, second])).astype(np.intp)
    keep = np.ones(count, dtype=bool)
    if len(torn) == 0:
        return keep
    a, b = np.searchsorted(torn, first), np.searchsorted(torn, second)
    chosen = greedy(len(torn), a, b)
    if len(torn) <= EXACT:
        exact = largest(len(torn), a, b)
        chosen = exact if exact.sum() > chosen.sum() else chosen
    keep[torn] = chosen
    return keep


def greedy(count: int, first: IndexArray, second: IndexArray) -> BoolArray:
    """A maximal set, by removing the node with the most contradictions; among equals the later one."""
    ends, others = np.concatenate([first, second]), np.concatenate([second, first])
    order = np.argsort(ends, kind="stable")
    others = others[order]
    pointer = np.searchsorted(ends[order], np.arange(count + 1))
    degree = np.bincount(ends, minlength=count).astype(np.intp)
    keep = np.ones(count, dtype=bool)
    removed = []
    while True:
        worst = count - 1 - int(degree[::-1].argmax())
        if degree[worst] <= 0:
            break
        keep[worst] = False
        removed.append(worst)
        neighbours = others[pointer[worst] : pointer[worst + 1]]
        degree[neighbours[keep[neighbours]]] -= 1
        degree[worst] = 0
    for node in reversed(removed):
        if not keep[others[pointer[node] : pointer[node + 1]]].any():
            keep[node] = True
    return keep


def largest(count: int, first: IndexArray, second: IndexArray) -> BoolArray:
    """The largest set, or the largest found within the budget; sets of nodes are the bits of whole numbers."""
    everyone = (1 << count) - 1
    allowed = [everyone & ~(1 << node) for node in range(count)]
    for a, b in zip(first.tolist(), second.tolist(), strict=True):
        allowed[a] &= ~(1 << b)
        allowed[b] &= ~(1 << a)
    best, budget = 0, _BRANCHES
    stack = [(0, everyone)]
    while stack and budget > 0:
        chosen, open_nodes = stack.pop()
        budget -= 1
        if chosen.bit_count() + open_nodes.bit_count() <= best.bit_count():
            continue
        if open_nodes == 0:
            best = max(best, chosen, key=int.bit_count)
            continue
        order, bound = _colours(open_nodes, allowed)
        children = []
        for node, colour in zip(reversed(order), reversed(bound), strict=True):
            if chosen.bit_count() + colour <= best.bit_count():
                break
            children.append((chosen | 1 << node, open_nodes & allowed[node]))
            open_nodes &= ~(1 << node)
        stack.extend(reversed(children))  # the most promising branch first
    return np.array([bool(best >> node & 1) for node in range(count)])


def _colours(nodes: int, allowed: list[int]) -> tuple[list[int], list[int]]:
    """Nodes by colour class, and with each the number of classes so far: no consistent set takes two of a class."""
    order, bound, colour = [], [], 0
    while nodes:
        colour += 1
        left = nodes
        while left:
            node = (left & -left).bit_length() - 1
            left &= ~(1 << node) & ~allowed[node]  # those that contradict it may share its colour
            order.append(node)
            bound.append(colour)
            nodes &= ~(1 << node)
    return order, bound
