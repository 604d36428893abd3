"""Diagnostics of readers: what is wrong, where (path, line, column), what was expected and what to do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from slamcli.errors import InputError

#: How many diagnostics of one file are shown in full.
SHOWN = 3


@dataclass(frozen=True)
class Diagnostic:
    """One defect of a file.

    Attributes
    ----------
    path, line, column
        Where; lines and columns count from 1, columns in bytes. Line 0 means the file as a whole.
    message
        What is wrong and what was expected.
    quote
        The text of the line, shortened around the column.
    hint
        What to do next; may be empty.
    """

    path: str
    line: int
    column: int
    message: str
    quote: str = ""
    hint: str = ""

    def __str__(self) -> str:
        where = f"{self.path}:{self.line}:{self.column}" if self.line else self.path
        return f"{where}: {self.message}"

    def lines(self) -> list[str]:
        """The message as it is printed: place and message, the quoted line with a marker, the hint."""
        out = [str(self)]
        if self.quote:
            text, marker = _window(self.quote, self.column)
            out += [f"    {text}", f"    {' ' * marker}^"]
        if self.hint:
            out.append(f"  hint: {self.hint}")
        return out


def _window(quote: str, column: int, width: int = 100) -> tuple[str, int]:
    """The part of a long line around a column, with tabs as blanks, and the marker's position in it."""
    text = quote.replace("\t", " ")
    start = max(0, column - width // 2) if len(text) > width else 0
    part = text[start : start + width]
    if start:
        part = "..." + part[3:]
    if start + width < len(text):
        part = part[:-3] + "..."
    return part, min(column - 1 - start, len(part))


class ParseError(InputError):
    """A file that is not valid, with a diagnostic for each defect."""

    def __init__(self, diagnostics: Sequence[Diagnostic]) -> None:
        first = diagnostics[0]
        details = first.lines()[1:]
        for diagnostic in diagnostics[1:SHOWN]:
            details += diagnostic.lines()
        if len(diagnostics) > SHOWN:
            details.append(f"... and {len(diagnostics) - SHOWN} more such records")
        if first.line:
            details.append("  --lenient skips, counts and shows records like these")
        super().__init__(str(first), tuple(details))
        self.diagnostics = tuple(diagnostics)
