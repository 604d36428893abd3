"""Tangent spaces by name, against the steps that they name, and the numbers that people read off a covariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from graphs import bundled, exact_graph, from_file, random_values
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from slamcli import models
from slamcli.geometry import se2, se3, so2
from slamcli.solver.covariance import CovarianceRecovery, CovarianceRequest, recover
from slamcli.solver.covariance.conventions import CONVENTIONS, change, frame, tangent, units
from slamcli.solver.covariance.relative import jacobians
from slamcli.solver.covariance.uncertainty import uncertainty

seeds = st.integers(0, 2**32 - 1)
STEP = 1e-6


def g2o_step(x: np.ndarray, w: np.ndarray) -> np.ndarray:
    """``VertexSE2::oplus``: the translation is added in the world."""
    return np.concatenate([x[:, :2] + w[:, :2], so2.wrap(x[:, 2:] + w[:, 2:])], axis=1)


def gtsam_step(x: np.ndarray, w: np.ndarray) -> np.ndarray:
    """``Pose3::retract``: X exp([omega, v])."""
    return se3.compose(x, se3.exp(np.concatenate([w[:, 3:], w[:, :3]], axis=1)))


@pytest.mark.parametrize(
    ("kind", "convention", "step"),
    [
        (models.SE2, "g2o", g2o_step),
        (models.SE3, "gtsam", gtsam_step),
        (models.SE2, "gtsam", lambda x, w: se2.compose(x, se2.exp(w))),
        (models.SE3, "g2o", se3.retract),
    ],
)
def test_a_change_takes_our_steps_to_theirs(kind, convention, step):
    rng = np.random.default_rng(1)
    x = random_values(rng, kind, 5)
    delta = STEP * rng.standard_normal((5, kind.dimension))
    matrix = change(kind, x, convention)
    theirs = delta if matrix is None else np.matvec(matrix, delta)
    assert_allclose(step(x, theirs), kind.retract(x, delta), rtol=0, atol=20.0 * STEP**2)


def test_every_convention_names_its_dimensions():
    for kind in (models.SE2, models.SE3, models.XY, models.XYZ):
        for convention in CONVENTIONS:
            assert len(tangent(kind, convention)) == len(units(kind, convention)) == kind.dimension
    assert units(models.SE3, "gtsam") == ("rad", "rad", "rad", "m", "m", "m")
    assert units(models.SE3, "slamcli") == ("m", "m", "m", "1", "1", "1")
    assert units(models.SE2, "g2o") == ("m", "m", "rad")
    assert frame(models.SE2, "g2o") == "translation along the axes of the world"
    assert change(models.XY, np.zeros((3, 2)), "g2o") is None


@pytest.mark.parametrize("convention", ["g2o", "gtsam"])
@pytest.mark.parametrize("name", ["landmarks_small.g2o", "sphere_small.g2o"])
def test_all_parts_of_a_result_are_in_one_convention(name, convention):
    """Marginals, cross, joint and relative covariances agree in every convention, as they do in ours."""
    graph = from_file(bundled(name)).graph
    recovery = CovarianceRecovery(graph)
    last = int(max(column.ids.max() for column in graph.variables.values()))
    found = recover(recovery, CovarianceRequest(joint=(3, last), cross=True, relative=((0, 3),), convention=convention))
    by_id = {int(i): c for m in found.marginals for i, c in zip(m.ids, m.covariance, strict=True)}
    size = len(by_id[3])
    assert_allclose(found.joint.covariance[:size, :size], by_id[3], rtol=1e-8, atol=1e-12)
    assert_allclose(found.joint.covariance[size:, size:], by_id[last], rtol=1e-8, atol=1e-12)
    assert found.joint.names[size].startswith(f"{last} ")
    for cross in found.cross:
        i, j = (int(k) for k in cross.ids[0])
        joint = recover(recovery, CovarianceRequest(joint=(i, j), convention=convention)).joint
        rows = cross.kinds[0].dimension
        assert_allclose(cross.covariance[0], joint.covariance[:rows, rows:], rtol=1e-8, atol=1e-12)
    # what is held is at the origin, unturned: the relative pose is the pose
    assert_allclose(found.relative[0].covariance, by_id[3], rtol=1e-8, atol=1e-12)


@given(st.sampled_from(["SE2 SE2", "SE3 SE3", "SE2 XY", "SE3 XYZ", "XY XY", "XYZ XYZ"]), seeds)
def test_jacobians_of_relative_variables_against_finite_differences(pair, seed):
    kinds = {kind.name: kind for kind in models.VARIABLE_KINDS}
    rng = np.random.default_rng(seed)
    graph = exact_graph(models.SE2, models.RELATIVE_POSE_2D, 3, 0)
    column = graph.variables["SE2"]
    names = pair.split()
    columns = {
        name: replace(column, kind=kinds[name], values=random_values(rng, kinds[name], 3)) for name in set(names)
    }
    graph = replace(graph, variables=columns)
    first, second = (names[0], 0), (names[1], 1)
    kind, value, found = jacobians(graph, first, second)
    wanted = np.zeros_like(found)
    start = 0
    for name, row in (first, second):
        for k in range(kinds[name].dimension):
            ends = []
            for sign in (1.0, -1.0):
                delta = np.zeros((1, kinds[name].dimension))
                delta[0, k] = sign * STEP
                values = columns[name].values.copy()
                values[row] = kinds[name].retract(values[row : row + 1], delta)[0]
                moved = replace(graph, variables=columns | {name: replace(columns[name], values=values)})
                ends.append(jacobians(moved, first, second)[1])
            # the relative value as a tangent step at the value itself
            local = {"SE2": se2.local, "SE3": se3.local}.get(kind.name, lambda x, y: y - x)
            wanted[:, start + k] = (local(value, ends[0]) - local(value, ends[1])) / (2.0 * STEP)
        start += kinds[name].dimension
    assert_allclose(found, wanted, rtol=0, atol=1e-7)


def test_ellipses_by_hand():
    """Deviations 2 and 1 along the pose's axes; the pose looks along y, so the long axis lies along y."""
    covariance = np.diag([4.0, 1.0, 0.01])[None]
    found = uncertainty(models.SE2, np.array([[5.0, 5.0, np.pi / 2]]), covariance, 9.0)
    assert_allclose(found.position, [[2.0, 1.0]])
    assert_allclose(found.rotation, [[np.degrees(0.1)]])
    assert_allclose(found.semi_axes, [[6.0, 3.0]])
    assert abs(found.angle[0]) == pytest.approx(90.0)
    assert found.total[0] == pytest.approx(np.sqrt(5.0))
    tilted = uncertainty(models.XY, np.zeros((1, 2)), np.array([[[2.0, 1.0], [1.0, 2.0]]]), 1.0)
    assert_allclose(tilted.semi_axes, [[np.sqrt(3.0), 1.0]])
    assert tilted.angle[0] == pytest.approx(45.0) and tilted.rotation.shape == (1, 0)


def test_ellipsoids_by_hand():
    """A quarter turn about z puts the pose's x axis on the world's y; quaternion parts are half angles."""
    root = np.sqrt(0.5)
    covariance = np.diag([9.0, 4.0, 1.0, 0.01, 0.0, 0.0])[None]
    found = uncertainty(models.SE3, np.array([[0.0, 0.0, 0.0, 0.0, 0.0, root, root]]), covariance, 4.0)
    assert_allclose(found.semi_axes, [[6.0, 4.0, 2.0]])
    assert_allclose(np.abs(found.directions[0]), [[0, 1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)
    assert_allclose(found.rotation, [[np.degrees(0.2), 0.0, 0.0]])
