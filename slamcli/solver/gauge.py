"""Gauge: which variables are held so that the least-squares problem has one solution.

What cameras see leaves seven freedoms, place, orientation and scale; ``freedoms`` counts those that are left and finds
tangent dimensions of cameras that hold them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from slamcli.graph import FactorGraph
from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.graph.topology import component_labels, node_columns, node_offsets, prior_dimensions
from slamcli.models import INTRINSICS, SWITCH
from slamcli.models.base import Array
from slamcli.solver import bundle, freedoms
from slamcli.solver.freedoms import Frozen

#: Which variables of each kind are held.
Held = dict[str, BoolArray]

_POSE = 6  # tangent dimensions


@dataclass(frozen=True)
class Gauge:
    """Which variables were held and why.

    Attributes
    ----------
    held
        Their ids.
    reason
        In words.
    freedoms
        Directions of similarity of scenes of cameras (place, orientation, scale) along which neither what is held nor
        what is measured says anything. Unknowns minus these is what measurements determine.
    frozen
        Tangent dimensions (n, d) by kind that do not move besides, so that fewer or none of the freedoms are free.
    dimensions
        The same by id: names of the tangent dimensions.
    """

    held: tuple[int, ...]
    reason: str
    freedoms: int = 0
    frozen: Frozen = field(default_factory=dict)
    dimensions: dict[int, tuple[str, ...]] = field(default_factory=dict)

    def degrees_of_freedom(self, graph: FactorGraph, held: Held) -> int:
        """Residual dimensions minus those of the unknowns that these could determine."""
        return graph.degrees_of_freedom(held) + self.freedoms


def choose(graph: FactorGraph, mode: str = "auto") -> tuple[Gauge, Held]:
    """Hold what the file or the user fixes; where a component has neither that nor a prior, its lowest id.

    Poses come before points: a component of points only holds its lowest point. Switches are held only where they are
    fixed, and neither they nor their priors hold anything else. Components with cameras that have free intrinsics are
    left free, since to hold one of those would hold its intrinsics as well: place, orientation and scale of the whole
    (7 freedoms) are then for damped steps to leave alone (see ``bundle``).

    Parameters
    ----------
    graph
        The graph.
    mode
        Of components with cameras: ``auto`` as above, ``free`` holds nothing, ``first`` the pose of the camera of the
        lowest id (not its intrinsics) and the scale by one coordinate of another, as far as they are not determined.

    Raises
    ------
    UsageError
        If there are no cameras to choose a mode for.
    """
    bundle.require_cameras(graph, "gauge", mode)
    columns, offsets = node_columns(graph), node_offsets(graph)
    label = component_labels(graph)
    with_prior = prior_dimensions(graph, label) > 0
    count = len(with_prior)
    fixed = np.concatenate([np.empty(0, dtype=bool), *(column.fixed for column in columns.values())])
    constrained = np.zeros(count, dtype=bool)
    constrained[label[fixed]] = True
    free = ~(constrained | with_prior)
    scenes = bundle.scenes(graph, label, count)
    free &= ~(bundle.floating(columns, label, count) if mode == "auto" else scenes)
    chosen = _lowest_of_each(graph, label)[free]
    held_nodes = fixed.copy()
    held_nodes[chosen] = True
    held = {
        name: held_nodes[offsets[name] : offsets[name] + len(column)] if name in columns else column.fixed
        for name, column in graph.variables.items()
    }
    ids = tuple(int(i) for name, column in graph.variables.items() for i in column.ids[held[name]])
    nodes_fixed = int(fixed.sum()) + sum(int(c.fixed.sum()) for c in graph.variables.values() if c.kind is SWITCH)
    found = [_of_scene(graph, label, int(k), held, mode) for k in np.flatnonzero(scenes)]
    parts = _similarity_words([left for left, _, _ in found], [words for _, words, _ in found if words], count)
    if any(c.fixed.any() for c in graph.variables.values() if c.kind in INTRINSICS):
        parts.append("intrinsics held")
    parts.append(_reason(nodes_fixed, len(chosen), int(with_prior[~constrained].sum()), count))  # ids follow it
    places = [place for _, _, some in found for place in some]
    total = sum(left for left, _, _ in found) + len(places)
    reason = ", ".join(filter(None, parts))
    return Gauge(ids, reason, total, _masks(graph, places), _names(graph, places)), held


def _of_scene(
    graph: FactorGraph, label: IndexArray, component: int, held: Held, mode: str
) -> tuple[int, str, list[freedoms.Place]]:
    """Freedoms that a component with cameras has left, what holds the others in words, and those dimensions."""
    scene = freedoms.scene(graph, label, component)
    basis: Array = freedoms.remaining(graph, scene, held)
    left = basis.shape[1]
    if mode != "first" or left == 0:
        return left, "", []
    places = freedoms.freeze(graph, scene, basis, held)
    return left - len(places), _frozen_words(graph, places), places


def _frozen_words(graph: FactorGraph, places: list[freedoms.Place]) -> str:
    """Which dimensions of which cameras."""
    words = [
        f"{'pose' if len(names) == _POSE else ' '.join(names)} of {identifier}"
        for identifier, names in _names(graph, places).items()
    ]
    return " and ".join(words) + " held" if words else ""


def _names(graph: FactorGraph, places: list[freedoms.Place]) -> dict[int, tuple[str, ...]]:
    """Names of the dimensions of each variable, by its id."""
    out: dict[int, tuple[str, ...]] = {}
    for name, row, dimension in sorted(places, key=lambda place: (place[0], place[2])):
        column = graph.variables[name]
        identifier = int(column.ids[row])
        out[identifier] = (*out.get(identifier, ()), column.kind.components[dimension])
    first = dict.fromkeys(int(graph.variables[name].ids[row]) for name, row, _ in places)
    return {identifier: out[identifier] for identifier in first}


def _similarity_words(left: list[int], frozen: list[str], components: int) -> list[str]:
    """What of place, orientation and scale is held, and what is free."""
    out = frozen[:1]
    if len(frozen) > 1:
        out = [f"{frozen[0]}, likewise in {len(frozen) - 1} more components"]
    for count in sorted({k for k in left if k}, reverse=True):
        several = left.count(count)
        where = "" if components == 1 else f" of {several} of {components} components"
        words = {7: "place, orientation and scale", 1: "scale"}.get(count, f"{count} of 7 freedoms of a similarity")
        out.append(f"{words}{where} left free")
    return out


def _masks(graph: FactorGraph, places: list[freedoms.Place]) -> Frozen:
    out: Frozen = {}
    for name, row, dimension in places:
        column = graph.variables[name]
        out.setdefault(name, np.zeros((len(column), column.kind.dimension), dtype=bool))[row, dimension] = True
    return out


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
