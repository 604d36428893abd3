"""Children that answer tasks line by line: with a time limit for each task, and another child after a crash."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import signal
import subprocess
import tempfile
import threading
from collections.abc import Callable, Iterator
from typing import IO, Any, TextIO

from slamcli.batch.execution import PYTHON, THREADS

#: Seconds for a child to load its libraries and its graph.
LOADING = 60.0
#: Asks a child: a request, the number of its tasks, the seconds for each (and those to load).
Ask = Callable[[dict[str, Any], int, Callable[[], float]], Iterator[dict[str, Any]]]


def answers(
    request: dict[str, Any],
    count: int,
    limit: Callable[[], float],
    *,
    loading: float = LOADING,
    threads: int | None = None,
) -> Iterator[dict[str, Any]]:
    """One answer of ``child`` for each of ``count`` tasks, in order; failures are answers as well.

    Parameters
    ----------
    request
        For the child; its ``tasks`` are cut to those that are open when a child has to be replaced.
    count
        Number of tasks.
    limit
        Seconds that a task may take, asked before each.
    loading
        Seconds on top for the first task of a child.
    threads
        Of the libraries, None for what the environment says.
    """
    done = 0
    while done < count:
        open_tasks = request | ({"tasks": request["tasks"][done:]} if "tasks" in request else {})
        with _child(open_tasks, threads) as (process, lines, messages):
            extra = loading
            while done < count:
                allowed = limit()
                line = _next(lines, allowed + extra)
                if line is None or line == "":
                    yield _failure(process, allowed if line is None else None, messages)
                    done += 1
                    break
                yield json.loads(line)
                done += 1
                extra = 0.0


def _next(lines: queue.Queue[str], seconds: float) -> str | None:
    """The next line, "" at the end of the stream, None if the time is over."""
    try:
        return lines.get(timeout=seconds)
    except queue.Empty:
        return None


def failure(note: str) -> dict[str, Any]:
    """The answer of a task that came to nothing."""
    return {"solve": None, "iterations": 0, "chi2": None, "reached": False, "note": note}


def _failure(process: subprocess.Popen[str], limit: float | None, messages: IO[bytes]) -> dict[str, Any]:
    if limit is not None:
        return failure(f"stopped after {limit:g} s") | {"stopped": limit}
    code = process.wait()
    note = f"the process died of {signal.Signals(-code).name}" if code < 0 else f"the process ended with {code}"
    messages.seek(0)
    last = messages.read().decode(errors="replace").strip().splitlines()[-1:]
    return failure(": ".join([note, *last])[:200])


@contextlib.contextmanager
def _child(
    request: dict[str, Any], threads: int | None
) -> Iterator[tuple[subprocess.Popen[str], queue.Queue[str], IO[bytes]]]:
    """A child with the request on its standard input and its lines in a queue; it is gone at the end."""
    command = [*PYTHON, "slamcli.batch.benchmark.child"]
    environment = dict(os.environ) | ({} if threads is None else dict.fromkeys(THREADS, str(threads)))
    lines: queue.Queue[str] = queue.Queue()
    with (
        tempfile.TemporaryFile() as messages,
        subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=messages,
            text=True,
            env=environment,
            start_new_session=True,  # Ctrl-C is for the parent, which decides what becomes of its child
        ) as process,
    ):
        try:
            assert process.stdin is not None and process.stdout is not None
            with contextlib.suppress(BrokenPipeError):
                process.stdin.write(json.dumps(request) + "\n")
                process.stdin.flush()  # and left open: its end tells the child that there is nobody left
            threading.Thread(target=_read, args=(process.stdout, lines), daemon=True).start()
            yield process, lines, messages
        finally:
            process.kill()


def _read(stream: TextIO, lines: queue.Queue[str]) -> None:
    """Lines of documents; what libraries print is passed over."""
    with contextlib.suppress(ValueError):  # closed
        for line in stream:
            if line.startswith("{"):
                lines.put(line)
    lines.put("")
