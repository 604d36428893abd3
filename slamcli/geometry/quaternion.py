"""Quaternion algebra on separate components (a, b, c, w), scalar last, Hamilton's convention.

SO(3), SE(3) and the residuals of spatial poses are built on these: arithmetic on contiguous components, with nothing
packed in between.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Components = Sequence[Array]


def multiply(x: Components, y: Components) -> Components:
    """Return the four components of the quaternion product x y."""
    (a, b, c, d), (e, f, g, h) = x, y
    return (
        d * e + a * h + b * g - c * f,
        d * f - a * g + b * h + c * e,
        d * g + a * f - b * e + c * h,
        d * h - a * e - b * f - c * g,
    )


def conjugate(x: Components) -> Components:
    """Return the components of the conjugate of x."""
    return (-x[0], -x[1], -x[2], x[3])


def unit(x: Components) -> Components:
    """Return the components of x / |x|, NaN where |x| is 0 or too large for a square.

    What is a unit quaternion to the last bits already stays as it is, so that normalizing twice changes nothing.
    """
    a, b, c, w = x
    with np.errstate(over="ignore"):
        square = a * a + b * b + c * c + w * w
    usable = (square > 0.0) & (square < np.inf)
    length = np.sqrt(np.where(usable, np.where(np.abs(square - 1.0) < 1e-15, 1.0, square), np.nan))
    return (a / length, b / length, c / length, w / length)


def cross(u: Components, v: Components) -> Components:
    """Return the three components of u x v."""
    (a, b, c), (d, e, f) = u, v
    return (b * f - c * e, c * d - a * f, a * e - b * d)


def matrix_rows(q: Components) -> tuple[Components, Components, Components]:
    """Return the rows of the rotation matrix of a unit quaternion, entry by entry."""
    a, b, c, w = q
    a2, b2, c2 = 2.0 * a, 2.0 * b, 2.0 * c
    aa, bb, cc = a2 * a, b2 * b, c2 * c
    ab, ac, bc = a2 * b, a2 * c, b2 * c
    wa, wb, wc = a2 * w, b2 * w, c2 * w
    return (
        (1.0 - (bb + cc), ab - wc, ac + wb),
        (ab + wc, 1.0 - (aa + cc), bc - wa),
        (ac - wb, bc + wa, 1.0 - (aa + bb)),
    )


def rotate(q: Components, p: Components) -> Components:
    """Return the three components of R(q) p = p + w u + v x u, u = 2 v x p, q = (v, w)."""
    *v, w = q
    u = [2.0 * k for k in cross(v, p)]
    return tuple(p[i] + (w * u[i] + k) for i, k in enumerate(cross(v, u)))


def complete(delta: Components) -> Components:
    """Return the unit quaternion with vector part delta and w >= 0; see retract."""
    u, v, w = delta
    square = u * u + v * v + w * w
    longer = np.sqrt(np.maximum(square, 1.0))
    return (u / longer, v / longer, w / longer, np.sqrt(np.maximum(1.0 - square, 0.0)))


def vector_part(q: Components) -> Components:
    """Return the vector part of q or -q, whichever has w >= 0."""
    sign = np.where(q[3] < 0.0, -1.0, 1.0)
    return (sign * q[0], sign * q[1], sign * q[2])
