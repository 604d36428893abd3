"""Places points that have no value by what cameras see of them: linear triangulation from all views at once.

A view measures P_x / P_z = a and P_y / P_z = b of the point in its camera's frame, so that

    (r_x - a r_z) . (X - C) = 0,    (r_y - b r_z) . (X - C) = 0

with the rows r of the world-to-camera rotation and the camera's place C: three unknowns for each point, all solved as a
batch. Equations are weighted by f / P_z, which makes their errors pixels, P_z being that of the solution before (R.
Hartley and P. Sturm, "Triangulation", CVIU 68(2), 1997). A point counts as placed where it lies in front of all cameras
that see it, and where the noise of the pixels leaves less than the distance itself of uncertainty along the worst
direction: two views from one place, or a single one, say no distance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli import models
from slamcli.errors import NumericalError
from slamcli.geometry import so3
from slamcli.graph import FactorGraph, Factors
from slamcli.graph.columns import BoolArray, IndexArray, Values
from slamcli.models import Projection, SbaProjection, SbaStereoProjection, SharedPinholeProjection
from slamcli.models.base import Array

_ROUNDS = 3  # of weighting
_NEWTON = 20  # iterations that undo distortion
_SINGULAR = 1e-13  # least eigenvalue over the greatest
_LARGEST = 1.0  # standard deviation along the worst direction, over the distance
_STEREO = 3  # numbers of a stereo measurement


@dataclass(frozen=True, eq=False)
class Views:
    """Equations ``normal . (X - C) = offset`` of views.

    Attributes
    ----------
    points
        (e,) row of the point of each equation.
    centre, axis
        (e, 3) place of the camera, and the direction along which depth counts.
    normal, offset
        (e, 3) and (e,).
    focal
        (e,) pixels for an angle of 1, times the root of the information.
    """

    points: IndexArray
    centre: Array
    axis: Array
    normal: Array
    offset: Array
    focal: Array

    def depth(self, places: Array) -> Array:
        """Depth (e,) of each equation's point."""
        return np.vecdot(self.axis, places[self.points] - self.centre)


def place_points_from_cameras(graph: FactorGraph, values: Values, placed: dict[str, BoolArray]) -> int:
    """Give places to points that are not placed and that cameras see; changes ``values`` and ``placed``.

    Returns
    -------
    int
        How many were placed.

    Raises
    ------
    NumericalError
        If a camera that sees something has no value: images alone place none.
    """
    name = models.XYZ.name
    if name not in graph.variables or not any(isinstance(factors.kind, Projection) for factors in graph.factors):
        return 0
    _require_cameras(graph)
    if placed[name].all():
        return 0
    found, good = triangulated(graph, values, ~placed[name])
    values[name] = np.where(good[:, None], found, values[name])
    placed[name] = placed[name] | good
    return int(np.count_nonzero(good))


def undetermined(graph: FactorGraph, *, also_known: bool) -> BoolArray:
    """Points (n,) that only cameras see and that these cannot place: without a value, or (also) seen but once.

    Parameters
    ----------
    graph
        The graph.
    also_known
        Whether points that have a value count where only one image of one camera shows them, which leaves their
        distance open.
    """
    column = graph.variables.get(models.XYZ.name)
    none = np.zeros(0 if column is None else len(column), dtype=bool)
    views, others = none.astype(np.intp), none.copy()
    if column is None:
        return none
    for factors in graph.factors:
        kinds = factors.kind.variables
        for slot in [slot for slot, kind in enumerate(kinds) if kind is models.XYZ]:
            rows = factors.indices[:, slot]
            if isinstance(factors.kind, Projection):
                views += np.bincount(rows, minlength=len(column)) * (1 + isinstance(factors.kind, SbaStereoProjection))
            else:
                others[rows] = True
    seen = (views > 0) & ~others & ~column.fixed
    out = seen & (views < 2) if also_known else none
    unknown = seen & ~column.known
    if unknown.any() and all(c.known.all() for c in graph.variables.values() if c.kind.is_pose):
        out = out | (unknown & ~triangulated(graph, graph.values, unknown)[1])
    return out


def triangulated(graph: FactorGraph, values: Values, wanted: BoolArray) -> tuple[Array, BoolArray]:
    """Places (n, 3) of the wanted points, and which of them their views determine, in front of all cameras."""
    count = len(wanted)
    parts = [_views(one, values, wanted) for one in graph.factors if isinstance(one.kind, Projection)]
    fields = ("points", "centre", "axis", "normal", "offset", "focal")
    views = Views(*(np.concatenate([getattr(part, field) for part in parts]) for field in fields))
    origin = _mean(views, count)
    weight = views.focal / np.maximum(float(np.median(views.focal)) if len(views.focal) else 1.0, 1e-300)
    with np.errstate(all="ignore"):
        for _ in range(_ROUNDS):
            places, low, regular = _solve(views, weight, origin, count)
            weight = views.focal / np.abs(views.depth(places))
        depth = views.depth(places)
        behind = np.bincount(views.points[~(depth > 0.0)], minlength=count) > 0
        nearest = np.full(count, np.inf)
        np.minimum.at(nearest, views.points, np.abs(depth))
        _, low, regular = _solve(views, weight, origin, count)
        certain = 1.0 / np.sqrt(low) <= _LARGEST * nearest
    good = wanted & regular & ~behind & certain & np.isfinite(places).all(axis=1)
    return places, good


