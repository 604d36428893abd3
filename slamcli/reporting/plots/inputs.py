"""What is to be drawn, recognized by content and read: maps, iterations, errors."""

from __future__ import annotations

import csv
import io
import json
import sys
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from slamcli.errors import InputError, UsageError
from slamcli.formats.diagnostics import Diagnostic
from slamcli.formats.source import read_bytes
from slamcli.models.base import Array

#: What each kind of figure is drawn from, in words.
KINDS = {
    "map": "a graph or a trajectory",
    "iterations": "iterations of optimize (--trace or --json)",
    "errors": "errors of evaluate (--errors)",
}
_HEAD = 4096


@dataclass(frozen=True, eq=False)
class Run:
    """The iterations of one optimization.

    Attributes
    ----------
    name
        For the legend.
    chi2
        (k + 1,) at the start and after each iteration; NaN where the file has null.
    seconds
        (k + 1,) since the start, of the iterations alone.
    accepted
        (k + 1,) False where an iteration could not take a step.
    status
        As in the file; None where the trace ends early.
    """

    name: str
    chi2: Array
    seconds: Array
    accepted: np.ndarray[Any, np.dtype[np.bool_]]
    status: str | None


@dataclass(frozen=True, eq=False)
class ErrorSeries:
    """Errors of the poses of one estimate.

    Attributes
    ----------
    name
        Of the estimate.
    columns
        (n,) numbers by the names of the file's columns, NaN where a cell is empty; in the file's order.
    """

    name: str
    columns: dict[str, Array]


