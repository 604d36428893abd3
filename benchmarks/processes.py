"""Children that answer tasks line by line: with a time limit for each task, and another child after a crash."""

from __future__ import annotations

import contextlib
import json
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any, TextIO

#: Seconds for a child to load its libraries and its graph.
LOADING = 60.0


def answers(request: dict[str, Any], count: int, limit: Callable[[], float]) -> Iterator[dict[str, Any]]:
    """One answer of ``benchmarks.peers`` for each of ``count`` tasks, in order; failures are answers as well.

    Parameters
    ----------
    request
        For the child; its ``tasks`` are cut to those that are open when a child has to be replaced.
    count
        Number of tasks.
    limit
        Seconds that a task may take, asked before each.
    """
    done = 0
    while done < count:
        open_tasks = request | ({"tasks": request["tasks"][done:]} if "tasks" in request else {})
        with _child(open_tasks) as (process, lines):
            extra = LOADING
            while done < count:
                allowed = limit()
                line = _next(lines, allowed + extra)
                if line is None or line == "":
                    yield _failure(process, allowed if line is None else None)
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


def _failure(process: subprocess.Popen[str], limit: float | None) -> dict[str, Any]:
    if limit is not None:
        note = f"stopped after {limit:.0f} s"
    else:
        code = process.wait()
        note = f"the process died of {signal.Signals(-code).name}" if code < 0 else f"the process ended with {code}"
    failed = {"solve": None, "iterations": 0, "chi2": None, "reached": False, "note": note}
    return failed if limit is None else failed | {"stopped": limit}


@contextlib.contextmanager
def _child(request: dict[str, Any]) -> Iterator[tuple[subprocess.Popen[str], queue.Queue[str]]]:
    """A child with the request on its standard input and its lines in a queue; it is gone at the end."""
    command = [sys.executable, "-m", "benchmarks.peers"]
    lines: queue.Queue[str] = queue.Queue()
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin is not None and process.stdout is not None
        with contextlib.suppress(BrokenPipeError):
            process.stdin.write(json.dumps(request))
            process.stdin.close()
        threading.Thread(target=_read, args=(process.stdout, lines), daemon=True).start()
        try:
            yield process, lines
        finally:
            process.kill()


def _read(stream: TextIO, lines: queue.Queue[str]) -> None:
    """Lines of documents; what libraries print is passed over."""
    with contextlib.suppress(ValueError):  # closed
        for line in stream:
            if line.startswith("{"):
                lines.put(line)
    lines.put("")
