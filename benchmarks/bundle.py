"""Bundle adjustment beside Ceres and GTSAM: ``python -m benchmarks.bundle [--runs N] [FILE ...]``.

Each run is a process of its own on one thread, all in turn; figures are medians of N runs (5). Cost is half the sum of
squares, without loss. Times are of the processor, which other processes disturb less than those of the clock, whose
ratio stands beside; the least of an iteration is what they disturb least. Times count from the loaded scene on, the
setup included. "to the cost" is when a run came to the lowest final cost of Ceres (to 1e-4); all stop at a relative
change of 1e-6. Peak memory is the process's, with loading, and for slamcli and GTSAM with Python. Ratios are to the
best of Ceres' solvers, each figure by itself.

Needs the standard data sets (SLAMCLI_DATASETS) or FILEs in BAL's format. What is not installed is left out, and said.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import itertools
import json
import math
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks import peer_ceres
from benchmarks.tables import print_table

SETS = ("bal/problem-16-22106-pre.txt", "bal/problem-49-7776-pre.txt")
SHARE = 1e-4
HEADER = (
    "solver",
    "cost",
    "iterations",
    "ms for one",
    "ratio",
    "least",
    "ratio",
    "s to the cost",
    "ratio",
    "of wall time",
    "s in all",
    "peak MB",
    "ratio",
)
#: One run: what it found, and when.
Run = dict[str, Any]


def ours(path: str) -> Run:
    """One run of slamcli."""
    import slamcli

    optimize, graph = slamcli.optimize, slamcli.read(path)  # (the name imports the solver)
    costs: list[float] = []
    times: list[float] = []
    marks: list[float] = []
    wall, processor = time.perf_counter(), time.process_time()

    def watch(start: str, chi2: float, record: Any) -> None:
        costs.append(0.5 * chi2)
        times.append(time.perf_counter() - wall)
        marks.append(time.process_time())

    optimize(graph, tolerance=1e-6, on_iteration=watch)
    return {
        "costs": costs,
        "times": times,
        "processor_times": [mark - processor for mark in marks],
        "seconds": time.perf_counter() - wall,
        "processor": time.process_time() - processor,
    }


def gtsams(path: str) -> Run:
    """One run of GTSAM's Levenberg-Marquardt with its own bundler camera."""
    import gtsam

    data = gtsam.readBal(path)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    noise = gtsam.noiseModel.Isotropic.Sigma(2, 1.0)
    for k in range(data.numberCameras()):
        values.insert(k, data.camera(k))
    for j in range(data.numberTracks()):
        track, key = data.track(j), gtsam.symbol("p", j)
        values.insert(key, track.point3())
        for m in range(track.numberMeasurements()):
            camera, pixel = track.measurement(m)
            graph.add(gtsam.GeneralSFMFactorCal3Bundler(pixel, noise, camera, key))
    started, processor = time.perf_counter(), time.process_time()
    parameters = gtsam.LevenbergMarquardtParams.CeresDefaults()
    parameters.setMaxIterations(100)
    optimizer = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters)
    costs, times, marks = [optimizer.error()], [0.0], [processor]
    while optimizer.iterations() < 100:
        optimizer.iterate()
        costs.append(optimizer.error())
        times.append(time.perf_counter() - started)
        marks.append(time.process_time())
        if costs[-2] - costs[-1] <= 1e-6 * costs[-2]:
            break
    return {
        "costs": costs,
        "times": times,
        "processor_times": [mark - processor for mark in marks],
        "seconds": times[-1],
        "processor": marks[-1] - processor,
    }


def child(who: str, path: str) -> Run:
    """A run in a process of its own, with its peak memory in MB."""
    command = [sys.executable, "-m", "benchmarks.bundle", "--child", who, path]
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    answer: Run = json.loads(done.stdout.splitlines()[-1])
    return answer


def contestants() -> dict[str, Callable[[str], Run]]:
    """Who can run here, by name; what is left out is said."""
    out: dict[str, Callable[[str], Run]] = {"slamcli": lambda path: child("slamcli", path)}
    try:
        peer_ceres.program()
    except peer_ceres.NotThereError as reason:
        print(f"Ceres is left out: {reason}")
    else:
        for solver, name in peer_ceres.SOLVERS.items():
            out[f"Ceres {name}"] = lambda path, solver=solver: peer_ceres.run(path, solver)  # type: ignore[misc]
    try:
        version = importlib.metadata.version("gtsam")
    except importlib.metadata.PackageNotFoundError:
        print("GTSAM is left out: it is not installed (pip install gtsam)")
    else:
        out[f"GTSAM {version}"] = lambda path: child("gtsam", path)
    return out


def figures(runs: list[Run], goal: float) -> dict[str, float]:
    """Medians of the runs of one contestant; ``goal`` is the cost that is to be reached."""
    each = [b - a for run in runs for a, b in itertools.pairwise(run["processor_times"])]

    def reached(clock: str) -> float:
        return statistics.median(
            next((t for t, c in zip(run[clock], run["costs"], strict=True) if c <= goal), math.inf) for run in runs
        )

    return {
        "cost": runs[0]["costs"][-1],
        "iterations": len(runs[0]["costs"]) - 1,
        "each": 1e3 * statistics.median(each),
        "least": 1e3 * min(each),
        "wall reached": reached("times"),
        "reached": reached("processor_times"),
        "seconds": statistics.median(run["processor"] for run in runs),
        "megabytes": statistics.median(run["megabytes"] for run in runs),
    }


def compare(path: str, runs: int, who: dict[str, Callable[[str], Run]]) -> None:
    """Print the table of one scene."""
    results: dict[str, list[Run]] = {name: [] for name in who}
    for _ in range(runs):
        for name, run in who.items():
            results[name].append(run(path))
    peers = [name for name in who if name.startswith("Ceres")] or ["slamcli"]
    goal = (1.0 + SHARE) * min(results[name][0]["costs"][-1] for name in peers)
    found = {name: figures(several, goal) for name, several in results.items()}

    def ratio(name: str, key: str) -> str:
        value = found[name][key] / min(found[peer][key] for peer in peers)
        return f"{value:.2f}" if math.isfinite(value) else "never"

    def cells(name: str) -> tuple[str, ...]:
        one = found[name]
        words = [name, f"{one['cost']:.8g}", f"{one['iterations']:.0f}", f"{one['each']:.1f}", ratio(name, "each")]
        words += [f"{one['least']:.1f}", ratio(name, "least")]
        words += [f"{one['reached']:.2f}", ratio(name, "reached"), ratio(name, "wall reached")]
        return (*words, f"{one['seconds']:.2f}", f"{one['megabytes']:.0f}", ratio(name, "megabytes"))

    version = results[peers[0]][0].get("version")
    title = f"{Path(path).stem}, {runs} runs" + (f", Ceres {version}" if version else "")
    print_table(title, HEADER, map(cells, found))


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", metavar="FILE")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--child", choices=("slamcli", "gtsam"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child:
        answer = (gtsams if given.child == "gtsam" else ours)(given.files[0])
        status = Path("/proc/self/status").read_text()
        answer["megabytes"] = int(status.split("VmHWM:")[1].split()[0]) / 1024.0
        print(json.dumps(answer))
        return
    folder = os.environ.get("SLAMCLI_DATASETS")
    if not given.files and folder is None:
        sys.exit("SLAMCLI_DATASETS must name the folder of the standard data sets, or give FILEs")
    who = contestants()
    for path in given.files or [str(Path(folder or "") / name) for name in SETS]:
        compare(path, given.runs, who)


if __name__ == "__main__":
    main()
