"""Certified optima of the isotropic objective: ``python -m benchmarks.certificate [--runs N] [SET ...]``.

For each set the minimum from the chordal start and its certificate, with the time of both, beside a run of GTSAM (its
chordal or LAGO start, then Levenberg-Marquardt) on the same weights in the same process: slamcli and GTSAM in turn,
medians of N runs (3). Everything counts from the loaded graph on, the setup included. Needs the standard data sets
(SLAMCLI_DATASETS); without gtsam the column of the ratio stays empty.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import slamcli
from slamcli.graph import FactorGraph
from slamcli.solver.certificate import Certificate, isotropic
from slamcli.solver.certificate.certify import certify
from slamcli.solver.certificate.isotropic import Precisions

#: Data set, and the minimum as SE-Sync's authors publish it (IJRR 2019), None if they do not.
SETS = {
    "pose2d/intel_sesync.g2o": "5.235e1",
    "pose2d/manhattan_sesync.g2o": "6.432e3",
    "pose2d/CSAIL_sesync.g2o": "3.170e1",
    "pose2d/city10000.g2o": "6.386e2",
    "pose2d/ais2klinik.g2o": "1.885e2",
    "pose3d/sphere2500.g2o": "1.687e3",
    "pose3d/torus3D.g2o": "2.423e4",
    "pose3d/parking-garage.g2o": "1.263e0",
    "pose3d/cubicle.g2o": "7.171e2",
    "pose3d/smallGrid3D.g2o": None,
}
HEADER = ("set", "published", "minimum", "certified", "eta", "of scale", "next eigenvalue", "bound", "relative")
TIMES = ("optimize ms", "certificate ms", "together ms", "gtsam ms", "over gtsam")


def ours(graph: FactorGraph) -> tuple[float, float, Certificate]:
    """Seconds of the optimization and of the certificate, and the certificate."""
    started = time.perf_counter()
    found = slamcli.optimize(isotropic.transform(graph), init="chordal")
    between = time.perf_counter()
    certificate = certify(graph.with_values(found.graph.values), minimized=found)
    return between - started, time.perf_counter() - between, certificate


def gtsam_run(graph: FactorGraph) -> Callable[[], float] | None:
    """A run of GTSAM on the isotropic weights that returns its seconds, or None where there is no gtsam."""
    if importlib.util.find_spec("gtsam") is None:
        return None
    import gtsam

    spatial = graph.space == 3
    between: Any = gtsam.BetweenFactorPose3 if spatial else gtsam.BetweenFactorPose2
    factors = gtsam.NonlinearFactorGraph()
    for column in graph.factors:
        precisions = Precisions.of_file(column)
        rows = zip(column.indices.tolist(), column.measurements, precisions.tau, precisions.kappa, strict=True)
        for (i, j), z, tau, kappa in rows:
            weight = np.array([2.0 * kappa] * 3 + [tau] * 3 if spatial else [tau, tau, 2.0 * kappa])
            factors.add(between(i, j, _pose(gtsam, z, spatial), gtsam.noiseModel.Diagonal.Precisions(weight)))
    origin = gtsam.Pose3() if spatial else gtsam.Pose2()
    prior: Any = gtsam.PriorFactorPose3 if spatial else gtsam.PriorFactorPose2
    factors.add(prior(0, origin, gtsam.noiseModel.Isotropic.Sigma(6 if spatial else 3, 1e-3)))

    def run() -> float:
        started = time.perf_counter()
        start = gtsam.InitializePose3.initialize(factors) if spatial else gtsam.lago.initialize(factors, False)
        gtsam.LevenbergMarquardtOptimizer(factors, start).optimize()
        return time.perf_counter() - started

    return run


def _pose(gtsam: Any, z: Any, spatial: bool) -> Any:
    if not spatial:
        return gtsam.Pose2(*z.tolist())
    x, y, z_, qx, qy, qz, qw = z.tolist()
    return gtsam.Pose3(gtsam.Rot3.Quaternion(qw, qx, qy, qz), np.array([x, y, z_]))


def row(path: Path, published: str | None, runs: int) -> tuple[str, ...]:
    """One line of the table."""
    graph = slamcli.read(str(path))
    peer = gtsam_run(graph)
    optimize, certificate, other = [], [], []
    for _ in range(runs):
        first, second, found = ours(graph)
        optimize.append(first)
        certificate.append(second)
        if peer is not None:
            other.append(peer())
    together = statistics.median(a + b for a, b in zip(optimize, certificate, strict=True))
    ratio = together / statistics.median(other) if other else None
    return (
        path.stem,
        published or "",
        f"{found.cost:.7g}",
        "yes" if found.certified else "NO",
        f"{found.eta:.1e}",
        f"{found.relative_eta:.0e}",
        "" if found.next_eigenvalue is None else f"{found.next_eigenvalue:.3g}",
        f"{found.suboptimality:.1e}",
        f"{found.relative_suboptimality:.0e}",
        f"{statistics.median(optimize) * 1e3:.0f}",
        f"{statistics.median(certificate) * 1e3:.0f}",
        f"{together * 1e3:.0f}",
        f"{statistics.median(other) * 1e3:.0f}" if other else "",
        f"{ratio:.2f}" if ratio else "",
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("sets", nargs="*", help="some of the sets only, by a part of their names")
    given = parser.parse_args()
    if not os.environ.get("SLAMCLI_DATASETS"):
        sys.exit("SLAMCLI_DATASETS does not name the folder of the standard data sets")
    print("| " + " | ".join(HEADER + TIMES) + " |")
    print("|" + "---|" * len(HEADER + TIMES))
    for name, published in SETS.items():
        path = Path(os.environ["SLAMCLI_DATASETS"]) / name
        if given.sets and not any(part in name for part in given.sets):
            continue
        if not path.exists():
            print(f"| {path.stem} | {published or ''} | not here |")
            continue
        print("| " + " | ".join(row(path, published, given.runs)) + " |", flush=True)


if __name__ == "__main__":
    main()
