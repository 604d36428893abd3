"""Runs of slamcli and of peers in this process: twice each, the second timed; a peer's fewest iterations.

Of each setting of a peer the fewest iterations that reach the optimum are looked for and then timed, as if the user of
the peer knew them; so the peers' own termination tests cost nothing.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, cast

import numpy as np

import slamcli
from slamcli.batch.benchmark.case import Case, Trial, reaches
from slamcli.batch.benchmark.peers.settings import Setting

#: Iterations that a method may take.
BUDGET = {"gn": 60, "lm": 200, "lm-ceres": 200, "dogleg": 200}
#: A peer's optimum counts as the best known one if polishing takes it there and it is this near.
NEAR = 0.1
#: A run that takes longer than this, in seconds, is not warmed up by another one.
LONG = 10.0

#: Runs a setting for so many iterations at most; a list takes up the own cost after each iteration.
Run = Callable[[Setting, int, list[float] | None], Trial]


def search(case: Case, setting: Setting, run: Run, own_best: float | None) -> dict[str, Any]:
    """Look for the fewest iterations that reach the optimum and time them.

    Parameters
    ----------
    case
        The graph.
    setting
        Of the peer.
    run
        Runs it.
    own_best
        The peer's own cost at the optimum, None if its cost is chi2.
    """
    course: list[float] = []
    first = run(setting, BUDGET[setting.method], course)
    own_cost_differs = own_best is not None
    near = first.chi2 <= case.best * (1.0 + NEAR)
    polished = case.polished(first.values) if near and not case.reached(first.chi2) and own_cost_differs else None
    if not (case.reached(first.chi2) or (polished is not None and case.reached(polished))):
        return first.document(case, _ended_at(first, polished))
    goal = case.best if own_best is None else own_best
    fewest = next((k + 1 for k, cost in enumerate(course) if reaches(cost, goal)), len(course))
    for count in range(max(fewest, 1), len(course) + 1):
        found = timed(case, setting, run, count, own_best)
        if found["reached"]:
            return found
    return first.document(case, "came to the optimum, but not in its own cost")


def _ended_at(trial: Trial, polished: float | None) -> str:
    if not np.isfinite(trial.chi2):
        return "diverged"
    return "another minimum, or not converged" + ("" if polished is None else f"; polished {polished:.9g}")


def timed(case: Case, setting: Setting, run: Run, count: int, own_best: float | None) -> dict[str, Any]:
    """Run a setting for a number of iterations, twice; the second is timed."""
    cold = run(setting, count, None)
    warm = run(setting, count, None) if cold.seconds < LONG else cold
    if case.reached(warm.chi2) or own_best is None:
        return warm.document(case, cold=cold.seconds)
    polished = case.polished(warm.values)
    reached = reaches(warm.own, own_best) and case.reached(polished)
    note = f"at the optimum of its own cost; polished {polished:.9g}" if reached else ""
    return warm.document(case, note, cold=cold.seconds, polished=polished, reached=reached)


def ours(case: Case, options: dict[str, Any]) -> dict[str, Any]:
    """slamcli, twice in the process; the second run is timed, the first one beside it.

    Parameters
    ----------
    case
        The graph.
    options
        Those of ``OptimizeOptions`` that are not the defaults.
    """
    from slamcli.solver.optimize import optimize
    from slamcli.solver.options import OptimizeOptions

    chosen = OptimizeOptions(**options | ({"fix": tuple(options["fix"])} if "fix" in options else {}))
    seconds: list[float] = []
    while len(seconds) < 2 and sum(seconds) < LONG:
        started = time.perf_counter()
        result = optimize(case.graph, options=chosen)
        seconds.append(time.perf_counter() - started)
    trial = Trial(case, result.graph.values, seconds[-1], result.iterations)
    return trial.document(
        case,
        cold=seconds[0],
        status=str(result.status),
        reason=result.reason,
        start=result.start,
        phases=result.time,
        load=case.load,
    )


def reference(case: Case, path: str) -> dict[str, Any]:
    """Save the values at the lowest chi2 that slamcli finds from its starts.

    Parameters
    ----------
    case
        The graph.
    path
        File (.npz) of the values by kind.
    """
    lowest, values, where = np.inf, case.graph.values, "none"
    for init in ("chordal", "spanning-tree", "auto", "file") if case.is_pose_graph else ("auto",):
        result = slamcli.optimize(case.graph, init=init, time_limit=30.0)
        if result.final_chi2 < lowest:
            lowest, values, where = result.final_chi2, result.graph.values, init
        if case.reached(lowest):
            break
    np.savez(path, **cast(dict[str, Any], values))
    poses = len(case.column) if case.is_pose_graph else case.graph.poses
    return {"chi2": lowest, "init": where, "vertices": poses, "edges": case.graph.edges}
