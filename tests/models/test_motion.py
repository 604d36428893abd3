"""Motion models: controls and displacements, their Jacobians, and noise that is what it claims to be."""

from fractions import Fraction
from math import factorial

import hypothesis.extra.numpy as nps
import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from numpy.testing import assert_allclose, assert_array_equal

from slamcli import models
from slamcli.errors import UsageError
from slamcli.geometry import se2, se3, so2
from slamcli.models.base import Array
from slamcli.models.motion import (
    MOTION_MODELS,
    BodyMotion,
    DifferentialDrive,
    MotionModel,
    OdometryMotion,
    VelocityMotion,
)
from slamcli.models.motion.base import SHORTEST_WAY

pytestmark = pytest.mark.filterwarnings("error")

STEP = 1e-5
DT = 0.4
ANGLES = [0.0, 1e-200, 1e-12, 1e-9, 1e-6, 1e-3, 0.1, np.nextafter(1.0, 0.0), 1.0, 3.0, np.pi, 3.2, 6.0]
VELOCITY = VelocityMotion(0.02, 0.003, 0.01, 0.02, 0.005, 0.01)
ODOMETRY = OdometryMotion(0.02, 0.01, 0.03, 0.005)
WHEELS = DifferentialDrive(baseline=0.3, slip=0.05)
BODY = BodyMotion((0.02, 0.01, 0.03))
SPATIAL = BodyMotion((0.02, 0.01, 0.03, 0.004, 0.005, 0.006), models.SE3)
PLANAR: list[MotionModel] = [VELOCITY, ODOMETRY, WHEELS, BODY]

each_model = pytest.mark.parametrize("model", [*PLANAR, SPATIAL], ids=lambda m: f"{m.name}-{m.kind.name}")
each_planar = pytest.mark.parametrize("model", PLANAR, ids=lambda m: m.name)
poses = nps.arrays(
    np.float64,
    st.tuples(st.integers(1, 5), st.just(3)),
    elements=st.floats(-10.0, 10.0),
).map(se2.normalize)


def controls(model: MotionModel, count: int = 100, seed: int = 0) -> Array:
    """Controls in both directions, with turns up to more than half a turn."""
    rng = np.random.default_rng(seed)
    if model is SPATIAL:
        return models.SE3.normalize(rng.normal(size=(count, 7)))
    if model is WHEELS:
        return rng.normal(scale=0.5, size=(count, 2))
    scale = [2.0, 2.0, 2.0] if model is not VELOCITY else [2.0, 5.0, 3.0]
    drawn = rng.normal(size=(count, 3)) * scale
    return se2.normalize(drawn) if model is BODY else drawn


# -- where controls lead ---------------------------------------------------------------------------------------------


def test_the_list_of_models_holds_each_by_its_name() -> None:
    assert set(MOTION_MODELS) == {"velocity", "odometry", "differential-drive", "body"}
    assert all(MOTION_MODELS[model.name] is type(model) for model in PLANAR)


@pytest.mark.parametrize(
    ("model", "control", "displacement"),
    [
        # a quarter of a circle of radius 1, then a quarter turn on the spot
        (VELOCITY, [np.pi / 2, np.pi / 2, np.pi / 2], [1.0, 1.0, -np.pi]),
        (VELOCITY, [2.0, 0.0, 0.0], [2.0, 0.0, 0.0]),
        (VELOCITY, [0.0, 1.0, 0.5], [0.0, 0.0, 1.5]),
        (ODOMETRY, [np.pi / 2, 3.0, -np.pi / 2], [0.0, 3.0, 0.0]),
        (ODOMETRY, [0.25, -2.0, -0.25], [-2.0 * np.cos(0.25), -2.0 * np.sin(0.25), 0.0]),
        # both wheels 1 m; the right one goes round the left one; both round their middle by a quarter turn
        (WHEELS, [1.0, 1.0], [1.0, 0.0, 0.0]),
        (WHEELS, [0.0, 0.3 * np.pi / 2], [0.15, 0.15, np.pi / 2]),
        (WHEELS, [-0.075 * np.pi, 0.075 * np.pi], [0.0, 0.0, np.pi / 2]),
        (BODY, [1.0, 2.0, 3.0], [1.0, 2.0, 3.0]),
    ],
)
def test_displacements_by_hand(model: MotionModel, control: list[float], displacement: list[float]) -> None:
    assert_allclose(model.displacement(np.array([control]), 1.0), [displacement], rtol=0, atol=1e-15)


