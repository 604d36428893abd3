"""All benchmarks in one run: ``make bench``, or ``python -m benchmarks.run [--runs N]``.

Everything is a ratio between things that were measured in turn in this run; medians, with the spread beside them.
Needs the standard data sets (SLAMCLI_DATASETS) and, for the peers, the extra ``peers``; says what it leaves out.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import slamcli
from benchmarks.tables import ms, print_table
from slamcli.batch.benchmark import runner
from slamcli.batch.benchmark.grid import Variant
from slamcli.reporting.benchmark import benchmark_markdown
from slamcli.solver import gauge, policies
from slamcli.solver.initialization import initialize
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.problem import Problem
from slamcli.solver.stopwatch import Stopwatch

#: Data set, start, and the goal of one iteration over one factorization.
ITERATION = (
    ("pose3d/sphere2500.g2o", "file", 1.4),
    ("pose3d/torus3D.g2o", "spanning-tree", 1.4),
    ("pose2d/manhattan_sesync.g2o", "file", 2.0),
    ("pose2d/city10000.g2o", "file", 2.0),
)
#: Data set and start of the whole optimization.
WHOLE = (
    ("pose2d/intel_sesync.g2o", "file"),
    ("pose2d/manhattan_sesync.g2o", "odometry"),
    ("pose2d/city10000.g2o", "file"),
    ("pose2d/kitti_00.g2o", "spanning-tree"),
    ("pose3d/sphere2500.g2o", "file"),
    ("pose3d/parking-garage.g2o", "file"),
    ("pose3d/torus3D.g2o", "spanning-tree"),
)
PEERS = tuple(name for name in ("g2opy", "gtsam") if importlib.util.find_spec(name))


def iterations(folder: Path, runs: int) -> None:
    """One Gauss-Newton iteration over CHOLMOD's numeric factorization alone of the same matrix."""
    from cvxopt import cholmod

    rows = []
    for name, start, goal in ITERATION:
        graph = slamcli.read(str(folder / name))
        _, held = gauge.choose(graph)
        values, _ = initialize(graph, start, held)
        stopwatch = Stopwatch()
        problem = Problem(graph, held, OptimizeOptions(), stopwatch)
        policy = policies.make(OptimizeOptions(method="gn"))
        now = problem.linearize(values)
        policy.step(problem, now)
        stopwatch.seconds.clear()
        whole, alone = [], []
        backend = problem._factorization
        for _ in range(10 * runs):
            started = time.perf_counter()
            policy.step(problem, now)
            whole.append(time.perf_counter() - started)
            started = time.perf_counter()
            cholmod.numeric(backend._matrix, backend._factor)
            alone.append(time.perf_counter() - started)
        ratio = statistics.median(a / b for a, b in zip(whole, alone, strict=True))
        parts = ", ".join(f"{k} {v / len(whole) * 1e3:.2f}" for k, v in stopwatch.seconds.items())
        rows.append((name, ms(whole), ms(alone), f"{ratio:.2f}", f"{goal}", parts))
    header = ("data set", "iteration, ms", "factorization alone, ms", "ratio", "goal", "mean ms by phase")
    print_table("One Gauss-Newton iteration", header, rows)


