"""What every group must satisfy, asked of all four modules with the same functions.

Elements are compared as matrices, which are the same for q and -q. Their translations are at
most 10, so that a tolerance is an absolute one.
"""

from types import ModuleType

import hypothesis.extra.numpy as nps
import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from slamcli.geometry import se2, se3, so2, so3

Array = NDArray[np.float64]

pytestmark = pytest.mark.filterwarnings("error")

GROUPS = (so2, se2, so3, se3)
POINT = {so2: 2, se2: 2, so3: 3, se3: 3}
TRANSLATION = {so2: 0, se2: 2, so3: 0, se3: 3}
BATCH = 4

all_groups = pytest.mark.parametrize("group", GROUPS, ids=lambda g: g.__name__.split(".")[-1])
quick = settings(max_examples=40, deadline=None, derandomize=True)
data = st.data()


def numbers(count: int, bound: float) -> st.SearchStrategy[Array]:
    """A batch (BATCH, count) of numbers of size up to bound, 0 and tiny ones among them."""
    return nps.arrays(np.float64, (BATCH, count), elements=st.floats(-bound, bound))


def elements(group: ModuleType) -> st.SearchStrategy[Array]:
    """Elements with positions up to 10, any rotation and both signs of a quaternion."""
    shift = TRANSLATION[group]
    if POINT[group] == 2:
        angles = nps.arrays(np.float64, (BATCH, 1), elements=st.floats(-np.pi, np.pi, exclude_max=True))
        return st.tuples(numbers(shift, 10), angles).map(np.hstack)
    return st.tuples(numbers(shift, 10), numbers(4, 1).map(unit_quaternions)).map(np.hstack)


def unit_quaternions(q: Array) -> Array:
    length = np.linalg.norm(q, axis=-1, keepdims=True)
    usable = length > 1e-3
    return np.where(usable, q, [0.0, 0.0, 0.0, 1.0]) / np.where(usable, length, 1.0)


def tangents(group: ModuleType, angle: float) -> st.SearchStrategy[Array]:
    """Tangent vectors with translations up to 10 and rotations up to an angle."""
    shift = TRANSLATION[group]
    count = group.DIM - shift
    turns = numbers(count, angle / np.sqrt(count))
    return st.tuples(numbers(shift, 10), turns).map(np.hstack)


def assert_same(group: ModuleType, x: Array, y: Array, atol: float = 1e-13) -> None:
    assert_allclose(group.to_matrix(x), group.to_matrix(y), rtol=0, atol=atol)


@all_groups
@quick
@given(data)
def test_product(group: ModuleType, data: st.DataObject) -> None:
    x, y, z = (data.draw(elements(group)) for _ in range(3))
    one = group.identity((BATCH,))
    compose, inverse = group.compose, group.inverse
    assert_same(group, compose(compose(x, y), z), compose(x, compose(y, z)))
    assert_same(group, compose(x, one), x)
    assert_same(group, compose(one, x), x)
    assert_same(group, compose(x, inverse(x)), one)
    assert_same(group, compose(inverse(x), x), one)
    assert_same(group, group.between(x, y), compose(inverse(x), y))
    assert_same(group, compose(x, group.between(x, y)), y)


@all_groups
@quick
@given(data)
def test_action_on_points(group: ModuleType, data: st.DataObject) -> None:
    x, y = data.draw(elements(group)), data.draw(elements(group))
    p = data.draw(numbers(POINT[group], 10))
    assert_allclose(group.act(group.identity((BATCH,)), p), p, rtol=0, atol=0)
    assert_allclose(group.act(group.compose(x, y), p), group.act(x, group.act(y, p)), rtol=0, atol=1e-13)
    padded = np.concatenate([p, np.ones((BATCH, 1))], axis=-1)[:, : group.to_matrix(x).shape[-1]]
    mapped = (group.to_matrix(x) @ padded[..., np.newaxis])[..., : POINT[group], 0]
    assert_allclose(group.act(x, p), mapped, rtol=0, atol=1e-13)


@all_groups
@quick
@given(data)
def test_matrices(group: ModuleType, data: st.DataObject) -> None:
    x, y = data.draw(elements(group)), data.draw(elements(group))
    matrix = group.to_matrix
    assert_allclose(matrix(group.compose(x, y)), matrix(x) @ matrix(y), rtol=0, atol=1e-13)
    rotation = matrix(x)[..., : POINT[group], : POINT[group]]
    assert_allclose(
        rotation @ rotation.swapaxes(-1, -2),
        np.broadcast_to(np.eye(POINT[group]), rotation.shape),
        atol=1e-14,
    )
    assert_allclose(np.linalg.det(rotation), 1.0, atol=1e-14)
    assert_same(group, group.from_matrix(matrix(x)), x, atol=1e-14)
    if POINT[group] == 2:
        assert_allclose(np.exp(1j * group.from_matrix(matrix(x))[:, -1]), np.exp(1j * x[:, -1]))


