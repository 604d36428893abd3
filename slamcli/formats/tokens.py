"""Bulk tokenizer of line-oriented text formats: lines, tags and numbers as arrays.

A pose-graph file is a few hundred thousand numbers between blanks. Finding lines and tokens is a handful of
vectorized passes over the bytes; everything that is not a number of a wanted record is then blanked, a comma is put
before each number, and what has become one JSON list is parsed in large pieces (orjson; correctly rounded, 40 ns a
number).
Numbers that JSON does not know (``.5``, ``+1``) send the text through numpy's own parser instead (70 ns).
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import orjson
from numpy.typing import NDArray

from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array

_BLANK, _NEWLINE, _HASH, _COMMA = 32, 10, 35, 44
_TAB, _RETURN = 9, 13  # white space between them; other control characters are damage and spoil their token
_CHUNK = 1 << 16  # bytes taken at a time, so that intermediate arrays stay in the cache and are used again
_TAG_WORDS = 8  # 64 bytes of the first token tell tags apart
_NUMBER = re.compile(rb"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\Z")
_BOM = b"\xef\xbb\xbf"


@dataclass(frozen=True, eq=False)
class BadToken:
    """A token that is not a finite decimal number: its line (from 0), byte offset and text."""

    line: int
    offset: int
    text: str


@dataclass(frozen=True, eq=False)
class Rows:
    """The records of one tag.

    Attributes
    ----------
    lines
        (m,) line numbers from 0.
    counts
        (m,) how many numbers follow the tag.
    offsets
        (m,) position of the first of them in the numbers of the text.
    """

    lines: IndexArray
    counts: IndexArray
    offsets: IndexArray

    def select(self, keep: NDArray[np.bool_]) -> Rows:
        """Some of the records."""
        return self if keep.all() else Rows(self.lines[keep], self.counts[keep], self.offsets[keep])


class TokenizedText:
    """Lines and tokens of a text.

    Parameters
    ----------
    data
        The text: ASCII or UTF-8, any line ending with a line feed in it, with or without byte order mark.

    Attributes
    ----------
    line_start
        (lines + 1,) byte offsets of the lines, the first behind a byte order mark; the last entry is the length of
        the text.
    first
        (lines + 1,) index of each line's first token.
    counts
        (lines,) tokens of each line, trailing comments excluded; 0 on blank and comment lines.
    token_start, token_stop
        Byte offsets of the tokens.
    """

    def __init__(self, data: bytes) -> None:
        self.data = data
        buffer = np.frombuffer(data, dtype=np.uint8)
        self._buffer = buffer
        text_start = len(_BOM) if data.startswith(_BOM) else 0
        self.token_start, self.token_stop, newlines = _tokens_and_newlines(buffer, text_start)
        ends_open = len(data) > text_start and (len(newlines) == 0 or newlines[-1] != len(data) - 1)
        tail = [len(data)] if ends_open else []
        self.line_start: IndexArray = np.concatenate([[text_start], newlines + 1, tail]).astype(np.intp)
        # (one dtype on both sides, or numpy would copy the tokens)
        self.first: IndexArray = np.searchsorted(self.token_start, self.line_start.astype(self.token_start.dtype))
        self.counts: IndexArray = np.diff(self.first)
        self.has_comment = np.zeros(self.lines, dtype=bool)
        if b"#" in data:
            hashes = np.flatnonzero(buffer[self.token_start] == _HASH)
            line = np.searchsorted(self.first, hashes, side="right") - 1
            np.minimum.at(self.counts, line, hashes - self.first[line])
            self.has_comment[line] = True

    @property
    def lines(self) -> int:
        """Number of lines."""
        return len(self.line_start) - 1

    @cached_property
    def tags(self) -> tuple[list[bytes], IndexArray]:
        """The distinct first tokens, and for each line the index of its own (-1 on blank and comment lines)."""
        tag_of_line = np.full(self.lines, -1, dtype=np.intp)
        used = np.flatnonzero(self.counts > 0)
        if len(used) == 0:
            return [], tag_of_line
        token = self.first[used]
        key = self._token_hash(token)
        run = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]]))
        _, where, inverse = np.unique(key[run], return_index=True, return_inverse=True)
        tag_of_line[used] = np.repeat(inverse, np.diff(np.append(run, len(key))))
        return [self.token(int(token[run[k]])) for k in where], tag_of_line

    def _token_hash(self, token: IndexArray) -> NDArray[np.uint64]:
        """A 64-bit hash of the first 64 bytes of each of the given tokens, in vectorized multiply-and-add."""
        start = self.token_start[token]
        length = np.minimum(self.token_stop[token] - start, 8 * _TAG_WORDS)
        padded = np.concatenate([self._buffer, np.zeros(8 * _TAG_WORDS, dtype=np.uint8)])
        words = np.ndarray((len(padded) - 7,), dtype="<u8", buffer=padded, strides=(1,))
        hashed = length.astype(np.uint64)
        multiplier = np.uint64(0x9E3779B97F4A7C15)
        for word in range((int(length.max()) + 7) // 8):
            present = np.clip(length - 8 * word, 0, 8).astype(np.uint64)
            mask = np.where(present == 8, ~np.uint64(0), (np.uint64(1) << (present * np.uint64(8))) - np.uint64(1))
            hashed = (hashed ^ (words[start + 8 * word] & mask)) * multiplier
            hashed ^= hashed >> np.uint64(29)
        return hashed

    def token(self, index: int) -> bytes:
        """Text of a token."""
        return self.data[self.token_start[index] : self.token_stop[index]]

    def line(self, line: int) -> str:
        """Text of a line (from 0), without its end."""
        start, stop = self.line_start[line], self.line_start[line + 1]
        return self.data[start:stop].decode("utf-8", "replace").rstrip("\r\n")

    def column(self, line: int, offset: int) -> int:
        """Column (from 1) of a byte offset in a line (from 0); a byte order mark does not count."""
        return offset - int(self.line_start[line]) + 1

    def end_column(self, line: int) -> int:
        """Column just behind the last token of a line (from 0)."""
        last = self.first[line] + self.counts[line] - 1
        return self.column(line, int(self.token_stop[last]))

    def record_spans(self) -> tuple[IndexArray, IndexArray]:
        """Byte offsets, for each line, of its first token and of the end of its last one (comments excluded).

        Equal on blank and comment lines.
        """
        start, stop = self.line_start[:-1].copy(), self.line_start[:-1].copy()
        used = np.flatnonzero(self.counts > 0)
        start[used] = self.token_start[self.first[used]]
        stop[used] = self.token_stop[self.first[used] + self.counts[used] - 1]
        return start, stop

    def parse(self, wanted: Collection[bytes], ignored: IndexArray) -> tuple[Array, dict[bytes, Rows], list[BadToken]]:
        """Parse the numbers of all records whose tag is wanted.

        Parameters
        ----------
        wanted
            Tags whose lines consist of the tag and numbers.
        ignored
            Lines (from 0) to leave out.

        Returns
        -------
        numbers
            All numbers of those records, in the order of the text.
        rows
            For each tag, where its records are in ``numbers``.
        bad
            Tokens that are not finite decimal numbers. If there are any, the numbers are not valid: call again with
            their lines ignored.
        """
        names, tag_of_line = self.tags
        is_wanted = np.array([name in wanted for name in names] + [False])
        use = is_wanted[tag_of_line]
        use[ignored] = False
        lines = np.flatnonzero(use)
        counts = self.counts[lines] - 1
        offsets = np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.intp) if len(lines) else lines
        numbers = self._parse_numbers(use, lines)
        if numbers is None or len(numbers) != counts.sum() or not np.isfinite(numbers).all():
            bad = self._bad_tokens(lines)
            if not bad:  # the parser and our grammar disagree: cannot happen, but must never be silent
                raise AssertionError("number parser and token count disagree")
            return np.empty(0), {}, bad
        rows = {}
        tag_of_used = tag_of_line[lines]
        for index, name in enumerate(names):
            if name in wanted:
                mine = np.flatnonzero(tag_of_used == index)
                rows[name] = Rows(lines[mine], counts[mine], offsets[mine])
        return numbers, rows, []

    def _parse_numbers(self, use: NDArray[np.bool_], lines: IndexArray) -> Array | None:
        """Numbers of the used lines, None where the parser met something that is not a number."""
        if not (self.counts[lines] > 1).any():
            return np.empty(0)
        text = bytearray(len(self.data))
        clean = np.frombuffer(text, dtype=np.uint8)
        np.maximum(self._buffer, _BLANK, out=clean)
        clean[_damaged(self._buffer)] = ord("?")
        clean[self.token_start[1:] - 1] = _COMMA  # before each token; what is no number is blanked with its comma
        clean[: self.line_start[0]] = _BLANK
        token = self.first[lines]
        start = np.maximum(self.token_start[token] - 1, 0)
        length = self.token_stop[token] - start
        for size in np.flatnonzero(np.bincount(length)).tolist():
            stretches = np.lib.stride_tricks.as_strided(clean, (len(clean) - size + 1, size), (1, 1))
            stretches[start[length == size]] = _BLANK
        # whole lines that are not used, in runs, and comments behind records
        edges = np.flatnonzero(np.diff(use.astype(np.int8), prepend=1, append=1))
        for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            clean[max(int(self.line_start[begin]) - 1, 0) : self.line_start[end]] = _BLANK
        for line in np.flatnonzero(self.has_comment & use).tolist():
            comment = self.token_start[self.first[line] + self.counts[line]]
            clean[comment - 1 : self.line_start[line + 1]] = _BLANK
        first_number = self.first[lines[self.counts[lines] > 1][0]] + 1
        clean[self.token_start[first_number] - 1] = _BLANK
        return _parse_list(text)

    def _bad_tokens(self, lines: IndexArray) -> list[BadToken]:
        """All tokens of the given lines that are not finite numbers (the slow path of broken files)."""
        bad = []
        for line in lines.tolist():
            first = int(self.first[line])
            for index in range(first + 1, first + int(self.counts[line])):
                text = self.token(index)
                if not _NUMBER.match(text) or not np.isfinite(float(text)):
                    bad.append(BadToken(line, int(self.token_start[index]), text.decode("utf-8", "replace")))
        return bad


def _damaged(buffer: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Which bytes are control characters other than white space."""
    return (buffer < _TAB) | ((buffer > _RETURN) & (buffer < _BLANK))