def worker(tool: str, path: Path) -> dict[str, float]:
    """One tool that reads a file, in its own process."""
    command = [sys.executable, "-m", "benchmarks.worker", tool, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    outcome: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return outcome


def whole(folder: Path, scratch: Path, runs: int) -> None:
    """Everything between the loaded graph and the converged one, from a file whose values are a good start for all."""
    ours = Variant("slamcli", options={"method": "gn", "init": "file", "tolerance": 1e-6})
    variants = (ours, *(Variant(peer, peer) for peer in PEERS))
    for name, start in WHOLE:
        graph = slamcli.read(str(folder / name))
        _, held = gauge.choose(graph)
        values, _ = initialize(graph, start, held)
        path = scratch / "start.g2o"
        slamcli.write(graph.with_values(values), str(path))
        result = runner.run((runner.described(f"{name} ({start})", path),), variants, repeats=runs)
        print(f"\n## Whole optimization, Gauss-Newton, after loading: {name}\n")
        print(benchmark_markdown(result), flush=True)


def write_world(path: Path, poses: int, closures: int) -> None:
    """A 2-D random walk on a grid with closures between poses that meet: for loading only."""
    random = np.random.default_rng(0)
    heading = np.cumsum(random.integers(-1, 2, poses) * (random.random(poses) < 0.2)) * (np.pi / 2)
    x, y = np.cumsum(np.cos(heading)), np.cumsum(np.sin(heading))
    later = random.integers(100, poses, closures)
    pairs = [(i, i + 1) for i in range(poses - 1)] + [(k - random.integers(10, 100), k) for k in later.tolist()]
    noise = random.normal(0.0, 0.05, (len(pairs), 3))
    with path.open("w", encoding="ascii") as stream:
        for i in range(poses):
            stream.write(f"VERTEX_SE2 {i} {x[i]:.6f} {y[i]:.6f} {heading[i]:.6f}\n")
        for (i, j), (a, b, c) in zip(pairs, noise.tolist(), strict=True):
            stream.write(f"EDGE_SE2 {i} {j} {1 + a:.6f} {b:.6f} {c:.6f} 400.0 0.0 0.0 400.0 0.0 400.0\n")


def loading(folder: Path, scratch: Path, runs: int) -> None:
    """Reading files, each tool in its own process."""
    world = scratch / "world100k.g2o"
    write_world(world, 100_000, 45_001)
    rows = []
    for path in (folder / "pose2d/city10000.g2o", world):
        outcomes: dict[str, list[dict[str, float]]] = {tool: [] for tool in ("slamcli", *PEERS)}
        for _ in range(runs):
            for tool, found in outcomes.items():
                found.append(worker(tool, path))
        ours = [outcome["load"] for outcome in outcomes["slamcli"]]
        for tool, found in outcomes.items():
            times = [outcome["load"] for outcome in found]
            ratio = statistics.median(a / b for a, b in zip(ours, times, strict=True))
            memory = max(outcome["memory_mb"] for outcome in found)
            rows.append((path.name, tool, ms(times), f"{ratio:.2f}", f"{memory:.0f}"))
    header = ("file", "tool", "load, ms", "slamcli / tool", "peak of the process, MB")
    print_table("Loading", header, rows)


def start_up(scratch: Path, runs: int) -> None:
    """Whole processes against the interpreter alone."""
    ten = scratch / "ten.g2o"
    vertices = [f"VERTEX_SE2 {i} {i} 0 0" for i in range(10)]
    edges = [f"EDGE_SE2 {i} {i + 1} 1 0 0.01 10 0 0 10 0 10" for i in range(9)] + [
        "EDGE_SE2 0 9 9 0.1 0 10 0 0 10 0 10"
    ]
    ten.write_text("\n".join(vertices + edges) + "\n", encoding="ascii")
    command = str(Path(sys.executable).with_name("slamcli"))
    pairs: list[tuple[list[str], list[str], float]] = [
        ([command, "--help"], [sys.executable, "-c", "pass"], 4.0),
        ([command, "optimize", str(ten)], [sys.executable, "-c", "import numpy, cvxopt.cholmod, click"], 1.6),
    ]
    # installed packages are compiled; a checkout is compiled by its first run, unless that is forbidden
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    rows = []
    for ours, theirs, goal in pairs:
        times: dict[int, list[float]] = {0: [], 1: []}
        for _ in range(5 * runs + 1):
            for which, words in enumerate((ours, theirs)):
                started = time.perf_counter()
                subprocess.run(words, capture_output=True, check=True, env=environment)
                times[which].append(time.perf_counter() - started)
        first, second = times[0][1:], times[1][1:]
        ratio = statistics.median(a / b for a, b in zip(first, second, strict=True))
        name = " ".join(["slamcli", *ours[1:2]])
        rows.append((name, ms(first), " ".join(["python", *theirs[1:]]), ms(second), f"{ratio:.2f}", f"{goal}"))
    print_table("Start-up, whole processes", ("command", "ms", "against", "ms", "ratio", "goal"), rows)


def filtering(runs: int) -> None:
    """An update of EKF-SLAM by one reading over one pass through the triangle of its covariance."""
    from benchmarks.filter import update_costs

    header = ("landmarks", "read and write of the triangle, ms", "update, ms", "ratio")
    print_table("EKF update", header, update_costs(runs))


def main() -> None:
    """Run the sections that the command line names, or all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5, help="repetitions of each measurement (default 5)")
    parser.add_argument("sections", nargs="*", help="iteration, whole, loading, startup, filter (default: all)")
    options = parser.parse_args()
    folder = Path(os.environ.get("SLAMCLI_DATASETS") or "/nonexistent")
    missing = [name for name in ("g2opy", "gtsam") if name not in PEERS]
    print(f"# slamcli {slamcli.__version__} benchmarks: medians of {options.runs} alternating runs (range)")
    if missing:
        print(f"not installed, left out: {', '.join(missing)}")
    with tempfile.TemporaryDirectory() as scratch_name:
        scratch = Path(scratch_name)
        sections: dict[str, Callable[[], None]] = {"startup": lambda: start_up(scratch, options.runs)}
        sections["filter"] = lambda: filtering(options.runs)
        if folder.is_dir():
            sections["iteration"] = lambda: iterations(folder, options.runs)
            sections["loading"] = lambda: loading(folder, scratch, options.runs)
            sections["whole"] = lambda: whole(folder, scratch, options.runs)
        else:
            print("SLAMCLI_DATASETS names no folder: only the start-up and the filter are measured")
        for name in options.sections or sections:
            sections[name]()


if __name__ == "__main__":
    main()
