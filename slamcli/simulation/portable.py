"""Arrays whose arithmetic gives the same bits on every machine.

The same seed has to give the same bytes everywhere. IEEE 754 fixes the results of + - * / and sqrt, but sine, cosine
and arc tangent come from the machine's vector units and mathematical library and differ in the last bit, and sums of
products may be fused or reordered (BLAS). A ``PortableArray`` computes the former by series of exactly rounded
operations and refuses the latter, so that the functions of ``geometry`` and ``models`` can be called as they are.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from slamcli.models.base import Array

# pi/2 in three parts; the first two have 30 zero bits at their end, so that small multiples of them are exact
_HALF_PI_1 = math.ldexp(math.floor(math.ldexp(math.pi / 2, 22)), -22)
_HALF_PI_2 = math.ldexp(math.floor(math.ldexp(math.pi / 2 - _HALF_PI_1, 44)), -44)
_HALF_PI_3 = math.pi / 2 - _HALF_PI_1 - _HALF_PI_2 + 6.123233995736766e-17  # what the double pi/2 lacks

_SINE = [(-1.0) ** k / math.factorial(2 * k + 1) for k in range(10)]
_COSINE = [(-1.0) ** k / math.factorial(2 * k) for k in range(11)]
_ARC_TANGENT = [(-1.0) ** k / (2 * k + 1) for k in range(13)]


class PortableArray(np.ndarray[Any, np.dtype[Any]]):
    """An array with reproducible elementwise arithmetic; make one with ``portable``."""

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, out: Any = None, **kwargs: Any) -> Any:
        plain = [np.asarray(value) if isinstance(value, PortableArray) else value for value in inputs]
        if out is not None:
            kwargs["out"] = tuple(np.asarray(value) for value in out)
        if ufunc in _SERIES and method == "__call__":
            result = _SERIES[ufunc](*plain)
            if out is not None:
                kwargs["out"][0][...] = result
        elif ufunc in _EXACT:
            result = getattr(ufunc, method)(*plain, **kwargs)
        else:
            raise TypeError(f"numpy.{ufunc.__name__} does not give the same bits on every machine")
        if out is not None:
            return out[0] if len(out) == 1 else out
        return result.view(PortableArray) if isinstance(result, np.ndarray) else result


def portable(values: Any) -> Any:
    """The values as a portable array (a view where they are an array already)."""
    return np.asarray(values, dtype=np.float64).view(PortableArray)


def _polynomial(coefficients: list[float], x: Array) -> Array:
    out = np.full_like(x, coefficients[-1])
    for coefficient in reversed(coefficients[:-1]):
        out = out * x + coefficient
    return out


def _sine_and_cosine(x: Any) -> tuple[Array, Array]:
    """Taylor series after reduction to [-pi/4, pi/4] by multiples of pi/2 (Cody and Waite)."""
    angle = np.asarray(x, dtype=np.float64)
    quarter = np.rint(angle * (2.0 / math.pi))
    rest = ((angle - quarter * _HALF_PI_1) - quarter * _HALF_PI_2) - quarter * _HALF_PI_3
    square = rest * rest
    sine, cosine = rest * _polynomial(_SINE, square), _polynomial(_COSINE, square)
    turn = (quarter - 4.0 * np.floor(0.25 * quarter)).astype(np.int8)
    swap = turn % 2 == 1
    first, second = np.where(swap, cosine, sine), np.where(swap, sine, cosine)
    return np.where(turn >= 2, -first, first), np.where((turn == 1) | (turn == 2), -second, second)


def _arctan2(y: Any, x: Any) -> Array:
    """The angle of (x, y): two half-angle steps take the ratio below 0.2, where the series converges quickly."""
    y, x = np.asarray(y, dtype=np.float64), np.asarray(x, dtype=np.float64)
    low, high = np.minimum(np.abs(x), np.abs(y)), np.maximum(np.abs(x), np.abs(y))
    ratio = low / np.where(high == 0.0, 1.0, high)
    for _ in range(2):
        ratio = ratio / (1.0 + np.sqrt(1.0 + ratio * ratio))
    angle = 4.0 * (ratio * _polynomial(_ARC_TANGENT, ratio * ratio))
    angle = np.where(np.abs(y) > np.abs(x), 0.5 * math.pi - angle, angle)
    angle = np.where(np.signbit(x), math.pi - angle, angle)
    return np.copysign(angle, y)


_SERIES: dict[np.ufunc, Callable[..., Array]] = {
    np.sin: lambda x: _sine_and_cosine(x)[0],
    np.cos: lambda x: _sine_and_cosine(x)[1],
    np.arctan2: _arctan2,
}

#: Exactly rounded, or not rounding at all.
_EXACT: frozenset[np.ufunc] = frozenset(
    {
        *(np.add, np.subtract, np.multiply, np.divide, np.negative, np.positive, np.absolute, np.square, np.sqrt),
        *(np.floor, np.ceil, np.rint, np.trunc, np.remainder, np.fmod, np.floor_divide),
        *(np.sign, np.copysign, np.minimum, np.maximum, np.isfinite, np.isnan, np.signbit, np.less),
        *(np.less_equal, np.greater, np.greater_equal, np.equal, np.not_equal, np.logical_and),
        *(np.logical_or, np.logical_not, np.bitwise_and, np.bitwise_or, np.invert),
    }
)
