"""SE(3), the poses of space.

An element is (x, y, z, qx, qy, qz, qw), stored as ``(..., 7)``: position in the world frame
and a unit quaternion as in ``so3``, the order of g2o's VERTEX_SE3:QUAT. It maps body
coordinates p to world coordinates R(q) p + (x, y, z). A tangent vector is (rho, omega), three
numbers of translation first, then a rotation vector in radians; it is in the body frame
wherever it stands to the right of an element, as in x exp(xi). (g2o's SE3 EXPMAP types put
omega first.) Translation has the unit of the file, metres by custom.

retract and local are g2o's: their tangent vector is (translation, vector part of a unit
quaternion). compose does not renormalize the quaternion; retract does.

Equations: J. Sola, J. Deray, D. Atchuthan, "A micro Lie theory for state estimation in
robotics", 2018 (arXiv:1812.01537), appendix D; T. Barfoot, "State Estimation for Robotics",
2017, sections 7.1.3 to 7.1.5. The Jacobians use that a twist is a rotation vector with dual
components, omega + eps rho with eps^2 = 0: the translation block of a function of the twist
is the derivative, at omega along rho, of the same function on SO(3).
"""

from __future__ import annotations

from math import factorial

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import quaternion, so2, so3
from slamcli.geometry.so2 import pack, unpack

Array = NDArray[np.float64]

SIZE = 7
DIM = 6


def identity(batch_shape: tuple[int, ...] = ()) -> Array:
    """Return the pose at the origin, ``(*batch_shape, 7)``."""
    out = np.zeros((*batch_shape, SIZE))
    out[..., 6] = 1.0
    return out


def normalize(x: Array) -> Array:
    """Scale the quaternion of ``x`` (..., 7) to unit norm; of norm zero, it becomes NaN."""
    tx, ty, tz, *q = unpack(x)
    return pack(tx, ty, tz, *quaternion.unit(q))


def compose(x: Array, y: Array) -> Array:
    """Return x y, (t_x + R_x t_y, q_x q_y); all are (..., 7)."""
    (tx, ty, tz, *qx), (u, v, w, *qy) = unpack(x), unpack(y)
    u, v, w = quaternion.rotate(qx, (u, v, w))
    return pack(tx + u, ty + v, tz + w, *quaternion.multiply(qx, qy))


def inverse(x: Array) -> Array:
    """Return the pose of the world seen from x, (-R^T t, q^-1); (..., 7) to (..., 7)."""
    tx, ty, tz, *q = unpack(x)
    back = quaternion.conjugate(q)
    return pack(*quaternion.rotate(back, (-tx, -ty, -tz)), *back)


def between(x: Array, y: Array) -> Array:
    """Return x^-1 y, the pose y seen from x; all are (..., 7).

    The positions are subtracted before they are rotated, so that two close poses far from
    the origin keep their digits.
    """
    (tx, ty, tz, *qx), (u, v, w, *qy) = unpack(x), unpack(y)
    back = quaternion.conjugate(qx)
    return pack(*quaternion.rotate(back, (u - tx, v - ty, w - tz)), *quaternion.multiply(back, qy))


def act(x: Array, p: Array) -> Array:
    """Map points from the body frame to the world.

    Parameters
    ----------
    x : array (..., 7)
    p : array (..., 3)
        Coordinates in the frame of the pose x.

    Returns
    -------
    array (..., 3)
        Coordinates in the frame that x is given in, R p + t.
    """
    tx, ty, tz, *q = unpack(x)
    u, v, w = quaternion.rotate(q, unpack(p))
    return pack(tx + u, ty + v, tz + w)


def exp(xi: Array) -> Array:
    """Return the pose reached by moving with the body-frame twist xi for one unit of time.

    Parameters
    ----------
    xi : array (..., 6)
        (rho, omega).

    Returns
    -------
    array (..., 7)
        (V rho, exp(omega)), V the left Jacobian of SO(3) at omega.
    """
    rho, omega = xi[..., :3], xi[..., 3:]
    angle = so3.norm(omega)
    a, b = so2.one_minus_cos_ratio(angle), so2.angle_minus_sin_ratio(angle)
    return pack(*_apply(omega, a, b, rho), *unpack(so3.exp(omega)))


