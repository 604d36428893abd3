"""Finished cases of a run that was interrupted, so that the next one does not run them again."""

from __future__ import annotations

import contextlib
import json
import os
from dataclasses import asdict
from typing import IO, Any

from slamcli.batch.regression.run import CaseRun
from slamcli.errors import InputError

#: With which each line begins: the first field of a ``CaseRun``.
_BEGIN = b'{"name": '


class State:
    """A file of JSON Lines, one for each finished case; cases are known by the hash of all that determines them.

    Two runs cannot have the same file. A line that was cut short (a full disk, a power failure) does not count.

    Parameters
    ----------
    path
        Of the file.
    resume
        Keep what is in it; else it begins anew.

    Raises
    ------
    InputError
        If it cannot be written, or another run has it.
    """

    def __init__(self, path: str, *, resume: bool) -> None:
        self.path = path
        self.problem = ""
        if os.path.exists(path) and not os.path.isfile(path):
            raise InputError(f"{path}: cannot be written: is no file")
        try:
            self._stream: IO[bytes] = open(path, "a+b")  # noqa: SIM115
            _lock(self._stream, path)
            self._refuse_others()
            if not resume:
                self._stream.truncate(0)
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from None
        self.finished = self._read()

    def _refuse_others(self) -> None:
        """A file that holds something else is not overwritten: a wrong name behind --state would cost it."""
        self._stream.seek(0)
        first = self._stream.readline()
        if first.strip() and not (first.startswith(_BEGIN) or _BEGIN.startswith(first)):
            self._stream.close()
            raise InputError(
                f"{self.path}: is no state file of slamcli regress", ("  remove it, or name another --state FILE",)
            )

    def _read(self) -> dict[str, CaseRun]:
        self._stream.seek(0)
        text = self._stream.read()
        found: dict[str, CaseRun] = {}
        for line in text.splitlines():
            with contextlib.suppress(ValueError, TypeError, KeyError):
                entry: dict[str, Any] = json.loads(line)
                run = CaseRun(**entry)
                found[run.key] = run
        if text and not text.endswith(b"\n"):
            self._stream.write(b"\n")
        return found

    def add(self, run: CaseRun) -> None:
        """Append a finished case; where that fails, the run goes on, and ``problem`` says why."""
        try:
            self._stream.write(json.dumps(asdict(run)).encode() + b"\n")
            self._stream.flush()
            os.fsync(self._stream.fileno())
        except (OSError, ValueError) as error:
            self.problem = self.problem or f"{self.path}: cannot be written any more: {error}: no resuming from here"

    def close(self, *, keep: bool) -> bool:
        """Let go of the file, and remove it where it has served or holds nothing; whether it stays."""
        stays = False
        with contextlib.suppress(OSError):
            stays = keep and os.path.getsize(self.path) > 0
            if not stays:
                os.unlink(self.path)
        with contextlib.suppress(OSError):
            self._stream.close()
        return stays


def _lock(stream: IO[bytes], path: str) -> None:
    try:
        import fcntl
    except ImportError:  # Windows
        return
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise InputError(f"{path}: another run has it", ("  wait for its end, or name another --state FILE",)) from None
