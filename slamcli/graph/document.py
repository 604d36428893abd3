"""What reading a file leaves with the graph: the report for the user and the text for the writer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

from slamcli.graph.columns import Factors, IndexArray, Values


@dataclass(eq=False)
class Document:
    """The text that a graph was read from, so that unchanged records are written from their original bytes.

    Attributes
    ----------
    raw
        The bytes as they came (compressed if they were).
    data
        The text, decompressed.
    spans
        Gives the byte offsets, for each line, of its first token and of the end of its last token (comments
        excluded); equal on blank and comment lines. Only the writer asks for them.
    line_start
        Byte offsets of the lines, and the length of the text as a last entry.
    comments
        Line numbers (from 1) of comments and blank lines.
    parameter_lines, fix_lines
        Line numbers of parameter records and FIX commands.
    first_edge_line
        Line number before which new vertices are inserted.
    values
        The values of the variables as they were read: what differs from them has changed.
    factors
        The factors as they were read, likewise.
    """

    raw: bytes
    data: bytes
    spans: Callable[[], tuple[IndexArray, IndexArray]]
    line_start: IndexArray
    comments: IndexArray
    parameter_lines: IndexArray
    fix_lines: IndexArray
    first_edge_line: int
    values: Values = field(default_factory=dict)
    factors: tuple[Factors, ...] = ()

    @cached_property
    def record_spans(self) -> tuple[IndexArray, IndexArray]:
        """See ``spans``."""
        return self.spans()

    @cached_property
    def sha256(self) -> str:
        """Hash of the file as it came."""
        import hashlib  # only where a report wants it

        return hashlib.sha256(self.raw).hexdigest()


@dataclass
class ReadingReport:
    """What a reader found: nothing is dropped in silence.

    Attributes
    ----------
    path
        As the user named it, ``-`` for standard input.
    format
        ``"g2o"`` or ``"toro"``.
    lines, comments, blank
        Counts of lines.
    by_tag
        Records read, by tag.
    skipped
        Records that were not used, by tag (unknown tags, data records).
    reasons
        Why, for those skipped tags that are known.
    malformed
        Malformed records that ``--lenient`` skipped: one message each.
    created
        Ids of variables that edges name and no vertex record defines, by kind.
    notes
        Assumptions and oddities, one sentence each.
    """

    path: str
    format: str
    lines: int = 0
    comments: int = 0
    blank: int = 0
    by_tag: dict[str, int] = field(default_factory=dict)
    skipped: dict[str, int] = field(default_factory=dict)
    reasons: dict[str, str] = field(default_factory=dict)
    malformed: list[str] = field(default_factory=list)
    created: dict[str, list[int]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    @property
    def skipped_total(self) -> int:
        """Number of records that were not used."""
        return sum(self.skipped.values()) + len(self.malformed)
