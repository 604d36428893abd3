"""Landmarks that could be elsewhere: the minima of chi2 over their sightings, the poses being as they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.graph.columns import BoolArray, Values
from slamcli.solver import under_observed
from slamcli.solver.initialization.landmarks import observability
from slamcli.solver.initialization.landmarks.place import minima
from slamcli.solver.initialization.landmarks.sightings import Sightings
from slamcli.solver.result import Result

#: The other place of a landmark is as good where its chi2 is larger by less than this many squared standard deviations
#: of the noise (the stated one, or what chi2 shows where that is less).
_AS_GOOD = 9.0
#: Places closer to each other than this share of their distance from the poses are the same.
_SAME = 1e-3
#: chi2 of a landmark is lower elsewhere if it is by this share and by this much.
_LOWER = 1e-6


@dataclass(frozen=True)
class Ambiguous:
    """A landmark with a second place that fits as well, given the noise.

    Attributes
    ----------
    id
        Of the landmark.
    place, other
        In metres: the one that was taken, and the other one with the poses as they are.
    chi2_difference
        chi2 of its edges there minus that at the place that was taken, with the poses as they are.
    """

    id: int
    place: tuple[float, ...]
    other: tuple[float, ...]
    chi2_difference: float


def of(result: Result, given: dict[str, BoolArray] | None = None) -> tuple[Values, int, tuple[Ambiguous, ...]]:
    """The state with landmarks where chi2 is lower, how many these are, and which have two places as good.

    Landmarks whose values were given (a mask for each kind) move only where chi2 is lower beyond the noise.
    """
    graph = result.graph
    values, moved, ambiguous = dict(graph.values), 0, []
    as_good = _AS_GOOD * min(1.0, result.final_chi2 / max(result.dof, 1))
    placed = {name: np.ones(len(column), dtype=bool) for name, column in graph.variables.items()}
    for name, wanted in under_observed.suspects(graph).items():
        column = graph.variables[name]
        sightings = Sightings.of_graph(graph, column.kind, graph.values, placed, wanted)
        current = sightings.chi2(column.values)
        apart = _SAME * sightings.distance(column.values)
        gain = _LOWER * (1.0 + current)
        if given is not None:
            gain = np.where(given[name], np.maximum(gain, as_good), gain)
        lowest, lowest_chi2 = column.values.copy(), current.copy()
        other, other_chi2 = np.full_like(column.values, np.nan), np.full(len(column), np.inf)
        for place, chi2 in minima(sightings):
            away = np.sqrt(np.square(place - column.values).sum(axis=1))
            elsewhere = wanted & np.isfinite(chi2) & (away > apart)
            elsewhere &= observability.regular(sightings, np.where(elsewhere[:, None], place, column.values))
            lower = elsewhere & (chi2 < np.minimum(lowest_chi2, current - gain))
            lowest[lower], lowest_chi2[lower] = place[lower], chi2[lower]
            next_best = elsewhere & (chi2 < other_chi2)
            other[next_best], other_chi2[next_best] = place[next_best], chi2[next_best]
        values[name] = lowest
        moved += int(np.count_nonzero(lowest_chi2 < current))
        for row in np.flatnonzero(other_chi2 - current < as_good).tolist():
            here, there = (tuple(float(x) for x in at[row]) for at in (column.values, other))
            ambiguous.append(Ambiguous(int(column.ids[row]), here, there, float(other_chi2[row] - current[row])))
    return values, moved, tuple(sorted(ambiguous, key=lambda landmark: landmark.id))
