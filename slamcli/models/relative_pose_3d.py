"""Relative pose of two spatial poses: g2o's EDGE_SE3:QUAT."""

from __future__ import annotations

import numpy as np

from slamcli.geometry import quaternion, se3
from slamcli.geometry.quaternion import Components
from slamcli.models.base import Array, FactorKind, components
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
        residual = np.empty((len(measurement), 6))
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
        jacobian_i, jacobian_j = jacobians
        u, sign, z_conjugate, delta, error = _residual(residual, x[0], x[1], measurement)
        u2 = [2.0 * k for k in u]
        for row, entries in enumerate(quaternion.matrix_rows(z_conjugate)):
            for column, entry in enumerate(entries):
                np.negative(entry, out=jacobian_i[:, row, column])
            # R_i (I + 2[d]x) transposed acts on u as u - 2 d x u = u + 2 [u]x d
            # (a row times a skew matrix is the cross product of the row with its vector)
            for column, entry in enumerate(quaternion.cross(entries, u2)):
                jacobian_i[:, row, 3 + column] = entry
        vector_part_jacobian(jacobian_i[:, 3:, 3:], z_conjugate, delta, -sign)
        for row, entries in enumerate(quaternion.matrix_rows(error)):
            for column, entry in enumerate(entries):
                jacobian_j[:, row, column] = entry
        vector_part_right_jacobian(jacobian_j[:, 3:, 3:], error, sign)


def _residual(
    residual: Array, pose_i: Array, pose_j: Array, z: Array
) -> tuple[Components, Array, Components, Components, Components]:
    """Write the residual; return u = R_i^T (t_j - t_i), the sign that makes w >= 0, and q_z*, q_i* q_j and q_E."""
    i, j, d = components(pose_i), components(pose_j), components(z)
    i_conjugate, z_conjugate = quaternion.conjugate(i[3:]), quaternion.conjugate(d[3:])
    u = quaternion.rotate(i_conjugate, [j[k] - i[k] for k in range(3)])
    delta = quaternion.multiply(i_conjugate, j[3:])
    error = quaternion.multiply(z_conjugate, delta)
    sign = np.where(error[3] < 0.0, -1.0, 1.0)
    for k, translation in enumerate(quaternion.rotate(z_conjugate, [u[k] - d[k] for k in range(3)])):
        residual[:, k] = translation
        np.multiply(sign, error[k], out=residual[:, 3 + k])
    return u, sign, z_conjugate, delta, error


def vector_part_right_jacobian(out: Array, a: Components, scale: Array) -> None:
    """Write the Jacobian of ``scale * vec(a (d, sqrt(1 - d^2)))`` at d = 0: ``scale (w I + [v]x)``, (m, 3, 3)."""
    x, y, z, w = (scale * k for k in a)
    out[:, 0, 0] = out[:, 1, 1] = out[:, 2, 2] = w
    out[:, 0, 1], out[:, 1, 0] = -z, z
    out[:, 0, 2], out[:, 2, 0] = y, -y
    out[:, 1, 2], out[:, 2, 1] = -x, x


def vector_part_jacobian(out: Array, a: Components, b: Components, scale: Array) -> None:
    """Write the Jacobian of ``scale * vec(a (d, 1) b)`` with respect to d at 0, (m, 3, 3).

    Expanding the two Hamilton products with v, w the vector and scalar parts gives
    ``(w_a w_b + v_a.v_b) I - v_a v_b^T - v_b v_a^T + [w_b v_a - w_a v_b]x``.
    """
    ax, ay, az, aw = (scale * k for k in a)
    bx, by, bz, bw = b
    xx, yy, zz, ww = ax * bx, ay * by, az * bz, aw * bw
    xy, xz, yz = ax * by + ay * bx, ax * bz + az * bx, ay * bz + az * by
    sx, sy, sz = bw * ax - aw * bx, bw * ay - aw * by, bw * az - aw * bz
    out[:, 0, 0] = ww - xx + yy + zz
    out[:, 1, 1] = ww + xx - yy + zz
    out[:, 2, 2] = ww + xx + yy - zz
    out[:, 0, 1], out[:, 1, 0] = -xy - sz, sz - xy
    out[:, 0, 2], out[:, 2, 0] = sy - xz, -xz - sy
    out[:, 1, 2], out[:, 2, 1] = -yz - sx, sx - yz
