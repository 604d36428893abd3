"""A Manhattan world of 100 000 poses and 300 000 edges: ``python -m benchmarks.scale [--poses N] [--runs N]``.

slamcli under several elimination orders beside GTSAM's Gauss-Newton with METIS, in turn, each in a process of its own,
from the same vertices to a relative decrease of chi2 below 1e-6. Ratios are medians over the runs; memory is the peak
of the whole process, loading included. Needs the extras ``peers`` and ``metis``; says what it leaves out.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from slamcli.batch.memory import peak_memory

TOLERANCE = 1e-6
#: Twice as many closures as poses, in streets on a square whose side grows with the root of the number of poses:
#: with AMD, L of the world of 100 000 poses has some 77 million nonzeros.
CLOSURES_PER_POSE, HALF_SIDE_AT_100_000 = 2, 100
TOOLS = ("slamcli auto", "slamcli amd", "gtsam metis")


def simulate(poses: int, path: Path) -> None:
    """Write the world; its vertices are dead reckoning that drifts by tens of metres."""
    half = max(10, round(HALF_SIDE_AT_100_000 * (poses / 100_000) ** 0.5))
    settings = (
        f"closures.count={CLOSURES_PER_POSE * poses}",
        "closures.reach=2.2",
        "closures.gap=5",
        f"path={{half: {half}, turning: 0.3}}",
        "robot={noise: [0.01, 0.002]}",
    )
    words = [sys.executable, "-m", "slamcli", "simulate", "manhattan", "--poses", str(poses), "-q", "-o", str(path)]
    for setting in settings:
        words += ["--set", setting]
    subprocess.run(words, check=True)


def run_slamcli(path: str, ordering: str, result: str) -> dict[str, float]:
    """Our Gauss-Newton from the file's values."""
    from slamcli import optimize, read, write

    started = time.perf_counter()
    graph = read(path)
    load = time.perf_counter() - started
    started = time.perf_counter()
    outcome = optimize(graph, method="gn", init="file", tolerance=TOLERANCE, ordering=ordering)
    solve = time.perf_counter() - started
    memory = peak_memory()
    if outcome.sparsity is None:
        sys.exit(outcome.reason)
    write(outcome.graph, result)
    factor = outcome.sparsity.nnz_factor
    return {"load": load, "solve": solve, "iterations": outcome.iterations, "memory_mb": memory, "nnz": factor}


def run_gtsam(path: str, ordering: str, result: str) -> dict[str, float]:
    """GTSAM's Gauss-Newton."""
    import gtsam

    started = time.perf_counter()
    graph, initial = gtsam.readG2o(path, False)
    load = time.perf_counter() - started
    origin = min(initial.keys())
    sigma = gtsam.noiseModel.Isotropic.Sigma(3, 1e-6)
    started = time.perf_counter()
    graph.add(gtsam.PriorFactorPose2(origin, initial.atPose2(origin), sigma))
    parameters = gtsam.GaussNewtonParams()
    parameters.setRelativeErrorTol(TOLERANCE)
    parameters.setAbsoluteErrorTol(1e-9)
    parameters.setOrderingType(ordering.upper())
    optimizer = gtsam.GaussNewtonOptimizer(graph, initial, parameters)
    values = optimizer.optimize()
    solve = time.perf_counter() - started
    memory = peak_memory()
    gtsam.writeG2o(graph, values, result)
    return {"load": load, "solve": solve, "iterations": optimizer.iterations(), "memory_mb": memory}


def chi2_of(result: Path, path: Path) -> float:
    """A tool's poses in our chi2 (GTSAM's files hold six digits)."""
    import slamcli

    graph, ended = slamcli.read(str(path)), slamcli.read(str(result))
    column = graph.variables["SE2"]
    return graph.chi2({"SE2": ended.variables["SE2"].values[ended.variables["SE2"].rows_of(column.ids)]})


def compare(poses: int, runs: int) -> None:
    """Simulate, run everything in turn, and print a Markdown table."""
    tools = [tool for tool in TOOLS if importlib.util.find_spec(tool.split()[0])]
    missing = [name for name in ("gtsam", "pymetis") if not importlib.util.find_spec(name)]
    if missing:
        print(f"left out, not installed: {', '.join(missing)}")
    with tempfile.TemporaryDirectory() as folder:
        path, result = Path(folder) / "world.g2o", Path(folder) / "result.g2o"
        simulate(poses, path)
        found: dict[str, list[dict[str, float]]] = {tool: [] for tool in tools}
        reached = {}
        for _ in range(runs):
            for tool in tools:
                words = [sys.executable, "-m", "benchmarks.scale", "--worker", *tool.split(), str(path), str(result)]
                done = subprocess.run(words, capture_output=True, text=True, check=True)
                found[tool].append(json.loads(done.stdout.splitlines()[-1]))
                reached[tool] = chi2_of(result, path)
    base = found["gtsam metis" if "gtsam metis" in found else tools[0]]
    names = ("tool", "solve, s", "ratio to gtsam", "iterations", "memory, MB", "ratio", "nnz(L)", "chi2")
    for row in (names, tuple("---" for _ in names)):
        print("| " + " | ".join(row) + " |")
    for tool in tools:
        times, memory = ([outcome[key] for outcome in found[tool]] for key in ("solve", "memory_mb"))
        pairs = list(zip(found[tool], base, strict=True))
        ratio = statistics.median(one["solve"] / other["solve"] for one, other in pairs)
        share = statistics.median(one["memory_mb"] / other["memory_mb"] for one, other in pairs)
        first = found[tool][0]
        cells = (
            tool,
            f"{statistics.median(times):.2f} ({min(times):.2f} to {max(times):.2f})",
            f"{ratio:.2f}",
            f"{first['iterations']:.0f}",
            f"{statistics.median(memory):.0f}",
            f"{share:.2f}",
            f"{first['nnz']:.0f}" if "nnz" in first else "-",
            f"{reached[tool]:.8g}",
        )
        print("| " + " | ".join(cells) + " |")


def main() -> None:
    """Run one tool where ``--worker`` names it, else the comparison."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--poses", type=int, default=100_000)
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--worker", nargs=4, metavar=("TOOL", "ORDERING", "FILE", "RESULT"))
    given = parser.parse_args()
    if given.worker:
        tool, ordering, path, result = given.worker
        print(json.dumps({"slamcli": run_slamcli, "gtsam": run_gtsam}[tool](path, ordering, result)))
    else:
        compare(given.poses, given.runs)


if __name__ == "__main__":
    main()
