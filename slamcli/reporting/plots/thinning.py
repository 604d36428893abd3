"""Fewer points and segments for the same picture."""

from __future__ import annotations

import numpy as np

from slamcli.graph.columns import IndexArray, finite_rows
from slamcli.models.base import Array


def thin_path(points: Array, cell: float) -> IndexArray:
    """Rows of a path that are enough to draw it.

    Points that lie in the same square (cube) of a grid as the point before them are left out, so that the drawn line
    stays within one diagonal of a cell of the given one. Rows that are not finite, the gaps, stay.

    Parameters
    ----------
    points
        (n, k) path.
    cell
        Side of the cells; with less than a pixel no difference can be seen.
    """
    if len(points) < 3 or not cell > 0.0:
        return np.arange(len(points))
    with np.errstate(invalid="ignore", over="ignore"):
        cells = np.floor((points - np.nanmin(points, axis=0)) / cell)
    keep = np.ones(len(points), dtype=bool)
    keep[1:-1] = (cells[1:-1] != cells[:-2]).any(axis=1)  # NaN differs from everything
    # the last point before a gap ends a line
    gap = ~finite_rows(points)
    keep[:-1] |= gap[1:]
    return np.flatnonzero(keep)


def spread(count: int, most: int) -> IndexArray:
    """At most so many row numbers of ``count``, evenly spread."""
    if count <= most:
        return np.arange(count)
    return np.arange(most) * count // most


def envelope(x: Array, y: Array, bins: int) -> IndexArray:
    """Rows that keep the lowest and the highest y of each of so many intervals of x: peaks survive.

    Parameters
    ----------
    x
        (n,) in ascending order.
    y
        (n,) values; NaN counts as the lowest.
    """
    if len(x) <= 4 * bins:
        return np.arange(len(x))
    width = (x[-1] - x[0]) / bins
    with np.errstate(invalid="ignore", divide="ignore"):
        bin_of = np.nan_to_num(np.floor((x - x[0]) / width)).astype(np.intp)
    rank = np.lexsort((np.nan_to_num(y, nan=-np.inf), bin_of))
    first = np.flatnonzero(np.diff(bin_of[rank], prepend=-1))
    last = np.append(first[1:], len(x)) - 1
    return np.unique(np.concatenate([rank[first], rank[last], [0, len(x) - 1]]))
