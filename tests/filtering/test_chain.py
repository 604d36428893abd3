"""Dead reckoning: stretches of steps as one, and the poses in between again."""

from itertools import pairwise

import numpy as np
import pytest

from slamcli.filtering.chain import composed, filled, integrated, integrated_covariance
from slamcli.geometry import se2

KEPT = [
    pytest.param([0, 12], id="one stretch"),
    pytest.param([0, 1, 5, 6, 11, 12], id="several"),
    pytest.param(list(range(13)), id="all"),
]


@pytest.fixture
def steps():
    """Displacements and covariances that no axis and no size makes simple."""
    rng = np.random.default_rng(5)
    displacement = np.column_stack([rng.normal(1.0, 0.3, 12), rng.normal(0.0, 0.3, 12), rng.normal(0.0, 0.8, 12)])
    factor = rng.normal(size=(12, 3, 3)) * 0.1
    return displacement, factor @ factor.transpose(0, 2, 1) + 1e-4 * np.eye(3)


def folded(displacement, covariance):
    """Pose and covariance after all steps, as a filter has them: P <- F P F^T + Q, local steps."""
    pose, total = np.zeros(3), np.zeros((3, 3))
    for step, noise in zip(displacement, covariance, strict=True):
        pose = se2.compose(pose, step)
        transition = se2.adjoint(se2.inverse(step))
        total = transition @ total @ transition.T + noise
    return pose, total


def test_integrated_composes_step_after_step(steps):
    poses = integrated(np.array([3.0, -2.0, 1.0]), steps[0])
    for k, step in enumerate(steps[0]):
        assert poses[k + 1] == pytest.approx(se2.compose(poses[k], step), abs=1e-12)


@pytest.mark.parametrize("kept", KEPT)
def test_stretches_are_what_a_filter_would_predict(steps, kept):
    displacement, covariance = composed(*steps, np.array(kept))
    for k, (first, last) in enumerate(pairwise(kept)):
        pose, total = folded(steps[0][first:last], steps[1][first:last])
        assert displacement[k] == pytest.approx(pose, abs=1e-12)
        assert covariance[k] == pytest.approx(total, abs=1e-12)


def test_covariance_of_dead_reckoning_is_that_of_the_filter(steps):
    poses = integrated(np.array([30.0, -20.0, 2.0]), steps[0])
    found = integrated_covariance(poses, np.zeros((3, 3)), steps[1])
    for k in range(len(poses)):
        assert found[k] == pytest.approx(folded(steps[0][:k], steps[1][:k])[1], abs=1e-10)


@pytest.mark.parametrize("kept", KEPT)
def test_without_anything_missing_the_poses_between_are_dead_reckoned(steps, kept):
    poses = integrated(np.array([3.0, -2.0, 1.0]), steps[0])
    assert filled(poses[kept], *steps, np.array(kept)) == pytest.approx(poses, abs=1e-12)


def test_poses_between_minimize_the_cost_of_their_steps(steps):
    """Held at both ends and filled in, no step in between can be changed to lower chi2: its gradient is zero."""
    displacement, covariance = steps
    ends = integrated(np.zeros(3), displacement)[[0, 12]]
    ends[1] = se2.retract(ends[1], np.array([2e-6, -1e-6, 1e-6]))  # so small that everything is linear
    poses = filled(ends, displacement, covariance, np.array([0, 12]))
    assert poses[[0, 12]] == pytest.approx(ends)
    residual = se2.local(displacement, se2.between(poses[:-1], poses[1:]))
    weighted = np.linalg.solve(covariance, residual[:, :, None])[:, :, 0]
    carried = np.matvec(se2.adjoint(se2.inverse(displacement[1:])).transpose(0, 2, 1), weighted[1:])
    assert np.abs(weighted).max() > 1e-6
    assert weighted[:-1] == pytest.approx(carried, abs=1e-9)


def test_a_robot_that_stands_still_has_no_part_in_what_is_missing(steps):
    displacement, covariance = (part.copy() for part in steps)
    displacement[4], covariance[4] = 0.0, 0.0
    ends = integrated(np.zeros(3), displacement)[[0, 12]]
    ends[1] = se2.retract(ends[1], np.array([0.2, -0.1, 0.05]))
    poses = filled(ends, displacement, covariance, np.array([0, 12]))
    assert poses[5] == pytest.approx(poses[4], abs=1e-12)
