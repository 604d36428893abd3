"""Landmark sets with and without Schur complement, beside GTSAM: ``python -m benchmarks.landmarks [--runs N]``.

In turn, each run in a process of its own, ours the second of two runs in it; ratios are medians over the runs. All
start from the same values, slamcli's chordal relaxation, which is not counted. GTSAM's wrapper has no factor for a
point seen from a planar pose; ours calls back into Python, so its value counts and its time does not. ``--leads`` looks
for values that others have published. Needs the standard data sets, and for GTSAM the extra ``peers``.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import slamcli
from benchmarks.tables import ms, print_table
from slamcli.graph import FactorGraph
from slamcli.graph.columns import Values
from slamcli.models.base import Array
from slamcli.solver import gauge
from slamcli.solver.initialization import initialize

SETS = ("victoriaPark_from_isam", "victoriaPark-full", "cityTrees10000_from_isam", "world-2000-full")
TOOLS = ("slamcli none", "slamcli schur", "gtsam COLAMD")
TOLERANCE = 1e-9
#: Key of the first landmark in GTSAM.
_POINTS = 10**7


def start(path: str) -> tuple[FactorGraph, Values]:
    """A graph and the values that all tools start from."""
    graph = slamcli.read(path)
    _, held = gauge.choose(graph)
    values, _ = initialize(graph, "chordal", held)
    return graph, values


def run_slamcli(path: str, elimination: str) -> dict[str, Any]:
    """Our Gauss-Newton."""
    graph, values = start(path)
    graph = graph.with_values(values)
    for _ in range(2):
        started = time.perf_counter()
        options = {"method": "gn", "init": "file", "tolerance": TOLERANCE, "elimination": elimination}
        result = slamcli.optimize(graph, **options)
        seconds = time.perf_counter() - started
    return {"solve": seconds, "iterations": result.iterations, "chi2": result.final_chi2}


def run_gtsam(path: str, ordering: str) -> dict[str, Any]:
    """GTSAM's Gauss-Newton; observations of landmarks call back into Python."""
    import gtsam

    source, values = start(path)
    graph = gtsam.NonlinearFactorGraph()
    for factors in source.factors:
        for (i, j), z, information in zip(
            factors.indices.tolist(), factors.measurements, factors.information, strict=True
        ):
            noise = gtsam.noiseModel.Gaussian.Information(information)
            if factors.kind.name == "relative_pose_2d":
                graph.add(gtsam.BetweenFactorPose2(i, j, gtsam.Pose2(*z.tolist()), noise))
            else:
                graph.add(gtsam.CustomFactor(noise, [i, _POINTS + j], _point_seen(z)))
    initial = gtsam.Values()
    for row, pose in enumerate(values["SE2"]):
        initial.insert(row, gtsam.Pose2(*pose.tolist()))
    for row, point in enumerate(values["XY"]):
        initial.insert(_POINTS + row, point)
    _, held = gauge.choose(source)
    for row in np.flatnonzero(held["SE2"]).tolist():
        graph.add(gtsam.PriorFactorPose2(row, initial.atPose2(row), gtsam.noiseModel.Isotropic.Precision(3, 1e6)))
    parameters = gtsam.GaussNewtonParams()
    parameters.setRelativeErrorTol(TOLERANCE)
    parameters.setAbsoluteErrorTol(0.0)
    parameters.setOrderingType(ordering)
    started = time.perf_counter()
    optimizer = gtsam.GaussNewtonOptimizer(graph, initial, parameters)
    ended = optimizer.optimize()
    seconds = time.perf_counter() - started
    final = {
        "SE2": np.asarray(gtsam.utilities.extractPose2(ended)),
        "XY": np.array([ended.atPoint2(_POINTS + row) for row in range(len(values["XY"]))]),
    }
    found = source.with_values({**values, **final})
    polished = slamcli.optimize(found, method="gn", init="file").final_chi2
    return {"solve": seconds, "iterations": optimizer.iterations(), "chi2": found.chi2(), "polished": polished}


def _point_seen(measured: Array) -> Any:
    """Residual and Jacobians of a point seen from a planar pose: R^T (l - t) - z (g2o's EDGE_SE2_XY)."""

    def error(factor: Any, values: Any, jacobians: list[Array] | None) -> Array:
        pose, point = values.atPose2(factor.keys()[0]), values.atPoint2(factor.keys()[1])
        of_pose, of_point = np.zeros((2, 3), order="F"), np.zeros((2, 2), order="F")
        seen: Array = pose.transformTo(point, of_pose, of_point)
        if jacobians is not None:
            jacobians[0], jacobians[1] = of_pose, of_point
        return seen - measured

    return error


