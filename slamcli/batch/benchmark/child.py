"""Runs on one graph in a process of its own: ``python -m slamcli.batch.benchmark.child``, a request on standard input.

The request is one JSON document: ``path`` of the graph, ``peer`` (``slamcli``, ``reference`` or a peer), ``best`` chi2
(null: not known), ``reference`` (a file of values at the optimum, for the peer's own cost there) and ``tasks``: for
slamcli a list of options, for a peer a list of setting names with a number of iterations each (null: search for the
fewest that reach the optimum). The answer is one line of JSON for each task, when it is done.
"""

from __future__ import annotations

import importlib
import json
import math
import os
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from slamcli.batch.benchmark.case import Case
from slamcli.batch.benchmark.peers.settings import SETTINGS
from slamcli.batch.benchmark.processes import failure
from slamcli.batch.benchmark.search import ours, reference, search, timed
from slamcli.batch.memory import peak_memory
from slamcli.errors import SlamcliError
from slamcli.graph.columns import Values


def main() -> None:
    """Answer the request on standard input."""
    request = json.loads(sys.stdin.readline())
    threading.Thread(target=_end_with_the_parent, daemon=True).start()
    best = request["best"]
    case = Case(request["path"], -math.inf if best is None else best)
    if request["peer"] == "slamcli":
        for options in request["tasks"]:
            _answer(_attempt(lambda options=options: ours(case, options)))  # type: ignore[misc]
        return
    if request["peer"] == "reference":
        _answer(reference(case, request["reference"]))
        return
    _answer_for_peer(case, request)


def _end_with_the_parent() -> None:
    """Standard input ends when the parent does, however that came."""
    os.read(sys.stdin.fileno(), 1)  # not sys.stdin.read(), whose lock the end of this process would wait for
    os._exit(1)


def _answer_for_peer(case: Case, request: dict[str, Any]) -> None:
    """The tasks of a peer; what it throws is its result."""
    settings = {setting.name: setting for setting in SETTINGS[request["peer"]]}
    try:
        peer = importlib.import_module(f"slamcli.batch.benchmark.peers.{request['peer']}").Peer(case)
        own_best = peer.own_best(_values(request["reference"]))
    except Exception as error:
        for name, _ in request["tasks"]:
            _answer({"setting": name, **failure(_words(error))})
        return
    for name, count in request["tasks"]:
        setting = settings[name]
        if count is None:
            found = _attempt(lambda one=setting: search(case, one, peer.run, own_best))  # type: ignore[misc]
        else:
            found = _attempt(lambda one=setting, n=count: timed(case, one, peer.run, n, own_best))  # type: ignore[misc]
        _answer({"setting": name, **found})


def _values(path: str) -> Values:
    with np.load(path) as values:
        return dict(values)


def _attempt(run: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """What a run gives, or its exception in words; with the processors that it kept busy and the peak memory."""
    started = time.process_time(), time.perf_counter()
    try:
        found = run()
    except Exception as error:
        found = failure(_words(error))
    found["cores"] = (time.process_time() - started[0]) / (time.perf_counter() - started[1])
    found["memory"] = peak_memory()
    return found


def _words(error: Exception) -> str:
    if isinstance(error, SlamcliError | ValueError):
        return " ".join(str(error).split())[:120]
    return " ".join(f"{type(error).__name__}: {error}".split())[:120]


def _answer(document: dict[str, Any]) -> None:
    print(json.dumps(document), flush=True)


if __name__ == "__main__":
    main()
