"""SO(3): sign and norm of a quaternion, half turns, matrices, Euler angles, g2o's steps."""

import warnings

import hypothesis.extra.numpy as nps
import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from slamcli.geometry import se3, so3

Array = NDArray[np.float64]

pytestmark = pytest.mark.filterwarnings("error")

PI = float(np.pi)
quick = settings(max_examples=100, deadline=None, derandomize=True)
AXES = np.array(
    [
        [1, 0, 0],
        [0, 1, 0],
        [0, 0, 1],
        [-1, 0, 0],
        [0.6, 0.8, 0],
        [0, -0.6, 0.8],
        [2 / 3, 2 / 3, -1 / 3],
    ]
)

unit_quaternions = (
    nps.arrays(np.float64, 4, elements=st.floats(-1, 1))
    .filter(lambda q: np.linalg.norm(q) > 1e-3)
    .map(lambda q: q / np.linalg.norm(q))
)


def about(axis: Array, half_angle_sine: float, half_angle_cosine: float) -> Array:
    return np.append(axis * half_angle_sine, half_angle_cosine)


def test_hamilton_order_and_sense() -> None:
    i, j, k = np.eye(4)[:3]
    assert_array_equal(so3.compose(i, j), k)
    assert_array_equal(so3.compose(j, i), -k)
    quarter = so3.exp(np.array([0.0, 0.0, PI / 2]))
    assert_allclose(quarter, [0, 0, np.sqrt(0.5), np.sqrt(0.5)])
    assert_allclose(so3.act(quarter, np.array([1.0, 0.0, 0.0])), [0, 1, 0], atol=1e-15)
    assert_allclose(so3.to_matrix(quarter), [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)


def test_skew_is_the_cross_product() -> None:
    random = np.random.default_rng(1)
    u, v = random.normal(size=(2, 5, 3))
    assert_allclose((so3.skew(u) @ v[..., np.newaxis])[..., 0], np.cross(u, v), atol=1e-15)


@quick
@given(unit_quaternions, unit_quaternions)
def test_both_signs_are_the_same_rotation(x: Array, y: Array) -> None:
    p = np.array([1.0, -2.0, 3.0])
    assert_array_equal(so3.to_matrix(-x), so3.to_matrix(x))
    assert_allclose(so3.act(-x, p), so3.act(x, p), rtol=0, atol=1e-15)
    for function in (so3.log, so3.to_euler, lambda q: so3.local(y, q), lambda q: so3.local(q, y)):
        both = np.array([function(x), function(-x)])
        # At half a turn either end of the axis is right.
        if min(abs(x[3]), abs(so3.between(x, y)[3])) > 1e-9:
            turn = (both[1] - both[0]) / (2 * PI)
            assert_allclose(turn, 0, atol=1e-12)


@quick
@given(unit_quaternions, unit_quaternions)
def test_log_and_local_take_the_short_way(x: Array, y: Array) -> None:
    assert np.linalg.norm(so3.log(x)) <= PI * (1 + 1e-15)
    w = np.abs(so3.between(x, y)[3])
    assert_allclose(np.sum(so3.local(x, y) ** 2), 1 - w * w, atol=1e-15)
    if w > 1e-9:  # at half a turn either end of the axis is right
        assert_allclose(so3.local(x, so3.retract(x, so3.local(x, y))), so3.local(x, y), atol=1e-14)


@pytest.mark.parametrize("axis", AXES, ids=str)
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("gap", [1e-3, 1e-6, 1e-9, 1e-12, -1e-3, -1e-9])
def test_log_near_half_a_turn(axis: Array, sign: float, gap: float) -> None:
    # Half the angle is pi/2 - gap/2; a negative gap is a turn past pi, back the other way.
    q = sign * about(axis, np.cos(gap / 2), np.sin(gap / 2))
    expected = axis * (PI - abs(gap)) * np.sign(gap)
    assert_allclose(so3.log(q), expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize("axis", AXES, ids=str)
def test_log_of_half_a_turn(axis: Array) -> None:
    for q in (about(axis, 1.0, 0.0), about(axis, 1.0, -0.0)):
        assert_allclose(so3.log(q), PI * axis, rtol=1e-15, atol=0)
        pose = np.concatenate([[1.0, 2.0, 3.0], q])
        assert_allclose(se3.to_matrix(se3.exp(se3.log(pose))), se3.to_matrix(pose), atol=2e-15)


def test_log_needs_no_unit_norm() -> None:
    q = so3.exp(np.array([0.3, -0.2, 0.5]))
    assert_allclose(so3.log(1e-3 * q), [0.3, -0.2, 0.5], rtol=1e-15)
    assert_array_equal(so3.log(np.array([0.0, 0.0, 0.0, -2.0])), np.zeros(3))
    assert np.all(np.isnan(so3.log(np.zeros(4))))


def test_normalize() -> None:
    q = np.array([[0.0, 0.0, 0.0, -3.0], [0.0] * 4, [3.0, 0.0, -4.0, 0.0], [np.nan, 0.0, 0.0, 1.0]])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = so3.normalize(q)
        pose = se3.normalize(np.hstack([np.ones((4, 3)), q]))
    assert_array_equal(result[[0, 2]], [[0, 0, 0, -1], [0.6, 0, -0.8, 0]])
    assert np.all(np.isnan(result[[1, 3]]))
    assert_array_equal(pose, np.hstack([np.ones((4, 3)), result]))


@quick
@given(unit_quaternions)
def test_from_matrix(q: Array) -> None:
    back = so3.from_matrix(so3.to_matrix(q))
    assert back[3] >= 0
    assert_allclose(np.linalg.norm(back), 1.0, rtol=0, atol=4e-16)
    expected = -q if back @ q < 0 else q
    assert_allclose(back, expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize("axis", AXES, ids=str)
@pytest.mark.parametrize("w", [0.0, 1e-12, 1e-8, 1e-4, 0.5, 1 - 1e-12, 1.0])
def test_from_matrix_keeps_small_components(axis: Array, w: float) -> None:
    q = about(axis, np.sqrt(1 - w * w), w)
    back = so3.from_matrix(so3.to_matrix(q))
    expected = -q if back @ q < 0 else q
    assert_allclose(back, expected, rtol=0, atol=4e-16)


def test_from_matrix_that_is_nearly_a_rotation() -> None:
    random = np.random.default_rng(2)
    q = so3.normalize(random.normal(size=(100, 4)))
    back = so3.from_matrix(so3.to_matrix(q) + 1e-7 * random.normal(size=(100, 3, 3)))
    assert_allclose(np.linalg.norm(back, axis=-1), 1.0, rtol=0, atol=1e-15)
    assert_allclose(so3.to_matrix(back), so3.to_matrix(q), rtol=0, atol=1e-6)


@quick
@given(nps.arrays(np.float64, 3, elements=st.floats(-PI, PI)))
def test_euler_angles_are_yaw_pitch_roll_rotations(rpy: Array) -> None:
    roll, pitch, yaw = (so3.to_matrix(so3.exp(v)) for v in np.diag(rpy))
    assert_allclose(so3.to_matrix(so3.from_euler(rpy)), yaw @ pitch @ roll, rtol=0, atol=2e-15)


@quick
@given(unit_quaternions)
def test_euler_angles_give_the_rotation_back(q: Array) -> None:
    rpy = so3.to_euler(q)
    assert_allclose(so3.to_matrix(so3.from_euler(rpy)), so3.to_matrix(q), rtol=0, atol=3e-15)
    assert abs(rpy[1]) <= PI / 2 + 4e-16
    assert np.all((rpy[[0, 2]] >= -PI) & (rpy[[0, 2]] < PI))


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("gap", [1.5, 0.3, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-14, 0.0])
@pytest.mark.parametrize(("roll", "yaw"), [(0.0, 0.0), (0.4, -1.1), (-3.0, 2.9), (3.1, 3.1)])
def test_euler_angles_near_the_poles(side: float, gap: float, roll: float, yaw: float) -> None:
    rpy = np.array([roll, side * (PI / 2 - gap), yaw])
    back = so3.to_euler(so3.from_euler(rpy))
    assert_allclose(back[1], rpy[1], rtol=0, atol=1e-15)
    # This close to the pole roll and yaw are one angle, and the other is lost.
    combined = (back[2] - rpy[2]) - side * (back[0] - rpy[0])
    assert_allclose(np.exp(1j * combined), 1.0, rtol=0, atol=2e-15)
    if gap >= 1e-6:
        assert_allclose(back, rpy, rtol=0, atol=2e-15 / gap)


@quick
@given(unit_quaternions, nps.arrays(np.float64, 3, elements=st.floats(-0.57, 0.57)))
def test_retract_appends_the_vector_part(q: Array, delta: Array) -> None:
    step = np.append(delta, np.sqrt(1 - delta @ delta))
    assert_allclose(so3.retract(q, delta), so3.compose(q, step), rtol=0, atol=4e-16)
    assert_allclose(np.linalg.norm(so3.retract(1.7 * q, delta)), 1.0, rtol=0, atol=4e-16)


@pytest.mark.parametrize("axis", AXES, ids=str)
@pytest.mark.parametrize("length", [1.0, 1.0 + 1e-15, 1.5, 1e6])
def test_retract_by_one_or_more_is_half_a_turn(axis: Array, length: float) -> None:
    q = so3.exp(np.array([0.3, -0.2, 0.5]))
    expected = so3.compose(q, np.append(axis, 0.0))
    assert_allclose(so3.retract(q, length * axis), expected, rtol=0, atol=3e-8)


def test_wrap_leaves_short_vectors_bit_for_bit() -> None:
    random = np.random.default_rng(3)
    short = random.uniform(-1.8, 1.8, size=(50, 3))
    mixed = so3.wrap(np.vstack([short, [[7.0, 0.0, 0.0], [np.nan, 0.0, 0.0], [0.0, -4.0, 0.0]]]))
    assert mixed[:50].tobytes() == short.tobytes() == so3.wrap(short).tobytes()
    assert_allclose(mixed[50], [7.0 - 2 * PI, 0, 0], rtol=1e-15)
    assert_allclose(mixed[52], [0, 2 * PI - 4.0, 0], rtol=1e-15)
