"""A peer on one pose graph in a process of its own: ``python -m benchmarks.peers``, a request on standard input.

The request is one JSON document: ``path`` of the graph, ``peer``, ``best`` chi2, ``reference`` (a file of values at
the optimum, for the peer's own cost there) and ``tasks``, a list of setting names with a number of iterations each
(null: search for the fewest that reach the optimum). The answer is one line of JSON for each task, when it is done.

Iterations: of each setting the fewest that reach the optimum are looked for and then timed, as if the user of the peer
knew them; so the peers' own termination tests cost nothing. The time is that of the second of two runs.
"""

from __future__ import annotations

import importlib
import json
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import slamcli
from benchmarks.settings import REACHED, SETTINGS, Setting
from slamcli.graph.columns import Values
from slamcli.models.base import Array
from slamcli.solver import gauge
from slamcli.solver.initialization import initialize

#: Iterations that a method may take.
BUDGET = {"gn": 60, "lm": 200, "lm-ceres": 200, "dogleg": 200}
#: A peer's optimum counts as the best known one if polishing takes it there and it is this near.
NEAR = 0.1


class Case:
    """A pose graph as arrays with the poses in the order of their ids, and its starts."""

    def __init__(self, path: str, best: float) -> None:
        started = time.perf_counter()
        self.graph = slamcli.read(path)
        self.load = time.perf_counter() - started
        self.best = best
        (self.column,) = (column for column in self.graph.variables.values() if len(column))
        self.space = self.column.kind.space
        if not all(factors.kind.relative_pose for factors in self.graph.factors):
            raise ValueError("not a pose graph")
        _, self.held = gauge.choose(self.graph)
        self.held_ranks = sorted(self.column.rank[self.held[self.column.kind.name]].tolist())
        self.pairs = self.column.rank[np.concatenate([f.indices for f in self.graph.factors])]
        self.measurements = np.concatenate([f.measurements for f in self.graph.factors])
        self.information = np.concatenate([f.information for f in self.graph.factors])
        self._starts: dict[str, tuple[Array, float]] = {}

    def start(self, name: str) -> tuple[Array, float]:
        """Poses (n, size) in the order of the ids, and the seconds that slamcli took to make them."""
        if name not in self._starts:
            method = "odometry" if name == "file" and not self.column.known.all() else name
            started = time.perf_counter()
            values, _ = initialize(self.graph, method, self.held)
            seconds = time.perf_counter() - started
            if name in ("file", "chordal"):
                seconds = 0.0  # what the file gives, and the start that is not counted
            self._starts[name] = values[self.column.kind.name][np.argsort(self.column.rank)], seconds
        return self._starts[name]

    def values(self, poses: Array) -> Values:
        """The state of poses in the order of the ids."""
        kind = self.column.kind
        return {**self.graph.values, kind.name: kind.normalize(poses[self.column.rank])}

    def chi2(self, poses: Array) -> float:
        """chi2 as slamcli has it."""
        return self.graph.chi2(self.values(poses))

    def polished(self, poses: Array) -> float:
        """chi2 at which slamcli's Gauss-Newton ends from these poses."""
        return slamcli.optimize(self.graph.with_values(self.values(poses)), method="gn", init="file").final_chi2

    def reached(self, chi2: float) -> bool:
        """Whether a chi2 is at the best known one, or below it."""
        return chi2 <= self.best * (1.0 + REACHED)


class Trial:
    """One run of a peer: poses at the end, chi2, seconds, iterations."""

    def __init__(self, case: Case, poses: Array, seconds: float, iterations: int, own: float = np.nan) -> None:
        self.poses, self.seconds, self.iterations, self.own = poses, seconds, iterations, own
        self.chi2 = case.chi2(poses)

    def document(self, case: Case, **more: Any) -> dict[str, Any]:
        """For JSON."""
        reached = case.reached(self.chi2)
        return {
            "solve": self.seconds, "iterations": self.iterations, "chi2": self.chi2, "reached": reached, "note": ""
        } | more  # fmt: skip


#: Runs a setting for so many iterations at most; a list takes up the (own cost, iterations) after each iteration.
Run = Callable[[Setting, int, list[float] | None], Trial]


