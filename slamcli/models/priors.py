"""Priors on one variable: g2o's EDGE_PRIOR_SE2, EDGE_PRIOR_SE2_XY, EDGE_SE3_PRIOR, EDGE_SE3_XYZ_PRIOR and points'."""

from __future__ import annotations

import numpy as np

from slamcli.geometry import se3, so2, so3
from slamcli.models.base import Array, FactorKind, components
from slamcli.models.relative_pose_3d import vector_part_jacobian
from slamcli.models.variables import SE2, SE3


class PosePrior2D(FactorKind):
    """e = vec(Z^-1 Xi): position in the measured frame, then the angle (g2o, ``EdgeSE2Prior``)."""

    name = "pose_prior_2d"
    variables = (SE2,)
    components = ("x", "y", "theta")
    measurement_size = 3

    def place(self, first: Array, measurement: Array, parameter: Array | None) -> Array:
        """Pose = the measurement."""
        return measurement

    def residual(self, x: tuple[Array, ...], measurement: Array, parameter: Array | None) -> Array:
        """Residuals (m, 3): metres, radians."""
        pose, z = x[0], measurement
        cosine, sine = np.cos(z[:, 2]), np.sin(z[:, 2])
        dx, dy = pose[:, 0] - z[:, 0], pose[:, 1] - z[:, 1]
        residual = np.empty((len(z), 3))
        residual[:, 0] = cosine * dx + sine * dy
        residual[:, 1] = cosine * dy - sine * dx
        residual[:, 2] = so2.wrap(pose[:, 2] - z[:, 2])
        return residual

    def linearize_into(
        self,
        residual: Array,
        jacobians: tuple[Array, ...],
        x: tuple[Array, ...],
        measurement: Array,
        parameter: Array | None,
    ) -> None:
        """Residuals and Jacobians; see the base class."""
        residual[:] = self.residual(x, measurement, parameter)
        _rotation_2d(jacobians[0][:, :2, :2], residual[:, 2])
        jacobians[0][:, 2, 2] = 1.0


class PositionPrior2D(FactorKind):
    """e = t_i - z: position in the world frame, in metres (g2o, ``EdgeSE2XYPrior``)."""

    name = "position_prior_2d"
    variables = (SE2,)
    components = ("x", "y")
    measurement_size = 2

    def residual(self, x: tuple[Array, ...], measurement: Array, parameter: Array | None) -> Array:
        """Residuals (m, 2) in metres."""
        return x[0][:, :2] - measurement

    def linearize_into(
        self,
        residual: Array,
        jacobians: tuple[Array, ...],
        x: tuple[Array, ...],
        measurement: Array,
        parameter: Array | None,
    ) -> None:
        """Residuals and Jacobians; see the base class."""
        np.subtract(x[0][:, :2], measurement, out=residual)
        _rotation_2d(jacobians[0][:, :, :2], x[0][:, 2])


class PosePrior3D(FactorKind):
    """e = toVectorMQT(Z^-1 Xi P) with the sensor offset P (g2o, ``EdgeSE3Prior``)."""

    name = "pose_prior_3d"
    variables = (SE3,)
    components = ("x", "y", "z", "qx", "qy", "qz")
    measurement_size = 7
    parameter = SE3

    def normalize(self, measurement: Array) -> Array:
        """Scale the measured quaternions to unit length."""
        return se3.normalize(measurement)

    def place(self, first: Array, measurement: Array, parameter: Array | None) -> Array:
        """Pose = measurement composed with the inverse offset."""
        assert parameter is not None
        return se3.compose(measurement, se3.inverse(parameter))

    def residual(self, x: tuple[Array, ...], measurement: Array, parameter: Array | None) -> Array:
        """Residuals (m, 6): metres, then the vector part of the error quaternion."""
        assert parameter is not None
        return se3.local(measurement, se3.compose(x[0], parameter))

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
        residual[:] = self.residual(x, measurement, parameter)
        to_pose = so3.compose(so3.inverse(measurement[:, 3:]), x[0][:, 3:])
        error = so3.compose(to_pose, parameter[:, 3:])
        sign = np.where(error[:, 3] < 0.0, -1.0, 1.0)
        rotation = so3.to_matrix(to_pose)
        jacobian = jacobians[0]
        jacobian[:, :3, :3] = rotation
        # t_i + R_i (I + 2[d]x) t_p moves by -2 R_i [t_p]x d
        jacobian[:, :3, 3:] = np.cross(rotation, -2.0 * parameter[:, None, :3])
        vector_part_jacobian(jacobian[:, 3:, 3:], components(to_pose), components(parameter[:, 3:]), sign)


class PositionPrior3D(FactorKind):
    """e = t_i - z: position in the world frame, in metres (g2o, ``EdgeSE3XYZPrior``).

    The record names a sensor offset, which g2o does not use in the error; neither do we.
    """

    name = "position_prior_3d"
    variables = (SE3,)
    components = ("x", "y", "z")
    measurement_size = 3
    parameter = SE3

    def residual(self, x: tuple[Array, ...], measurement: Array, parameter: Array | None) -> Array:
        """Residuals (m, 3) in metres."""
        return x[0][:, :3] - measurement

    def linearize_into(
        self,
        residual: Array,
        jacobians: tuple[Array, ...],
        x: tuple[Array, ...],
        measurement: Array,
        parameter: Array | None,
    ) -> None:
        """Residuals and Jacobians; see the base class."""
        np.subtract(x[0][:, :3], measurement, out=residual)
        jacobians[0][:, :, :3] = so3.to_matrix(x[0][:, 3:])


def _rotation_2d(out: Array, angle: Array) -> None:
    """Write rotation matrices (m, 2, 2)."""
    out[:, 0, 0] = out[:, 1, 1] = np.cos(angle)
    out[:, 1, 0] = np.sin(angle)
    out[:, 0, 1] = -out[:, 1, 0]
