"""Where landmarks are by ranges: two places each, mirror images of each other in the line that fits the poses best.

With the positions a_i of the poses relative to their weighted mean, squared ranges are

    r_i^2 = |p|^2 - 2 a_i . p + |a_i|^2

and what is left of them without their weighted mean is linear in p. Along the main axis of the a_i it gives p well,
across the axis the worse the straighter the path is. There the mean itself says |p|, hence |across|, but not the side.
"""

from __future__ import annotations

import numpy as np

from slamcli import models
from slamcli.graph.columns import IndexArray, finite_rows
from slamcli.models.base import Array
from slamcli.solver.initialization.landmarks.sightings import Sightings, summed
from slamcli.solver.initialization.landmarks.triangulation import rays

#: The linear solution across the axis counts where the spread there is more than this share of that along it.
_LEAST_WIDTH = 1e-9


def both_sides(sightings: Sightings) -> list[Array]:
    """Candidates (n, 2): left and right of the path, then the linear solution; NaN where ranges say none.

    Left is seen along the main axis, in the direction of increasing ids.
    """
    parts = [part for part in sightings.parts if part.kind is models.RANGE_2D]
    if not parts:
        return []
    row = np.concatenate([part.rows for part in parts])
    position = np.concatenate([part.others[:, :2] for part in parts if part.others is not None])
    square = np.square(np.concatenate([part.factors.measurements[:, 0] for part in parts]))
    information = np.concatenate([part.factors.information[:, 0, 0] for part in parts])
    # the variance of r^2 is 4 r^2 that of r; a range of zero shall not have all the weight
    weight = information / np.maximum(square, 1e-3 * _means(row, np.ones(len(row)), square, sightings.count)[row])
    weight = np.where(np.isfinite(weight) & (weight > 0.0), weight, np.finfo(np.float64).tiny)

    def mean(quantity: Array) -> Array:
        return _means(row, weight, quantity, sightings.count)

    centre = mean(position)
    a = position - centre[row]
    norm = np.square(a).sum(axis=1)
    level = mean(square - norm)  # of |p|^2
    spread = mean(a[:, :, None] * a[:, None, :])
    right = -0.5 * mean(a * (square - norm)[:, None])
    spread[~finite_rows(spread)] = 0.0  # no ranges, or beyond all numbers
    eigenvalues, axes = np.linalg.eigh(spread)
    order = np.concatenate([part.order for part in parts]).astype(np.float64)
    onward = mean(a * (order - mean(order)[row])[:, None])
    axes[:, :, 1] *= np.where(np.vecdot(axes[:, :, 1], onward) < 0.0, -1.0, 1.0)[:, None]
    left = np.stack([-axes[:, 1, 1], axes[:, 0, 1]], axis=1)
    axes[:, :, 0] = left
    with np.errstate(all="ignore"):
        solved = (axes.transpose(0, 2, 1) @ right[:, :, None])[:, :, 0] / eigenvalues
    along = np.where(eigenvalues[:, 1] > 0.0, solved[:, 1], np.nan)
    across = np.sqrt(np.maximum(level - np.square(along), 0.0))
    wide = eigenvalues[:, 0] > _LEAST_WIDTH * eigenvalues[:, 1]
    sides = [across, -across, np.where(wide, solved[:, 0], np.nan)]
    return [centre + left * side[:, None] + axes[:, :, 1] * along[:, None] for side in sides]


def on_rays(sightings: Sightings) -> list[Array]:
    """Candidates (n, 2) where the first bearing of a landmark crosses the circle of its first range."""
    ranges = [part for part in sightings.parts if part.kind is models.RANGE_2D]
    bearings = [part for part in sightings.parts if part.kind is models.BEARING_2D]
    if not ranges or not bearings:
        return []
    distance = np.full(sightings.count, np.nan)
    centre, origin, ray = (np.full((sightings.count, 2), np.nan) for _ in range(3))
    for part in reversed(ranges):
        assert part.others is not None
        distance[part.rows[::-1]] = part.factors.measurements[::-1, 0]
        centre[part.rows[::-1]] = part.others[::-1, :2]
    for part in reversed(bearings):
        origins, directions = rays(part)
        origin[part.rows[::-1]], ray[part.rows[::-1]] = origins[::-1], directions[::-1]
    foot = np.vecdot(ray, centre - origin)
    half = np.sqrt(np.maximum(np.square(distance) - np.square(origin + foot[:, None] * ray - centre).sum(axis=1), 0.0))
    return [origin + (foot + side)[:, None] * ray for side in (half, -half)]


def _means(row: IndexArray, weight: Array, quantity: Array, count: int) -> Array:
    """Weighted means of a quantity over the sightings of each landmark; NaN where it has none."""
    shape = (-1, *[1] * (quantity.ndim - 1))
    total = summed(row, weight, count)
    with np.errstate(all="ignore"):
        return summed(row, weight.reshape(shape) * quantity, count) / total.reshape(shape)
