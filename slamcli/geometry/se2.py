"""SE(2), the poses of the plane.

An element is (x, y, theta), stored as ``(..., 3)``: position in the world frame and heading
in radians, in [-pi, pi). It maps body coordinates p to world coordinates R(theta) p + (x, y).
A tangent vector is (rho_x, rho_y, theta), translation first, in the body frame wherever it
stands to the right of an element, as in x exp(xi) and retract(x, xi).

Equations: J. Sola, J. Deray, D. Atchuthan, "A micro Lie theory for state estimation in
robotics", 2018 (arXiv:1812.01537), appendix C. The Jacobians of exp are written with
a = (1 - cos theta) / theta^2, b = (theta - sin theta) / theta^3 and
c = (1 - theta/2 cot(theta/2)) / theta^2: because ad^3 = -theta^2 ad here, the series
sum ad^n / (n + 1)! and its inverse sum up to 1 + a ad + b ad^2 and 1 - ad / 2 + c ad^2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import so2
from slamcli.geometry.so2 import pack, unpack

Array = NDArray[np.float64]

SIZE = 3
DIM = 3


def identity(batch_shape: tuple[int, ...] = ()) -> Array:
    """Return the pose at the origin, ``(*batch_shape, 3)``."""
    return np.zeros((*batch_shape, SIZE))


def normalize(x: Array) -> Array:
    """Bring the heading of ``x`` (..., 3) to [-pi, pi)."""
    return pack(x[..., 0], x[..., 1], so2.wrap(x[..., 2]))


def compose(x: Array, y: Array) -> Array:
    """Return x y, (t_x + R(theta_x) t_y, theta_x + theta_y wrapped); all are (..., 3)."""
    (tx, ty, theta), (u, v, turn) = unpack(x), unpack(y)
    c, s = np.cos(theta), np.sin(theta)
    return pack(tx + (c * u - s * v), ty + (s * u + c * v), so2.wrap(theta + turn))


def inverse(x: Array) -> Array:
    """Return the pose of the world seen from x, (-R^T t, -theta); (..., 3) to (..., 3)."""
    u, v, theta = unpack(x)
    c, s = np.cos(theta), np.sin(theta)
    return pack(-(c * u + s * v), s * u - c * v, so2.wrap(-theta))


def between(x: Array, y: Array) -> Array:
    """Return x^-1 y, the pose y seen from x; all are (..., 3).

    The positions are subtracted before they are rotated, so that two close poses far from
    the origin keep their digits.
    """
    (tx, ty, theta), (u, v, heading) = unpack(x), unpack(y)
    c, s = np.cos(theta), np.sin(theta)
    u, v = u - tx, v - ty
    return pack(c * u + s * v, c * v - s * u, so2.wrap(heading - theta))


def chain(start: Array, steps: Array) -> Array:
    """Return the poses (n + 1, 3) that begin at ``start`` (3,) and follow relative poses (n, 3): dead reckoning.

    Headings are sums of turns and are not wrapped; positions are sums of rotated steps.
    """
    turned = np.zeros_like(steps, shape=len(steps) + 1)
    turned[1:] = np.cumsum(steps[:, 2])
    heading = start[2] + turned
    c, s = np.cos(heading[:-1]), np.sin(heading[:-1])
    x, y = c * steps[:, 0] - s * steps[:, 1], s * steps[:, 0] + c * steps[:, 1]
    along, across = (np.concatenate([[0.0], np.cumsum(part)]) for part in (x, y))
    return pack(start[0] + along, start[1] + across, heading)


def act(x: Array, p: Array) -> Array:
    """Map points from the body frame to the world.

    Parameters
    ----------
    x : array (..., 3)
    p : array (..., 2)
        Coordinates in the frame of the pose x.

    Returns
    -------
    array (..., 2)
        Coordinates in the frame that x is given in, R p + t.
    """
    (tx, ty, theta), (u, v) = unpack(x), unpack(p)
    c, s = np.cos(theta), np.sin(theta)
    return pack(tx + (c * u - s * v), ty + (s * u + c * v))


def exp(xi: Array) -> Array:
    """Return the pose reached by moving with the body-frame twist xi for one unit of time.

    Parameters
    ----------
    xi : array (..., 3)
        (rho, theta); theta may be any angle, full turns change the path.

    Returns
    -------
    array (..., 3)
        (V(theta) rho, theta wrapped), V = [[sin, cos - 1], [1 - cos, sin]] / theta.
    """
    u, v, theta = unpack(xi)
    along = so2.sinc(theta)
    across = theta * so2.one_minus_cos_ratio(theta)
    return pack(along * u - across * v, across * u + along * v, so2.wrap(theta))


def log(x: Array) -> Array:
    """Return the tangent vector of least rotation that exp takes to x.

    Parameters
    ----------
    x : array (..., 3)

    Returns
    -------
    array (..., 3)
        (V(theta)^-1 t, theta), theta in [-pi, pi). The inverse of V is
        [[h cot h, h], [-h, h cot h]] with h = theta / 2, regular in that range.
    """
    u, v, theta = unpack(normalize(x))
    half, diagonal = 0.5 * theta, so2.half_cot(theta)
    return pack(diagonal * u + half * v, diagonal * v - half * u, theta)


def adjoint(x: Array) -> Array:
    """Return the matrix Ad with x exp(xi) x^-1 = exp(Ad xi).

    Parameters
    ----------
    x : array (..., 3)

    Returns
    -------
    array (..., 3, 3)
        [[R, (y, -x)^T], [0, 1]].
    """
    out = to_matrix(x)
    out[..., 0, 2] = x[..., 1]
    out[..., 1, 2] = -x[..., 0]
    return out


def left_jacobian(xi: Array) -> Array:
    """Return the left Jacobian of exp.

    Parameters
    ----------
    xi : array (..., 3)

    Returns
    -------
    array (..., 3, 3)
        J with exp(xi + d) ~ exp(J d) exp(xi) for small d.
    """
    theta = xi[..., 2]
    a, b = so2.one_minus_cos_ratio(theta), so2.angle_minus_sin_ratio(theta)
    return _jacobian(xi, so2.sinc(theta), a, b)


def right_jacobian(xi: Array) -> Array:
    """Return the right Jacobian of exp, the left one of -xi; (..., 3) to (..., 3, 3).

    exp(xi + d) ~ exp(xi) exp(J d) for small d.
    """
    return left_jacobian(-xi)


def left_jacobian_inverse(xi: Array) -> Array:
    """Return the inverse of the left Jacobian; (..., 3) to (..., 3, 3).

    It is singular where theta is a multiple of 2 pi other than 0.
    """
    theta = xi[..., 2]
    c = so2.one_minus_half_cot_ratio(theta)
    return _jacobian(xi, so2.half_cot(theta), np.full_like(c, -0.5), c)


def right_jacobian_inverse(xi: Array) -> Array:
    """Return the inverse of the right Jacobian; (..., 3) to (..., 3, 3)."""
    return left_jacobian_inverse(-xi)


def _jacobian(xi: Array, diagonal: Array, a: Array, b: Array) -> Array:
    """Return 1 + a ad + b ad^2; the two corner entries are diagonal = 1 - b theta^2."""
    u, v, theta = unpack(xi)
    out = np.empty((*np.shape(xi)[:-1], DIM, DIM))
    out[..., 0, 0] = out[..., 1, 1] = diagonal
    out[..., 1, 0] = a * theta
    out[..., 0, 1] = -a * theta
    out[..., 0, 2] = a * v + b * theta * u
    out[..., 1, 2] = b * theta * v - a * u
    out[..., 2, 0], out[..., 2, 1], out[..., 2, 2] = 0.0, 0.0, 1.0
    return out


def wrap(xi: Array) -> Array:
    """Bring the angle of a tangent vector (..., 3) to [-pi, pi); rho stays as it is.

    Meant for differences of coordinates. It is not exp-invariant: a whole turn on an arc
    and no turn on a straight line end at different places.
    """
    return normalize(xi)


def retract(x: Array, delta: Array) -> Array:
    """Move a pose by a step in its own frame.

    Parameters
    ----------
    x : array (..., 3)
    delta : array (..., 3)
        (d_t in the body frame, d_theta in radians).

    Returns
    -------
    array (..., 3)
        (t + R(theta) d_t, theta + d_theta wrapped), which is x compose delta.

    Notes
    -----
    g2o's ``VertexSE2::oplus`` adds its d_t in the world frame: a step w of g2o is the step
    R^T w here. Gauss-Newton steps, and steps damped by a multiple of the identity, reach the
    same pose either way. Covariances of the two differ by the rotation R.
    """
    return compose(x, delta)


def local(x: Array, y: Array) -> Array:
    """Return (R_x^T (t_y - t_x), theta_y - theta_x wrapped); all are (..., 3).

    It is the delta for which retract(x, delta) is y.
    """
    return between(x, y)


def to_matrix(x: Array) -> Array:
    """Return the homogeneous matrix [[R, t], [0, 1]]; (..., 3) to (..., 3, 3)."""
    u, v, theta = unpack(x)
    out = np.empty((*np.shape(x)[:-1], 3, 3))
    out[..., 0, 0] = out[..., 1, 1] = np.cos(theta)
    out[..., 1, 0] = sine = np.sin(theta)
    out[..., 0, 1] = -sine
    out[..., 0, 2], out[..., 1, 2] = u, v
    out[..., 2, 0], out[..., 2, 1], out[..., 2, 2] = 0.0, 0.0, 1.0
    return out


def from_matrix(T: Array) -> Array:
    """Return the pose of a homogeneous matrix; (..., 3, 3) to (..., 3).

    Its upper left block may be off a rotation by rounding or scale; the nearest one counts.
    """
    theta = so2.from_matrix(T[..., :2, :2])
    return pack(T[..., 0, 2], T[..., 1, 2], theta[..., 0])
