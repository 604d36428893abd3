"""The analytic Jacobians of every kind of factor against finite differences, and where the residual vanishes."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from slamcli import models
from slamcli.geometry import so2
from slamcli.models import FACTOR_KINDS, FactorKind, VariableKind
from slamcli.models.base import Array

STEP = 1e-5  # of central differences: their error is about 1e-10, from rounding as from the third derivative
NEAR = 1e-3  # radians from where the residual jumps: more than a step, so that no difference spans the jump
ANGLES = {"theta", "bearing"}
OF_POSES = [models.RELATIVE_POSE_2D, models.RELATIVE_POSE_3D, models.POSE_PRIOR_2D, models.POSE_PRIOR_3D]

ALL_KINDS = [*FACTOR_KINDS, models.RELATIVE_POSE_2D_CHORDAL]

all_kinds = pytest.mark.parametrize("kind", ALL_KINDS, ids=lambda kind: kind.name)


def random_values(kind: VariableKind, count: int, rng: np.random.Generator) -> Array:
    """Values with positions of some metres and any orientation; quaternions of either sign."""
    values = rng.normal(scale=3.0, size=(count, kind.size))
    if kind is models.SWITCH:
        return rng.uniform(0.1, 0.9, (count, 1))  # steps end at 0 and 1
    if kind is models.SE2:
        values[:, 2] = rng.uniform(-np.pi, np.pi, count)
    return kind.normalize(values)


def random_factors(kind: FactorKind, count: int = 200, seed: int = 0) -> tuple[tuple[Array, ...], Array, Array | None]:
    """States, measurements and parameters of a kind, independent of each other."""
    rng = np.random.default_rng(seed)
    x = tuple(random_values(variable, count, rng) for variable in kind.variables)
    measurement = kind.normalize(rng.normal(scale=3.0, size=(count, kind.measurement_size)))
    if kind.components == ("x", "y", "theta"):
        measurement = models.SE2.normalize(measurement)
    if kind.components[0] == "range":
        measurement[:, 0] = np.abs(measurement[:, 0])
    parameter = None if kind.parameter is None else random_values(kind.parameter, count, rng)
    return x, measurement, parameter


def finite_differences(
    kind: FactorKind, x: tuple[Array, ...], measurement: Array, parameter: Array | None
) -> list[Array]:
    """The Jacobians by central differences through ``retract``."""
    angles = [name in ANGLES for name in kind.components]
    out = []
    for slot, variable in enumerate(kind.variables):
        jacobian = np.empty((len(measurement), kind.dimension, variable.dimension))
        for k in range(variable.dimension):
            ends = []
            for sign in (1.0, -1.0):
                delta = np.zeros((len(measurement), variable.dimension))
                delta[:, k] = sign * STEP
                moved = (*x[:slot], variable.retract(x[slot], delta), *x[slot + 1 :])
                ends.append(kind.residual(moved, measurement, parameter))
            difference = ends[0] - ends[1]
            difference[:, angles] = so2.wrap(difference[:, angles])
            jacobian[:, :, k] = difference / (2.0 * STEP)
        out.append(jacobian)
    return out


def assert_jacobians(kind: FactorKind, x: tuple[Array, ...], measurement: Array, parameter: Array | None) -> None:
    residual, jacobians = kind.linearize(x, measurement, parameter)
    assert_allclose(residual, kind.residual(x, measurement, parameter), rtol=1e-14, atol=1e-14)
    for analytic, numeric in zip(jacobians, finite_differences(kind, x, measurement, parameter), strict=True):
        # relative to the largest entry of each matrix; the bearing's third derivative grows as the point comes near
        scale = np.abs(numeric).max(axis=(1, 2), keepdims=True).clip(1.0)
        assert_allclose(analytic / scale, numeric / scale, rtol=0, atol=1e-6)
        assert analytic.shape == (len(measurement), kind.dimension, numeric.shape[-1])


@all_kinds
@pytest.mark.parametrize("seed", range(3))
def test_jacobians_at_random_states(kind: FactorKind, seed: int) -> None:
    assert_jacobians(kind, *random_factors(kind, seed=seed))


@pytest.mark.parametrize("kind", OF_POSES, ids=lambda kind: kind.name)
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_jacobians_where_the_rotation_error_is_nearly_half_a_turn(kind: FactorKind, side: float) -> None:
    """Where an angle wraps and where the sign of the error quaternion flips."""
    pose = kind.variables[-1]
    x, measurement, parameter = random_factors(kind)
    rng = np.random.default_rng(1)
    angle = np.pi + side * NEAR
    error = np.zeros((len(measurement), pose.size))
    error[:, : pose.space] = rng.normal(size=(len(measurement), pose.space))
    if pose is models.SE2:
        error[:, 2] = so2.wrap(np.full(len(error), angle))
    else:
        axis = rng.normal(size=(len(error), 3))
        error[:, 3:6] = np.sin(angle / 2.0) * axis / np.linalg.norm(axis, axis=1, keepdims=True)
        error[:, 6] = np.cos(angle / 2.0)
    last = kind.place(x[0], pose.compose(measurement, error), parameter)
    assert last is not None
    x = (*x[:-1], last)
    rotation = kind.residual(x, measurement, parameter)[:, pose.space :]
    half = np.pi if pose is models.SE2 else 1.0
    assert_allclose(np.linalg.norm(rotation, axis=1), half, rtol=0, atol=1.01 * NEAR)
    assert_jacobians(kind, x, measurement, parameter)


@pytest.mark.parametrize("kind", [models.BEARING_2D, models.RANGE_BEARING_2D], ids=lambda kind: kind.name)
def test_jacobians_of_bearings_near_the_wrap(kind: FactorKind) -> None:
    """Points seen just on either side of the direction opposite to the measured one, and behind the robot."""
    (pose, _), measurement, _ = random_factors(kind)
    measurement[::2, -1] = np.pi - NEAR
    direction = pose[:, 2] + measurement[:, -1] + np.pi + np.where(np.arange(len(pose)) % 4 < 2, NEAR, -NEAR)
    point = pose[:, :2] + 5.0 * np.stack([np.cos(direction), np.sin(direction)], axis=1)
    bearing = kind.residual((pose, point), measurement, None)[:, -1]
    assert_allclose(np.abs(bearing), np.pi, rtol=0, atol=1.01 * NEAR)
    assert_jacobians(kind, (pose, point), measurement, None)


@pytest.mark.parametrize("kind", [k for k in FACTOR_KINDS if any(v is models.SE3 for v in k.variables)], ids=repr)
def test_a_quaternion_and_its_negative_are_the_same_pose(kind: FactorKind) -> None:
    x, measurement, parameter = random_factors(kind)
    reference, jacobians = kind.linearize(x, measurement, parameter)
    for slot, variable in enumerate(kind.variables):
        if variable is models.SE3:
            flipped = x[slot].copy()
            flipped[:, 3:] *= -1.0
            other = kind.linearize((*x[:slot], flipped, *x[slot + 1 :]), measurement, parameter)
            assert_allclose(other[0], reference, rtol=0, atol=1e-13)
            for one, two in zip(other[1], jacobians, strict=True):
                assert_allclose(one, two, rtol=0, atol=1e-13)


@all_kinds
def test_reused_and_strided_buffers(kind: FactorKind) -> None:
    """``linearize_into`` leaves nothing of an earlier state behind, and accepts any strides."""
    residual, jacobians = kind.linearize(*random_factors(kind, seed=1))
    wide = np.zeros((len(residual), kind.dimension, 36))
    strided = tuple(wide[:, :, 12 * slot :: 2][:, :, : k.dimension] for slot, k in enumerate(kind.variables))
    second = random_factors(kind, seed=2)
    kind.linearize_into(residual, jacobians, *second)
    kind.linearize_into(np.empty_like(residual).T.copy().T, strided, *second)
    expected = kind.linearize(*second)
    np.testing.assert_array_equal(residual, expected[0])
    for reused, spread, fresh in zip(jacobians, strided, expected[1], strict=True):
        np.testing.assert_array_equal(reused, fresh)
        np.testing.assert_array_equal(spread, fresh)


@all_kinds
def test_the_residual_vanishes_where_place_puts_the_last_variable(kind: FactorKind) -> None:
    x, measurement, parameter = random_factors(kind)
    placed = kind.place(x[0], measurement, parameter)
    if placed is None:  # one bearing or one position does not determine a variable, nor a relative pose its switch
        assert kind.dimension < kind.variables[-1].dimension or models.SWITCH in kind.variables
        return
    assert placed.shape == x[-1].shape
    assert_allclose(kind.residual((*x[:-1], placed), measurement, parameter), 0.0, rtol=0, atol=1e-13)


@pytest.mark.parametrize("kind", [models.BEARING_2D, models.RANGE_2D, models.RANGE_BEARING_2D], ids=repr)
def test_the_direction_to_the_pose_itself_has_no_finite_jacobian(kind: FactorKind) -> None:
    nowhere = np.zeros((1, 3)), np.zeros((1, 2))
    residual, jacobians = kind.linearize(nowhere, np.zeros((1, kind.measurement_size)), None)
    assert not residual.any()
    assert not np.isfinite(jacobians[1]).any()
