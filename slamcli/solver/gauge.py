"""Gauge: which variables are held so that the least-squares problem has one solution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.graph import FactorGraph
from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.graph.topology import component_labels, node_offsets, prior_dimensions

#: Which variables of each kind are held.
Held = dict[str, BoolArray]


@dataclass(frozen=True)
class Gauge:
    """Which variables were held and why.

    Attributes
    ----------
    held
        Their ids.
    reason
        In words.
    """

    held: tuple[int, ...]
    reason: str


def choose(graph: FactorGraph) -> tuple[Gauge, Held]:
    """Hold what the file or the user fixes; where a component has neither that nor a prior, its lowest id.

    Poses come before points: a component of points only holds its lowest point.
    """
    offsets = node_offsets(graph)
    label = component_labels(graph)
    with_prior = prior_dimensions(graph, label) > 0
    count = len(with_prior)
    fixed = np.concatenate([column.fixed for column in graph.variables.values()])
    constrained = np.zeros(count, dtype=bool)
    constrained[label[fixed]] = True
    free = ~(constrained | with_prior)
    chosen = _lowest_of_each(graph, label)[free]
    held_nodes = fixed.copy()
    held_nodes[chosen] = True
    held = {name: held_nodes[offsets[name] : offsets[name] + len(column)] for name, column in graph.variables.items()}
    ids = tuple(int(i) for name, column in graph.variables.items() for i in column.ids[held[name]])
    return Gauge(ids, _reason(int(fixed.sum()), len(chosen), int(with_prior[~constrained].sum()), count)), held


def _lowest_of_each(graph: FactorGraph, label: IndexArray) -> IndexArray:
    """The node of the lowest pose id (else point id) of each component."""
    is_point = np.concatenate([np.full(len(c), not c.kind.is_pose) for c in graph.variables.values()])
    rank = np.concatenate([column.rank for column in graph.variables.values()])
    order = np.argsort(is_point * len(rank) + rank, kind="stable")
    return order[np.unique(label[order], return_index=True)[1]]


def _reason(fixed: int, chosen: int, priors: int, components: int) -> str:
    parts = []
    if fixed:
        parts.append(f"{fixed} fixed by the file or by --fix")
    if priors:
        parts.append("priors" if components == 1 else f"priors in {priors} of {components} components")
    if chosen:
        parts.append("lowest id held" if components == 1 else f"lowest id of {chosen} of {components} components held")
    return ", ".join(parts)