def compare(folder: Path, runs: int) -> None:
    """Print a table in Markdown."""
    rows = []
    tools = [tool for tool in TOOLS if importlib.util.find_spec(tool.split()[0])]
    for name in SETS:
        path = folder / "landmark2d" / f"{name}.g2o"
        found: dict[str, list[dict[str, Any]]] = {tool: [] for tool in tools}
        for _ in range(runs):
            for tool in tools:
                words = [sys.executable, "-m", "benchmarks.landmarks", "--worker", *tool.split(), str(path)]
                done = subprocess.run(words, capture_output=True, text=True, check=True)
                found[tool].append(json.loads(done.stdout.splitlines()[-1]))
        base = found[tools[0]]
        for tool in tools:
            times = [outcome["solve"] for outcome in found[tool]]
            ratio = statistics.median(
                one["solve"] / other["solve"] for one, other in zip(found[tool], base, strict=True)
            )
            last = found[tool][-1]
            chi2, polished = last["chi2"], last.get("polished", last["chi2"])
            cells = (name, tool, ms(times), f"{ratio:.2f}", str(last["iterations"]), f"{chi2:.10g}", f"{polished:.10g}")
            rows.append(cells)
    header = ("set", "tool", "solve, ms", f"ratio to {tools[0]}", "iterations", "chi2", "polished here")
    print_table("Landmarks, Gauss-Newton from a chordal start", header, rows)


def leads(folder: Path) -> None:
    """What SLAM++ seems to minimize on iSAM's files: ranges and bearings with information 1.

    Its table has 104.11 (incremental) and 144.91 (batch) for Victoria Park, 318.43 and 548.50 (five iterations) for
    cityTrees10000. ``sqrt``: iSAM's numbers, square roots of an information, are taken for the information itself.
    """
    rows = []
    for name in ("victoriaPark_from_isam", "cityTrees10000_from_isam"):
        optimum = slamcli.optimize(slamcli.read(str(folder / "landmark2d" / f"{name}.g2o"))).graph
        for odometry in ("squared", "sqrt"):
            for weight in ("squared", "sqrt", "1"):
                with tempfile.TemporaryDirectory() as temporary:
                    path = str(Path(temporary) / "graph.g2o")
                    slamcli.write(optimum, path)
                    Path(path).write_text("\n".join(_polar(Path(path).read_text(), odometry, weight)))
                    result = slamcli.optimize(slamcli.read(path), method="lm", init="file")
                rows.append((name, odometry, weight, f"{result.final_chi2:.6g}", str(result.status)))
    header = ("set", "information of odometry", "of range and bearing", "chi2 at the optimum", "status")
    print_table("Ranges and bearings in place of points", header, rows)


def _polar(text: str, odometry: str, weight: str) -> Iterator[str]:
    """Lines of a graph with points as seen turned into ranges and bearings."""
    for line in text.splitlines():
        words = line.split()
        if words[0] == "EDGE_SE2" and odometry == "sqrt":
            yield " ".join([*words[:6], *(repr(float(word) ** 0.5) for word in words[6:])])
        elif words[0] == "EDGE_SE2_XY":
            x, y = map(float, words[3:5])
            information = {"squared": float(words[5]), "sqrt": float(words[5]) ** 0.5, "1": 1.0}[weight]
            for tag, value in (("RANGE", math.hypot(x, y)), ("BEARING", math.atan2(y, x))):
                yield f"EDGE_{tag}_SE2_XY {words[1]} {words[2]} {value!r} {information!r}"
        else:
            yield line


def main() -> None:
    """Run one tool where ``--worker`` names it, else the comparison."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--leads", action="store_true")
    parser.add_argument("--worker", nargs=3, metavar=("TOOL", "SETTING", "FILE"))
    given = parser.parse_args()
    if given.worker:
        tool, setting, path = given.worker
        print(json.dumps({"slamcli": run_slamcli, "gtsam": run_gtsam}[tool](path, setting)))
        return
    folder = os.environ.get("SLAMCLI_DATASETS")
    if not folder:
        sys.exit("SLAMCLI_DATASETS must name the folder of the standard data sets")
    if given.leads:
        leads(Path(folder))
    else:
        compare(Path(folder), given.runs)


if __name__ == "__main__":
    main()
