"""Circular arcs: where a robot ends that drives a length while it turns by an angle.

    x = s sin(a) / a,  y = s (1 - cos a) / a        for the length s and the turn a

The end point lies at the distance s sinc(a/2) in the direction a/2. Written so, nothing cancels as the arc becomes
straight (a -> 0), and no threshold is needed. Only the derivative by a has a term, (a - sin a) / a^3, that does; there
a series takes over below 1 rad.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slamcli.geometry import so2
from slamcli.models.base import Array


class Arc(NamedTuple):
    """An arc of unit length: its end point and the end point's derivative by the turn; all are (m,).

    They are plain arrays: nothing but sums and products is to follow.
    """

    x: Array
    y: Array
    dx: Array
    dy: Array


def unit_arc(turn: Array) -> Arc:
    """Arc of length 1 with a turn in radians."""
    half = 0.5 * turn
    sine, cosine = np.asarray(np.sin(half)), np.asarray(np.cos(half))
    chord = _quotient(sine, np.asarray(half))
    angle = np.asarray(turn)
    x, y = chord * cosine, chord * sine
    bend = 0.5 * chord * chord  # (1 - cos a) / a^2
    square = np.where(np.abs(angle) < so2.SERIES_LIMIT, 1.0, angle * angle)
    tail = so2.series_near_zero(angle, so2.SIN_TAIL, lambda _: (1.0 - x) / square)  # (a - sin a) / a^3
    return Arc(x, y, angle * (tail - bend), x - bend)


def sinc(angle: Array) -> Array:
    """sin(a) / a, elementwise, as a plain array."""
    return _quotient(np.asarray(np.sin(angle)), np.asarray(angle))


def _quotient(sine: Array, angle: Array) -> Array:
    return np.asarray(np.divide(sine, angle, out=np.ones(angle.shape), where=angle != 0.0))
