"""A text that is nothing but numbers between blanks: all of them at once, and where each one stands."""

from __future__ import annotations

import contextlib
import re
import warnings

import numpy as np

from slamcli.errors import InputError
from slamcli.formats.diagnostics import Diagnostic
from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array

_TOKEN = re.compile(rb"\S+")
_NUMBER = re.compile(rb"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\Z")


class NumberStream:
    """The numbers of a text.

    Parameters
    ----------
    path
        As the user named the file, for messages.
    data
        The text.
    start
        Byte offset of what is to be read, behind a comment.

    Attributes
    ----------
    values
        (n,) all numbers.

    Raises
    ------
    InputError
        If a token is not a finite decimal number.
    """

    def __init__(self, path: str, data: bytes, start: int = 0) -> None:
        self.path, self._data, self._start = path, data, start
        found = None
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)
            with contextlib.suppress(DeprecationWarning, ValueError):
                found = np.fromstring(data[start:], dtype=np.float64, sep=" ")
        if found is None or not np.isfinite(found).all():
            raise self._bad_token()
        self.values: Array = found

    def __len__(self) -> int:
        return len(self.values)

    def whole(self, indices: IndexArray, what: str, below: int | None = None) -> IndexArray:
        """Some of the numbers, given by their positions, as whole numbers from 0 (and below a limit).

        Raises
        ------
        InputError
            If one is not.
        """
        found = self.values[indices]
        good = (found == np.floor(found)) & (found >= 0) & (found < (2**53 if below is None else below))
        if not good.all():
            limit = "" if below is None else f", at most {below - 1}"
            raise self.error(int(indices[~good][0]), f"expected {what} (a whole number from 0{limit})")
        return np.asarray(found.astype(np.intp))

    def error(self, index: int, message: str, hint: str = "") -> InputError:
        """What is wrong with a number (or with the end of the file, if there is no such number), with its place."""
        token = None
        for position, match in enumerate(_TOKEN.finditer(self._data, self._start)):
            if position == index:
                token = match
                break
        if token is None:
            return self.located(len(self._data.rstrip()), f"{message}, found the end of the file", hint)
        found = token[0].decode("utf-8", "replace")[:40]
        return self.located(token.start(), f"{message}, found {found!r}", hint)

    def located(self, offset: int, message: str, hint: str = "") -> InputError:
        """A message about a byte offset."""
        begin = self._data.rfind(b"\n", 0, offset) + 1
        end = self._data.find(b"\n", offset)
        quote = self._data[begin : end if end >= 0 else len(self._data)].decode("utf-8", "replace").rstrip()
        line = self._data.count(b"\n", 0, offset) + 1
        defect = Diagnostic(self.path, line, offset - begin + 1, message, quote, hint)
        return InputError(str(defect), tuple(defect.lines()[1:]))

    def _bad_token(self) -> InputError:
        for match in _TOKEN.finditer(self._data, self._start):
            if not _NUMBER.match(match[0]) or not np.isfinite(float(match[0])):
                found = match[0].decode("utf-8", "replace")[:40]
                hint = "decimal comma? numbers need a decimal point" if "," in found else ""
                return self.located(match.start(), f"expected a finite number, found {found!r}", hint)
        raise AssertionError("the number parser and the grammar of numbers disagree")
