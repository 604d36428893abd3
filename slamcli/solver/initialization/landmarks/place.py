"""Places landmarks that have no value by all their sightings at once.

Every way to a place (``triangulation``, ``multilateration``) gives candidates; each is refined to a minimum of chi2
over the landmark's own sightings (``refinement``), and the lowest counts. Where landmarks are all that others are seen
from (differences of points), these follow in further rounds. Landmarks that nothing determines are not placed (see
``observability``).
"""

from __future__ import annotations

import numpy as np

from slamcli import models
from slamcli.graph import FactorGraph
from slamcli.graph.columns import BoolArray, Values, finite_rows
from slamcli.models.base import Array
from slamcli.solver.initialization.landmarks import multilateration, observability, triangulation
from slamcli.solver.initialization.landmarks.refinement import refined
from slamcli.solver.initialization.landmarks.sightings import Part, Sightings

#: Candidates are as good as each other within this share of chi2, and of a squared deviation.
_TIE = 1e-6
#: Candidates straight ahead of the first bearing, in units of the extent of the path.
_AHEAD = (0.3, 3.0, 30.0)


def place(graph: FactorGraph, values: Values, placed: dict[str, BoolArray]) -> None:
    """Give places to landmarks that are not placed; changes ``values`` and ``placed``.

    Between places of the same chi2 the one that is nearer to the graph's own value counts, if there is one.
    """
    for kind in (models.XY, models.XYZ):
        name = kind.name
        while name in graph.variables and not placed[name].all():
            sightings = Sightings.of_graph(graph, kind, values, placed, ~placed[name])
            if not sightings.parts:
                break
            found, _ = best(sightings, own_values(graph, name))
            good = finite_rows(found)
            firm = observability.determined(sightings, np.where(good[:, None], found, 0.0))
            # what is to be left out has been left out by now; without a value of its own any crossing will do
            firm |= ~graph.variables[name].known & observability.regular(sightings, np.where(good[:, None], found, 0.0))
            good &= firm
            values[name] = np.where(good[:, None], found, values[name])
            placed[name] = placed[name] | good
            if not good.any() or not observability.differences(graph, kind):
                break


def own_values(graph: FactorGraph, name: str) -> Array:
    """Values (n, d) of the landmarks of a kind in the graph, NaN where it has none."""
    column = graph.variables[name]
    return np.where(column.known[:, None], column.values, np.nan)


@np.errstate(all="ignore")
def best(sightings: Sightings, near: Array) -> tuple[Array, Array]:
    """Place (n, d) of the lowest chi2 (n,) of each landmark; NaN and infinity where there is no candidate.

    Of places with the same chi2 the one next to ``near`` (n, d), or the first where that is NaN.
    """
    found = minima(sightings)
    lowest = np.min([chi2 for _, chi2 in found], axis=0)
    places, nearest = np.full_like(near, np.nan), np.full(len(near), np.inf)
    for k, (candidate, chi2) in enumerate(found):
        away = np.sqrt(np.square(candidate - near).sum(axis=1))
        away = np.where(np.isnan(near).any(axis=1), float(k), away)
        with np.errstate(invalid="ignore"):
            better = (chi2 <= lowest + _TIE * (lowest + 1.0)) & (away < nearest) & np.isfinite(chi2)
        places[better], nearest[better] = candidate[better], away[better]
    return places, lowest


@np.errstate(all="ignore")  # numbers may be of any size; what is not finite is no place
def minima(sightings: Sightings) -> list[tuple[Array, Array]]:
    """Minima (n, d) that the candidates lead to, with chi2 (n,); several may be the same."""
    linear = triangulation.least_squares(sightings)
    if all(part.kind in triangulation.AFFINE for part in sightings.parts):
        chi2 = sightings.chi2(linear)
        return [(linear, np.where(finite_rows(linear), chi2, np.inf))]
    candidates = [linear, *multilateration.both_sides(sightings), *multilateration.on_rays(sightings)]
    found = [refined(sightings, candidate) for candidate in candidates]
    bearings = [part for part in sightings.parts if part.kind is models.BEARING_2D]
    if not bearings:
        return found
    _, extent = sightings.centre()
    extent = np.where(extent > 0.0, extent, 1.0)
    near = [_lies_ahead(place, bearings, sightings.distance(place) < _AHEAD[-1] * extent) for place, _ in found]
    for candidate in _ahead(sightings, bearings, extent):
        candidate[np.any(near, axis=0)] = np.nan
        found.append(refined(sightings, candidate))
    return found


def _lies_ahead(places: Array, bearings: list[Part], near: BoolArray) -> BoolArray:
    """Which of the places (n,) that are near lie ahead of all poses that have a bearing to them."""
    out = near.copy()
    for part in bearings:
        origins, directions = triangulation.rays(part)
        out[part.rows[~(np.vecdot(directions, places[part.rows] - origins) > 0.0)]] = False
    return out


def _ahead(sightings: Sightings, bearings: list[Part], extent: Array) -> list[Array]:
    """Candidates ahead of the first bearing, for lines that cross behind the poses."""
    origin, ray = (np.full((sightings.count, 2), np.nan) for _ in range(2))
    first = np.full(sightings.count, np.iinfo(np.int64).max)
    for part in bearings:
        origins, directions = triangulation.rays(part)
        np.minimum.at(first, part.rows, part.order)
        use = part.order == first[part.rows]
        origin[part.rows[use]], ray[part.rows[use]] = origins[use], directions[use]
    return [origin + (share * extent)[:, None] * ray for share in _AHEAD]
