"""SO(3), the rotations of space, as unit quaternions.

An element is (qx, qy, qz, qw), stored as ``(..., 4)``: Hamilton's convention (ij = k), scalar
last, the order of g2o's files. It maps body coordinates p to world coordinates R(q) p. q and
-q are the same rotation; no function but from_matrix picks the one with w >= 0. A tangent
vector omega is a rotation vector, axis times angle in radians, in the body frame wherever it
stands to the right of an element, as in x exp(omega).

retract and local are g2o's: their tangent vector is the vector part of a unit quaternion,
about half a rotation vector. compose does not renormalize; retract does.

Equations: J. Sola, J. Deray, D. Atchuthan, "A micro Lie theory for state estimation in
robotics", 2018 (arXiv:1812.01537), appendix B; J. Sola, "Quaternion kinematics for the
error-state Kalman filter", 2017 (arXiv:1711.02508); T. Barfoot, "State Estimation for
Robotics", 2017, section 7.1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import so2
from slamcli.geometry.quaternion import complete, conjugate, matrix_rows, multiply, rotate, unit, vector_part
from slamcli.geometry.so2 import PI, pack, unpack

Array = NDArray[np.float64]

SIZE = 4
DIM = 3


def identity(batch_shape: tuple[int, ...] = ()) -> Array:
    """Return the rotation by zero, ``(*batch_shape, 4)``."""
    out = np.zeros((*batch_shape, SIZE))
    out[..., 3] = 1.0
    return out


def normalize(x: Array) -> Array:
    """Scale quaternions (..., 4) to unit norm, keeping their sign.

    A quaternion of norm zero is no rotation and gives four NaN, without a warning.
    """
    return pack(*unit(unpack(x)))


def compose(x: Array, y: Array) -> Array:
    """Return the quaternion product x y, rotation by y and then by x; all are (..., 4)."""
    return pack(*multiply(unpack(x), unpack(y)))


def inverse(x: Array) -> Array:
    """Return the conjugate, the inverse of a unit quaternion; (..., 4) to (..., 4)."""
    return pack(*conjugate(unpack(x)))


def between(x: Array, y: Array) -> Array:
    """Return x^-1 y, the orientation y seen from x; all are (..., 4)."""
    return pack(*multiply(conjugate(unpack(x)), unpack(y)))


def act(x: Array, p: Array) -> Array:
    """Rotate points of space.

    Parameters
    ----------
    x : array (..., 4)
    p : array (..., 3)
        Coordinates in the rotated frame.

    Returns
    -------
    array (..., 3)
        Coordinates in the frame that x is an orientation in, R(x) p.
    """
    return pack(*rotate(unpack(x), unpack(p)))


def exp(xi: Array) -> Array:
    """Return the rotation by a rotation vector in radians; (..., 3) to (..., 4).

    It is (sin(a/2) xi / a, cos(a/2)) with a = |xi|, and so has w >= 0 for a up to pi.
    """
    half = 0.5 * norm(xi)
    scale = 0.5 * so2.sinc(half)
    return pack(scale * xi[..., 0], scale * xi[..., 1], scale * xi[..., 2], np.cos(half))


def log(x: Array) -> Array:
    """Return the shortest rotation vector that exp takes to x.

    Parameters
    ----------
    x : array (..., 4)
        Of either sign. The length does not matter.

    Returns
    -------
    array (..., 3)
        Of norm at most pi, radians. For a turn by exactly pi (w = 0) both senses are
        shortest, and the one along the vector part is returned.
    """
    # The arc tangent of the half angle is accurate everywhere, unlike arccos(w) near 0 or
    # arcsin near pi. Where the vector part is 0, the quotient is its limit, 2 / w.
    sine, w = norm(x), x[..., 3].copy()
    cosine = np.abs(w)
    divisor = np.where(sine == 0.0, np.where(cosine > 0.0, cosine, np.nan), sine)
    angle = np.where(sine == 0.0, 2.0, 2.0 * np.arctan2(sine, cosine))
    scale = np.where(w < 0.0, -angle, angle) / divisor
    return pack(scale * x[..., 0], scale * x[..., 1], scale * x[..., 2])


def adjoint(x: Array) -> Array:
    """Return Ad with x exp(xi) x^-1 = exp(Ad xi), here R(x); (..., 4) to (..., 3, 3)."""
    return to_matrix(x)


def left_jacobian(xi: Array) -> Array:
    """Return the left Jacobian of exp.

    Parameters
    ----------
    xi : array (..., 3), radians

    Returns
    -------
    array (..., 3, 3)
        J with exp(xi + d) ~ exp(J d) exp(xi) for small d.
    """
    angle = norm(xi)
    return polynomial(xi, so2.one_minus_cos_ratio(angle), so2.angle_minus_sin_ratio(angle))


def right_jacobian(xi: Array) -> Array:
    """Return the right Jacobian of exp, the left one of -xi; (..., 3) to (..., 3, 3).

    exp(xi + d) ~ exp(xi) exp(J d) for small d.
    """
    return left_jacobian(np.negative(xi))


def left_jacobian_inverse(xi: Array) -> Array:
    """Return the inverse of the left Jacobian; (..., 3) to (..., 3, 3).

    It is singular at angles that are multiples of 2 pi other than 0.
    """
    c = so2.one_minus_half_cot_ratio(norm(xi))
    return polynomial(xi, np.full_like(c, -0.5), c)


def right_jacobian_inverse(xi: Array) -> Array:
    """Return the inverse of the right Jacobian; (..., 3) to (..., 3, 3)."""
    return left_jacobian_inverse(np.negative(xi))


def wrap(xi: Array) -> Array:
    """Return the rotation vectors of norm at most pi with the same rotations; (..., 3).

    Vectors of norm up to pi come back bit for bit, in a new array.
    """
    angle = norm(xi)
    long = angle > PI
    if not np.any(long):
        return np.array(xi, dtype=np.float64)
    safe = np.where(long, angle, 1.0)
    scale = np.where(long, so2.wrap(safe) / safe, 1.0)
    return pack(scale * xi[..., 0], scale * xi[..., 1], scale * xi[..., 2])


def retract(x: Array, delta: Array) -> Array:
    """Move a rotation by a step in its own frame, as g2o does.

    Parameters
    ----------
    x : array (..., 4)
    delta : array (..., 3)
        Vector part of the unit quaternion of the step, sin(a/2) times the axis.

    Returns
    -------
    array (..., 4)
        x (delta, sqrt(1 - |delta|^2)), renormalized.

    Notes
    -----
    g2o: ``fromCompactQuaternion`` in isometry3d_mappings.cpp. A delta longer than 1, which
    is the vector part of nothing, is shortened to 1, half a turn about its axis. (g2o
    ignores the rotation of such a step altogether.)
    """
    return pack(*unit(multiply(unpack(x), complete(unpack(delta)))))


def local(x: Array, y: Array) -> Array:
    """Return the delta for which retract(x, delta) is y; (..., 4) twice to (..., 3).

    It is the vector part of x^-1 y with the sign that makes its scalar part w >= 0 (g2o's
    ``toCompactQuaternion``).
    """
    return pack(*vector_part(multiply(conjugate(unpack(x)), unpack(y))))


def to_matrix(x: Array) -> Array:
    """Return the rotation matrix of unit quaternions; (..., 4) to (..., 3, 3)."""
    out = np.empty((*np.shape(x)[:-1], 3, 3))
    for i, row in enumerate(matrix_rows(unpack(x))):
        for j, entry in enumerate(row):
            out[..., i, j] = entry
    return out


def from_matrix(T: Array) -> Array:
    """Return the unit quaternion of a rotation matrix.

    Parameters
    ----------
    T : array (..., 3, 3)
        May be off a rotation by rounding.

    Returns
    -------
    array (..., 4)
        With w >= 0.

    Notes
    -----
    The entries of R give all ten products of two components of q. The four rows of
    4 q q^T are each q up to scale; the one with the largest diagonal entry, at least 1,
    loses nothing to cancellation (S. Shepperd, "Quaternion from rotation matrix", 1978).
    """
    (m00, m01, m02), (m10, m11, m12), (m20, m21, m22) = (unpack(T[..., i, :]) for i in range(3))
    xy, xz, yz = m01 + m10, m02 + m20, m12 + m21
    xw, yw, zw = m21 - m12, m02 - m20, m10 - m01
    xx, yy = 1.0 + m00 - m11 - m22, 1.0 - m00 + m11 - m22
    zz, ww = 1.0 - m00 - m11 + m22, 1.0 + m00 + m11 + m22
    rows = ((xx, xy, xz, xw), (xy, yy, yz, yw), (xz, yz, zz, zw), (xw, yw, zw, ww))
    largest = np.argmax(np.stack((xx, yy, zz, ww)), axis=0)
    q = unit([np.choose(largest, row) for row in rows])
    return pack(*vector_part(q), np.abs(q[3]))


def from_euler(rpy: Array) -> Array:
    """Return the rotation Rz(yaw) Ry(pitch) Rx(roll).

    Parameters
    ----------
    rpy : array (..., 3)
        (roll, pitch, yaw) in radians, the order of TORO's files.

    Returns
    -------
    array (..., 4)
        Of either sign.
    """
    half = 0.5 * rpy
    (cr, cp, cy), (sr, sp, sy) = unpack(np.cos(half)), unpack(np.sin(half))
    return pack(
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def to_euler(x: Array) -> Array:
    """Return (roll, pitch, yaw) with R = Rz(yaw) Ry(pitch) Rx(roll).

    Parameters
    ----------
    x : array (..., 4)
        Of either sign.

    Returns
    -------
    array (..., 3)
        Radians; pitch in [-pi/2, pi/2], roll and yaw in [-pi, pi). At pitch +pi/2 only
        yaw - roll and at -pi/2 only yaw + roll is defined; the angles returned are one
        choice, and give x back.

    Notes
    -----
    With half angles, (w - y, x + z) is sqrt(2) cos(pitch/2 + pi/4) times the unit vector at
    (roll + yaw) / 2, and (w + y, x - z) is sqrt(2) sin(pitch/2 + pi/4) times the one at
    (roll - yaw) / 2. Unlike arcsin of an entry of R this keeps all digits near +-pi/2
    (E. Bernardes, S. Viollet, "Quaternion to Euler angles conversion", PLOS ONE 2022).
    """
    a, b, c, w = unpack(x)
    total = np.hypot(w - b, a + c) + np.hypot(w + b, a - c)
    half_sum, half_difference = np.arctan2(a + c, w - b), np.arctan2(a - c, w + b)
    return pack(
        so2.wrap(half_sum + half_difference),
        2.0 * np.arctan2(4.0 * (w * b - a * c), total * total),
        so2.wrap(half_sum - half_difference),
    )


def norm(v: Array) -> Array:
    """Return the Euclidean norm of the first three components; (..., >= 3) to (...)."""
    a, b, c = v[..., 0], v[..., 1], v[..., 2]
    return np.asarray(np.sqrt(a * a + b * b + c * c))


def skew(v: Array) -> Array:
    """Return the matrix of the cross product, skew(v) p = v x p; (..., 3) to (..., 3, 3)."""
    a, b, c = unpack(v)
    out = np.zeros((*np.shape(v)[:-1], 3, 3))
    out[..., 2, 1], out[..., 0, 2], out[..., 1, 0] = a, b, c
    out[..., 1, 2], out[..., 2, 0], out[..., 0, 1] = -a, -b, -c
    return out


def polynomial(xi: Array, a: Array, b: Array) -> Array:
    """Return 1 + a skew(xi) + b skew(xi)^2; (..., 3), (...), (...) to (..., 3, 3).

    Every function of skew(xi) has this form, because skew(xi)^3 = -|xi|^2 skew(xi).
    """
    x, y, z = unpack(xi)
    out = np.empty((*np.shape(xi)[:-1], 3, 3))
    xx, yy, zz = x * x, y * y, z * z
    out[..., 0, 0] = 1.0 - b * (yy + zz)
    out[..., 1, 1] = 1.0 - b * (zz + xx)
    out[..., 2, 2] = 1.0 - b * (xx + yy)
    bxy, bxz, byz = b * x * y, b * x * z, b * y * z
    ax, ay, az = a * x, a * y, a * z
    out[..., 0, 1], out[..., 1, 0] = bxy - az, bxy + az
    out[..., 0, 2], out[..., 2, 0] = bxz + ay, bxz - ay
    out[..., 1, 2], out[..., 2, 1] = byz - ax, byz + ax
    return out
