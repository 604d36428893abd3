"""One command of slamcli in a process of its own: exit code, document, messages, time and memory."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

#: Exit code that stands for a command which its time limit ended, as that of timeout(1).
TIMED_OUT = 124
#: What makes a run the same whatever the machine does besides, and whatever its user has set for slamcli.
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


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


def execute(words: Sequence[str], folder: Path, limit: float | None = None) -> Execution:
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
        If the user asks to stop; the process is gone then.
    """
    environment = {name: value for name, value in os.environ.items() if not name.startswith("SLAMCLI_")}
    environment |= {name: value for name, value in os.environ.items() if name == "SLAMCLI_DATASETS"}
    environment |= dict.fromkeys(_ONE_THREAD, "1")
    started = time.perf_counter()
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        # a session of its own: Ctrl-C reaches this process, which decides what becomes of the other
        process = subprocess.Popen(
            [sys.executable, "-m", "slamcli", *words],
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=err,
            cwd=folder,
            env=environment,
            start_new_session=True,
        )
        with _killed_at_the_end(process):
            try:
                code = process.wait(limit)
            except subprocess.TimeoutExpired:
                code = TIMED_OUT
        seconds = time.perf_counter() - started
        out.seek(0)
        err.seek(0)
        return Execution(
            tuple(words),
            code if code >= 0 else 128 - code,
            document_of(out.read()),
            err.read().decode(errors="replace"),
            seconds,
        )


def document_of(text: bytes) -> dict[str, Any] | None:
    """The JSON document that a command printed, None if that is none."""
    try:
        document = json.loads(text)
    except ValueError:
        return None
    return document if isinstance(document, dict) else None


@contextlib.contextmanager
def _killed_at_the_end(process: subprocess.Popen[bytes]) -> Iterator[None]:
    try:
        yield
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
