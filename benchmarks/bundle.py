"""Bundle adjustment beside GTSAM: ``python -m benchmarks.bundle [--runs N] [FILE ...]``.

Each run is a process of its own on one thread, slamcli and GTSAM in turn; medians of N runs (3). Cost is half the sum
of squares, without loss. Time counts from the loaded scene on, the setup included. "to its cost" is when slamcli came
to GTSAM's final cost (to 1e-4); GTSAM leaves out what is behind its camera, so that its cost of Ladybug-49, where 31
observations are, is that of another problem. Needs the standard data sets (SLAMCLI_DATASETS) or FILEs in BAL's format;
without gtsam its columns stay empty. Ceres' costs, measured once, stand beside for the sets that have them.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import resource
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

#: Data set, and the final cost of Ceres 2.1 (sparse or dense Schur; of Ladybug after 50 iterations).
SETS: dict[str, float | None] = {
    "bal/problem-16-22106-pre.txt": 18033.9,
    "bal/problem-49-7776-pre.txt": 13344.29,
}
HEADER = (
    "set",
    "cost",
    "gtsam's",
    "ceres'",
    "iterations",
    "ms each",
    "s",
    "to its cost",
    "gtsam s",
    "ratio",
    "MB",
    "its MB",
)
SHARE = 1e-4


def ours(path: str, elimination: str) -> dict[str, Any]:
    """One run of slamcli: the cost after each iteration, and when."""
    import slamcli

    graph = slamcli.read(path)
    started = time.perf_counter()
    course = [(0.0, 0.5 * graph.chi2())]

    def watch(start: str, chi2: float, record: Any) -> None:
        if record is not None:
            course.append((time.perf_counter() - started, 0.5 * chi2))

    result = slamcli.optimize(graph, elimination=elimination, tolerance=1e-6, on_iteration=watch)
    seconds = time.perf_counter() - started
    each = statistics.median(record.time for record in result.trace)
    return {"seconds": seconds, "course": course, "cost": 0.5 * result.final_chi2, "each": each}


def gtsams(path: str) -> dict[str, Any]:
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
    started = time.perf_counter()
    parameters = gtsam.LevenbergMarquardtParams.CeresDefaults()
    parameters.setMaxIterations(100)
    optimizer = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters)
    optimizer.optimize()
    return {"seconds": time.perf_counter() - started, "cost": optimizer.error(), "iterations": optimizer.iterations()}


def child(who: str, path: str) -> dict[str, Any]:
    """A run in a process of its own, with its peak memory in MB."""
    command = [sys.executable, "-m", "benchmarks.bundle", "--child", who, path]
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    answer: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return answer


def row(path: str, ceres: float | None, runs: int) -> tuple[str, ...]:
    """The figures of one set."""
    peer = importlib.util.find_spec("gtsam") is not None
    pairs = [(child("auto", path), child("gtsam", path) if peer else None) for _ in range(runs)]
    mine = [one for one, _ in pairs]
    theirs = [other for _, other in pairs if other is not None]
    cost = mine[0]["cost"]
    words = [Path(path).stem, f"{cost:.6g}"]
    words += [f"{theirs[0]['cost']:.6g}" if theirs else "", "" if ceres is None else f"{ceres:.6g}"]
    words += [str(len(mine[0]["course"]) - 1), f"{1e3 * statistics.median(one['each'] for one in mine):.1f}"]
    seconds = statistics.median(one["seconds"] for one in mine)
    words.append(f"{seconds:.2f}")
    if theirs:
        goal = theirs[0]["cost"] * (1.0 + SHARE)
        reached = [next((t for t, c in one["course"] if c <= goal), None) for one in mine]
        times = [t for t in reached if t is not None]
        peer_seconds = statistics.median(other["seconds"] for other in theirs)
        words += [f"{statistics.median(times):.2f}" if times else "never", f"{peer_seconds:.2f}"]
        words.append(f"{statistics.median(times) / peer_seconds:.2f}" if times else "")
    else:
        words += ["", "", ""]
    words.append(f"{mine[0]['megabytes']:.0f}")
    words.append(f"{theirs[0]['megabytes']:.0f}" if theirs else "")
    return tuple(words)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", metavar="FILE")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--child", choices=("auto", "none", "schur", "gtsam"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child:
        path = given.files[0]
        answer = gtsams(path) if given.child == "gtsam" else ours(path, given.child)
        answer["megabytes"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        print(json.dumps(answer))
        return
    folder = os.environ.get("SLAMCLI_DATASETS")
    if not given.files and folder is None:
        sys.exit("SLAMCLI_DATASETS must name the folder of the standard data sets, or give FILEs")
    sets: list[tuple[str, float | None]] = [(path, None) for path in given.files] or [
        (str(Path(folder or "") / k), v) for k, v in SETS.items()
    ]
    rows = [HEADER, *(row(path, ceres, given.runs) for path, ceres in sets)]
    widths = [max(len(line[k]) for line in rows) for k in range(len(HEADER))]
    for line in rows:
        print("  ".join(word.rjust(width) for word, width in zip(line, widths, strict=True)))


if __name__ == "__main__":
    main()
