"""Plain tables of numbers, one record a line: tokenized in bulk, checked by line and column.

Trajectory files are such tables. Numbers are separated by blanks or by commas; ``#`` begins a comment.
"""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass

import numpy as np

from slamcli.errors import InputError
from slamcli.formats.diagnostics import Diagnostic, ParseError
from slamcli.formats.tokens import TokenizedText
from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.models.base import Array

_NUMBER = re.compile(rb"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\Z")
_NOT_FINITE = re.compile(r"[+-]?(nan|inf|infinity)\Z", re.IGNORECASE)
_SHOWN = 8


@dataclass(frozen=True, eq=False)
class Table:
    """The numbers of a table.

    Attributes
    ----------
    numbers
        (m, columns) finite numbers.
    lines
        (m,) line numbers in the file, from 1.
    positions
        (m,) which record of the file each row is, from 0. Records that were skipped count.
    skipped
        Messages of the records that were skipped.
    """

    numbers: Array
    lines: IndexArray
    positions: IndexArray
    skipped: list[str]


class TableText:
    """A text of numbers before its layout is known.

    Parameters
    ----------
    path
        As the user named the file, for diagnostics.
    data
        The text, decompressed.

    Attributes
    ----------
    commas
        Whether commas separate the numbers.
    decimal_commas
        Whether there are blanks between them as well, so that the commas are likely to be decimal ones.
    records
        Lines (from 0) that hold more than a comment.
    header
        Whether the first of them is words while the second is numbers.
    """

    def __init__(self, path: str, data: bytes) -> None:
        self.path = path
        self.original = TokenizedText(data)
        first = np.flatnonzero(self.original.counts > 0)
        probe = self.original.line(int(first[0])).partition("#")[0] if len(first) else ""
        self.commas = "," in probe
        self.decimal_commas = self.commas and " " in re.sub(r"\s*,\s*", ",", probe.strip())
        self.text = TokenizedText(data.replace(b",", b" ")) if self.commas else self.original
        self.records: IndexArray = np.flatnonzero(self.text.counts > 0)
        self.header = not self._starts_with_number(0) and self._starts_with_number(1)

    @property
    def is_table(self) -> bool:
        """Whether the records begin with numbers (a header line above them is a defect, not another format)."""
        return self._starts_with_number(0) or self.header

    @property
    def columns(self) -> int:
        """Numbers in most of the records; where two counts are as frequent, that of the first record counts."""
        counts = self.text.counts[self.records]
        frequency = np.bincount(counts)
        first = int(counts[int(self.header)])
        return first if frequency[first] == frequency.max() else int(frequency.argmax())

    def _starts_with_number(self, record: int) -> bool:
        if record >= len(self.records):
            return False
        token = self.text.token(int(self.text.first[self.records[record]]))
        return _NUMBER.match(token) is not None or _NOT_FINITE.match(token.decode("utf-8", "replace")) is not None

    def refuse(self, expected: str, hint: str) -> InputError:
        """An error about the layout of the whole file, shown at its first record."""
        line = int(self.records[self.text.counts[self.records] == self.columns][0])
        column = self.text.column(line, int(self.text.token_start[self.text.first[line]]))
        message = f"expected {expected}, found {int(self.text.counts[line])} numbers"
        shown = Diagnostic(self.path, line + 1, column, message, self.original.line(line), hint).lines()
        return InputError(shown[0], tuple(shown[1:]))

    def read(self, columns: int, layout: str, lenient: bool, header: bool = False) -> Table:
        """The numbers, ``columns`` in each record.

        Parameters
        ----------
        columns
            How many numbers a record has.
        layout
            Their names, for messages.
        lenient
            Skip malformed records instead of raising.
        header
            Whether a line of words may stand above the numbers.

        Raises
        ------
        ParseError
            With a diagnostic for each malformed record.
        """
        text = self.text
        if header and self.header:
            self.records, self.header = self.records[1:], False
        defects = [self._count_defect(line, columns, layout) for line in self._wrong_counts(columns)]
        use = np.zeros(text.lines, dtype=bool)
        use[self.records] = text.counts[self.records] == columns
        numbers = self._numbers(use)
        if numbers is None:
            bad = self._number_defects(np.flatnonzero(use))
            use[[line for line, _ in bad]] = False
            defects += [defect for _, defect in bad]
            numbers = self._numbers(use)
            if numbers is None:
                raise AssertionError("number parser and grammar disagree")
        defects.sort(key=lambda defect: (defect.line, defect.column))
        if defects and not lenient:
            raise ParseError(defects)
        positions = np.flatnonzero(use[self.records])
        skipped = [str(defect) for defect in defects]
        return Table(numbers.reshape(-1, columns), self.records[positions] + 1, positions, skipped)

    def defect(self, line: int, message: str, hint: str = "", token: int = 0) -> Diagnostic:
        """A defect of a record (line from 1) at one of its numbers (from 0)."""
        offset = int(self.text.token_start[self.text.first[line - 1] + token])
        return self._diagnostic(line - 1, self.text.column(line - 1, offset), message, hint)

    def _diagnostic(self, line: int, column: int, message: str, hint: str) -> Diagnostic:
        return Diagnostic(self.path, line + 1, column, message, self.original.line(line), hint)

    def _wrong_counts(self, columns: int) -> list[int]:
        return self.records[self.text.counts[self.records] != columns].tolist()

    def _count_defect(self, line: int, columns: int, layout: str) -> Diagnostic:
        text = self.text
        found = int(text.counts[line])
        if self.header and line == self.records[0]:
            column = text.column(line, int(text.token_start[text.first[line]]))
            message = f"expected a number, found {text.token(int(text.first[line])).decode('utf-8', 'replace')!r}"
            return self._diagnostic(line, column, message, "a header line? begin it with #")
        column = (
            text.column(line, int(text.token_start[text.first[line] + columns]))
            if found > columns
            else text.end_column(line)
        )
        hint = f"the layout is {layout}"
        if not self.commas and "," in self.original.line(line):
            hint = "commas? separate the numbers by blanks everywhere, with decimal points"
        return self._diagnostic(line, column, f"expected {columns} numbers, found {found}", hint)

    def _number_defects(self, lines: IndexArray) -> list[tuple[int, Diagnostic]]:
        """The first token of each line that is not a finite number (the slow path of broken files)."""
        text, out = self.text, []
        for line in lines.tolist():
            for index in range(int(text.first[line]), int(text.first[line] + text.counts[line])):
                token = text.token(index)
                if not _NUMBER.match(token) or not np.isfinite(float(token)):
                    word = token.decode("utf-8", "replace")
                    column = text.column(line, int(text.token_start[index]))
                    message = f"expected a finite number, found {word!r}"
                    header = self.header and line == self.records[0]
                    hint = "a header line? begin it with #" if header else _hint(word)
                    out.append((line, self._diagnostic(line, column, message, hint)))
                    break
        return out

    def _numbers(self, use: BoolArray) -> Array | None:
        """All numbers of the used lines, None where the parser met something that is not a finite number."""
        text = self.text
        clean = bytearray(text.data)
        view = np.frombuffer(clean, dtype=np.uint8)
        view[: text.line_start[0]] = 32
        edges = np.flatnonzero(np.diff(use.astype(np.int8), prepend=1, append=1))
        for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            view[text.line_start[begin] : text.line_start[end]] = 32
        for line in np.flatnonzero(text.has_comment & use).tolist():
            view[text.token_start[text.first[line] + text.counts[line]] : text.line_start[line + 1]] = 32
        expected = int(text.counts[use].sum())
        if expected == 0:
            return np.empty(0)
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)
            try:
                numbers: Array = np.fromstring(bytes(clean), dtype=np.float64, sep=" ")
            except (DeprecationWarning, ValueError):
                return None
        return numbers if len(numbers) == expected and np.isfinite(numbers).all() else None


def skipped_notes(path: str, skipped: list[str]) -> list[str]:
    """What to say about records that were skipped."""
    if not skipped:
        return []
    out = [f"skipped: {message}" for message in skipped[:_SHOWN]]
    if len(skipped) > _SHOWN:
        out.append(f"{path}: ... and {len(skipped) - _SHOWN} more malformed records skipped")
    return out


def _hint(word: str) -> str:
    if _NOT_FINITE.match(word):
        return "tracking lost? leave such lines out"
    if "," in word:
        return "a decimal comma, or commas between only some of the numbers?"
    return ""
