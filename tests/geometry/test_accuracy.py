"""Digits: against series in extended precision, from angles of 1e-12 to beyond pi.

The references know nothing of the closed forms: exp and its Jacobians are summed as power
series of the matrices of the Lie algebra, in numpy's longdouble (80 bits where there is one),
and the scalar coefficients as series of rational numbers.
"""

from fractions import Fraction
from types import ModuleType

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from slamcli.geometry import se2, se3, so2, so3

Array = NDArray[np.float64]
Long = NDArray[np.longdouble]

pytestmark = pytest.mark.filterwarnings("error")

PI = float(np.pi)
ANGLES = [
    *(0.0, 1e-200, 1e-12, 1e-10, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 0.5),
    *(np.nextafter(1.0, 0), 1.0, np.nextafter(1.0, 2), 1.5, 2.0, 3.0),
    *(PI - 1e-6, PI - 1e-9, np.nextafter(PI, 0), PI, np.nextafter(PI, 4), PI + 1e-9, 4.0),
]
# Where each coordinate of a tangent vector goes in the matrix of the Lie algebra, and whether
# its negative stands at the transposed place.
HAT = {
    so2: [(1, 0, True)],
    se2: [(0, 2, False), (1, 2, False), (1, 0, True)],
    so3: [(2, 1, True), (0, 2, True), (1, 0, True)],
    se3: [
        *((0, 3, False), (1, 3, False), (2, 3, False)),
        *((2, 1, True), (0, 2, True), (1, 0, True)),
    ],
}
TRANSLATION = {so2: 0, se2: 2, so3: 0, se3: 3}
MATRIX = {so2: 2, se2: 3, so3: 3, se3: 4}

all_groups = pytest.mark.parametrize("group", HAT, ids=lambda g: g.__name__.split(".")[-1])
each_angle = pytest.mark.parametrize("angle", ANGLES, ids=lambda a: f"{a:.17g}")


def hat(group: ModuleType, xi: Long) -> Long:
    matrix = np.zeros((MATRIX[group], MATRIX[group]), np.longdouble)
    for value, (row, column, skew) in zip(xi, HAT[group], strict=True):
        matrix[row, column] += value
        if skew:
            matrix[column, row] -= value
    return matrix


def bracket(group: ModuleType, xi: Long) -> Long:
    """The matrix ad of xi: its columns are the commutators with the basis."""
    basis = np.eye(group.DIM, dtype=np.longdouble)
    products = [hat(group, xi) @ hat(group, e) - hat(group, e) @ hat(group, xi) for e in basis]
    return np.array([[p[row, column] for p in products] for row, column, _ in HAT[group]])


def power_series(matrix: Long, first_factorial: int) -> Long:
    """Sum matrix^n / (n + first_factorial)!."""
    term = np.eye(len(matrix), dtype=np.longdouble)
    total = term.copy()
    for n in range(1, 60):
        term = matrix @ term / (n + first_factorial)
        total = total + term
    return total


def tangents(group: ModuleType, angle: float) -> Array:
    """Five tangent vectors with this angle and translations of size 1."""
    random = np.random.default_rng(7)
    shift = TRANSLATION[group]
    parts = []
    for count, length in ((shift, 1.0), (group.DIM - shift, angle)):
        direction = random.normal(size=(5, count))
        norm = np.linalg.norm(direction, axis=-1, keepdims=True)
        parts.append(direction / np.where(norm > 0, norm, 1.0) * length)
    return np.hstack(parts)


@all_groups
@each_angle
def test_exp(group: ModuleType, angle: float) -> None:
    for xi in tangents(group, angle):
        expected = power_series(hat(group, xi.astype(np.longdouble)), 0)
        matrix = group.to_matrix(group.exp(xi))
        assert_allclose(matrix, expected, rtol=0, atol=2e-15)
        # To first order in the angle the rotation is skew: relative digits of a small one.
        size = MATRIX[group] - (TRANSLATION[group] > 0)
        skew, expected_skew = (m[:size, :size] - m[:size, :size].T for m in (matrix, expected))
        assert_allclose(skew, expected_skew, rtol=0, atol=4e-15 * angle)