@all_groups
@quick
@given(data)
def test_exp_and_log_invert_each_other(group: ModuleType, data: st.DataObject) -> None:
    x = data.draw(elements(group))
    assert_same(group, group.exp(group.log(x)), x)
    xi = data.draw(tangents(group, np.pi - 1e-9))
    assert_allclose(group.log(group.exp(xi)), xi, rtol=0, atol=1e-13)


@all_groups
@quick
@given(data)
def test_exp_is_a_one_parameter_subgroup(group: ModuleType, data: st.DataObject) -> None:
    xi = data.draw(tangents(group, 4.0))
    s, t = data.draw(st.floats(-1, 1)), data.draw(st.floats(-1, 1))
    product = group.compose(group.exp(s * xi), group.exp(t * xi))
    assert_same(group, group.exp((s + t) * xi), product)
    assert_same(group, group.exp(-xi), group.inverse(group.exp(xi)))


@all_groups
@quick
@given(data)
def test_adjoint(group: ModuleType, data: st.DataObject) -> None:
    x, y = data.draw(elements(group)), data.draw(elements(group))
    xi = data.draw(tangents(group, 3.0))
    conjugated = group.compose(group.compose(x, group.exp(xi)), group.inverse(x))
    moved = (group.adjoint(x) @ xi[..., np.newaxis])[..., 0]
    assert_same(group, conjugated, group.exp(moved), atol=1e-12)
    assert_allclose(group.adjoint(group.compose(x, y)), group.adjoint(x) @ group.adjoint(y), atol=1e-12)


@all_groups
@quick
@given(data)
def test_jacobians_are_the_derivatives_of_exp(group: ModuleType, data: st.DataObject) -> None:
    xi = data.draw(tangents(group, 4.0))
    step = 1e-5
    ahead = group.exp(xi[:, np.newaxis] + step * np.eye(group.DIM))
    behind = group.exp(xi[:, np.newaxis] - step * np.eye(group.DIM))
    middle_inverse = group.inverse(group.exp(xi))[:, np.newaxis]
    left, right = (
        (group.log(forward) - group.log(backward)).swapaxes(-1, -2) / (2 * step)
        for forward, backward in (
            (group.compose(ahead, middle_inverse), group.compose(behind, middle_inverse)),
            (group.compose(middle_inverse, ahead), group.compose(middle_inverse, behind)),
        )
    )
    assert_allclose(group.left_jacobian(xi), left, rtol=0, atol=2e-8)
    assert_allclose(group.right_jacobian(xi), right, rtol=0, atol=2e-8)


@all_groups
@quick
@given(data)
def test_jacobians_are_related(group: ModuleType, data: st.DataObject) -> None:
    xi = data.draw(tangents(group, 4.0))
    one = np.broadcast_to(np.eye(group.DIM), (BATCH, group.DIM, group.DIM))
    left, right = group.left_jacobian(xi), group.right_jacobian(xi)
    assert_allclose(left @ group.left_jacobian_inverse(xi), one, rtol=0, atol=1e-12)
    assert_allclose(right @ group.right_jacobian_inverse(xi), one, rtol=0, atol=1e-12)
    assert_allclose(left, group.adjoint(group.exp(xi)) @ right, rtol=0, atol=1e-12)


@all_groups
@quick
@given(data)
def test_local_inverts_retract(group: ModuleType, data: st.DataObject) -> None:
    x, y = data.draw(elements(group)), data.draw(elements(group))
    # In space the rotation part is a sine, at most 1.
    delta = data.draw(tangents(group, np.pi - 1e-9 if POINT[group] == 2 else 0.999))
    assert_allclose(group.local(x, group.retract(x, delta)), delta, rtol=0, atol=1e-13)
    # Near half a turn, w = sqrt(1 - |d|^2) is known to the root of the precision only.
    assert_same(group, group.retract(x, group.local(x, y)), y, atol=1e-7)


@all_groups
@quick
@given(data)
def test_retract_is_exp_to_first_order(group: ModuleType, data: st.DataObject) -> None:
    x, xi = data.draw(elements(group)), data.draw(tangents(group, 1.0))
    delta = xi.copy()
    if POINT[group] == 3:
        delta[:, TRANSLATION[group] :] /= 2  # the sine of half the angle
    forward, backward = group.retract(x, 1e-5 * delta), group.retract(x, -1e-5 * delta)
    slope = (group.log(group.between(x, forward)) - group.log(group.between(x, backward))) / 2e-5
    assert_allclose(slope, xi, rtol=0, atol=1e-8)


@all_groups
@quick
@given(data)
def test_wrap_keeps_the_rotation(group: ModuleType, data: st.DataObject) -> None:
    xi = data.draw(tangents(group, 40.0))
    wrapped, shift = group.wrap(xi), TRANSLATION[group]
    assert_array_equal(wrapped[:, :shift], xi[:, :shift])
    assert np.all(np.linalg.norm(wrapped[:, shift:], axis=-1) <= np.pi * (1 + 1e-15))
    rotation = so2 if POINT[group] == 2 else so3
    assert_same(rotation, rotation.exp(wrapped[:, shift:]), rotation.exp(xi[:, shift:]))
    assert_array_equal(group.wrap(wrapped / 1.5), wrapped / 1.5)


