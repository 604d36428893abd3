"""One command of slamcli in a process of its own: exit code, document, messages, time and memory."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

#: Exit code that stands for a command which its time limit ended, as that of timeout(1).
TIMED_OUT = 124
#: Runs a module; not one that happens to stand in the working directory.
PYTHON = (sys.executable, "-P", "-m")
#: Environment variables that set the number of threads of the libraries.
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Execution:
    """One command that has ended.

    Attributes
    ----------
    words
        Behind ``slamcli``.
    exit_code
        Of the process; 128 + n where signal n ended it, ``TIMED_OUT`` where its time limit did.
    document
        What it printed with ``--json``, None if that is no JSON document.
    messages
        What it wrote on standard error.
    seconds
        Wall-clock time of the whole process.
    """

    words: tuple[str, ...]
    exit_code: int
    document: dict[str, Any] | None
    messages: str
    seconds: float


#: Runs words of slamcli in a folder, with a limit of seconds or None.
Executor = Callable[[Sequence[str], Path, float | None], Execution]


class Processes:
    """Runs commands, also from several threads at once, and can end all of them.

    A thread that waits for a process does not hear of Ctrl-C: the main thread does, and calls ``stop``.
    """

    def __init__(self) -> None:
        self._running: set[subprocess.Popen[bytes]] = set()
        self._lock = threading.Lock()
        self._stopped = False

    def execute(self, words: Sequence[str], folder: Path, limit: float | None = None) -> Execution:
        """Run a command of slamcli in a process of its own, on one thread.

        Parameters
        ----------
        words
            Behind ``slamcli``; ``--json`` among them gives a document.
        folder
            Working directory.
        limit
            Seconds after which the process is killed.

        Raises
        ------
        KeyboardInterrupt
            If the user asks to stop, or ``stop`` was called; the process is gone then.
        """
        return self.run([*PYTHON, "slamcli", *words], words, folder, limit)

    def run(self, line: Sequence[str], words: Sequence[str], folder: Path, limit: float | None = None) -> Execution:
        """The same with any command line; ``words`` are what the result says was run."""
        started = time.perf_counter()
        with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
            with self._process(line, folder, out, err) as process:
                try:
                    code = process.wait(limit)
                except subprocess.TimeoutExpired:
                    code = TIMED_OUT
            seconds = time.perf_counter() - started
            if self._stopped:
                raise KeyboardInterrupt
            out.seek(0)
            err.seek(0)
            return Execution(
                tuple(words),
                code if code >= 0 else 128 - code,
                document_of(out.read()),
                err.read().decode(errors="replace"),
                seconds,
            )

    def stop(self) -> None:
        """End all processes that run, and start none any more."""
        with self._lock:
            self._stopped = True
            for process in self._running:
                process.kill()

    @contextlib.contextmanager
    def _process(self, line: Sequence[str], folder: Path, out: IO[bytes], err: IO[bytes]) -> Iterator[Any]:
        """A process that is gone at the end, come what may."""
        with self._lock:
            if self._stopped:
                raise KeyboardInterrupt
            # a session of its own: Ctrl-C reaches this process, which decides what becomes of the other
            process = subprocess.Popen(
                list(line),
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                cwd=folder,
                env=environment(),
                start_new_session=True,
            )
            self._running.add(process)
        try:
            yield process
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()
            with self._lock:
                self._running.discard(process)


def execute(words: Sequence[str], folder: Path, limit: float | None = None) -> Execution:
    """Run a command of slamcli in a process of its own: see ``Processes.execute``."""
    return Processes().execute(words, folder, limit)


def environment() -> dict[str, str]:
    """Of a command: nothing that a user has set for slamcli but where data sets are, and one thread."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("SLAMCLI_")}
    kept |= {name: value for name, value in os.environ.items() if name == "SLAMCLI_DATASETS"}
    return kept | dict.fromkeys(THREADS, "1")


def document_of(text: bytes) -> dict[str, Any] | None:
    """The JSON document that a command printed, None if that is none."""
    try:
        document = json.loads(text)
    except ValueError:
        return None
    return document if isinstance(document, dict) else None
