"""SO(2), the rotations of the plane, and the functions of an angle all groups share.

An element is its angle theta in radians, stored as ``(..., 1)`` and kept in [-pi, pi), the
range of g2o's ``normalize_theta``. The group is commutative and its tangent vector is the
angle too, so exp and log only wrap and every Jacobian is 1.

Equations: J. Sola, J. Deray, D. Atchuthan, "A micro Lie theory for state estimation in
robotics", 2018 (arXiv:1812.01537), appendix A. The scalar functions at the end of the file
are the coefficients of exp and of the Jacobians in the other groups.
"""

from __future__ import annotations

from collections.abc import Callable
from math import factorial

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SIZE = 1
DIM = 1

PI = float(np.pi)
TAU = 2.0 * PI


def unpack(x: Array) -> list[Array]:
    """Split the last axis; (..., k) to k arrays (...).

    They are contiguous copies: arithmetic on every seventh number of an array is several
    times slower than on a row of them, and each component is used more than once.
    """
    return [x[..., i].copy() for i in range(x.shape[-1])]


def pack(*components: Array) -> Array:
    """Put k arrays (...) side by side on a new last axis, broadcasting; to (..., k)."""
    shape = np.broadcast_shapes(*(np.shape(c) for c in components))
    out = np.empty((*shape, len(components)))
    for i, component in enumerate(components):
        out[..., i] = component
    return out


def wrap(xi: Array) -> Array:
    """Bring angles to [-pi, pi), elementwise.

    Parameters
    ----------
    xi : array of any shape, radians

    Returns
    -------
    array of the same shape
        A new array. Values inside the range come back bit for bit; the others are moved by
        multiples of TAU, the double nearest 2 pi. Infinite angles give NaN.

    Notes
    -----
    No step rounds: ``fmod`` is exact, so are the products of TAU with up to 8, because its
    last three bits are zero, and so is the difference, which keeps the last bit of both.
    """
    if np.size(xi) == 0 or _in_range(xi, PI):
        return np.array(xi, dtype=np.float64)
    if not _in_range(xi, 8.0 * TAU):
        with np.errstate(invalid="ignore"):
            xi = np.fmod(xi, TAU)
    out = np.asarray(xi / TAU)
    np.rint(out, out=out)
    out += 0.0  # of -0.0 makes 0.0: an angle -0.0 is to stay what it is
    out *= TAU
    np.subtract(xi, out, out=out)
    # Halves are rounded to the even number: odd multiples of pi end at either end.
    np.copyto(out, -PI, where=out == PI)
    return out


def _in_range(angle: Array, bound: float) -> bool:
    """Whether all angles are in [-bound, bound); False if one is NaN."""
    return bool(np.min(angle) >= -bound and np.max(angle) < bound)


def identity(batch_shape: tuple[int, ...] = ()) -> Array:
    """Return the rotation by zero, ``(*batch_shape, 1)``."""
    return np.zeros((*batch_shape, SIZE))


def normalize(x: Array) -> Array:
    """Bring the angle of ``x`` (..., 1) to [-pi, pi)."""
    return wrap(x)


def compose(x: Array, y: Array) -> Array:
    """Return x y, the rotation by y and then by x; all are (..., 1)."""
    return wrap(x + y)


def inverse(x: Array) -> Array:
    """Return the rotation by -x; (..., 1) to (..., 1)."""
    return wrap(-x)


def between(x: Array, y: Array) -> Array:
    """Return x^-1 y, the orientation y seen from x; all are (..., 1)."""
    return wrap(y - x)


def act(x: Array, p: Array) -> Array:
    """Rotate points of the plane.

    Parameters
    ----------
    x : array (..., 1)
    p : array (..., 2)
        Coordinates in the rotated frame.

    Returns
    -------
    array (..., 2)
        Coordinates in the frame that x is an orientation in, R(x) p.
    """
    c, s = np.cos(x[..., 0]), np.sin(x[..., 0])
    u, v = unpack(p)
    return pack(c * u - s * v, s * u + c * v)


def exp(xi: Array) -> Array:
    """Return the rotation by the angle xi; (..., 1) to (..., 1)."""
    return wrap(xi)


def log(x: Array) -> Array:
    """Return the angle of x in [-pi, pi); (..., 1) to (..., 1)."""
    return wrap(x)


def adjoint(x: Array) -> Array:
    """Return the adjoint matrix, 1 in a commutative group; (..., 1) to (..., 1, 1)."""
    return np.ones((*np.shape(x), DIM))


def left_jacobian(xi: Array) -> Array:
    """Return the left Jacobian of exp, which is 1; (..., 1) to (..., 1, 1)."""
    return np.ones((*np.shape(xi), DIM))


