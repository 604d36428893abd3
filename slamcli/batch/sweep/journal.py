"""The journal of a sweep: one line of JSON for each task that has ended, on the disk before the next one counts.

Only the process that coordinates the sweep writes it. Lines are only added. What a crash has left of a last line is
removed, so that the task is run again; of several lines with the same key the last one counts.
"""

from __future__ import annotations

import contextlib
import json
import os
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from slamcli.errors import InputError

NAME = "journal.jsonl"
_HEAD = {"journal": "slamcli sweep", "format": 1}


@dataclass(frozen=True)
class Record:
    """What came of a task.

    Attributes
    ----------
    key
        Of the task.
    exit_code
        Of its command, or of the step that failed before or after it.
    failed
        Name of the step with this code, None for code 0.
    message
        First error message of that step.
    figures
        By metric; None where there is none.
    seconds
        Wall-clock time of each step.
    """

    key: str
    exit_code: int
    failed: str | None
    message: str
    figures: dict[str, float | None]
    seconds: dict[str, float] = field(compare=False)


class Journal:
    """The journal of a folder, which must be locked.

    Parameters
    ----------
    path
        Of the file; it is made if it does not exist.

    Attributes
    ----------
    records
        By key.
    notes
        What was found amiss.

    Raises
    ------
    InputError
        If it cannot be read or written, or is no journal.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.records: dict[str, Record] = {}
        self.notes: list[str] = []
        try:
            self._handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o666)
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from None
        try:
            self._load()
        except BaseException:
            self.close()
            raise

    def append(self, record: Record) -> None:
        """Add a record; it is on the disk when this returns. A second one with the same key takes its place.

        Raises
        ------
        InputError
            If it cannot be written; what the journal had is unchanged.
        """
        self._write(asdict(record))
        self.records[record.key] = record

    def close(self) -> None:
        """Close the file."""
        os.close(self._handle)

    def _load(self) -> None:
        with open(self._handle, "rb", closefd=False) as stream:
            content = stream.read()
        whole = content.rfind(b"\n") + 1
        if whole < len(content):
            self.notes.append(f"{self.path}: its last line is torn, from a crash: that task is run again")
            self._cut(whole)
        lines = content[:whole].splitlines()
        if not lines:
            self._write(_HEAD)
            _sync_folder(self.path.parent)
            return
        for number, line in enumerate(lines, 1):
            entry = _parsed(line)
            if number == 1 and entry == _HEAD:
                continue
            record = None if entry is None or number == 1 else _record(entry)
            if record is None:
                raise InputError(
                    f"{self.path}:{number}: is no line of a sweep's journal",
                    ("  --no-resume puts the file aside and runs all tasks again",),
                )
            self.records[record.key] = record

    def _write(self, entry: dict[str, Any]) -> None:
        size = os.fstat(self._handle).st_size
        rest = memoryview(json.dumps(entry).encode() + b"\n")
        try:
            while rest:
                rest = rest[os.write(self._handle, rest) :]
            os.fsync(self._handle)
        except OSError as error:
            with contextlib.suppress(OSError):
                os.ftruncate(self._handle, size)
            raise InputError(
                f"{self.path}: cannot be written: {error.strerror}",
                (f"  it has {len(self.records)} results; the same command goes on from there",),
            ) from None

    def _cut(self, size: int) -> None:
        try:
            os.ftruncate(self._handle, size)
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written: {error.strerror}") from None


def set_aside(path: Path) -> None:
    """Make room for a new journal; an old one is kept as ``journal.jsonl.old``."""
    with contextlib.suppress(FileNotFoundError):
        os.replace(path, path.with_name(path.name + ".old"))


def _parsed(line: bytes) -> dict[str, Any] | None:
    try:
        entry = json.loads(line)
    except ValueError:
        return None
    return entry if isinstance(entry, dict) else None


def _record(entry: dict[str, Any]) -> Record | None:
    try:
        record = Record(**entry)
    except TypeError:
        return None
    kinds = (("key", str), ("exit_code", int), ("failed", str | None), ("message", str), ("figures", dict))
    fits = all(isinstance(getattr(record, name), kind) for name, kind in (*kinds, ("seconds", dict)))
    return record if fits else None


def _sync_folder(folder: Path) -> None:
    """The name of a new file is on the disk, too."""
    with contextlib.suppress(OSError):  # not on every file system
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
