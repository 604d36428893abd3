"""Plain text for terminals: aligned tables, numbers with one rule, colour only where it was asked for."""

from __future__ import annotations

from collections.abc import Sequence

_COLOURS = {"green": "32", "yellow": "33", "red": "31", "bold": "1"}


def table(rows: Sequence[Sequence[str]], align: str) -> list[str]:
    """Lines of a table; ``align`` has one ``<`` or ``>`` for each column."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(align))]
    return [
        "  ".join(f"{cell:{side}{width}}" for cell, side, width in zip(row, align, widths, strict=True)).rstrip()
        for row in rows
    ]


def seconds(value: float) -> str:
    """A duration in ms below one second, in s above."""
    return f"{value * 1e3:.1f} ms" if value < 1.0 else f"{value:.2f} s"


def count(value: float, unit: str) -> str:
    """A large count with its unit and a prefix: ``1.53 Mflop``."""
    for limit, prefix in ((1e12, "T"), (1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= limit:
            return f"{value / limit:.3g} {prefix}{unit}"
    return f"{value:.0f} {unit}"


def plural(number: int, noun: str) -> str:
    """``1 edge``, ``2 edges``."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def coloured(text: str, colour: str, on: bool) -> str:
    """Text in a colour of a terminal, or as it is."""
    return f"\x1b[{_COLOURS[colour]}m{text}\x1b[0m" if on else text
