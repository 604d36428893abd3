"""Numbers with units on the command line: ``2,1,30deg``."""

from __future__ import annotations

from typing import Any

import click


class Numbers(click.ParamType):  # type: ignore[type-arg]  # generic only in click 8.5
    """Numbers between commas as a tuple of floats in SI units.

    Parameters
    ----------
    units
        See ``parse_numbers``: ``Numbers("m", "m", "rad")`` takes a planar pose. None given: any count, any suffix.
    minimum
        Smallest value that every number may have; None: any. (Standard deviations are not negative.)
    """

    name = "numbers"

    def __init__(self, *units: str, minimum: float | None = None) -> None:
        self.units = units or None
        self.minimum = minimum

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        """The numbers; a usage error names the part that is wrong."""
        if not isinstance(value, str):  # a default, given as numbers
            return tuple(value)
        from slamcli.formats.quantities import parse_numbers

        try:
            numbers = parse_numbers(value, self.units)
        except ValueError as error:
            self.fail(str(error), param, ctx)
        if self.minimum is not None and min(numbers) < self.minimum:
            self.fail(f"no number may be below {self.minimum:g}, found {min(numbers):g} in {value!r}", param, ctx)
        return numbers
