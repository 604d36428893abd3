"""Gauge: which variables are held so that the least-squares problem has one solution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.graph import FactorGraph
from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.graph.topology import component_labels, node_columns, node_offsets, prior_dimensions
from slamcli.solver import bundle

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

    Poses come before points: a component of points only holds its lowest point. Switches are held only where they are
    fixed, and neither they nor their priors hold anything else. Components with cameras that have free intrinsics are
    left free, since to hold one of those would hold its intrinsics as well: place, orientation and scale of the whole
    (7 freedoms) are then for damped steps to leave alone (see ``bundle``).
    """
    columns, offsets = node_columns(graph), node_offsets(graph)
    label = component_labels(graph)
    with_prior = prior_dimensions(graph, label) > 0
    count = len(with_prior)
    fixed = np.concatenate([np.empty(0, dtype=bool), *(column.fixed for column in columns.values())])
    constrained = np.zeros(count, dtype=bool)
    constrained[label[fixed]] = True
    free = ~(constrained | with_prior)
    floating = free & bundle.floating(columns, label, count)
    free &= ~floating
    chosen = _lowest_of_each(graph, label)[free]
    held_nodes = fixed.copy()
    held_nodes[chosen] = True
    held = {
        name: held_nodes[offsets[name] : offsets[name] + len(column)] if name in columns else column.fixed
        for name, column in graph.variables.items()
    }
    ids = tuple(int(i) for name, column in graph.variables.items() for i in column.ids[held[name]])
    total = sum(int(column.fixed.sum()) for column in graph.variables.values())
    reason = _reason(total, len(chosen), int(with_prior[~constrained].sum()), count)
    if floating.any():
        where = "" if count == 1 else f" of {int(floating.sum())} of {count} components"
        free_of = f"place, orientation and scale{where} left free"
        reason = f"{reason}, {free_of}" if reason else free_of
    return Gauge(ids, reason), held


def _lowest_of_each(graph: FactorGraph, label: IndexArray) -> IndexArray:
    """The node of the lowest pose id (else point id) of each component."""
    columns = node_columns(graph).values()
    is_point = np.concatenate([np.empty(0, dtype=bool), *(np.full(len(c), c.kind.is_point) for c in columns)])
    rank = np.concatenate([np.empty(0, dtype=np.intp), *(column.rank for column in columns)])
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