def search(case: Case, setting: Setting, run: Run, own_best: float | None) -> dict[str, Any]:
    """Look for the fewest iterations that reach the optimum and time them."""
    course: list[float] = []
    first = run(setting, BUDGET[setting.method], course)
    own_cost_differs = own_best is not None
    near = first.chi2 <= case.best * (1.0 + NEAR)
    polished = case.polished(first.poses) if near and not case.reached(first.chi2) and own_cost_differs else None
    if not (case.reached(first.chi2) or (polished is not None and case.reached(polished))):
        return first.document(case, note=_ended_at(first, polished))
    goal = case.best if own_best is None else own_best
    fewest = next((k + 1 for k, cost in enumerate(course) if cost <= goal * (1.0 + REACHED)), len(course))
    for count in range(max(fewest, 1), len(course) + 1):
        found = timed(case, setting, run, count, own_best)
        if found["reached"]:
            return found
    return first.document(case, note="came to the optimum, but not in its own cost")


def _ended_at(trial: Trial, polished: float | None) -> str:
    if not np.isfinite(trial.chi2):
        return "diverged"
    return "another minimum, or not converged" + ("" if polished is None else f"; polished {polished:.9g}")


def timed(case: Case, setting: Setting, run: Run, count: int, own_best: float | None) -> dict[str, Any]:
    """Run a setting for a number of iterations, twice; the second is timed."""
    cold = run(setting, count, None)
    warm = run(setting, count, None) if cold.seconds < 10.0 else cold
    if case.reached(warm.chi2) or own_best is None:
        return warm.document(case, cold=cold.seconds)
    polished = case.polished(warm.poses)
    reached = warm.own <= own_best * (1.0 + REACHED) and case.reached(polished)
    note = f"at the optimum of its own cost; polished {polished:.9g}" if reached else ""
    return warm.document(case, cold=cold.seconds, polished=polished, reached=reached, note=note)


def ours(case: Case, options: dict[str, Any]) -> dict[str, Any]:
    """slamcli, twice in the process; the second run is timed, the first one beside it."""
    from slamcli.solver.optimize import optimize
    from slamcli.solver.options import OptimizeOptions

    seconds, chosen = [], OptimizeOptions(**options)
    for _ in range(2):
        started = time.perf_counter()
        result = optimize(case.graph, options=chosen)
        seconds.append(time.perf_counter() - started)
    poses = result.graph.variables[case.column.kind.name].values[np.argsort(case.column.rank)]
    trial = Trial(case, poses, seconds[1], result.iterations)
    return trial.document(
        case, cold=seconds[0], status=str(result.status), start=result.start, phases=result.time, load=case.load
    )


def main() -> None:
    """Answer the request on standard input."""
    request = json.load(sys.stdin)
    case = Case(request["path"], request["best"])
    if request["peer"] == "slamcli":
        for options in request["tasks"]:
            _answer(ours(case, options))
        return
    if request["peer"] == "reference":
        _answer(reference(case, request["reference"]))
        return
    peer = importlib.import_module(f"benchmarks.peer_{request['peer']}").Peer(case)
    own_best = peer.own_best(np.load(request["reference"]))
    settings = {setting.name: setting for setting in SETTINGS[request["peer"]]}
    for name, count in request["tasks"]:
        started = time.process_time(), time.perf_counter()
        try:
            if count is None:
                found = search(case, settings[name], peer.run, own_best)
            else:
                found = timed(case, settings[name], peer.run, count, own_best)
        except Exception as error:  # whatever the peer throws is its result
            words = " ".join(f"{type(error).__name__}: {error}".split())
            found = {"solve": None, "iterations": 0, "chi2": None, "reached": False, "note": words[:120]}
        found["cores"] = (time.process_time() - started[0]) / (time.perf_counter() - started[1])
        _answer({"setting": name, **found})


def reference(case: Case, path: str) -> dict[str, Any]:
    """Save the poses at the lowest chi2 that slamcli finds from its starts."""
    lowest, poses, where = np.inf, case.start("spanning-tree")[0], "none"
    for init in ("chordal", "spanning-tree", "auto", "file"):
        result = slamcli.optimize(case.graph, init=init, time_limit=30.0)
        if result.final_chi2 < lowest:
            lowest, where = result.final_chi2, init
            poses = result.graph.variables[case.column.kind.name].values[np.argsort(case.column.rank)]
        if case.reached(lowest):
            break
    np.save(path, poses)
    return {"chi2": lowest, "init": where, "vertices": len(case.column), "edges": len(case.pairs)}


def _answer(document: dict[str, Any]) -> None:
    print(json.dumps(document), flush=True)


if __name__ == "__main__":
    main()
