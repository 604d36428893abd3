"""Covariances of scenes of cameras: the gauge, against dense algebra, invariants of the gauge, and the noise itself."""

from dataclasses import replace

import numpy as np
import pytest
from bundle_scenes import ring

import slamcli
from slamcli.errors import NumericalError
from slamcli.graph import FactorGraph, camera_intrinsics
from slamcli.models.base import Array
from slamcli.solver.covariance import CovarianceRecovery, CovarianceRequest, recover, recovery_of
from slamcli.solver.linear_system import Linearizer
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.stopwatch import Stopwatch


def dense(graph: FactorGraph) -> Array:
    """The whole H, nothing held but what the graph fixes."""
    held = {name: column.fixed for name, column in graph.variables.items()}
    linearizer = Linearizer(graph, held, Stopwatch())
    pattern, system = linearizer.pattern, linearizer.linearize(graph.values)
    out = np.zeros((pattern.dimension, pattern.dimension))
    out[pattern.scalar_rows, pattern.scalar_columns] = system.hessian
    return np.triu(out) + np.triu(out, 1).T


def frozen_rows(recovery: CovarianceRecovery) -> Array:
    """Scalar rows of the whole H that the gauge holds."""
    masks = [
        recovery.gauge.frozen.get(name, np.zeros((len(column), column.kind.dimension), dtype=bool)).ravel()
        for name, column in recovery.graph.variables.items()
    ]
    return np.concatenate(masks)


@pytest.mark.parametrize("shared", [False, True])
def test_they_are_the_inverse_without_what_is_held(shared: bool) -> None:
    graph = slamcli.optimize(ring()).graph
    graph = slamcli.optimize(camera_intrinsics.shared(graph)).graph if shared else graph
    recovery = CovarianceRecovery(graph)
    whole, frozen = dense(graph), frozen_rows(recovery)
    assert frozen.sum() == 7
    expected = np.zeros_like(whole)
    kept = np.flatnonzero(~frozen)
    root = 1.0 / np.sqrt(whole.diagonal()[kept])
    inner = np.linalg.inv(whole[np.ix_(kept, kept)] * root * root[:, None]) * root * root[:, None]
    expected[np.ix_(kept, kept)] = inner
    start = 0
    for name, found in recovery.marginals().items():
        width = found.shape[1]
        for row, block in enumerate(found):
            part = slice(start + row * width, start + (row + 1) * width)
            scale = np.sqrt(np.maximum(expected[part, part].diagonal(), 1e-30))
            np.testing.assert_allclose(
                block / scale / scale[:, None], expected[part, part] / scale / scale[:, None], atol=1e-6, err_msg=name
            )
        start += width * len(found)
    ids = [0, 3, 20, *(graph.variables[k].ids[0] for k in camera_intrinsics.shared_names(graph))]
    joint = recover(recovery, CovarianceRequest(joint=tuple(int(i) for i in ids))).joint
    assert joint is not None
    assert (np.diag(joint.covariance)[:6] == 0.0).all()
    assert (np.linalg.eigvalsh(joint.covariance) > -1e-9 * np.abs(joint.covariance).max()).all()


def test_what_no_gauge_can_change_has_the_same_covariance_in_all() -> None:
    """Intrinsics and the ratio of two distances: first camera held, two cameras held, points held."""
    graph = slamcli.optimize(ring(points=60)).graph
    found = [
        CovarianceRecovery(graph, OptimizeOptions(fix=fix)).marginals()["CAMERA"][:, 6:, 6:]
        for fix in ((), (10, 11, 12), (30, 45, 50))
    ]
    whole = dense(graph)
    root = 1.0 / np.sqrt(whole.diagonal())
    values, vectors = np.linalg.eigh(whole * root * root[:, None])
    # with three points held nothing but more than the gauge is fixed, so only the first is minimal
    pseudo = (vectors[:, 7:] / values[7:]) @ vectors[:, 7:].T * root * root[:, None]
    for camera in range(6):
        part = slice(9 * camera + 6, 9 * camera + 9)
        scale = np.sqrt(pseudo[part, part].diagonal())
        np.testing.assert_allclose(
            found[0][camera] / scale / scale[:, None], pseudo[part, part] / scale / scale[:, None], atol=1e-6
        )
    assert (np.trace(found[1], axis1=1, axis2=2) <= np.trace(found[0], axis1=1, axis2=2) * (1.0 + 1e-9)).all()


def test_focal_lengths_scatter_as_the_covariance_says() -> None:
    """The error of f over its standard deviation, in 12 scenes of 6 cameras: chi-square with 72 degrees of freedom."""
    sigma, total = 0.3, 0.0
    for seed in range(12):
        scene = ring(noise=sigma, seed=seed, points=60, share=1.0)
        result = slamcli.optimize(scene)
        deviation = sigma * np.sqrt(CovarianceRecovery(result.graph).marginals()["CAMERA"][:, 6, 6])
        total += float(
            np.square((result.graph.values["CAMERA"][:, 7] - scene.values["CAMERA"][:, 7]) / deviation).sum()
        )
    assert abs(total - 72.0) < 4.5 * np.sqrt(2.0 * 72.0)  # (those of one scene are correlated)


def test_covariances_at_the_end_of_a_run_have_a_gauge_although_the_run_had_none() -> None:
    result = slamcli.optimize(ring())
    assert result.gauge.frozen == {}
    recovery = recovery_of(result)
    assert recovery.gauge.reason == "pose of 0 and z of 3 held"
    assert recovery.dof == result.dof
    assert (recovery.marginals()["CAMERA"][0, :6] == 0.0).all()
    assert recovery.marginals()["CAMERA"][0, 6, 6] > 0.0


@pytest.mark.parametrize("unit", [1e-5, 1e5])
def test_the_unit_of_length_does_not_matter(unit: float) -> None:
    """Pivots of points are then ten orders of magnitude from those of angles, and still not rounding."""
    graph = slamcli.optimize(ring()).graph
    values = {name: value.copy() for name, value in graph.values.items()}
    values["CAMERA"][:, :3] *= unit
    values["XYZ"] *= unit
    one, other = CovarianceRecovery(graph).marginals(), CovarianceRecovery(graph.with_values(values)).marginals()
    np.testing.assert_allclose(other["XYZ"], unit**2 * one["XYZ"], rtol=1e-5, atol=1e-9 * unit**2)
    np.testing.assert_allclose(other["CAMERA"][:, 6:, 6:], one["CAMERA"][:, 6:, 6:], rtol=1e-5)


def test_a_point_seen_once_is_named() -> None:
    scene = ring()
    factors = scene.factors[0]
    first = factors.indices[factors.indices[:, 1] == 5, 0][0]
    keep = np.flatnonzero((factors.indices[:, 1] != 5) | (factors.indices[:, 0] == first))
    with pytest.raises(NumericalError) as error:
        CovarianceRecovery(replace(scene, factors=[factors.part(keep)])).marginals()
    assert any("XYZ 11" in line for line in error.value.details)
