"""Where a new landmark is: from one reading of two numbers, or from bearings or ranges at several poses.

All of them end in the same step, ``ekf.initialize``: two numbers place a point, and the implicit function theorem says
how its error hangs on the readings and on the poses they were made from, which are in the state.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from slamcli.filtering.ekf import initialize
from slamcli.filtering.readings import Linearization, Reading, Sighting, Stream, linearize, linearize_readings
from slamcli.filtering.state import POSE, Block, State
from slamcli.models.base import Array

#: How much less likely than the other the mirror image of a landmark must be, as a difference of chi-square.
_MIRROR_CHI2 = 16.0
#: Largest standard deviation of a new landmark, as a part of its distance, at which a linearization still holds.
_RELATIVE_DEVIATION = 0.1
_NEWTON_STEPS = 20


class View(NamedTuple):
    """A reading of a landmark that is not in the state, from a pose that is."""

    reading: Reading
    pose: Block


class Placement(NamedTuple):
    """Where a landmark is, and the views that say so.

    Attributes
    ----------
    point
        (2,) the best fit to all views.
    views
        Those whose two numbers place it: one of range and bearing or xy, two of bearing or range.
    rest
        The others.
    """

    point: Array
    views: list[View]
    rest: list[View]


def place(state: State, streams: Sequence[Stream], view: View) -> Placement:
    """The point of one reading of two numbers."""
    stream = streams[view.reading.stream]
    pose = _pose(state, view)[None]
    point = stream.sensor.kind.place(pose, stream.measurements[view.reading.row][None], None)
    assert point is not None
    return Placement(point[0], [view], [])


def enter(
    state: State, streams: Sequence[Stream], placement: Placement, first: bool
) -> tuple[Block, Linearization | None]:
    """Put a placed landmark into the state.

    Everything is linearized about the best fit: two numbers place the landmark, by a linear step from there, and the
    remaining views come back as an update that is to follow.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the readings do not place it there.
    """
    n = state.size
    state.reserve(n + 2)
    state.mean[n : n + 2] = state.first[n : n + 2] = placement.point  # lent, for the linearization
    lent = Block(n, 2)
    stacked, rest = (
        linearize(state, streams, [Sighting(view.reading, view.pose, lent) for view in views], first) if views else None
        for views in (placement.views, placement.rest)
    )
    assert stacked is not None
    if not all(np.isfinite(part.jacobian).all() for part in (stacked, rest) if part is not None):
        raise np.linalg.LinAlgError("the robot is on the landmark: no derivative exists")
    point = placement.point + np.linalg.solve(stacked.jacobian[:, -2:], stacked.innovation)
    block = initialize(state, point, stacked)
    state.first[n : n + 2] = placement.point
    if rest is not None:
        rest.innovation[:] -= rest.jacobian[:, -2:] @ (point - placement.point)
    return block, rest


def triangulate(state: State, streams: Sequence[Stream], views: list[View], min_parallax: float) -> Placement | None:
    """The best fit to bearings, None while their parallax is too small.

    It starts from the crossing of the newest bearing with the one of greatest parallax, ahead of both.
    """
    newest = views[-1]
    origin, direction = _ray(state, streams, newest)
    best = math.sin(min(min_parallax, 0.5 * math.pi))
    chosen: Array | None = None
    for view in views[:-1]:
        start, along = _ray(state, streams, view)
        crossing = direction[0] * along[1] - direction[1] * along[0]  # sine of the parallax
        if abs(crossing) < best:
            continue
        gap = start - origin
        ahead = (gap[0] * along[1] - gap[1] * along[0]) / crossing
        other = (gap[0] * direction[1] - gap[1] * direction[0]) / crossing
        if ahead > 0.0 and other > 0.0:
            best, chosen = abs(crossing), origin + ahead * direction
    fit = None if chosen is None else _fit(state, streams, views, chosen)
    return None if fit is None else _placement(state, streams, views, fit[1])


def _ray(state: State, streams: Sequence[Stream], view: View) -> tuple[Array, Array]:
    """Origin and direction of a bearing, in the world."""
    x, y, theta = _pose(state, view).tolist()
    angle = theta + float(streams[view.reading.stream].measurements[view.reading.row, 0])
    return np.array([x, y]), np.array([math.cos(angle), math.sin(angle)])


def trilaterate(state: State, streams: Sequence[Stream], views: list[View]) -> Placement | None:
    """The point of three ranges or more, None while its mirror image explains them nearly as well.

    Two circles cross at two points, mirror images of each other. Both are moved to where all ranges agree best,
    weighted by the covariance of their innovations, poses included; the better one must be so by a margin.
    """
    if len(views) < 3:
        return None
    poses = np.array([_pose(state, view) for view in views])
    ranges = np.array([streams[v.reading.stream].measurements[v.reading.row, 0] for v in views])
    candidates = [_fit(state, streams, views, point) for point in _crossings(poses[:, :2], ranges)]
    found = sorted((candidate for candidate in candidates if candidate is not None), key=lambda pair: pair[0])
    if not found:
        return None
    separate = [c for c in found[1:] if np.hypot(*(c[1] - found[0][1])) > 1e-3 * float(ranges.max())]
    if separate and separate[0][0] - found[0][0] < _MIRROR_CHI2:
        return None
    if len(separate) < 1 and len(found) < 2:
        return None  # the mirror image found no minimum of its own: too little is known of it
    return _placement(state, streams, views, found[0][1])


def _crossings(centres: Array, radii: Array) -> list[Array]:
    """Both crossings of the first circle with the one farthest from it; the nearest points where they miss."""
    other = int(np.argmax(np.square(centres - centres[0]).sum(axis=1)))
    axis = centres[other] - centres[0]
    distance = float(np.hypot(*axis))
    if distance == 0.0:
        return []
    axis = axis / distance
    along = 0.5 * (distance + (radii[0] - radii[other]) * (radii[0] + radii[other]) / distance)
    across = math.sqrt(max(float(radii[0]) ** 2 - along**2, 1e-6 * float(radii[0]) ** 2))
    normal = np.array([-axis[1], axis[0]])
    return [centres[0] + along * axis + sign * across * normal for sign in (1.0, -1.0)]


def _fit(state: State, streams: Sequence[Stream], views: list[View], point: Array) -> tuple[float, Array] | None:
    """chi2 and point of the best fit to all views (Gauss-Newton), None if it does not settle."""
    index = np.unique(np.concatenate([np.arange(v.pose.start, v.pose.start + POSE) for v in views]))
    covariance = state.block(index)
    poses = np.array([_pose(state, view) for view in views])
    noise = np.diag([float(streams[v.reading.stream].noise[v.reading.row, 0, 0]) for v in views])
    measured = np.array([streams[v.reading.stream].measurements[v.reading.row] for v in views])
    sensor = streams[views[0].reading.stream].sensor
    columns = np.searchsorted(index, np.array([v.pose.start for v in views]))[:, None] + np.arange(POSE)
    for _ in range(_NEWTON_STEPS):
        nu, by_pose, by_point = linearize_readings(sensor, poses, np.tile(point, (len(views), 1)), measured)
        h = np.zeros((len(views), len(index)))
        np.put_along_axis(h, columns, by_pose[:, 0], axis=1)
        weight = h @ covariance @ h.T + noise
        a = by_point[:, 0]
        if not (np.isfinite(a).all() and np.isfinite(weight).all()):
            return None
        solved = np.linalg.solve(weight, np.column_stack([a, nu[:, 0]]))
        normal, right = a.T @ solved[:, :2], a.T @ solved[:, 2]
        if np.linalg.cond(normal) > 1e12:
            return None
        step = np.linalg.solve(normal, right)
        chi2 = float(nu[:, 0] @ solved[:, 2])
        length, distance = float(np.hypot(*step)), float(np.hypot(*(point - poses[-1, :2])))
        if length <= 1e-9 * distance:
            return chi2, point
        point = point + step * min(1.0, 0.5 * distance / length)
    return None


def _placement(state: State, streams: Sequence[Stream], views: list[View], point: Array) -> Placement | None:
    """A best fit with the two views that see it from the most different sides; None if it is not precise enough.

    Too little is known where sensor noise alone leaves it a deviation that is a large part of its distance: a
    linearization would not hold.
    """
    poses = np.array([_pose(state, view) for view in views])
    stream = streams[views[0].reading.stream]
    rows = [view.reading.row for view in views]
    points = np.tile(point, (len(views), 1))
    _, _, by_point = linearize_readings(stream.sensor, poses, points, stream.measurements[rows])
    weighted = by_point[:, 0] / np.sqrt(stream.noise[rows, 0, 0])[:, None]
    if not np.isfinite(weighted).all():
        return None
    weakest = float(np.linalg.eigvalsh(weighted.T @ weighted)[0])
    nearest = float(np.hypot(*(point - poses[:, :2]).T).min())
    if not weakest > 0.0 or 1.0 / math.sqrt(weakest) > _RELATIVE_DEVIATION * nearest:
        return None
    areas = np.abs(weighted[:, None, 0] * weighted[None, :, 1] - weighted[:, None, 1] * weighted[None, :, 0])
    pair = sorted(int(k) for k in np.unravel_index(int(np.argmax(areas)), areas.shape))
    rest = [view for k, view in enumerate(views) if k not in pair]
    return Placement(point, [views[k] for k in pair], rest)


def _pose(state: State, view: View) -> Array:
    return state.mean[view.pose.start : view.pose.start + POSE]
