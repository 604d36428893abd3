"""Marginal covariances of all poses beside GTSAM's: ``python -m benchmarks.covariance [--runs N]``.

Both start from a graph at its optimum in memory and end with the covariances of all poses, linearization and
factorization included, in turn in one process. The differences are relative to the standard deviations: those of
GTSAM's own linearization, whose between factors leave out a derivative in the size of the residuals, and those of
GTSAM's elimination of our Jacobians. Needs the standard data sets (SLAMCLI_DATASETS) and gtsam.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
from pathlib import Path
from typing import Any

import gtsam
import numpy as np

import slamcli
from benchmarks.tables import ms, table
from slamcli.graph import FactorGraph
from slamcli.solver.covariance import CovarianceRecovery, CovarianceRequest, recover
from slamcli.solver.options import OptimizeOptions

#: Data set, start of the optimization, largest seconds (issue 6) and largest share of GTSAM's time.
GRAPHS = (
    ("pose2d/manhattan_sesync.g2o", "chordal", None, 1 / 3),
    ("pose2d/city10000.g2o", "file", 2.0, 1 / 3),
    ("pose3d/sphere2500.g2o", "chordal", None, 1 / 3),
)
#: Deviation of the prior by which GTSAM holds the first pose, in metres and radians.
PRIOR = 1e-6


def ours(graph: FactorGraph, convention: str = "slamcli") -> np.ndarray:
    """All marginals, in the order of the ids."""
    recovery = CovarianceRecovery(graph, OptimizeOptions(fix=(0,)))
    if convention == "slamcli":
        ((name, found),) = recovery.marginals().items()
    else:
        (marginals,) = recover(recovery, CovarianceRequest(convention=convention)).marginals
        found, name = marginals.covariance, marginals.kind.name
    return found[np.argsort(graph.variables[name].ids)]


def theirs(graph: Any, values: Any, count: int) -> np.ndarray:
    """All of GTSAM's marginals."""
    marginals = gtsam.Marginals(graph, values)
    return np.array([marginals.marginalCovariance(key) for key in range(count)])


def their_graph(graph: FactorGraph) -> tuple[Any, Any]:
    """The same graph in GTSAM with a prior for the held pose.

    Not by ``gtsam.readG2o``, which takes g2o's information of the half angles for one of rotation vectors.
    """
    ((name, column),) = graph.variables.items()
    size, spatial = column.kind.dimension, name == "SE3"
    back = np.eye(3)  # takes GTSAM's tangent vectors (omega, t) to g2o's (t, omega / 2)
    if spatial:
        back = np.zeros((6, 6))
        back[:3, 3:], back[3:, :3] = np.eye(3), 0.5 * np.eye(3)

    def pose(x: np.ndarray) -> Any:
        return gtsam.Pose3(gtsam.Rot3.Quaternion(x[6], *x[3:6]), x[:3]) if spatial else gtsam.Pose2(*x)

    between = gtsam.BetweenFactorPose3 if spatial else gtsam.BetweenFactorPose2
    prior = gtsam.PriorFactorPose3 if spatial else gtsam.PriorFactorPose2
    made, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for identifier, x in zip(column.ids.tolist(), column.values, strict=True):
        values.insert(identifier, pose(x))
    for factors in graph.factors:
        ids = factors.variable_ids(graph.variables).tolist()
        for (i, j), z, omega in zip(ids, factors.measurements, factors.information, strict=True):
            made.add(between(i, j, pose(z), gtsam.noiseModel.Gaussian.Information(back.T @ omega @ back)))
    made.add(
        prior(0, values.atPose3(0) if spatial else values.atPose2(0), gtsam.noiseModel.Isotropic.Sigma(size, PRIOR))
    )
    return made, values


def our_jacobians(graph: FactorGraph) -> tuple[Any, Any]:
    """Our whitened linear factors in a Gaussian graph of GTSAM's."""
    ((_, column),) = graph.variables.items()
    size = column.kind.dimension
    made, values, unit = gtsam.GaussianFactorGraph(), gtsam.VectorValues(), gtsam.noiseModel.Unit.Create(size)
    for factors in graph.factors:
        residual, parts = factors.linearize(graph.values)
        root = np.linalg.cholesky(factors.information).transpose(0, 2, 1)
        first, second = (root @ part for part in parts)
        right = -np.matvec(root, residual)
        ids = factors.variable_ids(graph.variables)
        for k, (i, j) in enumerate(ids.tolist()):
            made.add(gtsam.JacobianFactor(i, first[k], j, second[k], right[k], unit))
    made.add(gtsam.JacobianFactor(0, np.eye(size) / PRIOR, np.zeros(size), unit))
    for identifier in column.ids.tolist():
        values.insert(identifier, np.zeros(size))
    return made, values


def deviation(found: np.ndarray, wanted: np.ndarray) -> str:
    """Largest difference over the product of the standard deviations, without the held pose."""
    sigma = np.sqrt(np.diagonal(wanted[1:], axis1=1, axis2=2))
    return f"{np.abs((found - wanted)[1:] / (sigma[:, :, None] * sigma[:, None, :])).max():.1e}"


def measure(path: Path, start: str, runs: int) -> tuple[list[float], list[float], str, str]:
    """Seconds of ours and theirs, and the deviations of both comparisons."""
    graph = slamcli.optimize(slamcli.read(str(path)), method="gn", init=start).graph
    made, values = their_graph(graph)
    count = graph.poses
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(runs):
        for seconds, call in zip(times, (lambda: ours(graph), lambda: theirs(made, values, count)), strict=True):
            began = time.perf_counter()
            found = call()
            seconds.append(time.perf_counter() - began)
    own = deviation(found, ours(graph, "gtsam"))
    same = deviation(theirs(*our_jacobians(graph), count), ours(graph))
    return *times, own, same


def main() -> None:
    """Measure all graphs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3, help="repetitions of each measurement (default 3)")
    options = parser.parse_args()
    folder = Path(os.environ["SLAMCLI_DATASETS"])
    rows = []
    for name, start, seconds, share in GRAPHS:
        first, second, own, same = measure(folder / name, start, options.runs)
        ratio = statistics.median(a / b for a, b in zip(first, second, strict=True))
        goal = f"{'-' if seconds is None else f'{seconds:g} s'}, {share:.2f}"
        rows.append((name, ms(first), ms(second), f"{ratio:.3f}", goal, own, same))
    header = ("data set", "slamcli, ms", "gtsam, ms", "slamcli / gtsam", "goals", "off gtsam's", "off, same Jacobians")
    print(table("Marginal covariances of all poses", header, rows))


if __name__ == "__main__":
    main()
