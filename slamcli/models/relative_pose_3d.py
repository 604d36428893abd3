"""Relative pose of two spatial poses: g2o's EDGE_SE3:QUAT."""

from __future__ import annotations

import numpy as np

from slamcli.geometry import se3, so3
from slamcli.models.base import Array, FactorKind
from slamcli.models.variables import SE3


class RelativePose3D(FactorKind):
    """e = toVectorMQT(Z^-1 Xi^-1 Xj): translation in the frame of the *measured* pose j, then vec(q), q_w >= 0.

    With E = Z^-1 Xi^-1 Xj = (R_E, t_E), its quaternion q_E, and u = R_i^T (t_j - t_i),

        e_t = R_z^T (u - d)            e_R = sign(w_E) vec(q_E),   q_E = q_z* q_i* q_j

    (g2o, ``EdgeSE3`` and ``isometry3d_mappings``). The rotation part is sin(angle/2) times the axis: the same
    physical noise has four times the information that it has for a rotation vector.
    """

    name = "relative_pose_3d"
    variables = (SE3, SE3)
    components = ("x", "y", "z", "qx", "qy", "qz")
    measurement_size = 7

    @property
    def relative_pose(self) -> bool:
        """True: the measurement is pose j seen from pose i."""
        return True

    def normalize(self, measurement: Array) -> Array:
        """Scale the measured quaternions to unit length."""
        return se3.normalize(measurement)

    def place(self, first: Array, measurement: Array, parameter: Array | None) -> Array:
        """Pose j = pose i composed with the measurement."""
        return se3.compose(first, measurement)

    def residual(self, x: tuple[Array, ...], measurement: Array, parameter: Array | None) -> Array:
        """Residuals (m, 6): metres, then the vector part of the error quaternion."""
        return _residual(x[0], x[1], measurement)[0]

    def linearize(
        self, x: tuple[Array, ...], measurement: Array, parameter: Array | None
    ) -> tuple[Array, tuple[Array, ...]]:
        """Residuals (m, 6) and Jacobians 2 x (m, 6, 6) for the local steps of poses i and j."""
        residual, u, sign, z_conjugate, delta, error = _residual(x[0], x[1], measurement)
        m = len(residual)
        rotation_z = so3.to_matrix(z_conjugate)
        jacobian_i = np.zeros((m, 6, 6))
        np.negative(rotation_z, out=jacobian_i[:, :3, :3])
        # R_i (I + 2[d]x) transposed acts on u as u - 2 d x u = u + 2 [u]x d
        jacobian_i[:, :3, 3:] = cross_columns(rotation_z, 2.0 * u)
        jacobian_i[:, 3:, 3:] = vector_part_jacobian(z_conjugate, delta, -sign)
        jacobian_j = np.zeros((m, 6, 6))
        jacobian_j[:, :3, :3] = so3.to_matrix(error)
        jacobian_j[:, 3:, 3:] = vector_part_right_jacobian(error, sign)
        return residual, (jacobian_i, jacobian_j)


def _residual(pose_i: Array, pose_j: Array, z: Array) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Residual, u = R_i^T (t_j - t_i), the sign that makes w >= 0, and the quaternions q_z*, q_i* q_j, q_E."""
    i_conjugate, z_conjugate = so3.inverse(pose_i[:, 3:]), so3.inverse(z[:, 3:])
    u = so3.act(i_conjugate, pose_j[:, :3] - pose_i[:, :3])
    delta = so3.compose(i_conjugate, pose_j[:, 3:])
    error = so3.compose(z_conjugate, delta)
    sign = np.where(error[:, 3] < 0.0, -1.0, 1.0)
    residual = np.empty((len(z), 6))
    residual[:, :3] = so3.act(z_conjugate, u - z[:, :3])
    residual[:, 3:] = sign[:, None] * error[:, :3]
    return residual, u, sign, z_conjugate, delta, error


def cross_columns(matrix: Array, vector: Array) -> Array:
    """``matrix @ skew(vector)`` for stacks (m, 3, 3) and (m, 3)."""
    out = np.empty_like(matrix)
    x, y, z = vector[:, 0, None], vector[:, 1, None], vector[:, 2, None]
    first, second, third = matrix[:, :, 0], matrix[:, :, 1], matrix[:, :, 2]
    out[:, :, 0] = z * second - y * third
    out[:, :, 1] = x * third - z * first
    out[:, :, 2] = y * first - x * second
    return out


def vector_part_right_jacobian(a: Array, scale: Array) -> Array:
    """Jacobian of ``scale * vec(a (d, sqrt(1 - d^2)))`` at d = 0: ``scale (w I + [v]x)``, (m, 3, 3)."""
    x, y, z, w = (scale * a[:, k] for k in range(4))
    out = np.empty((len(a), 3, 3))
    out[:, 0, 0] = out[:, 1, 1] = out[:, 2, 2] = w
    out[:, 0, 1], out[:, 1, 0] = -z, z
    out[:, 0, 2], out[:, 2, 0] = y, -y
    out[:, 1, 2], out[:, 2, 1] = -x, x
    return out


def vector_part_jacobian(a: Array, b: Array, scale: Array) -> Array:
    """Jacobian of ``scale * vec(a (d, 1) b)`` with respect to d at 0, (m, 3, 3).

    Expanding the two Hamilton products with v, w the vector and scalar parts gives
    ``(w_a w_b + v_a.v_b) I - v_a v_b^T - v_b v_a^T + [w_b v_a - w_a v_b]x``.
    """
    ax, ay, az, aw = (scale * a[:, k] for k in range(4))
    bx, by, bz, bw = (b[:, k] for k in range(4))
    xx, yy, zz, ww = ax * bx, ay * by, az * bz, aw * bw
    xy, xz, yz = ax * by + ay * bx, ax * bz + az * bx, ay * bz + az * by
    sx, sy, sz = bw * ax - aw * bx, bw * ay - aw * by, bw * az - aw * bz
    out = np.empty((len(a), 3, 3))
    out[:, 0, 0] = ww - xx + yy + zz
    out[:, 1, 1] = ww + xx - yy + zz
    out[:, 2, 2] = ww + xx + yy - zz
    out[:, 0, 1], out[:, 1, 0] = -xy - sz, sz - xy
    out[:, 0, 2], out[:, 2, 0] = sy - xz, -xz - sy
    out[:, 1, 2], out[:, 2, 1] = -yz - sx, sx - yz
    return out
