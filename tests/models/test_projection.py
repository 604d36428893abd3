"""Projection factors: Jacobians against finite differences, hand-worked images, points that have none."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from slamcli import models
from slamcli.geometry import se3, so3
from slamcli.models import PROJECTION_KINDS, Projection
from slamcli.models.base import Array

STEP = 1e-6

all_kinds = pytest.mark.parametrize("kind", PROJECTION_KINDS, ids=lambda kind: kind.name)


def random_views(kind: Projection, count: int = 200, seed: int = 0) -> tuple[tuple[Array, ...], Array, Array | None]:
    """Cameras anywhere, each with a point some metres in front of it, off the axis by up to 30 degrees or so."""
    rng = np.random.default_rng(seed)
    pose = se3.normalize(rng.normal(size=(count, 7)) * 3.0)
    local = np.concatenate([rng.normal(size=(count, 2)), kind.forward * rng.uniform(2.0, 6.0, (count, 1))], axis=1)
    variables = [kind.variables[kind.camera].size - 7, 0 if kind.parameter is None else kind.parameter.size]
    if kind is models.BAL_PROJECTION:
        intrinsics = np.stack([rng.uniform(400, 600, count), *rng.normal(scale=0.1, size=(2, count))], axis=1)
    else:
        intrinsics = rng.uniform(300.0, 600.0, (count, max(variables)))
        intrinsics[:, -1] = rng.uniform(0.1, 0.5, count)  # the baseline
    camera = np.concatenate([pose, intrinsics], axis=1) if variables[0] else pose
    x = [camera, se3.act(pose, local)]
    measurement = rng.normal(scale=100.0, size=(count, kind.measurement_size))
    ordered = tuple(x if kind.camera == 0 else x[::-1])
    return ordered, measurement, None if kind.parameter is None else intrinsics


@all_kinds
@pytest.mark.parametrize("seed", range(3))
def test_jacobians_against_finite_differences(kind: Projection, seed: int) -> None:
    x, measurement, parameter = random_views(kind, seed=seed)
    residual, jacobians = kind.linearize(x, measurement, parameter)
    assert_allclose(residual, kind.residual(x, measurement, parameter), rtol=1e-12, atol=1e-12)
    for slot, variable in enumerate(kind.variables):
        assert jacobians[slot].shape == (len(measurement), kind.dimension, variable.dimension)
        for k in range(variable.dimension):
            ends = []
            for sign in (1.0, -1.0):
                delta = np.zeros((len(measurement), variable.dimension))
                delta[:, k] = sign * STEP
                moved = (*x[:slot], variable.retract(x[slot], delta), *x[slot + 1 :])
                ends.append(kind.residual(moved, measurement, parameter))
            numeric = (ends[0] - ends[1]) / (2.0 * STEP)
            scale = np.abs(jacobians[slot]).max(axis=(1, 2))[:, None].clip(1.0)
            assert_allclose(jacobians[slot][:, :, k] / scale, numeric / scale, rtol=0, atol=1e-7)


@all_kinds
def test_reused_and_strided_buffers(kind: Projection) -> None:
    residual, jacobians = kind.linearize(*random_views(kind, seed=1))
    wide = np.zeros((len(residual), kind.dimension, 36))
    strided = tuple(wide[:, :, 18 * slot :: 2][:, :, : k.dimension] for slot, k in enumerate(kind.variables))
    second = random_views(kind, seed=2)
    kind.linearize_into(residual, jacobians, *second)
    kind.linearize_into(np.empty_like(residual).T.copy().T, strided, *second)
    expected = kind.linearize(*second)
    np.testing.assert_array_equal(residual, expected[0])
    for reused, spread, fresh in zip(jacobians, strided, expected[1], strict=True):
        np.testing.assert_array_equal(reused, fresh)
        np.testing.assert_array_equal(spread, fresh)


def test_bal_camera_by_its_definition() -> None:
    """P = R X + t, p = -P.xy / P.z, f (1 + k1 |p|^2 + k2 |p|^4) p, with R and t of the world seen from the camera."""
    rng = np.random.default_rng(4)
    turn = so3.exp(np.array([0.3, -0.2, 0.5]))
    rotation, translation = so3.to_matrix(turn), np.array([0.1, 0.4, -6.0])
    point = rng.normal(size=3)
    p = rotation @ point + translation
    q = -p[:2] / p[2]
    square = q @ q
    expected = 500.0 * (1.0 - 0.2 * square + 0.03 * square**2) * q
    camera = np.concatenate([-rotation.T @ translation, so3.inverse(turn), [500.0, -0.2, 0.03]])
    x = camera[None], point[None]
    residual = models.BAL_PROJECTION.residual(x, np.array([[7.0, -3.0]]), None)
    assert_allclose(residual[0], expected - [7.0, -3.0], rtol=1e-13)
    assert_allclose(models.BAL_PROJECTION.depth(x), [-p[2]], rtol=1e-13)


def test_pinhole_cameras_by_hand() -> None:
    """A camera at (1, 0, 0) that looks along z sees (2, 1, 4) at (1, 1, 4) in its frame."""
    pose, point = np.array([[1.0, 0, 0, 0, 0, 0, 1]]), np.array([[2.0, 1.0, 4.0]])
    camera = np.concatenate([pose, [[500.0, 400.0, 320.0, 240.0, 0.5]]], axis=1)
    mono = models.SBA_PROJECTION.residual((point, camera), np.array([[440.0, 300.0]]), None)
    assert_allclose(mono, [[5.0, 40.0]], atol=1e-12)  # 500/4 + 320 = 445, 400/4 + 240 = 340
    stereo = models.SBA_STEREO_PROJECTION.residual((point, camera), np.array([[440.0, 300.0, 380.0]]), None)
    assert_allclose(stereo, [[5.0, 40.0, 2.5]], atol=1e-12)  # 500 (1 - 0.5)/4 + 320 = 382.5
    expmap = models.EXPMAP_PROJECTION.residual(
        (point, pose), np.array([[440.0, 300.0]]), np.array([[500.0, 320.0, 240.0, 0.5]])
    )
    assert_allclose(expmap, [[-5.0, -65.0]], atol=1e-12)  # 500/4 + 240 = 365, and measured minus predicted


@all_kinds
def test_depth_has_the_sign_of_what_is_in_front(kind: Projection) -> None:
    x, _, _ = random_views(kind)
    assert (kind.depth(x) > 0.0).all()
    point = kind.point
    camera = x[kind.camera]
    mirrored = list(x)
    mirrored[point] = 2.0 * camera[:, :3] - x[point]
    assert (kind.depth(tuple(mirrored)) < 0.0).all()


@all_kinds
def test_a_point_in_the_plane_of_the_camera_has_no_finite_residual(kind: Projection) -> None:
    x, measurement, parameter = random_views(kind, count=2)
    camera = x[kind.camera]
    camera[:, 3:7] = [0.0, 0.0, 0.0, 1.0]
    point = camera[:, :3] + np.array([[1.0, 2.0, 0.0], [0.0, 0.0, 0.0]])
    pair = tuple((camera, point) if kind.camera == 0 else (point, camera))
    residual, jacobians = kind.linearize(pair, measurement, parameter)
    assert not np.isfinite(residual[:, :2]).any()
    assert not np.isfinite(jacobians[kind.point]).all(axis=(1, 2)).any()


@pytest.mark.parametrize("kind", [models.CAMERA, models.SBA_CAMERA, models.SE3_EXPMAP], ids=lambda kind: kind.name)
def test_cameras_are_groups_with_a_local_step(kind: models.VariableKind) -> None:
    rng = np.random.default_rng(0)
    x = kind.normalize(rng.normal(size=(20, kind.size)))
    neutral = kind.compose(x, kind.inverse(x))
    assert_allclose(np.abs(neutral[:, :7]), np.tile(np.abs(kind.identity[:7]), (20, 1)), atol=1e-14)
    assert_allclose(neutral[:, 7:], 0.0, atol=1e-14)
    assert_allclose(kind.retract(x, np.zeros((20, kind.dimension))), x, atol=1e-15)
    delta = rng.normal(scale=0.1, size=(20, kind.dimension))
    moved = kind.retract(x, delta)
    assert_allclose(moved[:, :7], se3.retract(x[:, :7], delta[:, :6]), atol=1e-15)
    assert_allclose(moved[:, 7:] - x[:, 7:], delta[:, 6:] if kind is models.CAMERA else 0.0, atol=1e-15)
