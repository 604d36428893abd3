"""False loop closures: what each robust method makes of them. ``python -m benchmarks.outliers --help``.

Clean sets are spoiled by ``simulation.injection`` (every policy, several amounts and seeds) and optimized by every
method. Precision and recall are of the closures that are kept: the share of true ones among them, and the share of the
true ones that is kept. ``chi2`` is that of what is kept over the optimum of the clean set, less 1; ``ATE`` is against
that optimum, in metres, after alignment; times are in seconds, injection and reading left out. Of precision, recall
and chi2 the worst seed is shown beside the mean.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from joblib import Parallel, delayed

from slamcli.errors import SlamcliError
from slamcli.evaluation import evaluate
from slamcli.formats import read
from slamcli.graph import FactorGraph
from slamcli.graph.trajectory import of_graph
from slamcli.simulation.injection import Amount, Injected, InjectOptions, inject
from slamcli.simulation.outliers import POLICIES
from slamcli.simulation.reference import Reference
from slamcli.solver.optimize import optimize
from slamcli.solver.options import KERNELS, ROBUST
from slamcli.solver.result import Result
from slamcli.solver.robust.rejection import of_kernel

SETS = {
    "M3500": "pose2d/M3500.g2o",
    "intel": "pose2d/intel_sesync.g2o",
    "sphere2500": "pose3d/sphere2500.g2o",
    "torus3D": "pose3d/torus3D.g2o",
    "city10000": "pose2d/city10000.g2o",
}
METHODS = ("lm", *(name for name in KERNELS if name != "none"), *(m for m in ROBUST if m not in ("none", "auto")))


@dataclass(frozen=True)
class Row:
    """One run."""

    set: str
    policy: str
    percent: int
    seed: int
    method: str
    precision: float
    recall: float
    chi2: float
    ate: float
    seconds: float


def clean(path: Path) -> tuple[FactorGraph, Result]:
    """A set without false closures and its optimum."""
    graph = read(str(path))
    return graph, optimize(graph, init="chordal")


def spoiled(graph: FactorGraph, optimum: Result, policy: str, percent: int, seed: int) -> Injected:
    """The set with false closures that contradict the optimum."""
    known = {name: np.ones(len(column), dtype=bool) for name, column in graph.variables.items()}
    reference = Reference(optimum.graph.values, known, "optimum")
    options = InjectOptions(false_closures=Amount(percent, percent=True), policy=policy, seed=seed)
    return inject(graph, options, lambda _: reference)


def run(name: str, path: Path, policy: str, percent: int, seed: int, methods: Iterable[str]) -> list[Row]:
    """All methods on one spoiled set."""
    graph, optimum = clean(path)
    injected = spoiled(graph, optimum, policy, percent, seed)
    return [_scored(Row(name, policy, percent, seed, m, 0, 0, 0, 0, 0), injected, optimum) for m in methods]


def _scored(row: Row, injected: Injected, optimum: Result) -> Row:
    began = time.perf_counter()
    try:
        result = _optimized(injected.graph, row.method)
        rejection = result.rejection or of_kernel(result.graph, result.options, result.dof)
    except SlamcliError:
        return Row(*_key(row), *[float("nan")] * 5)
    seconds = time.perf_counter() - began
    closures = [mask | rejected for mask, rejected in zip(injected.outliers, rejection.rejected, strict=True)]
    false_kept = sum(int((o & ~r).sum()) for o, r in zip(injected.outliers, rejection.rejected, strict=True))
    true_lost = sum(int((c & ~o).sum()) for c, o in zip(closures, injected.outliers, strict=True))
    true = rejection.closures - injected.outlier_count
    kept = rejection.closures - rejection.count
    estimate, truth = of_graph(result.graph, row.method), of_graph(optimum.graph, "optimum")
    ate = evaluate([estimate], truth).estimates[0].absolute["translation"].rmse
    precision = (kept - false_kept) / kept if kept else 1.0
    chi2 = rejection.inlier_chi2 / optimum.final_chi2 - 1.0
    return Row(*_key(row), precision, (true - true_lost) / true, chi2, ate, seconds)


def _key(row: Row) -> tuple[str, str, int, int, str]:
    return row.set, row.policy, row.percent, row.seed, row.method


def _optimized(graph: FactorGraph, method: str) -> Result:
    """A run of a method: least squares by ``lm``, a kernel from the spanning tree, or a robust method."""
    if method == "lm":
        return optimize(graph, method="lm", init="odometry")
    if method in KERNELS:
        return optimize(graph, method="lm", init="odometry", kernel=method)
    return optimize(graph, robust=method)


def table(rows: list[Row]) -> Iterator[str]:
    """Markdown: a row for each set, policy, amount and method; means and worst cases over the seeds."""
    yield "| set | policy | false, % | method | precision | worst | recall | worst | chi2 | worst | ATE, m | time, s |"
    yield "|---|---|---|---|---|---|---|---|---|---|---|---|"
    groups: dict[tuple[str, str, int, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row.set, row.policy, row.percent, row.method), []).append(row)
    for (name, policy, percent, method), group in groups.items():
        precision, recall, chi2, ate, seconds = np.array(
            [(r.precision, r.recall, r.chi2, r.ate, r.seconds) for r in group]
        ).T
        worst = chi2[np.abs(chi2).argmax()]
        yield (
            f"| {name} | {policy} | {percent} | {method} | {precision.mean():.4f} | {precision.min():.4f} | "
            f"{recall.mean():.4f} | {recall.min():.4f} | {chi2.mean():.2%} | {worst:.2%} | {ate.mean():.3g} | "
            f"{np.median(seconds):.2f} |"
        )


def main() -> None:
    """Parse, run, print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.outliers", description=__doc__)
    parser.add_argument("--data", default=os.environ.get("SLAMCLI_DATASETS", "."), help="folder of the standard sets")
    parser.add_argument("--sets", nargs="+", default=["M3500", "intel", "sphere2500"], choices=list(SETS))
    parser.add_argument(
        "--policies", nargs="+", default=["random", "local", "grouped", "random-grouped"], choices=POLICIES
    )
    parser.add_argument("--percent", nargs="+", type=int, default=[10, 50, 90])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--methods", nargs="+", default=list(METHODS), choices=METHODS)
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    jobs = [
        (name, Path(given.data) / SETS[name], policy, percent, seed, given.methods)
        for name in given.sets
        for policy in given.policies
        for percent in given.percent
        for seed in range(given.seeds)
    ]
    found = Parallel(n_jobs=given.jobs)(delayed(run)(*job) for job in jobs)
    print(*table([row for rows in found for row in rows]), sep="\n")


if __name__ == "__main__":
    main()
