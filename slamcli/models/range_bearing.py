"""Range and bearing of a point as a pose senses them: the sensor model and its factors.

With (u, v) = R(theta)^T (l - t) the point in the frame of the pose,

    range = sqrt(u^2 + v^2)            in metres
    bearing = atan2(v, u)              in radians, in [-pi, pi), counterclockwise from straight ahead

(Thrun, Burgard, Fox, "Probabilistic Robotics", 2005, section 6.6, where the bearing is atan2(dy, dx) - theta).

``predict`` and ``linearize`` are the sensor model that simulator, filter and factors share. They apply nothing but
elementwise ufuncs to their input, so that a subclass of ndarray with sines of its own goes through them.

Factors have the sign of g2o's ``EdgeSE2PointXYBearing``, measurement minus prediction: SLAM++'s EDGE_SE2_RB, g2o's
EDGE_BEARING_SE2_XY, and EDGE_RANGE_SE2_XY. At the pose itself direction and bearing are undefined: the Jacobians are
not finite there, and the solver says so.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamcli.geometry import so2
from slamcli.models.base import Array, FactorKind
from slamcli.models.point_observation import in_frame_2d
from slamcli.models.variables import SE2, XY


def predict(pose: Array, point: Array) -> tuple[Array, Array]:
    """What a sensor on the pose reads of the point.

    Parameters
    ----------
    pose
        (m, 3) x, y, theta in the world frame.
    point
        (m, 2) in the world frame.

    Returns
    -------
    range, bearing
        (m,) metres; (m,) radians in [-pi, pi). At the pose itself both are 0.
    """
    view = _View.of(pose, point)
    return view.range, so2.wrap(view.bearing)


def linearize(pose: Array, point: Array) -> tuple[Array, Array, Array, Array]:
    """Range, bearing and their Jacobians; rows are (range, bearing).

    Parameters
    ----------
    pose, point
        As in ``predict``.

    Returns
    -------
    range, bearing
        As in ``predict``.
    jacobian_pose
        (m, 2, 3) with respect to a step in the frame of the pose, ``SE2.retract``:
        ``[[-u/r, -v/r, 0], [v/r^2, -u/r^2, -1]]``. Textbooks move x and y along the axes of the world instead:
        ``world_jacobian`` rotates the first two columns, which gives
        ``[[-dx/r, -dy/r, 0], [dy/r^2, -dx/r^2, -1]]``.
    jacobian_point
        (m, 2, 2) with respect to the point, ``[[dx/r, dy/r], [-dy/r^2, dx/r^2]]``.
    """
    view = _View.of(pose, point)
    jacobian_pose, jacobian_point = np.empty((len(view.u), 2, 3)), np.empty((len(view.u), 2, 2))
    for row, component in enumerate(("range", "bearing")):
        along_u, along_v, turn = view.gradient(component)
        jacobian_pose[:, row, 0], jacobian_pose[:, row, 1], jacobian_pose[:, row, 2] = -along_u, -along_v, turn
        jacobian_point[:, row, 0], jacobian_point[:, row, 1] = view.to_world(along_u, along_v)
    return view.range, so2.wrap(view.bearing), jacobian_pose, jacobian_point


def world_jacobian(jacobian: Array, pose: Array) -> Array:
    """Jacobian (m, d, 3) with respect to (x, y, theta) in the world, from the one in the frame of the pose (m, 3).

    A step w of the position in the world is the step R^T w in the frame of the pose.
    """
    cosine, sine = np.cos(pose[:, 2])[:, None], np.sin(pose[:, 2])[:, None]
    along, across = jacobian[:, :, 0], jacobian[:, :, 1]
    return so2.pack(cosine * along - sine * across, sine * along + cosine * across, jacobian[:, :, 2])


class _View(NamedTuple):
    """The point in the frame of the pose, and the cosine and sine of the pose's heading; all are (m,)."""

    u: Array
    v: Array
    cosine: Array
    sine: Array

    @classmethod
    def of(cls, pose: Array, point: Array) -> _View:
        return cls(*in_frame_2d(pose, point))

    @property
    def range(self) -> Array:
        """Metres."""
        return np.sqrt(self.u * self.u + self.v * self.v)

    @property
    def bearing(self) -> Array:
        """Radians in [-pi, pi]."""
        return np.arctan2(self.v, self.u)

    def gradient(self, component: str) -> tuple[Array, Array, float]:
        """Derivatives of the range or the bearing by u, by v, and by a turn of the pose."""
        square = self.u * self.u + self.v * self.v
        with np.errstate(divide="ignore", invalid="ignore"):
            if component == "range":
                distance = np.sqrt(square)
                return self.u / distance, self.v / distance, 0.0
            return -self.v / square, self.u / square, -1.0

    def to_world(self, along_u: Array, along_v: Array) -> tuple[Array, Array]:
        """A gradient by u, v as one by the coordinates of the point in the world."""
        return self.cosine * along_u - self.sine * along_v, self.sine * along_u + self.cosine * along_v


class _Sensing(FactorKind):
    """e = z - h, bearings wrapped; ``components`` says which of range and bearing are measured."""

    variables = (SE2, XY)

    def normalize(self, measurement: Array) -> Array:
        """Wrap bearings to [-pi, pi)."""
        if "bearing" not in self.components:
            return measurement
        return np.concatenate([measurement[:, :-1], so2.wrap(measurement[:, -1:])], axis=1)

    def residual(self, x: tuple[Array, ...], measurement: Array, parameter: Array | None) -> Array:
        """Residuals (m, dimension) in metres and radians."""
        residual = np.empty(measurement.shape)
        self._residual(residual, _View.of(x[0], x[1]), measurement)
        return residual

    def _residual(self, residual: Array, view: _View, measurement: Array) -> None:
        for k, component in enumerate(self.components):
            if component == "range":
                residual[:, k] = measurement[:, k] - view.range
            else:
                residual[:, k] = so2.wrap(measurement[:, k] - view.bearing)

    def linearize_into(
        self,
        residual: Array,
        jacobians: tuple[Array, ...],
        x: tuple[Array, ...],
        measurement: Array,
        parameter: Array | None,
    ) -> None:
        """Residuals and Jacobians; see the base class."""
        view = _View.of(x[0], x[1])
        self._residual(residual, view, measurement)
        jacobian_pose, jacobian_point = jacobians
        for k, component in enumerate(self.components):
            along_u, along_v, turn = view.gradient(component)
            jacobian_pose[:, k, 0], jacobian_pose[:, k, 1], jacobian_pose[:, k, 2] = along_u, along_v, -turn
            jacobian_point[:, k, 0], jacobian_point[:, k, 1] = view.to_world(-along_u, -along_v)


class RangeBearing2D(_Sensing):
    """e = z - (range, bearing): metres, radians."""

    name = "range_bearing_2d"
    components = ("range", "bearing")
    measurement_size = 2

    def place(self, first: Array, measurement: Array, parameter: Array | None) -> Array:
        """Point at the measured range in the measured direction."""
        direction = first[:, 2] + measurement[:, 1]
        return first[:, :2] + measurement[:, :1] * so2.pack(np.cos(direction), np.sin(direction))


class Bearing2D(_Sensing):
    """e = z - bearing, in radians."""

    name = "bearing_2d"
    components = ("bearing",)
    measurement_size = 1


class Range2D(_Sensing):
    """e = z - range, in metres."""

    name = "range_2d"
    components = ("range",)
    measurement_size = 1