def right_jacobian(xi: Array) -> Array:
    """Return the right Jacobian of exp, which is 1; (..., 1) to (..., 1, 1)."""
    return np.ones((*np.shape(xi), DIM))


def left_jacobian_inverse(xi: Array) -> Array:
    """Return the inverse of the left Jacobian, 1; (..., 1) to (..., 1, 1)."""
    return np.ones((*np.shape(xi), DIM))


def right_jacobian_inverse(xi: Array) -> Array:
    """Return the inverse of the right Jacobian, 1; (..., 1) to (..., 1, 1)."""
    return np.ones((*np.shape(xi), DIM))


def retract(x: Array, delta: Array) -> Array:
    """Return x moved by the angle delta, theta + delta wrapped; all are (..., 1)."""
    return wrap(x + delta)


def local(x: Array, y: Array) -> Array:
    """Return the delta in [-pi, pi) for which retract(x, delta) is y; all are (..., 1)."""
    return wrap(y - x)


def to_matrix(x: Array) -> Array:
    """Return the rotation matrix [[cos, -sin], [sin, cos]]; (..., 1) to (..., 2, 2)."""
    out = np.empty((*np.shape(x)[:-1], 2, 2))
    out[..., 0, 0] = out[..., 1, 1] = np.cos(x[..., 0])
    sine = np.sin(x[..., 0])
    out[..., 0, 1] = -sine
    out[..., 1, 0] = sine
    return out


def from_matrix(T: Array) -> Array:
    """Return the rotation nearest to a 2 x 2 matrix; (..., 2, 2) to (..., 1).

    The angle maximizes trace(R^T T), so a matrix that is a rotation up to scale or small
    errors is projected onto the group (the Procrustes problem in the plane).
    """
    sine, cosine = T[..., 1, 0] - T[..., 0, 1], T[..., 0, 0] + T[..., 1, 1]
    return wrap(np.arctan2(sine, cosine)[..., np.newaxis])


# Functions of a rotation angle. All are even, so a norm serves as well as a signed angle,
# and all are finite at 0, where the quotients that define them cancel. A difference of
# terms of size 1 keeps about 16 digits less those of angle^2; below SERIES_LIMIT the Taylor
# series, to the last bit with about ten terms, takes over.
SERIES_LIMIT = 1.0
BERNOULLI = (  # |B_2|, |B_4|, |B_6|, ...
    *(1 / 6, 1 / 30, 1 / 42, 1 / 30, 5 / 66, 691 / 2730, 7 / 6, 3617 / 510),
    *(43867 / 798, 174611 / 330, 854513 / 138, 236364091 / 2730),
)
SIN_TAIL = tuple((-1) ** k / factorial(2 * k + 3) for k in range(9))
COT_TAIL = tuple(b / factorial(2 * k) for k, b in enumerate(BERNOULLI, 1))


def series_near_zero(angle: Array, coefficients: tuple[float, ...], closed_form: Callable[[Array], Array]) -> Array:
    """Evaluate an even function by its series near 0 and in closed form elsewhere.

    Parameters
    ----------
    angle : array (...), radians
    coefficients : floats
        Of angle^0, angle^2, angle^4, ...
    closed_form : function of an array (...)
        Called with 1 in place of the small angles.

    Returns
    -------
    array (...)
    """
    small = np.abs(angle) < SERIES_LIMIT
    square = np.square(np.where(small, angle, 0.0))
    series = np.full_like(square, coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        series = series * square + coefficient
    if np.all(small):
        return series
    return np.where(small, series, closed_form(np.where(small, 1.0, angle)))


def sinc(angle: Array) -> Array:
    """Return sin(a) / a, elementwise; accurate as it stands, except for 0 / 0."""
    safe = np.where(angle == 0.0, 1.0, angle)
    return np.where(angle == 0.0, 1.0, np.sin(safe) / safe)


def one_minus_cos_ratio(angle: Array) -> Array:
    """Return (1 - cos a) / a^2, elementwise, as sinc(a / 2)^2 / 2, which cannot cancel."""
    return 0.5 * np.square(sinc(0.5 * angle))


def angle_minus_sin_ratio(angle: Array) -> Array:
    """Return (a - sin a) / a^3, elementwise."""
    return series_near_zero(angle, SIN_TAIL, lambda a: (a - np.sin(a)) / (a * a * a))


def half_cot(angle: Array) -> Array:
    """Return (a / 2) cot(a / 2), elementwise; it has poles at the multiples of 2 pi but 0."""
    half = 0.5 * angle
    return np.cos(half) / sinc(half)


def one_minus_half_cot_ratio(angle: Array) -> Array:
    """Return (1 - (a / 2) cot(a / 2)) / a^2, elementwise."""
    return series_near_zero(angle, COT_TAIL, lambda a: (1.0 - half_cot(a)) / (a * a))