@all_groups
@each_angle
def test_log_gives_back_the_shortest_tangent_vector(group: ModuleType, angle: float) -> None:
    xi = tangents(group, angle)
    # The turn on the far side of pi is the shorter one the other way round.
    if angle < np.nextafter(PI, 0):
        back = group.log(group.exp(xi))
        assert_allclose(back, xi, rtol=0, atol=1e-14)
        rotation = slice(TRANSLATION[group], None)
        assert_allclose(back[:, rotation], xi[:, rotation], rtol=4e-15, atol=0)
    else:
        back = group.log(group.exp(xi))[:, TRANSLATION[group] :]
        assert_allclose(np.linalg.norm(back, axis=-1), min(angle, 2 * PI - angle), rtol=0, atol=2e-15)
        again = group.exp(group.log(group.exp(xi)))
        assert_allclose(group.to_matrix(again), group.to_matrix(group.exp(xi)), atol=1e-14)


@all_groups
@each_angle
def test_jacobians(group: ModuleType, angle: float) -> None:
    for xi in tangents(group, angle):
        matrix = bracket(group, xi.astype(np.longdouble))
        left, right = power_series(matrix, 1), power_series(-matrix, 1)
        assert_allclose(group.left_jacobian(xi), left, rtol=0, atol=2e-15)
        assert_allclose(group.right_jacobian(xi), right, rtol=0, atol=2e-15)
        inverse = group.left_jacobian_inverse(xi).astype(np.longdouble)
        one = np.eye(group.DIM)
        assert_allclose(inverse @ left, one, rtol=0, atol=1e-14)
        inverse = group.right_jacobian_inverse(xi).astype(np.longdouble)
        assert_allclose(inverse @ right, one, rtol=0, atol=1e-14)


def sine_and_cosine(angle: Fraction) -> tuple[Fraction, Fraction]:
    terms = [Fraction(1)]
    for n in range(1, 60):
        terms.append(terms[-1] * angle / n)
    sine = sum(t * (-1) ** k for k, t in enumerate(terms[1::2]))
    cosine = sum(t * (-1) ** k for k, t in enumerate(terms[0::2]))
    return Fraction(sine), Fraction(cosine)


@pytest.mark.parametrize("angle", [1e-12, 1e-9, 1e-6, 1e-4, 1e-3, *ANGLES[10:]])
def test_coefficients_have_all_digits(angle: float) -> None:
    a = Fraction(angle)
    sine, cosine = sine_and_cosine(a)
    half_sine, half_cosine = sine_and_cosine(a / 2)
    half_cot = a / 2 * half_cosine / half_sine
    exact = {
        so2.sinc: sine / a,
        so2.one_minus_cos_ratio: (1 - cosine) / a**2,
        so2.angle_minus_sin_ratio: (a - sine) / a**3,
        so2.half_cot: half_cot,
        so2.one_minus_half_cot_ratio: (1 - half_cot) / a**2,
    }
    for function, value in exact.items():
        for signed in (angle, -angle):
            result = float(function(np.array(signed)))
            error = abs(Fraction(result) / value - 1)
            # sin has a zero near pi, cot one too, where a digit of the angle is worth many.
            near_zero = function in (so2.sinc, so2.half_cot) and abs(angle - PI) < 0.1
            assert error < 5e-15 or (near_zero and abs(Fraction(result) - value) < 2e-16)


def test_coefficients_at_zero() -> None:
    zero = np.zeros(2)
    for function, value in {
        so2.sinc: 1.0,
        so2.one_minus_cos_ratio: 1 / 2,
        so2.angle_minus_sin_ratio: 1 / 6,
        so2.half_cot: 1.0,
        so2.one_minus_half_cot_ratio: 1 / 12,
    }.items():
        assert list(function(zero)) == [value, value]
