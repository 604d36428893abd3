"""Landmarks that their sightings do not determine: found, named, and held back from the optimization.

A single bearing leaves a landmark anywhere on its ray; with it in the problem, H is singular, or the landmark runs off
to infinity. Such landmarks say next to nothing about the poses. They and their edges are left out of the problem, and
the result has them as they were. Which ones these are is decided at the poses of the start (see
``initialization.landmarks.observability``) and looked at once more at the poses of the result: what these determine is
taken in, and where the run failed, what these do not determine any more is left out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slamcli.graph import FactorGraph, Factors, Variables
from slamcli.graph.columns import BoolArray, IndexArray, Values, finite_rows
from slamcli.models import BEARING_2D, RANGE_2D, XY, XYZ, FactorKind, Projection
from slamcli.models.base import Array
from slamcli.solver.initialization.landmarks import observability
from slamcli.solver.initialization.landmarks.place import best, own_values
from slamcli.solver.initialization.landmarks.sightings import Sightings
from slamcli.solver.robust.rejection import Rejection

#: Which landmarks of each kind.
Landmarks = dict[str, BoolArray]


@dataclass(frozen=True)
class UnderObserved:
    """A landmark that is held back.

    Attributes
    ----------
    id
        Of the landmark.
    kind
        ``XY`` or ``XYZ``.
    edges
        Number of its edges, which are left out with it.
    reason
        In words, what is all that there is of it.
    has_value
        Whether the graph has a value for it, which it keeps.
    """

    id: int
    kind: str
    edges: int
    reason: str
    has_value: bool


@dataclass(frozen=True, eq=False)
class HeldBack:
    """What was left out of a graph.

    Attributes
    ----------
    graph
        The whole graph.
    rows
        Rows of the variables that are kept, by kind.
    factors
        For each column of factors the rows that are kept.
    """

    graph: FactorGraph
    rows: dict[str, IndexArray]
    factors: list[IndexArray]

    @classmethod
    def of(cls, graph: FactorGraph, landmarks: Landmarks) -> HeldBack:
        """Leave out landmarks with their edges."""
        rows = {
            name: np.flatnonzero(~landmarks[name]) if name in landmarks else np.arange(len(column))
            for name, column in graph.variables.items()
        }
        factors = []
        for column in graph.factors:
            keep = np.ones(len(column), dtype=bool)
            for slot, kind in enumerate(column.kind.variables):
                if kind.name in landmarks:
                    keep &= ~landmarks[kind.name][column.indices[:, slot]]
            factors.append(np.flatnonzero(keep))
        return cls(graph, rows, factors)

    @property
    def edges(self) -> int:
        """Number of edges that are left out."""
        columns = zip(self.graph.factors, self.factors, strict=True)
        return sum(len(column) - len(rows) for column, rows in columns)

    def without(self, graph: FactorGraph) -> FactorGraph:
        """Another graph of the same variables without what is left out."""
        lost = {}
        for name, rows in self.rows.items():
            mask = np.ones(len(graph.variables[name]), dtype=bool)
            mask[rows] = False
            lost[name] = mask
        return HeldBack.of(graph, lost).reduced()

    def reduced(self) -> FactorGraph:
        """The graph without them; columns of factors of which nothing is left are not there either."""
        position, variables = {}, {}
        for name, column in self.graph.variables.items():
            rows = self.rows[name]
            position[name] = np.zeros(len(column), dtype=np.intp)
            position[name][rows] = np.arange(len(rows))
            if len(rows):
                variables[name] = column if len(rows) == len(column) else _selected(column, rows)
        factors = []
        for edges, rows in zip(self.graph.factors, self.factors, strict=True):
            if len(rows) == 0:
                continue
            part = edges if len(rows) == len(edges) else edges.part(rows)
            indices = [position[k.name][part.indices[:, slot]] for slot, k in enumerate(part.kind.variables)]
            factors.append(replace(part, indices=np.stack(indices, axis=1)))
        return replace(self.graph, variables=variables, factors=factors)

    def restored(self, reduced: FactorGraph) -> FactorGraph:
        """The whole graph with the values of a reduced one; what is left out is as it was."""
        columns = {}
        for name, column in self.graph.variables.items():
            values, known = column.values.copy(), column.known.copy()
            if len(self.rows[name]):
                values[self.rows[name]] = reduced.variables[name].values
                known[self.rows[name]] = reduced.variables[name].known
            columns[name] = replace(column, values=values, known=known)
        return replace(self.graph, variables=columns)

    def expanded(self, rejection: Rejection) -> Rejection:
        """What was decided about the edges of the reduced graph, for those of the whole one: the others are kept."""
        rejected, weight, chi2, found = [], [], [], 0
        for column, rows in zip(self.graph.factors, self.factors, strict=True):
            rejected.append(np.zeros(len(column), dtype=bool))
            weight.append(np.ones(len(column)))
            chi2.append(np.zeros(len(column)))
            if len(rows):
                rejected[-1][rows] = rejection.rejected[found]
                weight[-1][rows] = rejection.weight[found]
                chi2[-1][rows] = rejection.chi2[found]
                found += 1
        return replace(rejection, rejected=rejected, weight=weight, chi2=chi2)


def _selected(column: Variables, rows: IndexArray) -> Variables:
    return replace(
        column,
        ids=column.ids[rows],
        values=column.values[rows],
        fixed=column.fixed[rows],
        known=column.known[rows],
        lines=column.lines[rows],
    )


def suspects(graph: FactorGraph) -> Landmarks:
    """Landmarks that may be under-observed: not fixed, seen by no camera, and not determined whatever the poses are.

    Empty for most graphs. What joins landmarks with a value to each other only is left to the gauge.
    """
    out = {}
    for kind in (XY, XYZ):
        if kind.name not in graph.variables:
            continue
        column = graph.variables[kind.name]
        wanted = ~column.fixed
        for factors in graph.factors:
            if isinstance(factors.kind, Projection) and kind in factors.kind.variables:
                wanted[factors.indices[:, factors.kind.variables.index(kind)]] = False
        if wanted.any():
            sightings, group = _all_sightings(graph, kind.name, graph.values, wanted), observability.joined(graph, kind)
            wanted &= ~observability.linearly(sightings, group) & _each(np.logical_and, wanted, group)
            tied = [part.rows for part in sightings.parts if part.kind not in observability.DIFFERENCES]
            alone = np.ones(len(column), dtype=bool)
            alone[np.concatenate([np.empty(0, dtype=np.intp), *tied])] = False
            several = np.bincount(group, minlength=len(column))[group] > 1
            wanted &= ~(several & _each(np.logical_and, alone, group) & _each(np.logical_or, column.known, group))
        if wanted.any():
            out[kind.name] = wanted
    return out


def _each(combined: np.ufunc, mask: BoolArray, group: IndexArray) -> BoolArray:
    """A mask (n,) combined over each landmark's group."""
    out = np.full(len(mask), bool(combined.identity))
    combined.at(out, group, mask)
    return np.asarray(out[group])