@all_groups
@quick
@given(data)
def test_normalize(group: ModuleType, data: st.DataObject) -> None:
    x = data.draw(elements(group))
    assert_allclose(group.normalize(x), x, rtol=0, atol=1e-15)
    off = x.copy()
    if POINT[group] == 2:
        off[:, -1] += 6 * np.pi
        angle = group.normalize(off)[:, -1]
        assert np.all((angle >= -np.pi) & (angle < np.pi))
        assert_same(group, group.normalize(off), x, atol=1e-14)
    else:
        off[:, -4:] *= -0.3
        assert_allclose(group.normalize(off)[:, -4:], -x[:, -4:], rtol=0, atol=1e-15)
    assert_array_equal(group.normalize(off)[:, : TRANSLATION[group]], x[:, : TRANSLATION[group]])


def sample(group: ModuleType, *batch: int) -> tuple[Array, Array, Array]:
    """Elements, tangent vectors and points that refuse to be written to."""
    random = np.random.default_rng(group.SIZE)
    x = group.normalize(random.normal(size=(*batch, group.SIZE)))
    xi, p = (random.normal(size=(*batch, k)) / 2 for k in (group.DIM, POINT[group]))
    for array in (x, xi, p):
        array.flags.writeable = False
    return x, xi, p


@all_groups
@pytest.mark.parametrize("name", ["compose", "between", "local", "retract", "act"])
def test_binary_functions_broadcast(group: ModuleType, name: str) -> None:
    x = sample(group, 3, 1)[0]
    second = {"retract": 1, "act": 2}.get(name, 0)
    y = sample(group, 5)[second]
    function = getattr(group, name)
    expected = np.array([[function(x[i, 0], y[j]) for j in range(5)] for i in range(3)])
    assert expected.ndim == 3
    assert_allclose(function(x, y), expected, rtol=0, atol=1e-14)
    assert function(x[:0], y).shape == (0, 5, expected.shape[-1])


@all_groups
@pytest.mark.parametrize(
    ("name", "of_tangent", "tail"),
    [
        ("normalize", False, "S"),
        ("inverse", False, "S"),
        ("log", False, "D"),
        ("adjoint", False, "DD"),
        ("exp", True, "S"),
        ("wrap", True, "D"),
        ("left_jacobian", True, "DD"),
        ("right_jacobian", True, "DD"),
        ("left_jacobian_inverse", True, "DD"),
        ("right_jacobian_inverse", True, "DD"),
    ],
)
def test_unary_functions_take_batches(group: ModuleType, name: str, of_tangent: bool, tail: str) -> None:
    argument = sample(group, 3, 2)[int(of_tangent)]
    function = getattr(group, name)
    expected = np.array([[function(argument[i, j]) for j in range(2)] for i in range(3)])
    result = function(argument)
    assert result.shape == (3, 2, *({"S": group.SIZE, "D": group.DIM}[k] for k in tail))
    assert result.dtype == np.float64
    assert_allclose(result, expected, rtol=0, atol=1e-14)
    assert not np.shares_memory(result, argument)
    assert function(argument[:0]).shape == (0, *result.shape[1:])


@all_groups
def test_matrix_functions_take_batches(group: ModuleType) -> None:
    x = sample(group, 3, 2)[0]
    matrices = group.to_matrix(x)
    assert_allclose(matrices[1, 1], group.to_matrix(x[1, 1]), rtol=0, atol=1e-14)
    one = group.from_matrix(matrices[2, 0])
    assert_allclose(group.from_matrix(matrices)[2, 0], one, rtol=0, atol=1e-14)
    assert group.from_matrix(matrices[:0]).shape == (0, 2, group.SIZE)


@all_groups
def test_identity(group: ModuleType) -> None:
    assert group.identity().shape == (group.SIZE,)
    assert group.identity((2, 3)).shape == (2, 3, group.SIZE)
    one = group.to_matrix(group.identity((2, 3)))
    assert_array_equal(one, np.broadcast_to(np.eye(one.shape[-1]), one.shape))
    assert_array_equal(group.exp(np.zeros(group.DIM)), group.identity())
    assert_array_equal(group.log(group.identity()), np.zeros(group.DIM))


@all_groups
def test_nan_stays_in_its_row(group: ModuleType) -> None:
    x, xi, _ = sample(group, 3)
    x, xi = x.copy(), 3 * xi
    clean = group.compose(group.retract(x, xi), group.exp(group.wrap(xi)))
    xi[1] = np.nan
    mixed = group.compose(group.retract(x, xi), group.exp(group.wrap(xi)))
    assert np.all(np.isnan(mixed[1]))
    assert_allclose(mixed[[0, 2]], clean[[0, 2]], rtol=0, atol=1e-14)
