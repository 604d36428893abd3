"""Connectivity of a factor graph: components, degrees, loop closures, parallel and self edges.

Variables are numbered through all kinds here ("nodes"): the columns one after the other, in their order. Switches are
no nodes: a switchable loop closure joins its two poses, whatever its switch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.graph.columns import BoolArray, Factors, IndexArray, Variables
from slamcli.graph.factor_graph import FactorGraph


@dataclass(frozen=True, eq=False)
class Topology:
    """Counts and labels that describe how a graph hangs together.

    Attributes
    ----------
    components
        (n,) component number of each node, 0 for the component of the first node.
    degrees
        (n,) number of factors between two variables at each node.
    loop_closures
        For each column of factors, which of them are loop closures.
    parallel_edges
        Number of edges that repeat the pair of an earlier edge.
    self_edges
        Number of edges from a variable to itself.
    """

    components: IndexArray
    degrees: IndexArray
    loop_closures: list[BoolArray]
    parallel_edges: int
    self_edges: int

    @property
    def component_count(self) -> int:
        """Number of connected components."""
        return int(self.components.max()) + 1 if len(self.components) else 0

    @property
    def loop_closure_count(self) -> int:
        """Number of loop closures."""
        return sum(int(np.count_nonzero(mask)) for mask in self.loop_closures)


def node_columns(graph: FactorGraph) -> dict[str, Variables]:
    """The columns of variables that are nodes: all but switches and intrinsics, which are nowhere."""
    return {name: column for name, column in graph.variables.items() if column.kind.space}


def node_offsets(graph: FactorGraph) -> dict[str, int]:
    """First node number of each kind of variable."""
    offsets, total = {}, 0
    for name, column in node_columns(graph).items():
        offsets[name] = total
        total += len(column)
    return offsets


def node_pairs(graph: FactorGraph) -> IndexArray:
    """Pairs of nodes (e, 2) that a factor joins, in the order of the columns of factors."""
    offsets = node_offsets(graph)
    pairs = []
    for factors in graph.factors:
        slots = [(slot, kind.name) for slot, kind in enumerate(factors.kind.variables) if kind.space]
        if len(slots) == 2:
            pairs.append(np.stack([offsets[name] + factors.indices[:, slot] for slot, name in slots], axis=1))
    return np.concatenate(pairs) if pairs else np.empty((0, 2), dtype=np.intp)


def connected_components(nodes: int, pairs: IndexArray) -> IndexArray:
    """Component number of each node, by hooking to the smallest neighbour and pointer jumping."""
    label = np.arange(nodes)
    a, b = pairs[:, 0], pairs[:, 1]
    while True:
        low = np.minimum(label[a], label[b])
        high = np.maximum(label[a], label[b])
        if np.array_equal(low, high):
            break
        np.minimum.at(label, high, low)
        while True:
            jumped = label[label]
            if np.array_equal(jumped, label):
                break
            label = jumped
    return np.unique(label, return_inverse=True)[1].astype(np.intp)


def component_labels(graph: FactorGraph) -> IndexArray:
    """Component number of each node of a graph."""
    return connected_components(sum(len(column) for column in node_columns(graph).values()), node_pairs(graph))


def prior_dimensions(graph: FactorGraph, label: IndexArray) -> IndexArray:
    """By how many residual dimensions priors tie each component to the world."""
    offsets = node_offsets(graph)
    total = np.zeros(int(label.max(initial=-1)) + 1, dtype=np.intp)
    for factors in graph.factors:
        if len(factors.kind.variables) == 1 and factors.kind.variables[0].space:
            rows = label[offsets[factors.kind.variables[0].name] + factors.indices[:, 0]]
            total += np.bincount(rows, minlength=len(total)) * factors.kind.dimension
    return total


def is_loop_closure(graph: FactorGraph, factors: Factors) -> BoolArray:
    """Which factors are off the odometry chain: relative poses whose ids are not neighbours in the order of ids."""
    if not factors.kind.relative_pose:
        return np.zeros(len(factors), dtype=bool)
    rank = graph.variables[factors.kind.variables[0].name].rank
    return np.abs(rank[factors.indices[:, 0]] - rank[factors.indices[:, 1]]) > 1


def analyze(graph: FactorGraph) -> Topology:
    """Components, degrees, loop closures, parallel and self edges of a graph."""
    nodes = sum(len(column) for column in node_columns(graph).values())
    pairs = node_pairs(graph)
    loops = pairs[:, 0] == pairs[:, 1]
    proper = pairs[~loops]
    keys = proper.min(axis=1) * nodes + proper.max(axis=1) if len(proper) else np.empty(0, dtype=np.intp)
    return Topology(
        components=connected_components(nodes, pairs),
        degrees=np.bincount(proper.ravel(), minlength=nodes),
        loop_closures=[is_loop_closure(graph, factors) for factors in graph.factors],
        parallel_edges=int(np.count_nonzero(np.diff(np.sort(keys)) == 0)),
        self_edges=int(np.count_nonzero(loops)),
    )
