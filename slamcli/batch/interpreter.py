"""One command of slamcli after another in a process that stays: without the 0.2 s to 0.3 s in which a process starts.

An ``Interpreter`` is an ``Executor`` as ``execution.execute`` is, with the same results: the other side,
``slamcli.cli.serve``, runs each command as a process of its own would. What a thread or a process of the caller does
meanwhile, and how many of them there are, makes no difference; and a command that crashes takes nobody with it.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, Any

from slamcli.batch.execution import TIMED_OUT, Execution, document_of, environment

_COMMAND = (sys.executable, "-P", "-m", "slamcli.cli.serve")
#: What a traceback of Python itself may fill, in bytes.
_LONGEST_MESSAGE = 1 << 20


def scratch() -> IO[bytes]:
    """A nameless file that lives as long as it is open: in memory if the system can, since a disk may be full."""
    if hasattr(os, "memfd_create"):
        return os.fdopen(os.memfd_create("slamcli"), "w+b")
    return tempfile.TemporaryFile()


class Closed(Exception):
    """The interpreter was closed while it ran a command, or before."""


class Interpreter:
    """A process that runs commands; it starts with the first, and again after one that it did not survive."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._errors = scratch()
        self._closed = False

    def __call__(self, words: Sequence[str], folder: Path, limit: float | None = None) -> Execution:
        """Run a command of slamcli.

        Parameters
        ----------
        words
            Behind ``slamcli``.
        folder
            Working directory.
        limit
            Seconds after which the process is killed.

        Raises
        ------
        Closed
            If another thread has called ``close``.
        """
        process = self._started()
        late = threading.Event()
        started = time.perf_counter()
        watch = threading.Timer(limit, _end, (process, late)) if limit is not None else None
        if watch is not None:
            watch.start()
        try:
            answer = _asked(process, {"words": list(words), "folder": str(folder)})
        finally:
            if watch is not None:
                watch.cancel()
        seconds = time.perf_counter() - started
        if self._closed:
            raise Closed
        messages = os.pread(self._errors.fileno(), _LONGEST_MESSAGE, 0).decode(errors="replace")
        if answer is not None:
            return Execution(tuple(words), answer["code"], document_of(answer["out"].encode()), messages, seconds)
        code = process.wait()
        self._forget()
        return Execution(
            tuple(words), TIMED_OUT if late.is_set() else code if code >= 0 else 128 - code, None, messages, seconds
        )

    def close(self) -> None:
        """End the process, whatever it is at."""
        self._closed = True
        process = self._process
        if process is not None:
            process.kill()
            process.wait()

    def _started(self) -> subprocess.Popen[bytes]:
        if self._process is None:
            self._process = subprocess.Popen(
                _COMMAND,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                env=environment(),
                start_new_session=True,  # Ctrl-C reaches the caller, who decides
            )
        if self._closed:
            self.close()
            raise Closed
        return self._process

    def _forget(self) -> None:
        if self._process is not None:
            for stream in (self._process.stdin, self._process.stdout):
                with contextlib.suppress(OSError):  # what was not sent cannot be sent any more
                    stream.close()  # type: ignore[union-attr]
        self._process = None


class Interpreters:
    """Those of this process: as many as its threads use at the same time."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._idle: list[Interpreter] = []
        self._all: list[Interpreter] = []

    @contextlib.contextmanager
    def lease(self) -> Iterator[Interpreter]:
        """An interpreter that nobody else uses meanwhile."""
        with self._lock:
            if self._idle:
                found = self._idle.pop()
            else:
                found = Interpreter()
                self._all.append(found)
        try:
            yield found
        finally:
            with self._lock:
                if found in self._all:
                    self._idle.append(found)

    def close(self) -> None:
        """End all of them; the next lease starts a new one."""
        with self._lock:
            ended, self._all, self._idle = self._all, [], []
        for interpreter in ended:
            interpreter.close()


#: Of this process. They end with it: each reads end of file.
INTERPRETERS = Interpreters()


def _asked(process: subprocess.Popen[bytes], question: dict[str, Any]) -> dict[str, Any] | None:
    """The answer, None if the process ended instead."""
    assert process.stdin is not None and process.stdout is not None
    try:
        process.stdin.write(json.dumps(question).encode() + b"\n")
        process.stdin.flush()
    except OSError:
        return None
    line = process.stdout.readline()
    return json.loads(line) if line.endswith(b"\n") else None


def _end(process: subprocess.Popen[bytes], late: threading.Event) -> None:
    late.set()
    process.kill()
