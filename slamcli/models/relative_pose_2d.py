"""Relative pose of two planar poses (odometry, scan matching, loop closure): g2o's EDGE_SE2."""

from __future__ import annotations

import numpy as np

from slamcli.geometry import se2, so2
from slamcli.models.base import Array, FactorKind, components
from slamcli.models.variables import SE2


class RelativePose2D(FactorKind):
    """e = vec(Z^-1 (Xi^-1 Xj)): translation in the frame of the *measured* pose j, then the angle.

    With R_i the rotation of pose i and d, phi the measured translation and angle,

        e_t     = R(phi)^T (R_i^T (t_j - t_i) - d)
        e_theta = wrap(theta_j - theta_i - phi)

    (g2o, ``EdgeSE2``). The information is therefore that of a translation expressed in frame j; TORO expresses it
    in frame i, which ``formats.toro`` converts.
    """

    name = "relative_pose_2d"
    variables = (SE2, SE2)
    components = ("x", "y", "theta")
    measurement_size = 3

    @property
    def relative_pose(self) -> bool:
        """True: the measurement is pose j seen from pose i."""
        return True

    def place(self, first: Array, measurement: Array, parameter: Array | None) -> Array:
        """Pose j = pose i composed with the measurement."""
        return se2.compose(first, measurement)

    def residual(self, x: tuple[Array, ...], measurement: Array, parameter: Array | None) -> Array:
        """Residuals (m, 3): x, y in metres, theta in radians."""
        residual = np.empty((len(measurement), 3))
        _residual(residual, x[0], x[1], measurement)
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
        u, v, cos_z, sin_z = _residual(residual, x[0], x[1], measurement)
        jacobian_i, jacobian_j = jacobians
        jacobian_i[:, 0, 0] = -cos_z
        jacobian_i[:, 0, 1] = -sin_z
        jacobian_i[:, 1, 0] = sin_z
        jacobian_i[:, 1, 1] = -cos_z
        # d(R_i^T w)/d(theta_i) = (v, -u) for (u, v) = R_i^T w
        jacobian_i[:, 0, 2] = cos_z * v - sin_z * u
        jacobian_i[:, 1, 2] = -sin_z * v - cos_z * u
        jacobian_i[:, 2, 2] = -1.0
        # R(phi)^T R_i^T R_j is the rotation by the residual angle itself
        cos_e, sin_e = np.cos(residual[:, 2]), np.sin(residual[:, 2])
        jacobian_j[:, 0, 0] = cos_e
        jacobian_j[:, 0, 1] = -sin_e
        jacobian_j[:, 1, 0] = sin_e
        jacobian_j[:, 1, 1] = cos_e
        jacobian_j[:, 2, 2] = 1.0


def _residual(residual: Array, pose_i: Array, pose_j: Array, z: Array) -> tuple[Array, Array, Array, Array]:
    """Write the residual; return (u, v) = R_i^T (t_j - t_i), and the cosine and sine of the measured angle."""
    (xi, yi, theta_i), (xj, yj, theta_j), (zx, zy, phi) = components(pose_i), components(pose_j), components(z)
    cos_i, sin_i = np.cos(theta_i), np.sin(theta_i)
    dx, dy = xj - xi, yj - yi
    u, v = cos_i * dx + sin_i * dy, cos_i * dy - sin_i * dx
    cos_z, sin_z = np.cos(phi), np.sin(phi)
    a, b = u - zx, v - zy
    residual[:, 0] = cos_z * a + sin_z * b
    residual[:, 1] = cos_z * b - sin_z * a
    residual[:, 2] = so2.wrap(theta_j - theta_i - phi)
    return u, v, cos_z, sin_z