def log(x: Array) -> Array:
    """Return the tangent vector of least rotation that exp takes to x.

    Parameters
    ----------
    x : array (..., 7)
        With a quaternion of either sign.

    Returns
    -------
    array (..., 6)
        (V^-1 t, omega), with the norm of omega at most pi; see so3.log.
    """
    omega = so3.log(x[..., 3:])
    c = so2.one_minus_half_cot_ratio(so3.norm(omega))
    return pack(*_apply(omega, np.full_like(c, -0.5), c, x[..., :3]), *unpack(omega))


def adjoint(x: Array) -> Array:
    """Return the matrix Ad with x exp(xi) x^-1 = exp(Ad xi).

    Parameters
    ----------
    x : array (..., 7)

    Returns
    -------
    array (..., 6, 6)
        [[R, skew(t) R], [0, R]].
    """
    rotation = so3.to_matrix(x[..., 3:])
    return _blocks(rotation, np.matmul(so3.skew(x[..., :3]), rotation))


def left_jacobian(xi: Array) -> Array:
    """Return the left Jacobian of exp.

    Parameters
    ----------
    xi : array (..., 6)

    Returns
    -------
    array (..., 6, 6)
        J with exp(xi + d) ~ exp(J d) exp(xi) for small d. It is [[V, Q], [0, V]] with V as
        in exp and Q the derivative of V at omega along rho, which is Barfoot's Q_l
        (section 7.1.5) in fewer terms.
    """
    rho, omega = xi[..., :3], xi[..., 3:]
    angle = so3.norm(omega)
    a, b = so2.one_minus_cos_ratio(angle), so2.angle_minus_sin_ratio(angle)
    da = so2.series_near_zero(angle, _A_SLOPE, _a_slope)
    db = so2.series_near_zero(angle, _B_SLOPE, _b_slope)
    return _blocks(so3.polynomial(omega, a, b), _polynomial_slope(omega, rho, a, b, da, db))


def right_jacobian(xi: Array) -> Array:
    """Return the right Jacobian of exp, the left one of -xi; (..., 6) to (..., 6, 6).

    exp(xi + d) ~ exp(xi) exp(J d) for small d.
    """
    return left_jacobian(np.negative(xi))


def left_jacobian_inverse(xi: Array) -> Array:
    """Return the inverse of the left Jacobian; (..., 6) to (..., 6, 6).

    It is singular at angles that are multiples of 2 pi other than 0.
    """
    rho, omega = xi[..., :3], xi[..., 3:]
    angle = so3.norm(omega)
    c = so2.one_minus_half_cot_ratio(angle)
    dc = so2.series_near_zero(angle, _C_SLOPE, _c_slope)
    a, da = np.full_like(c, -0.5), np.zeros_like(c)
    return _blocks(so3.polynomial(omega, a, c), _polynomial_slope(omega, rho, a, c, da, dc))


def right_jacobian_inverse(xi: Array) -> Array:
    """Return the inverse of the right Jacobian; (..., 6) to (..., 6, 6)."""
    return left_jacobian_inverse(np.negative(xi))


def wrap(xi: Array) -> Array:
    """Bring the rotation vector of ``xi`` (..., 6) to a norm of at most pi; rho stays.

    It is not exp-invariant: a whole turn on a screw and a straight line end apart.
    """
    return pack(*unpack(xi[..., :3]), *unpack(so3.wrap(xi[..., 3:])))


def retract(x: Array, delta: Array) -> Array:
    """Move a pose by a step in its own frame, as g2o's ``VertexSE3::oplus`` does.

    Parameters
    ----------
    x : array (..., 7)
    delta : array (..., 6)
        (d_t in the body frame, vector part of a unit quaternion). See so3.retract for a
        vector part longer than 1.

    Returns
    -------
    array (..., 7)
        (t + R d_t, q (d, sqrt(1 - |d|^2)) renormalized).
    """
    (tx, ty, tz, *q), (u, v, w, *d) = unpack(x), unpack(delta)
    u, v, w = quaternion.rotate(q, (u, v, w))
    return pack(tx + u, ty + v, tz + w, *quaternion.unit(quaternion.multiply(q, quaternion.complete(d))))


def local(x: Array, y: Array) -> Array:
    """Return the delta for which retract(x, delta) is y.

    Parameters
    ----------
    x, y : array (..., 7)

    Returns
    -------
    array (..., 6)
        (R_x^T (t_y - t_x), vector part of q_x^-1 q_y with w >= 0): g2o's ``toVectorMQT``
        of x^-1 y.
    """
    u, v, w, *q = unpack(between(x, y))
    return pack(u, v, w, *quaternion.vector_part(q))


