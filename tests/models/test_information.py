"""Upper triangles, and the test for information matrices with a clearly negative eigenvalue."""

import hypothesis.extra.numpy as nps
import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import assume, given
from numpy.testing import assert_array_equal

from slamcli.models.base import Array
from slamcli.models.information import (
    RELATIVE_PIVOT_TOLERANCE,
    eigenvalue_range,
    from_upper_triangle,
    indefinite,
    to_upper_triangle,
)

dimensions = st.sampled_from([1, 2, 3, 6])


def symmetric(eigenvalues: Array, seed: int) -> Array:
    """A matrix with these eigenvalues and any eigenvectors, as a stack of one."""
    basis, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(len(eigenvalues), len(eigenvalues))))
    matrix = basis @ np.diag(eigenvalues) @ basis.T
    return (0.5 * (matrix + matrix.T))[None]


@given(dimensions.flatmap(lambda d: nps.arrays(np.float64, (3, d * (d + 1) // 2), elements=st.floats(-9, 9))))
def test_triangles_there_and_back(numbers: Array) -> None:
    dimension = {1: 1, 3: 2, 6: 3, 21: 6}[numbers.shape[1]]
    matrices = from_upper_triangle(numbers, dimension)
    assert_array_equal(to_upper_triangle(matrices), numbers)
    assert_array_equal(matrices, matrices.transpose(0, 2, 1))
    assert_array_equal(matrices[:, 0, :], numbers[:, :dimension])  # the first row comes first


@given(dimensions.flatmap(lambda d: nps.arrays(np.float64, d, elements=st.floats(1e-3, 1e3))), st.integers(0, 999))
def test_positive_definite_matrices(eigenvalues: Array, seed: int) -> None:
    assert not indefinite(symmetric(eigenvalues, seed)).any()


@given(
    st.sampled_from([2, 3, 6]).flatmap(lambda d: nps.arrays(np.float64, d, elements=st.floats(0.01, 1e3))),
    st.integers(0, 999),
    st.data(),
)
def test_semidefinite_matrices_are_harmless(eigenvalues: Array, seed: int, data: st.DataObject) -> None:
    rank = data.draw(st.integers(0, len(eigenvalues) - 1))
    eigenvalues[rank:] = 0.0
    assert not indefinite(symmetric(eigenvalues, seed)).any()


@given(dimensions.flatmap(lambda d: nps.arrays(np.float64, d, elements=st.floats(-1e3, 1e3))), st.integers(0, 999))
def test_indefinite_matrices(eigenvalues: Array, seed: int) -> None:
    """The verdict is that of the eigenvalues, wherever those are clear."""
    low, high = eigenvalues.min(), np.abs(eigenvalues).max()
    assume(high > 1e-6)
    assume(abs(low) > 3.0 * RELATIVE_PIVOT_TOLERANCE * high)
    assert indefinite(symmetric(eigenvalues, seed)).tolist() == [low < 0.0]


@given(nps.arrays(np.float64, (5, 21), elements=st.floats(-9, 9).map(lambda x: round(x, 1))))
def test_stacks_of_any_symmetric_matrices_agree_with_eigvalsh(numbers: Array) -> None:
    """Among them matrices with zeros on the diagonal, where an elimination without pivoting divides by zero."""
    matrices = from_upper_triangle(numbers, 6)
    eigenvalues = np.linalg.eigvalsh(matrices)
    clear = np.abs(eigenvalues[:, 0]) > 1e-3 * np.abs(eigenvalues).max(axis=1)
    assert_array_equal(indefinite(matrices)[clear], eigenvalues[clear, 0] < 0.0)


@pytest.mark.parametrize(
    ("matrix", "verdict"),
    [
        ([[0.0, 0.0], [0.0, 0.0]], False),
        ([[0.0, 1.0], [1.0, 0.0]], True),
        ([[-1.0, 0.0], [0.0, -1.0]], True),
        ([[1.0, 1.0], [1.0, 1.0]], False),
        ([[1.0, 1.0], [1.0, 0.999999]], False),  # singular, written with six digits
        ([[1.0, 2.0], [2.0, 1.0]], True),
        ([[1e-12, 0.0], [0.0, 1e12]], False),
    ],
)
def test_matrices_by_hand(matrix: list[list[float]], verdict: bool) -> None:
    assert indefinite(np.array([matrix])).tolist() == [verdict]


def test_every_matrix_of_a_stack_has_its_own_verdict() -> None:
    stack = np.concatenate([np.eye(3)[None], -np.eye(3)[None], np.zeros((1, 3, 3)), np.diag([1.0, -1.0, 5.0])[None]])
    assert indefinite(stack).tolist() == [False, True, False, True]
    low, high = eigenvalue_range(stack)
    assert low.tolist() == [1.0, -1.0, 0.0, -1.0]
    assert high.tolist() == [1.0, -1.0, 0.0, 5.0]
    assert indefinite(np.empty((0, 3, 3))).shape == (0,)
