"""Marginals of GTSAM at the same linearization point, in its convention.

GTSAM's between factors leave out the derivative of the logarithm, so its H differs from ours in the size of the
residuals. Two comparisons get around that: the same graphs with measurements that fit (no residuals), and GTSAM's
elimination of our own Jacobians at the residuals of the data.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from graphs import bundled, from_file
from support import dataset

import slamcli
from slamcli.graph import FactorGraph
from slamcli.solver.covariance import CovarianceRecovery, CovarianceRequest, recover
from slamcli.solver.options import OptimizeOptions

gtsam = pytest.importorskip("gtsam")

#: Deviation, in metres and radians, of the prior that stands for a held pose.
PRIOR = 1e-6
HELD = OptimizeOptions(fix=(0,))


def at_optimum(name: str) -> FactorGraph:
    if "/" in name:
        graph = slamcli.read(str(dataset(name)))
        return slamcli.optimize(graph, method="gn", init="chordal").graph
    return from_file(bundled(name)).graph


def without_residuals(graph: FactorGraph) -> FactorGraph:
    (factors,) = graph.factors
    kind = factors.kind.variables[0]
    first, second = factors.gather(graph.values)
    return replace(graph, factors=[replace(factors, measurements=kind.compose(kind.inverse(first), second))])


def their_graph(graph: FactorGraph) -> tuple[object, object]:
    """Their nonlinear graph: information in the order of their tangent space, (omega, t) = T (t, h)."""
    ((name, column),) = graph.variables.items()
    (factors,) = graph.factors
    spatial = name == "SE3"
    back = np.eye(3)
    if spatial:
        back = np.zeros((6, 6))
        back[:3, 3:], back[3:, :3] = np.eye(3), 0.5 * np.eye(3)

    def pose(x: np.ndarray) -> object:
        return gtsam.Pose3(gtsam.Rot3.Quaternion(x[6], *x[3:6]), x[:3]) if spatial else gtsam.Pose2(*x)

    between = gtsam.BetweenFactorPose3 if spatial else gtsam.BetweenFactorPose2
    prior = gtsam.PriorFactorPose3 if spatial else gtsam.PriorFactorPose2
    made, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for row, x in enumerate(column.values):
        values.insert(row, pose(x))
    for (i, j), z, omega in zip(factors.indices.tolist(), factors.measurements, factors.information, strict=True):
        made.add(between(i, j, pose(z), gtsam.noiseModel.Gaussian.Information(back.T @ omega @ back)))
    made.add(prior(0, pose(column.values[0]), gtsam.noiseModel.Isotropic.Sigma(column.kind.dimension, PRIOR)))
    return made, values


def our_jacobians(graph: FactorGraph) -> tuple[object, object]:
    """Our linear factors, whitened, in a Gaussian graph of theirs."""
    ((_, column),) = graph.variables.items()
    (factors,) = graph.factors
    size = column.kind.dimension
    made, values, unit = gtsam.GaussianFactorGraph(), gtsam.VectorValues(), gtsam.noiseModel.Unit.Create(size)
    residual, parts = factors.linearize(graph.values)
    root = np.linalg.cholesky(factors.information).transpose(0, 2, 1)
    first, second = (root @ part for part in parts)
    right = -np.matvec(root, residual)
    for k, (i, j) in enumerate(factors.indices.tolist()):
        made.add(gtsam.JacobianFactor(i, first[k], j, second[k], right[k], unit))
    made.add(gtsam.JacobianFactor(0, np.eye(size) / PRIOR, np.zeros(size), unit))
    for row in range(len(column)):
        values.insert(row, np.zeros(size))
    return made, values


def deviation(graph: FactorGraph, theirs: tuple[object, object], convention: str) -> float:
    """Largest difference of an entry, relative to the product of its two standard deviations."""
    marginals = gtsam.Marginals(*theirs)
    request = CovarianceRequest(convention=convention)
    ours = recover(CovarianceRecovery(graph, HELD), request).marginals[0].covariance[1:]
    rows = range(0, len(ours), 1 + len(ours) // 500)  # theirs of sphere2500 take a while; the benchmark takes all
    found, ours = np.array([marginals.marginalCovariance(row + 1) for row in rows]), ours[rows]
    sigma = np.sqrt(np.diagonal(ours, axis1=1, axis2=2))
    return float(np.abs((found - ours) / (sigma[:, :, None] * sigma[:, None, :])).max())


NAMES = (
    "manhattan_small.g2o",
    "sphere_small.g2o",
    pytest.param("pose2d/manhattan_sesync.g2o", marks=pytest.mark.datasets),
    pytest.param("pose3d/sphere2500.g2o", marks=[pytest.mark.datasets, pytest.mark.slow]),
)


@pytest.mark.parametrize("name", NAMES)
def test_marginals_without_residuals(name: str) -> None:
    graph = without_residuals(at_optimum(name))
    assert deviation(graph, their_graph(graph), "gtsam") < 1e-6


@pytest.mark.parametrize("name", NAMES)
def test_marginals_of_the_same_jacobians(name: str) -> None:
    graph = at_optimum(name)
    assert deviation(graph, our_jacobians(graph), "slamcli") < 1e-6


def test_the_derivative_that_they_leave_out_matters() -> None:
    """Without which the comparisons above could be made with the data as they are."""
    graph = at_optimum("sphere_small.g2o")
    assert 1e-5 < deviation(graph, their_graph(graph), "gtsam") < 1e-2


def test_joint_of_a_pair_that_no_edge_joins() -> None:
    graph = without_residuals(at_optimum("sphere_small.g2o"))
    joint = gtsam.Marginals(*their_graph(graph)).jointMarginalCovariance(gtsam.KeyVector([7, 311])).fullMatrix()
    ours = recover(CovarianceRecovery(graph, HELD), CovarianceRequest(joint=(7, 311), convention="gtsam")).joint
    sigma = np.sqrt(np.diag(joint))
    assert np.abs((ours.covariance - joint) / np.outer(sigma, sigma)).max() < 1e-6
