"""Projections with constant or shared intrinsics: Jacobians by finite differences, residuals by the other models."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from slamcli import models
from slamcli.geometry import se3
from slamcli.graph import Factors
from slamcli.graph.depths import depths
from slamcli.models import Projection
from slamcli.models.base import Array

STEP = 1e-6
all_kinds = pytest.mark.parametrize("kind", models.SHARED_PROJECTION_KINDS, ids=lambda kind: kind.name)


def views(kind: Projection, count: int = 100, seed: int = 0) -> tuple[tuple[Array, ...], Array]:
    """Cameras anywhere, each with a point some metres in front of it."""
    rng = np.random.default_rng(seed)
    pose = se3.normalize(rng.normal(size=(count, 7)) * 3.0)
    local = np.concatenate([rng.normal(size=(count, 2)), kind.forward * rng.uniform(2.0, 6.0, (count, 1))], axis=1)
    if kind is models.SHARED_PINHOLE_PROJECTION:
        intrinsics = rng.uniform(300.0, 600.0, (count, 4))
    else:
        intrinsics = np.stack([rng.uniform(400, 600, count), *rng.normal(scale=0.1, size=(2, count))], axis=1)
    x = [pose, se3.act(pose, local), intrinsics]
    if len(kind.variables) == 2:
        x = [np.concatenate([pose, intrinsics], axis=1), x[1]]
    return tuple(x), rng.normal(scale=100.0, size=(count, 2))


@all_kinds
@pytest.mark.parametrize("seed", range(3))
def test_jacobians_of_shared_intrinsics(kind: Projection, seed: int) -> None:
    x, measurement = views(kind, seed=seed)
    residual, jacobians = kind.linearize(x, measurement, None)
    assert_allclose(residual, kind.residual(x, measurement, None), rtol=1e-12, atol=1e-10)
    for slot, variable in enumerate(kind.variables):
        assert jacobians[slot].shape == (len(measurement), 2, variable.dimension)
        for k in range(variable.dimension):
            ends = []
            for sign in (1.0, -1.0):
                delta = np.zeros((len(measurement), variable.dimension))
                delta[:, k] = sign * STEP
                moved = (*x[:slot], variable.retract(x[slot], delta), *x[slot + 1 :])
                ends.append(kind.residual(moved, measurement, None))
            numeric = (ends[0] - ends[1]) / (2.0 * STEP)
            scale = np.abs(jacobians[slot]).max(axis=(1, 2))[:, None].clip(1.0)
            assert_allclose(jacobians[slot][:, :, k] / scale, numeric / scale, rtol=0, atol=5e-7)


@all_kinds
def test_buffers_may_be_reused_and_strided(kind: Projection) -> None:
    residual, jacobians = kind.linearize(*views(kind, seed=1), None)
    wide = np.zeros((len(residual), 2, 54))
    strided = tuple(wide[:, :, 18 * slot :: 2][:, :, : k.dimension] for slot, k in enumerate(kind.variables))
    kind.linearize_into(residual, jacobians, *views(kind, seed=2), None)
    kind.linearize_into(np.empty_like(residual).T.copy().T, strided, *views(kind, seed=2), None)
    expected = kind.linearize(*views(kind, seed=2), None)
    np.testing.assert_array_equal(residual, expected[0])
    for reused, spread, fresh in zip(jacobians, strided, expected[1], strict=True):
        np.testing.assert_array_equal(reused, fresh)
        np.testing.assert_array_equal(spread, fresh)


def test_the_residuals_are_those_of_cameras_with_intrinsics_of_their_own() -> None:
    (pose, point, intrinsics), z = views(models.SHARED_BAL_PROJECTION)
    camera = np.concatenate([pose, intrinsics], axis=1)
    expected = models.BAL_PROJECTION.residual((camera, point), z, None)
    assert_allclose(models.SHARED_BAL_PROJECTION.residual((pose, point, intrinsics), z, None), expected)
    assert_allclose(models.CALIBRATED_BAL_PROJECTION.residual((camera, point), z, None), expected)
    (pose, point, intrinsics), z = views(models.SHARED_PINHOLE_PROJECTION)
    camera = np.concatenate([pose, intrinsics, np.zeros((len(pose), 1))], axis=1)
    expected = models.SBA_PROJECTION.residual((point, camera), z, None)
    assert_allclose(models.SHARED_PINHOLE_PROJECTION.residual((pose, point, intrinsics), z, None), expected)


def test_a_pinhole_image_by_hand() -> None:
    """A camera at the origin sees (1, 2, 4) at (500 / 4 + 320, 400 * 2 / 4 + 240) = (445, 440)."""
    x = (np.array([[0.0, 0, 0, 0, 0, 0, 1]]), np.array([[1.0, 2, 4]]), np.array([[500.0, 400, 320, 240]]))
    residual = models.SHARED_PINHOLE_PROJECTION.residual(x, np.array([[440.0, 441.0]]), None)
    assert_allclose(residual, [[5.0, -1.0]])
    assert models.SHARED_PINHOLE_PROJECTION.depth(x).tolist() == [4.0]


@pytest.mark.parametrize(
    "kind", [*models.PROJECTION_KINDS, *models.SHARED_PROJECTION_KINDS], ids=lambda kind: str(kind.name)
)
def test_depths_by_camera_are_those_by_observation(kind: Projection) -> None:
    rng = np.random.default_rng(5)
    values = {}
    for variable in kind.variables:
        found = rng.normal(size=(7, variable.size))
        values[variable.name] = variable.normalize(found)
    indices = rng.integers(0, 7, (50, len(kind.variables)))
    size = (50, kind.measurement_size)
    factors = Factors(kind, indices, np.zeros(size), np.zeros((50, kind.dimension, kind.dimension)))
    assert_allclose(depths(factors, values), kind.depth(factors.gather(values)), atol=1e-13)