def _tokens_and_newlines(buffer: NDArray[np.uint8], start: int) -> tuple[IndexArray, IndexArray, IndexArray]:
    """Where tokens start and where they stop, and where the line feeds are, from a byte offset on."""
    offset = np.int32 if len(buffer) < 2**31 else np.int64  # half the memory for all files but the largest
    none = np.empty(0, dtype=offset)
    starts, stops, newlines = [none], [none], [none]
    inside = False
    for begin in range(start, len(buffer), _CHUNK):
        chunk = buffer[begin : begin + _CHUNK]
        inked = (chunk > _BLANK) | _damaged(chunk)
        if bool(inked[0]) != inside:
            (stops if inside else starts).append(np.array([begin], dtype=offset))
        for which, edge in ((starts, inked[1:] > inked[:-1]), (stops, inked[1:] < inked[:-1])):
            found = np.flatnonzero(edge)
            which.append((found + (begin + 1)).astype(offset))
        newlines.append((np.flatnonzero(chunk == _NEWLINE) + begin).astype(offset))
        inside = bool(inked[-1])
    if inside:
        stops.append(np.array([len(buffer)], dtype=offset))
    return np.concatenate(starts), np.concatenate(stops), np.concatenate(newlines)


def _parse_list(text: bytearray) -> Array | None:
    """Numbers of a comma-separated list, None where there is something that is not a number.

    In chunks: the Python numbers of one make room for those of the next.
    """
    parts, begin = [], 0
    while begin < len(text):
        stop = text.find(b",", begin + _CHUNK)
        stop = len(text) if stop < 0 else stop
        part = _parse_chunk(text[begin:stop])
        if part is None:
            return None
        parts.append(part)
        begin = stop + 1
    return np.concatenate(parts)


def _has_negative_zero(text: NDArray[np.uint8]) -> bool:
    """Whether a number ends in ``-0``."""
    minus, zero = text[:-1] == ord("-"), text[1:] == ord("0")
    ends = np.append(text[2:] <= _COMMA, True)
    return bool((minus & zero & ends[: len(minus)]).any())


def _parse_chunk(text: bytearray) -> Array | None:
    # true, false, null and strings are JSON, too; and JSON's -0 is an integer, which has no sign
    if not (b"u" in text or b"l" in text or b'"' in text or _has_negative_zero(np.frombuffer(text, dtype=np.uint8))):
        try:
            found = orjson.loads(b"[" + text + b"]")
            return np.fromiter(found, dtype=np.float64, count=len(found))
        except (ValueError, TypeError, OverflowError):
            pass
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        try:
            numbers = bytes(text.replace(b",", b" "))
            return np.empty(0) if numbers.isspace() else np.fromstring(numbers, dtype=np.float64, sep=" ")
        except (DeprecationWarning, ValueError):
            return None