def test_velocities_count_by_their_duration() -> None:
    control = controls(VELOCITY)
    duration = np.linspace(0.1, 2.0, len(control))
    assert_allclose(
        VELOCITY.displacement(control, duration),
        VELOCITY.displacement(control * duration[:, None], 1.0),
        rtol=0,
        atol=1e-13,
    )


@pytest.mark.parametrize("angle", [sign * angle for angle in ANGLES for sign in (1, -1)])
def test_arcs_keep_their_digits_as_they_become_straight(angle: float) -> None:
    """Against the power series in rational numbers, the derivative by the turn included."""
    terms = range(40)
    a = Fraction(angle)
    x = sum((-1) ** k * a ** (2 * k) / factorial(2 * k + 1) for k in terms)
    y = sum((-1) ** k * a ** (2 * k + 1) / factorial(2 * k + 2) for k in terms)
    dx = sum((-1) ** k * 2 * k * a ** (2 * k - 1) / factorial(2 * k + 1) for k in terms[1:])
    dy = sum((-1) ** k * (2 * k + 1) * a ** (2 * k) / factorial(2 * k + 2) for k in terms)
    control = np.array([[1.0, angle, -angle]])  # gamma turns back: the Jacobian is in the frame of the beginning
    found, jacobian = VELOCITY.displacement(control, 1.0), VELOCITY.jacobian(control, 1.0)
    assert_allclose(found[0, :2], [float(x), float(y)], rtol=1e-15, atol=1e-15 if abs(angle) > 3.0 else 0.0)
    assert_allclose(jacobian[0, :2, 0], found[0, :2], rtol=0, atol=0)
    assert_allclose(jacobian[0, :2, 1], [float(dx), float(dy)], rtol=4e-15, atol=2e-16 if abs(angle) > 0.5 else 0.0)


@given(poses)
def test_a_control_makes_the_displacement_it_was_made_for(relative: Array) -> None:
    for model in PLANAR:
        made = model.displacement(model.control(relative, DT), DT)
        rest = model.remainder(relative, DT)
        assert_allclose(se2.between(relative, se2.compose(made, rest)), 0.0, rtol=0, atol=1e-13 + 2 * SHORTEST_WAY)
        if model is not WHEELS:
            assert not rest.any()


@given(poses)
def test_a_way_longer_than_a_nanometre_is_made_exactly(relative: Array) -> None:
    relative = relative[np.hypot(relative[:, 0], relative[:, 1]) > 1.01 * SHORTEST_WAY]
    for model in (VELOCITY, ODOMETRY):
        made = model.displacement(model.control(relative, DT), DT)
        assert_allclose(se2.local(relative, made), 0.0, rtol=0, atol=2e-14)


def test_displacements_of_controls_give_the_controls_back() -> None:
    rng = np.random.default_rng(0)
    arcs = rng.uniform([-3.0, -3.0, -1.0], [3.0, 3.0, 1.0], (200, 3))
    assert_allclose(VELOCITY.control(VELOCITY.displacement(arcs, 1.0), 1.0), arcs, rtol=0, atol=1e-13)
    turns = rng.uniform([-1.5, -3.0, -1.5], [1.5, 3.0, 1.5], (200, 3))
    assert_allclose(ODOMETRY.control(ODOMETRY.displacement(turns, 1.0), 1.0), turns, rtol=0, atol=1e-13)
    wheels = rng.uniform(-0.4, 0.4, (200, 2))
    assert_allclose(WHEELS.control(WHEELS.displacement(wheels, 1.0), 1.0), wheels, rtol=0, atol=1e-13)
    assert_allclose(WHEELS.remainder(WHEELS.displacement(wheels, 1.0), 1.0), 0.0, rtol=0, atol=1e-15)


def test_wheels_do_not_move_sideways() -> None:
    sideways = np.array([[0.0, 2.0, 0.0], [1.0, 2.0, 0.0]])
    assert_array_equal(WHEELS.control(sideways, 1.0), [[0.0, 0.0], [1.0, 1.0]])
    assert_array_equal(WHEELS.remainder(sideways, 1.0), [[0.0, 2.0, 0.0], [0.0, 2.0, 0.0]])