def _solve(views: Views, weight: Array, origin: Array, count: int) -> tuple[Array, Array, BoolArray]:
    """Weighted least squares: places (n, 3), the least eigenvalue (n,) of each matrix, and which are regular."""
    row = np.where(np.isfinite(weight)[:, None], weight[:, None] * views.normal, 0.0)
    right = np.vecdot(row, views.centre - origin[views.points])
    right += np.where(np.isfinite(weight), weight, 0.0) * views.offset
    matrix, vector = np.zeros((count, 3, 3)), np.zeros((count, 3))
    np.add.at(matrix, views.points, row[:, :, None] * row[:, None, :])
    np.add.at(vector, views.points, row * right[:, None])
    matrix[~np.isfinite(matrix).all(axis=(1, 2))] = 0.0
    eigenvalues, axes = np.linalg.eigh(matrix)
    regular = eigenvalues[:, 0] > _SINGULAR * np.maximum(eigenvalues[:, 2], np.finfo(np.float64).tiny)
    share = (axes.transpose(0, 2, 1) @ vector[:, :, None])[:, :, 0] / eigenvalues
    return origin + (axes @ share[:, :, None])[:, :, 0], eigenvalues[:, 0], regular


def _mean(views: Views, count: int) -> Array:
    """Mean place (n, 3) of the cameras that see each point."""
    total = np.maximum(np.bincount(views.points, minlength=count), 1)
    return np.stack([np.bincount(views.points, c, minlength=count) / total for c in views.centre.T], axis=1)


def _views(factors: Factors, values: Values, wanted: BoolArray) -> Views:
    """The equations of one column of factors, for the wanted points."""
    kind = factors.kind
    assert isinstance(kind, Projection)
    part = factors.part(np.flatnonzero(wanted[factors.indices[:, kind.point]]))
    x = part.gather(values)
    camera = x[kind.camera]
    slopes, focal = _slopes(part, x)
    rows = so3.to_matrix(so3.inverse(camera[:, 3:7]))  # of the world's vectors seen from the camera
    point, centre = part.indices[:, kind.point], camera[:, :3]
    axis = kind.forward * rows[:, 2]
    across = [0, 1, 0][: slopes.shape[1]]
    normals = [rows[:, k] - slope[:, None] * rows[:, 2] for k, slope in zip(across, slopes.T, strict=True)]
    offsets = [np.zeros(len(part))] * 2 + ([camera[:, 11]] if slopes.shape[1] == _STEREO else [])
    size = len(normals)
    information = np.trace(part.information, axis1=1, axis2=2) / kind.dimension
    focal = focal * np.sqrt(np.maximum(information, 0.0))
    return Views(
        np.tile(point, size),
        np.tile(centre, (size, 1)),
        np.tile(axis, (size, 1)),
        np.concatenate(normals),
        np.concatenate(offsets),
        np.tile(focal, size),
    )


def _slopes(part: Factors, x: tuple[Array, ...]) -> tuple[Array, Array]:
    """What the pixels say of P_x / P_z and P_y / P_z (and of (P_x - b) / P_z), (m, 2 or 3), and focal lengths (m,)."""
    kind, z = part.kind, part.measurements
    with np.errstate(all="ignore"):
        if isinstance(kind, SharedPinholeProjection):
            return (z - x[2][:, 2:]) / x[2][:, :2], np.sqrt(np.abs(x[2][:, 0] * x[2][:, 1]))
        if isinstance(kind, SbaProjection):
            if part.parameters is not None:
                f, centre = part.parameters[:, :1], part.parameters[:, 1:3]
                return (z - centre) / f, np.abs(f[:, 0])
            focal, centre = x[kind.camera][:, 7:9], x[kind.camera][:, 9:11]
            if kind.measurement_size == _STEREO:
                focal, centre = focal[:, [0, 1, 0]], centre[:, [0, 1, 0]]
            return (z - centre) / focal, np.sqrt(np.abs(focal[:, 0] * focal[:, 1]))
        intrinsics = x[2] if len(x) == _STEREO else x[0][:, 7:]
        return -_undistorted(z / intrinsics[:, :1], intrinsics[:, 1:]), np.abs(intrinsics[:, 0])


def _undistorted(image: Array, distortion: Array) -> Array:
    """Solutions p of p (1 + k1 |p|^2 + k2 |p|^4) = image (m, 2), by Newton's method on |p|; NaN where it finds none."""
    k1, k2 = distortion.T
    wanted = np.sqrt(np.square(image).sum(axis=1))
    radius = wanted.copy()
    for _ in range(_NEWTON):
        square = np.square(radius)
        error = radius * (1.0 + square * (k1 + k2 * square)) - wanted
        radius = radius - error / (1.0 + square * (3.0 * k1 + 5.0 * k2 * square))
    square = np.square(radius)
    found = np.abs(radius * (1.0 + square * (k1 + k2 * square)) - wanted) <= 1e-9 * (1.0 + wanted)
    ratio = np.where(wanted > 0.0, radius / np.where(wanted > 0.0, wanted, 1.0), 1.0)
    return image * np.where(found & (radius >= 0.0), ratio, np.nan)[:, None]


def _require_cameras(graph: FactorGraph) -> None:
    """Every camera that sees something needs a value."""
    lost: set[int] = set()
    for factors in graph.factors:
        if isinstance(factors.kind, Projection):
            column = graph.variables[factors.kind.variables[factors.kind.camera].name]
            rows = np.unique(factors.indices[:, factors.kind.camera])
            lost |= set(column.ids[rows[~column.known[rows]]].tolist())
    if lost:
        shown = ", ".join(str(i) for i in sorted(lost)[:5]) + (", ..." if len(lost) > 5 else "")
        who = "1 camera has" if len(lost) == 1 else f"{len(lost)} cameras have"
        raise NumericalError(
            f"{who} no estimate, and images of points place none: {shown}", ("  give vertices for cameras",)
        )
