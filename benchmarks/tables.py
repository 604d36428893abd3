"""Tables of measurements in Markdown."""

from __future__ import annotations

import statistics
from collections.abc import Iterable


def ms(values: list[float]) -> str:
    """Median and range in milliseconds of seconds."""
    return f"{statistics.median(values) * 1e3:.1f} ({min(values) * 1e3:.1f} to {max(values) * 1e3:.1f})"


def table(title: str, header: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    """A Markdown table below a heading."""
    lines = [f"\n## {title}\n"]
    lines += ["| " + " | ".join(row) + " |" for row in (header, tuple("---" for _ in header), *rows)]
    return "\n".join(lines)


def print_table(title: str, header: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> None:
    """Print a table as soon as it is there."""
    print(table(title, header, rows), flush=True)
