"""A pose observes the coordinates of a point in its own frame: g2o's EDGE_SE2_XY and EDGE_SE3_TRACKXYZ."""

from __future__ import annotations

import numpy as np

from slamcli.geometry import se2, se3, so2, so3
from slamcli.models.base import Array, FactorKind
from slamcli.models.variables import SE2, SE3, XY, XYZ


class PointObservation2D(FactorKind):
    """e = Xi^-1 l - z: the point in the frame of the pose, in metres (g2o, ``EdgeSE2PointXY``)."""

    name = "point_observation_2d"
    variables = (SE2, XY)
    components = ("x", "y")
    measurement_size = 2

    def place(self, first: Array, measurement: Array, parameter: Array | None) -> Array:
        """Point = pose applied to the measurement."""
        return se2.act(first, measurement)

    def residual(self, x: tuple[Array, ...], measurement: Array, parameter: Array | None) -> Array:
        """Residuals (m, 2) in metres."""
        u, v, _, _ = in_frame_2d(x[0], x[1])
        return so2.pack(u, v) - measurement

    def linearize_into(
        self,
        residual: Array,
        jacobians: tuple[Array, ...],
        x: tuple[Array, ...],
        measurement: Array,
        parameter: Array | None,
    ) -> None:
        """Residuals and Jacobians; see the base class."""
        u, v, cosine, sine = in_frame_2d(x[0], x[1])
        jacobian_pose, jacobian_point = jacobians
        np.subtract(u, measurement[:, 0], out=residual[:, 0])
        np.subtract(v, measurement[:, 1], out=residual[:, 1])
        jacobian_pose[:, 0, 0] = jacobian_pose[:, 1, 1] = -1.0
        jacobian_pose[:, 0, 2] = v
        jacobian_pose[:, 1, 2] = -u
        jacobian_point[:, 0, 0] = jacobian_point[:, 1, 1] = cosine
        jacobian_point[:, 0, 1] = sine
        jacobian_point[:, 1, 0] = -sine


class PointObservation3D(FactorKind):
    """e = (Xi P)^-1 l - z: the point in the frame of a sensor with offset P on the pose, in metres.

    g2o's ``EdgeSE3PointXYZ``; P is the PARAMS_SE3OFFSET that the edge names.
    """

    name = "point_observation_3d"
    variables = (SE3, XYZ)
    components = ("x", "y", "z")
    measurement_size = 3
    parameter = SE3

    def place(self, first: Array, measurement: Array, parameter: Array | None) -> Array:
        """Point = pose, then sensor offset, applied to the measurement."""
        assert parameter is not None
        return se3.act(se3.compose(first, parameter), measurement)

    def residual(self, x: tuple[Array, ...], measurement: Array, parameter: Array | None) -> Array:
        """Residuals (m, 3) in metres."""
        assert parameter is not None
        local = so3.act(so3.inverse(x[0][:, 3:]), x[1] - x[0][:, :3])
        return so3.act(so3.inverse(parameter[:, 3:]), local - parameter[:, :3]) - measurement

    def linearize_into(
        self,
        residual: Array,
        jacobians: tuple[Array, ...],
        x: tuple[Array, ...],
        measurement: Array,
        parameter: Array | None,
    ) -> None:
        """Residuals and Jacobians; see the base class."""
        assert parameter is not None
        pose_inverse, offset_inverse = so3.inverse(x[0][:, 3:]), so3.inverse(parameter[:, 3:])
        local = so3.act(pose_inverse, x[1] - x[0][:, :3])
        np.subtract(so3.act(offset_inverse, local - parameter[:, :3]), measurement, out=residual)
        rotation = so3.to_matrix(offset_inverse)
        jacobian_pose, jacobian_point = jacobians
        np.negative(rotation, out=jacobian_pose[:, :, :3])
        # see RelativePose3D; each row of R times skew(v) is the cross product of that row with v
        jacobian_pose[:, :, 3:] = np.cross(rotation, 2.0 * local[:, None, :])
        jacobian_point[:] = so3.to_matrix(so3.compose(offset_inverse, pose_inverse))


def in_frame_2d(pose: Array, point: Array) -> tuple[Array, Array, Array, Array]:
    """Points (m, 2) in the frames of poses (m, 3): their coordinates u and v, and the heading's cosine and sine."""
    cosine, sine = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    dx, dy = point[:, 0] - pose[:, 0], point[:, 1] - pose[:, 1]
    return cosine * dx + sine * dy, cosine * dy - sine * dx, cosine, sine