def among(graph: FactorGraph, wanted: Landmarks, values: Values) -> Landmarks:
    """Those of some landmarks that their sightings from the poses of ``values`` do not determine.

    Differences count where the other landmark is determined.
    """
    out, values = {}, dict(values)
    for name, mask in wanted.items():
        lost, near, kind = mask.copy(), own_values(graph, name), graph.variables[name].kind
        while lost.any():
            placed = {other: np.ones(len(column), dtype=bool) for other, column in graph.variables.items()}
            sightings = Sightings.of_graph(graph, kind, values, {**placed, name: ~lost}, lost)
            found, _ = best(sightings, near)
            good = lost & finite_rows(found)
            good &= observability.determined(sightings, np.where(good[:, None], found, 0.0))
            values[name] = np.where(good[:, None], found, values[name])
            lost &= ~good
            if not good.any() or not observability.differences(graph, kind):
                break
        if lost.any():
            out[name] = lost
    return out


def at_values(graph: FactorGraph) -> Landmarks:
    """Landmarks that are under-observed with everything else at the graph's values."""
    wanted = suspects(graph)
    return among(graph, wanted, graph.values) if wanted else {}


def places(graph: FactorGraph, name: str, wanted: BoolArray) -> Array:
    """Best places (n, d) of some landmarks of a kind, everything else as it is; NaN for the others."""
    sightings = _all_sightings(graph, name, graph.values, wanted)
    return best(sightings, own_values(graph, name))[0]


def described(graph: FactorGraph, landmarks: Landmarks) -> tuple[UnderObserved, ...]:
    """Landmarks with what there is of them, by id."""
    out = []
    for name, mask in landmarks.items():
        column = graph.variables[name]
        counts = [
            (factors, np.bincount(factors.indices[:, slot], minlength=len(column)))
            for factors, slot in _ends(graph, name)
        ]
        weight = np.zeros(len(column))
        for factors, slot in _ends(graph, name):
            weight += np.bincount(factors.indices[:, slot], np.abs(factors.information).sum(axis=(1, 2)), len(column))
        for row in np.flatnonzero(mask).tolist():
            seen = {factors.kind: int(count[row]) for factors, count in counts if count[row]}
            total = sum(int(count[row]) for _, count in counts)
            reason = _reason(set(seen), total, weight[row] > 0.0)
            out.append(UnderObserved(int(column.ids[row]), name, total, reason, bool(column.known[row])))
    return tuple(sorted(out, key=lambda landmark: landmark.id))


def _ends(graph: FactorGraph, name: str) -> list[tuple[Factors, int]]:
    """Columns of factors with the slots in which they have variables of a kind."""
    return [(f, slot) for f in graph.factors for slot, kind in enumerate(f.kind.variables) if kind.name == name]


def _reason(kinds: set[FactorKind], total: int, weighs: bool) -> str:
    """What is all that there is of a landmark."""
    if total == 0:
        return "no edge"
    if not weighs:
        return f"{total} edge{'s' if total > 1 else ''} without information"
    if kinds == {BEARING_2D}:
        return "a single bearing" if total == 1 else f"{total} bearings that do not cross"
    if kinds == {RANGE_2D}:
        return "a single range" if total == 1 else f"{total} ranges from one direction"
    return "a single edge" if total == 1 else f"{total} edges that leave a direction open"


def _all_sightings(graph: FactorGraph, name: str, values: Values, wanted: BoolArray) -> Sightings:
    placed = {other: np.ones(len(column), dtype=bool) for other, column in graph.variables.items()}
    return Sightings.of_graph(graph, graph.variables[name].kind, values, placed, wanted)
