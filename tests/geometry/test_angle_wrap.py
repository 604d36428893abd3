"""so2.wrap: the range, exactness, and values that must come back bit for bit."""

import warnings
from fractions import Fraction

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from numpy.testing import assert_array_equal
from numpy.typing import NDArray

from slamcli.geometry import so2

Array = NDArray[np.float64]

pytestmark = pytest.mark.filterwarnings("error")

PI = float(np.pi)
BELOW_PI = float(np.nextafter(PI, 0))
quick = settings(max_examples=200, deadline=None, derandomize=True)

SPECIAL = [0.0, -0.0, 5e-324, -5e-324, 1e-300, 1.0, -PI, -BELOW_PI, BELOW_PI, PI / 2, -PI / 2]
# Something out of the range beside them, which takes the array off the shortest path:
# nothing, one turn, edges of the range, many turns, and what has no angle.
COMPANIONS = [[], [4.0], [PI], [5 * PI], [1e6], [-1e300], [np.nan], [np.inf], [np.nan, 4.0, -60.0]]


def same_bits(x: Array, y: Array) -> bool:
    return x.tobytes() == y.tobytes()


@pytest.mark.parametrize("companions", COMPANIONS, ids=str)
def test_values_in_range_are_unchanged_whatever_is_beside_them(companions: list[float]) -> None:
    angles = np.array(SPECIAL + companions)
    assert same_bits(so2.wrap(angles)[: len(SPECIAL)], np.array(SPECIAL))


@quick
@given(
    st.lists(st.floats(-PI, PI, exclude_max=True), min_size=1),
    st.lists(st.floats(-1e9, 1e9), max_size=2),
)
def test_values_in_range_are_unchanged(inside: list[float], beside: list[float]) -> None:
    wrapped = so2.wrap(np.array(inside + beside))
    assert same_bits(wrapped[: len(inside)], np.array(inside))


@quick
@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1))
def test_result_is_in_range_and_whole_turns_away(angles: list[float]) -> None:
    wrapped = so2.wrap(np.array(angles))
    assert np.all((wrapped >= -PI) & (wrapped < PI))
    for angle, result in zip(angles, wrapped.tolist(), strict=True):
        turns = (Fraction(angle) - Fraction(result)) / Fraction(so2.TAU)
        assert turns.denominator == 1  # exactly: nothing was rounded


@pytest.mark.parametrize("k", range(-20, 21))
def test_neighbours_of_the_multiples_of_pi(k: int) -> None:
    multiple = k * PI
    angles = np.array([np.nextafter(multiple, -np.inf), multiple, np.nextafter(multiple, np.inf)])
    for group_of_angles in (angles, angles[:1], angles[1:2], angles[2:]):
        wrapped = so2.wrap(group_of_angles)
        assert np.all((wrapped >= -PI) & (wrapped < PI))
        turns = (group_of_angles - wrapped) / so2.TAU
        assert_array_equal(turns, np.rint(turns))


def test_plus_pi_becomes_minus_pi() -> None:
    assert_array_equal(so2.wrap(np.array([PI, -PI, 3 * PI])), [-PI, -PI, -PI])


def test_angles_that_are_none() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        wrapped = so2.wrap(np.array([np.inf, 4.0, -np.inf, np.nan]))
    assert_array_equal(np.isnan(wrapped), [True, False, True, True])
    assert wrapped[1] == 4.0 - so2.TAU


@pytest.mark.parametrize("shape", [(), (0,), (3, 0), (1,), (2, 3, 1)])
@pytest.mark.parametrize("value", [1.0, 4.0, 100.0])
def test_shape_is_kept_and_the_array_is_new(shape: tuple[int, ...], value: float) -> None:
    angles = np.full(shape, value)
    wrapped = so2.wrap(angles)
    assert wrapped.shape == shape
    assert wrapped.dtype == np.float64
    assert not np.shares_memory(wrapped, angles)
    assert np.all(angles == value)


def test_strided_input() -> None:
    poses = np.linspace(-9.0, 9.0, 30).reshape(10, 3)
    assert_array_equal(so2.wrap(poses[:, 2]), so2.wrap(poses[:, 2].copy()))
