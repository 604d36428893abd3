"""Spanning trees from several roots: breadth first, or along the least uncertain paths.

The uncertainty of a path is the sum of its edges' (the trace of their covariances, say), without what a turn does to
everything behind it; so the tree of the least uncertain paths is one of shortest paths (Dijkstra 1959).
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.models.base import Array


@dataclass(frozen=True, eq=False)
class Edges:
    """The edges at each node: those of node n are at ``pointer[n]`` to ``pointer[n + 1]``.

    Attributes
    ----------
    pointer
        (nodes + 1,) positions in the two others.
    neighbours
        The node at the other end.
    numbers
        The number of the edge.
    """

    pointer: list[int]
    neighbours: list[int]
    numbers: list[int]

    @classmethod
    def of(cls, nodes: int, first: IndexArray, second: IndexArray) -> Edges:
        """The edges between ``first`` (m,) and ``second`` (m,)."""
        ends = np.concatenate([first, second])
        by_end = np.argsort(ends, kind="stable")
        pointer = np.concatenate([[0], np.cumsum(np.bincount(ends, minlength=nodes))])
        other = np.concatenate([second, first])[by_end]
        return cls(pointer.tolist(), other.tolist(), (by_end % max(len(first), 1)).tolist())


def breadth_first(edges: Edges, roots: BoolArray, order: list[int]) -> tuple[IndexArray, IndexArray]:
    """Parent of each node (roots: themselves) and the edge to it (roots: -1), breadth first from all roots at once.

    Nodes that no root reaches start trees of their own, in the given order.
    """
    parent, edge = [-1] * len(roots), [-1] * len(roots)
    seeds = iter(order)
    queue = _planted(parent, roots) or _next_seed(parent, seeds)
    while queue:
        for node in queue:  # grows while it is walked: a breadth-first queue
            for k in range(edges.pointer[node], edges.pointer[node + 1]):
                other = edges.neighbours[k]
                if parent[other] < 0:
                    parent[other], edge[other] = node, edges.numbers[k]
                    queue.append(other)
        queue = _next_seed(parent, seeds)
    return np.array(parent, dtype=np.intp), np.array(edge, dtype=np.intp)


def least_uncertain(
    edges: Edges, uncertainty: Array, roots: BoolArray, order: list[int]
) -> tuple[IndexArray, IndexArray]:
    """Parents and edges as from ``breadth_first``, along the paths with the least sum of ``uncertainty`` (m,).

    Among equals the path of fewer edges counts.
    """
    parent, edge = [-1] * len(roots), [-1] * len(roots)
    cost = uncertainty.tolist()
    total: list[tuple[float, float]] = [(np.inf, np.inf)] * len(
        roots
    )  # infinite edges count, too, if there are no others
    seeds = iter(order)
    queue = _planted(parent, roots) or _next_seed(parent, seeds)
    while queue:
        heap = [(0.0, 0, root) for root in queue]
        for root in queue:
            total[root] = (0.0, 0)
        while heap:
            length, depth, node = heapq.heappop(heap)
            if (length, depth) > total[node]:
                continue  # a shorter path has been found since
            for k in range(edges.pointer[node], edges.pointer[node + 1]):
                other, number = edges.neighbours[k], edges.numbers[k]
                longer = (length + cost[number], depth + 1)
                if longer < total[other]:
                    total[other], parent[other], edge[other] = longer, node, number
                    heapq.heappush(heap, (*longer, other))
        queue = _next_seed(parent, seeds)
    return np.array(parent, dtype=np.intp), np.array(edge, dtype=np.intp)


def _planted(parent: list[int], roots: BoolArray) -> list[int]:
    """The roots, marked as their own parents."""
    queue: list[int] = np.flatnonzero(roots).tolist()
    for root in queue:
        parent[root] = root
    return queue


def _next_seed(parent: list[int], seeds: Iterator[int]) -> list[int]:
    """The next node that nothing has reached, as a root; [] where there is none."""
    seed = next((node for node in seeds if parent[node] < 0), None)
    if seed is None:
        return []
    parent[seed] = seed
    return [seed]


def kruskal(nodes: int, first: IndexArray, second: IndexArray) -> list[int]:
    """The edges of a forest that takes them in their order, leaving out those that close a cycle."""
    root = list(range(nodes))
    chosen = []
    for k, (a, b) in enumerate(zip(first.tolist(), second.tolist(), strict=True)):
        while root[a] != a:
            root[a] = a = root[root[a]]
        while root[b] != b:
            root[b] = b = root[root[b]]
        if a != b:
            root[a] = b
            chosen.append(k)
    return chosen