def to_matrix(x: Array) -> Array:
    """Return the homogeneous matrix [[R, t], [0, 1]]; (..., 7) to (..., 4, 4)."""
    out = np.empty((*np.shape(x)[:-1], 4, 4))
    out[..., :3, :3] = so3.to_matrix(x[..., 3:])
    out[..., :3, 3] = x[..., :3]
    out[..., 3, :3], out[..., 3, 3] = 0.0, 1.0
    return out


def from_matrix(T: Array) -> Array:
    """Return the pose of a homogeneous matrix, with qw >= 0; (..., 4, 4) to (..., 7)."""
    return pack(*unpack(T[..., :3, 3]), *unpack(so3.from_matrix(T[..., :3, :3])))


def _apply(omega: Array, a: Array, b: Array, v: Array) -> list[Array]:
    """Return the components of (1 + a skew(omega) + b skew(omega)^2) v, all (..., 3)."""
    axis, vector = unpack(omega), unpack(v)
    once = quaternion.cross(axis, vector)
    twice = quaternion.cross(axis, once)
    return [p + a * q + b * r for p, q, r in zip(vector, once, twice, strict=True)]


def _blocks(diagonal: Array, corner: Array) -> Array:
    """Return [[diagonal, corner], [0, diagonal]]; (..., 3, 3) twice to (..., 6, 6)."""
    out = np.zeros((*diagonal.shape[:-2], DIM, DIM))
    out[..., :3, :3] = out[..., 3:, 3:] = diagonal
    out[..., :3, 3:] = corner
    return out


def _polynomial_slope(omega: Array, rho: Array, a: Array, b: Array, da: Array, db: Array) -> Array:
    """Return the derivative of so3.polynomial(omega, a, b) at omega along rho.

    Parameters
    ----------
    omega, rho : array (..., 3)
    a, b, da, db : array (...)
        Functions of the norm of omega and their derivatives by it, divided by it, so that
        along rho they change at the rates s da and s db with s = omega . rho.

    Returns
    -------
    array (..., 3, 3)
        skew(a rho + s da omega) + b (omega rho^T + rho omega^T - 2 s) + s db skew(omega)^2.
    """
    (x, y, z), (u, v, w) = unpack(omega), unpack(rho)
    xu, yv, zw = x * u, y * v, z * w
    dot = xu + yv + zw
    sda, sdb = dot * da, dot * db
    out = np.empty((*omega.shape[:-1], 3, 3))
    out[..., 0, 0] = -2.0 * b * (yv + zw) - sdb * (y * y + z * z)
    out[..., 1, 1] = -2.0 * b * (zw + xu) - sdb * (z * z + x * x)
    out[..., 2, 2] = -2.0 * b * (xu + yv) - sdb * (x * x + y * y)
    mxy = b * (x * v + y * u) + sdb * x * y
    mxz = b * (x * w + z * u) + sdb * x * z
    myz = b * (y * w + z * v) + sdb * y * z
    kx, ky, kz = a * u + sda * x, a * v + sda * y, a * w + sda * z
    out[..., 0, 1], out[..., 1, 0] = mxy - kz, mxy + kz
    out[..., 0, 2], out[..., 2, 0] = mxz + ky, mxz - ky
    out[..., 1, 2], out[..., 2, 1] = myz - kx, myz + kx
    return out


# f'(angle) / angle for the coefficients a, b of the Jacobian and c of its inverse
# (so2.one_minus_cos_ratio, angle_minus_sin_ratio, one_minus_half_cot_ratio): the series of
# f' / angle follows from that of f term by term.
_A_SLOPE = tuple((-1) ** k * 2 * k / factorial(2 * k + 2) for k in range(1, 11))
_B_SLOPE = tuple(2 * k * c for k, c in enumerate(so2.SIN_TAIL))[1:]
_C_SLOPE = tuple(2 * k * c for k, c in enumerate(so2.COT_TAIL))[1:]


def _a_slope(angle: Array) -> Array:
    return np.asarray((so2.sinc(angle) - 2.0 * so2.one_minus_cos_ratio(angle)) / angle**2)


def _b_slope(angle: Array) -> Array:
    a, b = so2.one_minus_cos_ratio(angle), so2.angle_minus_sin_ratio(angle)
    return np.asarray((a - 3.0 * b) / angle**2)


def _c_slope(angle: Array) -> Array:
    c, diagonal = so2.one_minus_half_cot_ratio(angle), so2.half_cot(angle)
    return np.asarray((0.25 - c * (diagonal + 2.0)) / angle**2)
