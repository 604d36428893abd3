"""Tables of numbers that belong to a log: fixed columns, times in order, defects shown by line and column."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from slamcli.errors import InputError
from slamcli.formats.diagnostics import ParseError
from slamcli.formats.source import read_bytes
from slamcli.formats.tables import TableText, skipped_notes
from slamcli.graph.columns import BoolArray, IdArray, IndexArray
from slamcli.models.base import Array


@dataclass(frozen=True, eq=False)
class Columns:
    """The numbers of a table.

    Attributes
    ----------
    text
        Where they come from.
    numbers
        (m, columns).
    lines
        (m,) line numbers from 1.
    lenient
        Whether rows with defects are skipped instead of refused.
    skipped
        Messages of the rows that were skipped.
    """

    text: TableText
    numbers: Array
    lines: IndexArray
    lenient: bool
    skipped: list[str] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.numbers)

    @property
    def notes(self) -> list[str]:
        """What to say about skipped rows."""
        return skipped_notes(self.text.path, self.skipped)

    def without(self, bad: BoolArray, message: str, hint: str = "", column: int | IndexArray = 0) -> Columns:
        """Refuse rows with a defect in a column (or in one for each row), or skip them where the reading is lenient.

        Raises
        ------
        ParseError
            With a diagnostic for each.
        InputError
            If no row is left.
        """
        if not bad.any():
            return self
        places = zip(self.lines[bad].tolist(), np.broadcast_to(column, bad.shape)[bad].tolist(), strict=True)
        defects = [self.text.defect(line, message, hint, token) for line, token in places]
        if not self.lenient:
            raise ParseError(defects)
        skipped = [*self.skipped, *(str(defect) for defect in defects)]
        kept = replace(self, numbers=self.numbers[~bad], lines=self.lines[~bad], skipped=skipped)
        return kept.require_rows()

    def ascending(self, *, strictly: bool = False) -> Columns:
        """The rows with times (the first column) in order; see ``without``."""
        times = self.numbers[:, 0]
        latest = np.maximum.accumulate(np.concatenate([[-np.inf], times]))[:-1]
        bad = times <= latest if strictly else times < latest
        what = "later than" if strictly else "not before"
        hint = "the rows must be in the order of time: sort them, or is this the end of two logs in one file?"
        return self.without(bad, f"the time goes back or stands still, expected one {what} those above", hint)

    def ids(self, column: int, what: str) -> tuple[Columns, IdArray]:
        """The rows whose numbers in a column are ids, and those ids; see ``without``."""
        values = self.numbers[:, column]
        bad = (values != np.rint(values)) | (values < 0.0) | (values >= 2.0**53)
        kept = self.without(bad, f"expected {what}, a whole number", column=column)
        return kept, kept.numbers[:, column].astype(np.int64)

    def require_rows(self) -> Columns:
        """Itself, if there is a row left.

        Raises
        ------
        InputError
            If not.
        """
        if len(self) == 0:
            raise InputError(f"{self.text.path}: holds no usable record", tuple(f"  {note}" for note in self.notes))
        return self


def read_columns(path: str, layout: str, lenient: bool, columns: int | None = None) -> Columns:
    """Read a table.

    Parameters
    ----------
    path
        Its file.
    layout
        Names of its columns between blanks, for messages and for their number.
    lenient
        Skip malformed rows instead of raising.
    columns
        Their number where ``layout`` does not tell it; 0 stands for as many as the file has.

    Raises
    ------
    InputError
        If the file cannot be read, holds no number, or has another number of columns.
    """
    text = TableText(path, read_bytes(path)[1])
    if len(text.records) == 0:
        raise InputError(f"{path}: holds no record at all", (f"  expected lines of: {layout}",))
    expected = len(layout.split()) if columns is None else columns or text.columns
    if not text.header and text.columns != expected:
        raise text.refuse(f"{expected} numbers a line ({layout})", "")
    table = text.read(expected, layout, lenient)
    return Columns(text, table.numbers, table.lines, lenient, list(table.skipped)).require_rows()