@each_planar
def test_half_turns(model: MotionModel) -> None:
    """Turns just below, at and just above 180 degrees, on the spot and on the way, forwards and backwards."""
    turns = np.array([np.nextafter(np.pi, 0.0), -np.pi, np.nextafter(-np.pi, 0.0), np.pi - 1e-9, 1e-9 - np.pi])
    for x, y in ((0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (-1.0, -1e-12)):
        relative = so2.pack(np.full(5, x), np.full(5, y), turns)
        control = model.control(relative, DT)
        made = se2.compose(model.displacement(control, DT), model.remainder(relative, DT))
        assert (np.abs(made[:, 2]) <= np.pi).all()
        assert_allclose(se2.between(relative, made), 0.0, rtol=0, atol=1e-14)


@each_model
def test_no_motion(model: MotionModel) -> None:
    still = np.tile(model.kind.identity, (2, 1))
    control = model.control(still, DT)
    assert_array_equal(model.displacement(control, DT), still)
    assert np.isfinite(model.jacobian(control, DT)).all()
    if not isinstance(model, BodyMotion):
        assert not control.any()
        assert not model.covariance(control, DT).any()


def test_a_turn_on_the_spot_is_one_turn() -> None:
    """Not a turn by the rounding errors of the position, and back again."""
    spot = np.array([[1e-16, -3e-16, 0.7], [-0.0, 0.0, -3.0]])
    assert_allclose(VELOCITY.control(spot, 0.5), [[0.0, 1.4, 0.0], [0.0, -6.0, 0.0]], rtol=1e-15)
    assert_array_equal(ODOMETRY.control(spot, 0.5), [[0.0, 0.0, 0.7], [0.0, 0.0, -3.0]])


def test_what_lies_behind_is_reached_in_reverse() -> None:
    assert_allclose(VELOCITY.control(np.array([[-2.0, 0.0, 0.0]]), 1.0), [[-2.0, 0.0, 0.0]], rtol=0, atol=0)
    assert_allclose(ODOMETRY.control(np.array([[-2.0, 0.0, 0.5]]), 1.0), [[0.0, -2.0, 0.5]], rtol=0, atol=0)


# -- Jacobians -------------------------------------------------------------------------------------------------------


def local(kind: models.VariableKind, x: Array, y: Array) -> Array:
    return se2.local(x, y) if kind is models.SE2 else se3.local(x, y)


@each_model
def test_jacobian_by_the_control(model: MotionModel) -> None:
    control = controls(model)
    at = model.displacement(control, DT)
    jacobian = model.jacobian(control, DT)
    assert jacobian.shape == (len(control), model.kind.dimension, len(model.components))
    for k in range(len(model.components)):
        noise = np.zeros((len(control), len(model.components)))
        noise[:, k] = STEP
        ends = [local(model.kind, at, model.displacement(model.perturb(control, s * noise), DT)) for s in (1, -1)]
        assert_allclose(jacobian[:, :, k], (ends[0] - ends[1]) / (2.0 * STEP), rtol=0, atol=1e-8)


@each_model
def test_propagation(model: MotionModel) -> None:
    """The pose after the step, and its Jacobians by the pose before it and by the control."""
    kind, control = model.kind, controls(model)
    rng = np.random.default_rng(2)
    pose = kind.normalize(rng.normal(scale=2.0, size=(len(control), kind.size)))
    after, by_pose, by_control = model.propagate(pose, control, DT)
    assert_allclose(after, kind.compose(pose, model.displacement(control, DT)), rtol=0, atol=1e-15)
    for k in range(kind.dimension):
        delta = np.zeros((len(pose), kind.dimension))
        delta[:, k] = STEP
        ends = [local(kind, after, model.propagate(kind.retract(pose, s * delta), control, DT)[0]) for s in (1, -1)]
        assert_allclose(by_pose[:, :, k], (ends[0] - ends[1]) / (2.0 * STEP), rtol=0, atol=2e-8)
    assert_array_equal(by_control, model.jacobian(control, DT))


# -- noise -----------------------------------------------------------------------------------------------------------


def test_variances_by_hand() -> None:
    one = np.array([[2.0, 3.0, 5.0]])
    velocity = VelocityMotion(0.1, 0.2, 0.3, 0.4, 0.5, 0.6).variances(one, 7.0)
    assert_allclose(velocity, [[0.1 * 4 + 0.2 * 9, 0.3 * 4 + 0.4 * 9, 0.5 * 4 + 0.6 * 9]])
    odometry = OdometryMotion(0.1, 0.2, 0.3, 0.4).variances(one, 7.0)
    assert_allclose(odometry, [[0.1 * 4 + 0.2 * 9, 0.3 * 9 + 0.4 * (4 + 25), 0.1 * 25 + 0.2 * 9]])
    assert_allclose(DifferentialDrive(1.0, 0.1).variances(np.array([[4.0, -9.0]]), 7.0), [[0.04, 0.09]])
    assert_allclose(BODY.variances(one, 7.0), [[4e-4, 1e-4, 9e-4]])


@each_model
def test_covariance_is_that_of_the_jacobian(model: MotionModel) -> None:
    control = controls(model)
    jacobian, variances = model.jacobian(control, DT), model.variances(control, DT)
    expected = jacobian @ (variances[:, :, None] * jacobian.transpose(0, 2, 1))
    assert_allclose(model.covariance(control, DT), expected, rtol=0, atol=1e-13)


def test_the_noise_of_wheels_adds_up_along_the_way() -> None:
    """Two half ways straight ahead have the covariance of the whole one, up to how errors spread."""
    whole, half = np.array([[0.2, 0.2]]), np.array([[0.1, 0.1]])
    start = WHEELS.covariance(half, 1.0)
    _, by_pose, by_control = WHEELS.propagate(np.zeros((1, 3)), half, 1.0)
    noise = WHEELS.variances(half, 1.0)[:, :, None] * by_control.transpose(0, 2, 1)
    twice = by_pose @ start @ by_pose.transpose(0, 2, 1) + by_control @ noise
    once = WHEELS.covariance(whole, 1.0)
    assert_allclose(twice[0, 0, 0], once[0, 0, 0], rtol=1e-14)
    assert_allclose(twice[0, 2, 2], once[0, 2, 2], rtol=1e-14)


@each_model
def test_the_covariance_is_that_of_sampled_noise(model: MotionModel) -> None:
    """Within three standard errors: sqrt((S_ij^2 + S_ii S_jj) / (n - 1)) for the sampled covariance S_ij."""
    count = 40_000
    control = np.repeat(controls(model, 1, seed=3), count, axis=0)
    small = 0.01  # of the noise, so that its second order does not count
    deviations = small * np.sqrt(model.variances(control, DT))
    noise = deviations * np.random.default_rng(4).standard_normal(deviations.shape)
    at = model.displacement(control, DT)
    samples = local(model.kind, at, model.displacement(model.perturb(control, noise), DT))
    covariance = np.square(small) * model.covariance(control[:1], DT)[0]
    variances = np.diag(covariance)
    error = np.sqrt((np.square(covariance) + np.outer(variances, variances)) / (count - 1))
    assert variances.all()
    assert (np.abs(np.cov(samples.T) - covariance) <= 3.0 * error).all()


def test_the_inverse_covariance_is_the_information_of_the_relative_pose() -> None:
    """Noise on a control gives residuals of an edge that measures the displacement with the model's covariance."""
    for model, kind in ((VELOCITY, models.RELATIVE_POSE_2D), (SPATIAL, models.RELATIVE_POSE_3D)):
        control = controls(model, 50, seed=5)
        rng = np.random.default_rng(6)
        noise = 1e-6 * rng.standard_normal((50, len(model.components)))
        measured = model.displacement(control, DT)
        before = model.kind.normalize(rng.normal(size=(50, model.kind.size)))
        after = model.kind.compose(before, model.displacement(model.perturb(control, noise), DT))
        residual = kind.residual((before, after), measured, None)
        assert_allclose(residual, np.matvec(model.jacobian(control, DT), noise), rtol=0, atol=1e-9)


# -- what is refused -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "parameters", "named"),
    [
        (VelocityMotion, {"alpha6": -1.0}, "alpha6"),
        (OdometryMotion, {"alpha2": float("nan")}, "alpha2"),
        (DifferentialDrive, {"slip": -0.1}, "slip"),
        (DifferentialDrive, {"baseline": 0.0}, "baseline"),
        (DifferentialDrive, {"baseline": float("inf")}, "baseline"),
        (BodyMotion, {"deviations": (1.0, 1.0)}, "3 numbers"),
        (BodyMotion, {"deviations": (1.0, 1.0, -1.0)}, "3 numbers"),
        (BodyMotion, {"deviations": (1.0, 1.0, 1.0), "kind": models.SE3}, "6 numbers"),
    ],
)
def test_parameters_that_mean_nothing(model: type, parameters: dict[str, object], named: str) -> None:
    with pytest.raises(UsageError, match=named):
        model(**parameters)
