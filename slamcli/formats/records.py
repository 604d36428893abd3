"""The records of one text in one dialect: numbers and ids of each tag as arrays, and the defects met on the way."""

from __future__ import annotations

import numpy as np

from slamcli.formats.diagnostics import Diagnostic, ParseError
from slamcli.formats.dialect import Dialect, EdgeTag, ParameterTag, VertexTag
from slamcli.formats.tokens import Rows, TokenizedText
from slamcli.graph.columns import BoolArray, IdArray, IndexArray
from slamcli.models.base import Array

Record = VertexTag | EdgeTag | ParameterTag

_EXACT = 2.0**53  # ids from here on are read digit by digit: a float no longer holds them


class Records:
    """Numbers and ids by tag.

    Parameters
    ----------
    path
        As the user named the file, for diagnostics.
    text
        The tokenized text.
    dialect
        Its tag table.
    lenient
        Collect defects instead of raising them.

    Attributes
    ----------
    rows
        For each tag that occurs, its well-formed records.
    ids
        For each of those tags, the ids of its records, (m, ids), all of one dtype.
    defects
        What is wrong with the records that were left out.
    ignored
        Lines (from 0) of those records.
    """

    def __init__(self, path: str, text: TokenizedText, dialect: Dialect, lenient: bool) -> None:
        self.path = path
        self.text = text
        self.dialect = dialect
        self.lenient = lenient
        self.defects: list[Diagnostic] = []
        self.ignored: set[int] = set()
        self.rows: dict[str, Rows] = {}
        self.ids: dict[str, IdArray] = {}
        self._parse_numbers()
        self._check_counts()
        self._read_ids()
        self.settle()

    # -- access --------------------------------------------------------------------------------------------------

    def matrix(self, tag: str, count: int, where: BoolArray | None = None) -> Array:
        """The first ``count`` numbers of each record of a tag (or of some of them), (m, count)."""
        rows = self.rows[tag] if where is None else self.rows[tag].select(where)
        if len(rows.lines) == 0:
            return np.empty((0, count))
        first, width = int(rows.offsets[0]), int(rows.counts[0])
        contiguous = int(rows.offsets[-1]) == first + width * (len(rows.lines) - 1)
        if contiguous and (rows.counts == width).all():
            return self._numbers[first : first + width * len(rows.lines)].reshape(-1, width)[:, :count]
        return self._numbers[rows.offsets[:, None] + np.arange(count)]

    def drop(self, tag: str, keep: BoolArray) -> None:
        """Leave out some records of a tag, whose defects have been noted."""
        if not keep.all():
            self.rows[tag] = self.rows[tag].select(keep)
            if tag in self.ids:
                self.ids[tag] = self.ids[tag][keep]

    def lines_of(self, tag: str | None) -> IndexArray:
        """Lines (from 0) that start with a tag, whatever follows."""
        names, index = self.text.tags
        if tag is None or tag.encode() not in names:
            return np.empty(0, dtype=np.intp)
        return np.flatnonzero(index == names.index(tag.encode()))

    def defect(self, line: int, offset: int | None, message: str, hint: str = "") -> None:
        """Note a defect of a line (from 0) at a byte offset (None: behind the last token)."""
        self.ignored.add(line)
        column = self.text.end_column(line) if offset is None else self.text.column(line, offset)
        quote = self.text.line(line)
        self.defects.append(Diagnostic(self.path, line + 1, column, message, quote, hint))

    def settle(self) -> None:
        """Raise the defects found so far, unless lenient.

        Raises
        ------
        ParseError
            With a diagnostic for each malformed record.
        """
        if self.defects and not self.lenient:
            raise ParseError(sorted(self.defects, key=lambda defect: (defect.line, defect.column)))

    # -- steps ---------------------------------------------------------------------------------------------------

    def _parse_numbers(self) -> None:
        wanted = {tag.encode() for tag in self.dialect.tags}
        while True:
            self._numbers, rows, bad = self.text.parse(wanted, np.fromiter(sorted(self.ignored), dtype=np.intp))
            if not bad:
                break
            for token in bad:
                message = f"expected a finite number, found {token.text!r}"
                self.defect(token.line, token.offset, message, _number_hint(token.text))
        self.rows = {name.decode(): found for name, found in rows.items()}

    def _check_counts(self) -> None:
        """Leave out records with too few or too many numbers."""
        for record in self.dialect.records:
            if (rows := self.rows.get(record.tag)) is None:
                continue
            if self._is_bare(record, rows):
                continue
            good = np.isin(rows.counts, record.allowed_counts)
            for k in np.flatnonzero(~good).tolist():
                self._count_defect(record, int(rows.lines[k]), int(rows.counts[k]))
            self.drop(record.tag, good)

    def _is_bare(self, record: Record, rows: Rows) -> bool:
        """Whether all records of a tag lack their information matrices, and may."""
        if not self.dialect.bare_edges or not isinstance(record, EdgeTag):
            return False
        return bool((rows.counts == record.without_information).all())

    def _count_defect(self, record: Record, line: int, found: int) -> None:
        most = max(record.allowed_counts)
        offset = int(self.text.token_start[self.text.first[line] + 1 + most]) if found > most else None
        expected = " or ".join(str(count) for count in sorted(record.allowed_counts))
        hint = f"the layout is {record.layout}"
        if isinstance(record, EdgeTag) and found == record.without_information:
            others = " here and not in all records" if self.dialect.bare_edges else ""
            hint = f"the information matrix is missing{others}; {hint}"
        self.defect(line, offset, f"{record.tag} expects {expected} numbers, found {found}", hint)

    def _read_ids(self) -> None:
        """Ids of all records: whole numbers of up to 64 bits (GTSAM keys are unsigned)."""
        for record in self.dialect.records:
            if record.tag in self.rows:
                count = record.ids if isinstance(record, EdgeTag) else 1
                values = self.matrix(record.tag, count)
                exact = len(values) > 0 and float(np.abs(values).max()) >= _EXACT
                ids = self._exact_ids(record.tag, count) if exact else values.astype(np.int64)
                whole = np.ones(len(ids), dtype=bool) if exact else (ids == values).all(axis=1)
                self.ids[record.tag] = ids
                for k in np.flatnonzero(~whole).tolist():
                    self._id_defect(int(self.rows[record.tag].lines[k]), count)
                self.drop(record.tag, whole)
        if any(ids.dtype == np.uint64 for ids in self.ids.values()):
            self._make_unsigned()

    def _exact_ids(self, tag: str, count: int) -> IdArray:
        """Ids read digit by digit."""
        texts = [
            [self.text.token(token + slot) for slot in range(count)]
            for token in (self.text.first[self.rows[tag].lines] + 1).tolist()
        ]
        good = np.array([all(is_id(token) for token in row) for row in texts], dtype=bool)
        for k in np.flatnonzero(~good).tolist():
            self._id_defect(int(self.rows[tag].lines[k]), count)
        self.drop(tag, good)
        whole = [[int(token) for token in row] for row, ok in zip(texts, good, strict=True) if ok]
        dtype = np.uint64 if any(i >= 2**63 for row in whole for i in row) else np.int64
        if dtype is np.uint64 and any(i < 0 for row in whole for i in row):
            raise self._mixed_signs()
        return np.array(whole, dtype=object).reshape(-1, count).astype(dtype)

    def _make_unsigned(self) -> None:
        """One dtype for all ids: numpy compares int64 with uint64 as floats."""
        for tag, ids in self.ids.items():
            if ids.dtype != np.uint64 and (ids < 0).any():
                raise self._mixed_signs()
            self.ids[tag] = ids.astype(np.uint64)

    def _mixed_signs(self) -> ParseError:
        message = "holds negative ids and ids of 2^63 and more; 64 bits cannot tell both apart"
        return ParseError([Diagnostic(self.path, 0, 0, message)])

    def _id_defect(self, line: int, count: int) -> None:
        first = int(self.text.first[line]) + 1
        bad = next((t for t in range(first, first + count) if not is_id(self.text.token(t))), first)
        found = self.text.token(bad).decode("utf-8", "replace")
        self.defect(
            line, int(self.text.token_start[bad]), f"expected an id (a whole number of 64 bits), found {found!r}"
        )


def is_id(token: bytes) -> bool:
    """Whether a token is a whole number of at most 64 bits, signed or unsigned."""
    digits = token[1:] if token[:1] in (b"+", b"-") else token
    return digits.isdigit() and len(digits) <= 40 and -(2**63) <= int(token) < 2**64


def _number_hint(text: str) -> str:
    """What a token that is not a number may have been meant to be."""
    if "," in text:
        return "decimal comma? numbers need a decimal point (write the file in the C locale)"
    if text[:1].isdigit() and "d" in text.lower():
        return "Fortran exponent? write e instead of d"
    return ""