def kind_of(path: str) -> str:
    """A key of ``KINDS``, by the first characters that are not white: the reader then says what is wrong, if anything.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    head = _head(path).removeprefix(b"\xef\xbb\xbf").lstrip()
    if head[:1] in (b"{", b"["):
        return "iterations"
    words = {word.strip(b' "\r') for word in head.partition(b"\n")[0].split(b",")}
    return "errors" if b"translation_error_m" in words or {b"estimate", b"id"} <= words else "map"


def one_kind(paths: Sequence[str]) -> str:
    """The kind of all of these files.

    Raises
    ------
    UsageError
        If they cannot be drawn together: the message says what each file is.
    """
    kinds = {path: kind_of(path) for path in paths}
    if len(set(kinds.values())) > 1:
        lines = tuple(f"  {path}: {KINDS[kind]}" for path, kind in kinds.items())
        raise UsageError("these inputs cannot be drawn in one figure", lines)
    return next(iter(kinds.values()))


def _head(path: str) -> bytes:
    """The first characters of a file or of standard input, decompressed, without taking them from the latter."""
    if path == "-":
        if sys.stdin is None:
            raise InputError("standard input is closed")
        stream: Any = sys.stdin.buffer
        if hasattr(stream, "peek"):
            head = stream.peek(_HEAD)
        else:
            position = stream.tell()
            head = stream.read(_HEAD)
            stream.seek(position)
    else:
        try:
            with open(path, "rb") as stream:
                head = stream.read(_HEAD)
        except IsADirectoryError:
            raise InputError(f"{path}: is a directory, expected a file") from None
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    if head.startswith(b"\x1f\x8b"):
        try:
            return zlib.decompressobj(wbits=31).decompress(head, _HEAD)
        except zlib.error:
            return b""  # the reader has a message for it
    return bytes(head)


def read_runs(path: str, name: str) -> list[Run]:
    """Read what ``optimize --trace`` or ``optimize --json`` wrote; a trace may hold several runs, one after the other.

    Raises
    ------
    InputError
        If it is not JSON, not of ``optimize``, or has no iterations.
    """
    text = read_bytes(path)[1].decode("utf-8", "replace").removeprefix("\ufeff")
    found = _runs(path, _documents(path, text))
    if not found:
        raise InputError(f"{path}: is empty, expected what slamcli optimize --trace writes")
    names = [name] if len(found) == 1 else [f"{name} ({k})" for k in range(1, len(found) + 1)]
    return [_run(path, *run) for run in zip(names, found, strict=True)]


def _documents(path: str, text: str) -> list[Any]:
    """The one JSON document of a file, or those of its lines."""
    try:
        return [json.loads(text)]
    except ValueError as error:
        whole = error
    out = []
    for number, line in enumerate(text.splitlines(), 1):
        if line.strip():
            try:
                out.append(json.loads(line))
            except json.JSONDecodeError as error:
                if not out:  # a document over many lines
                    error, number, line = _located(whole, text, error, number, line)
                shown = Diagnostic(path, number, error.colno, f"is not JSON: {error.msg}", line).lines()
                raise InputError(shown[0], tuple(shown[1:])) from None
    return out


def _located(
    whole: ValueError, text: str, error: json.JSONDecodeError, number: int, line: str
) -> tuple[json.JSONDecodeError, int, str]:
    """Where a document over many lines is broken."""
    if not isinstance(whole, json.JSONDecodeError):
        return error, number, line
    lines = text.splitlines()
    return whole, whole.lineno, lines[whole.lineno - 1] if whole.lineno <= len(lines) else ""


def _runs(path: str, documents: list[Any]) -> list[tuple[Any, list[Any], str | None]]:
    """Of each run: chi2 at the start, records of iterations, status."""
    if len(documents) == 1 and isinstance(documents[0], dict) and "event" not in documents[0]:
        document = documents[0]
        if document.get("command") != "optimize" or not isinstance(document.get("trace"), list):
            found = f"of slamcli {document['command']}" if "command" in document else "without 'command'"
            raise InputError(f"{path}: a JSON document {found}", ("  expected one of slamcli optimize --json",))
        return [(document.get("initial_chi2"), document["trace"], document.get("status"))]
    out: list[tuple[Any, list[Any], str | None]] = []
    for number, event in enumerate(documents, 1):
        name = event.get("event") if isinstance(event, dict) else None
        if name == "start":
            out.append((event.get("chi2"), [], None))
        elif name in ("tried", "iteration", "end") and out:
            if name == "iteration":
                out[-1][1].append(event)
            elif name == "end":
                out[-1] = (*out[-1][:2], event.get("status"))
        else:
            raise InputError(
                f"{path}:{number}: is no event of a trace",
                ("  expected lines of slamcli optimize --trace: start, iterations, end",),
            )
    return out


def _run(path: str, name: str, events: tuple[Any, list[Any], str | None]) -> Run:
    start, records, status = events
    if not records:
        raise InputError(f"{path}: holds no iterations", ("  optimize stopped before the first one",))
    try:
        chi2 = np.array([_number(start)] + [_number(record["chi2"]) for record in records])
        times = np.array([0.0] + [_number(record["time"]) for record in records])
        accepted = np.array([True] + [bool(record.get("accepted", True)) for record in records])
    except (KeyError, TypeError, ValueError, AttributeError):
        raise InputError(f"{path}: an iteration lacks 'chi2' or 'time', or they are no numbers") from None
    if not np.isfinite(chi2).any():
        raise InputError(f"{path}: no chi2 in it is finite")
    return Run(name, chi2, np.cumsum(times), accepted, status)


def _number(value: Any) -> float:
    return float("nan") if value is None else float(value)


def read_errors(path: str, name: str) -> list[ErrorSeries]:
    """Read the CSV file of ``slamcli evaluate --errors``: one series for each estimate in it.

    Raises
    ------
    InputError
        If it cannot be read, or a cell is not a number, with file and line.
    """
    text = read_bytes(path)[1].decode("utf-8", "replace").removeprefix("\ufeff")
    try:
        rows = list(csv.reader(io.StringIO(text)))
    except csv.Error as error:
        raise InputError(f"{path}: is not CSV: {error}") from None
    header, body = rows[0], [(number, row) for number, row in enumerate(rows[1:], 2) if row]
    if "translation_error_m" not in header:
        raise InputError(f"{path}:1: has no column 'translation_error_m'", (f"  columns: {', '.join(header)}",))
    if not body:
        raise InputError(f"{path}: holds no errors, only a header")
    for number, row in body:
        if len(row) != len(header):
            raise InputError(f"{path}:{number}: expected {len(header)} columns, found {len(row)}")
    cells = dict(zip(header, zip(*(row for _, row in body), strict=True), strict=True))
    columns = {}
    for key in header:
        if key not in ("estimate", "id"):
            columns[key] = _numbers(path, key, cells[key], body)
    of = np.array(cells.get("estimate", ("",) * len(body)), dtype=object)
    estimates = list(dict.fromkeys(of.tolist()))
    return [
        ErrorSeries(estimate or name, {key: column[of == estimate] for key, column in columns.items()})
        for estimate in estimates
    ]


def _numbers(path: str, name: str, cells: Sequence[str], body: Sequence[tuple[int, list[str]]]) -> Array:
    try:
        return np.array([cell or "nan" for cell in cells], dtype=np.float64)
    except ValueError:
        for (number, _), cell in zip(body, cells, strict=True):
            try:
                float(cell or "nan")
            except ValueError:
                raise InputError(f"{path}:{number}: {name} is {cell!r}, expected a number") from None
        raise
