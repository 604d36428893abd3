"""The TORO text format, 2-D and 3-D: its tag table, its order of the information and its frame.

2-D: ``EDGE2 i j dx dy dtheta I11 I12 I22 I33 I13 I23`` (that order). 3-D: ``EDGE3 i j x y z roll pitch yaw`` and the
upper triangle, row by row, of a 6x6 information, which may be left out (then it is the identity).

TORO's information weighs errors of the numbers in the record: a translation seen from pose i, an angle or three
Euler angles (R = Rz(yaw) Ry(pitch) Rx(roll)). Our residuals (g2o's) have the translation in the frame of the
measured pose j and the vector part of a quaternion, so

    Omega = J^T Omega_toro J

with J the Jacobian of the record's numbers by our residual at the measurement: in 2-D ``diag(R(dtheta), 1)``, which
is exact for every residual; in 3-D ``diag(R_z, 2 W^-1)``, exact for the translation and to first order for the
rotation, where W maps Euler rates to the body's angular velocity (Diebel 2006, "Representing Attitude", eq. 288).
"""

from __future__ import annotations

import numpy as np

from slamcli import models
from slamcli.formats.dialect import Dialect, EdgeTag, VertexTag
from slamcli.geometry import so3
from slamcli.models import FactorKind
from slamcli.models.base import Array
from slamcli.models.information import from_upper_triangle, to_upper_triangle

#: Positions in TORO's I11 I12 I22 I33 I13 I23 of the row-by-row order I11 I12 I13 I22 I23 I33, and back.
_ROW_ORDER = [0, 1, 4, 2, 5, 3]
_TORO_ORDER = [0, 1, 3, 5, 2, 4]


def _decode_2d(kind: FactorKind, measurement: Array, numbers: Array) -> tuple[Array, Array]:
    information = from_upper_triangle(numbers[:, _ROW_ORDER], 3)
    return measurement, _rotated(information, _frame_2d(measurement))


def _encode_2d(kind: FactorKind, measurement: Array, information: Array) -> tuple[Array, Array]:
    back = _frame_2d(measurement).transpose(0, 2, 1)
    return measurement, to_upper_triangle(_rotated(information, back))[:, _TORO_ORDER]


def _decode_3d(kind: FactorKind, measurement: Array, numbers: Array) -> tuple[Array, Array]:
    information = from_upper_triangle(numbers, 6)
    return pose_from_euler(measurement), _rotated(information, _record_by_residual(measurement[:, 3:]))


def _encode_3d(kind: FactorKind, measurement: Array, information: Array) -> tuple[Array, Array]:
    record = pose_to_euler(measurement)
    return record, to_upper_triangle(_rotated(information, _residual_by_record(record[:, 3:])))


def pose_from_euler(numbers: Array) -> Array:
    """Poses (n, 7) from x y z roll pitch yaw."""
    return np.concatenate([numbers[:, :3], so3.from_euler(numbers[:, 3:])], axis=1)


def pose_to_euler(values: Array) -> Array:
    """Inverse of ``pose_from_euler``."""
    return np.concatenate([values[:, :3], so3.to_euler(values[:, 3:])], axis=1)


def _rotated(information: Array, jacobian: Array) -> Array:
    """J^T Omega J, made symmetric to the last bit."""
    with np.errstate(all="ignore"):  # what is not finite is refused by the reader and by the writer
        product = jacobian.transpose(0, 2, 1) @ information @ jacobian
    return 0.5 * (product + product.transpose(0, 2, 1))


def _frame_2d(measurement: Array) -> Array:
    """J = diag(R(dtheta), 1), (m, 3, 3)."""
    cosine, sine = np.cos(measurement[:, 2]), np.sin(measurement[:, 2])
    out = np.zeros((len(measurement), 3, 3))
    out[:, 0, 0] = out[:, 1, 1] = cosine
    out[:, 0, 1], out[:, 1, 0] = -sine, sine
    out[:, 2, 2] = 1.0
    return out


def _record_by_residual(euler: Array) -> Array:
    """J = diag(R_z, 2 W^-1): Jacobian of the record's numbers by our residual, (m, 6, 6)."""
    return np.asarray(np.linalg.inv(_residual_by_record(euler)), dtype=np.float64)


def _residual_by_record(euler: Array) -> Array:
    """J^-1 = diag(R_z^T, W / 2): Jacobian of our residual by the record's numbers, (m, 6, 6)."""
    roll, pitch = euler[:, 0], euler[:, 1]
    out = np.zeros((len(euler), 6, 6))
    out[:, :3, :3] = so3.to_matrix(so3.inverse(so3.from_euler(euler)))
    out[:, 3, 3] = 0.5
    out[:, 3, 5] = -0.5 * np.sin(pitch)
    out[:, 4, 4] = 0.5 * np.cos(roll)
    out[:, 4, 5] = 0.5 * np.sin(roll) * np.cos(pitch)
    out[:, 5, 4] = -0.5 * np.sin(roll)
    out[:, 5, 5] = 0.5 * np.cos(roll) * np.cos(pitch)
    return out


TORO = Dialect(
    name="toro",
    vertices=(
        VertexTag("VERTEX2", models.SE2, 3),
        VertexTag("VERTEX", models.SE2, 3),
        VertexTag("VERTEX3", models.SE3, 6, pose_from_euler, pose_to_euler),
    ),
    edges=(
        EdgeTag("EDGE2", models.RELATIVE_POSE_2D, 3, decode=_decode_2d, encode=_encode_2d),
        EdgeTag("EDGE", models.RELATIVE_POSE_2D, 3, decode=_decode_2d, encode=_encode_2d),
        EdgeTag("EDGE3", models.RELATIVE_POSE_3D, 6, True, _decode_3d, _encode_3d),
    ),
    unused={"EQUIV": "poses are not merged, so the graph lacks these closures"},
)
