"""Numbers with units, as command lines and configuration files have them: ``2,1,30deg``."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

#: Suffix: the SI unit that a number with it is converted to, and the factor.
SUFFIXES: dict[str, tuple[str, float]] = {
    "m": ("m", 1.0),
    "cm": ("m", 0.01),
    "mm": ("m", 0.001),
    "rad": ("rad", 1.0),
    "deg": ("rad", math.pi / 180.0),
}
_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([^\W\d_]*)", re.ASCII)


def parse_numbers(text: str, units: Sequence[str] | None = None) -> tuple[float, ...]:
    """Numbers between commas, in metres and radians.

    Parameters
    ----------
    text
        Such as ``"2,1,30deg"``. A number without a suffix is in SI units already.
    units
        The unit of each number, ``"m"``, ``"rad"`` or ``""`` (a plain number); as many numbers are expected.
        None: any count, any suffix.

    Raises
    ------
    ValueError
        With a sentence that names the offending part.
    """
    parts = text.split(",")
    if units is not None and len(parts) != len(units):
        shape = ",".join(unit or "number" for unit in units)
        plural = "number" if len(units) == 1 else "numbers between commas"
        raise ValueError(f"expected {len(units)} {plural} ({shape}), found {len(parts)} in {text!r}")
    return tuple(_number(part, None if units is None else units[k], text) for k, part in enumerate(parts))


def _number(part: str, unit: str | None, text: str) -> float:
    where = "" if part == text else f" in {text!r}"
    match = _NUMBER.fullmatch(part.strip())
    if match is None:
        raise ValueError(f"expected a number with or without a unit, found {part!r}{where}")
    number, suffix = float(match[1]), match[2]
    if suffix:
        fitting = [name for name, (si, _) in SUFFIXES.items() if unit in (None, si)]
        if suffix not in fitting:
            expected = f"expected {', '.join(fitting)} or none" if fitting else "none belongs here"
            raise ValueError(f"the unit {suffix!r} of {part!r}{where}: {expected}")
        number *= SUFFIXES[suffix][1]
    if not math.isfinite(number):
        raise ValueError(f"{part!r}{where} is too large for a number")
    return number
