"""Order, frames and signs of the pose groups, by examples one can follow on paper."""

import subprocess
import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose

from slamcli.geometry import se2, se3, so2, so3

pytestmark = pytest.mark.filterwarnings("error")

PI = float(np.pi)
ROOT = np.sqrt(0.5)
# At (1, 2), looking along +y.
FACING_LEFT = np.array([1.0, 2.0, PI / 2])
FACING_LEFT_3D = np.array([1.0, 2.0, 3.0, 0.0, 0.0, ROOT, ROOT])


def test_sizes() -> None:
    assert [(g.SIZE, g.DIM) for g in (so2, se2, so3, se3)] == [(1, 1), (3, 3), (4, 3), (7, 6)]


def test_points_go_from_the_body_to_the_world() -> None:
    ahead = np.array([1.0, 0.0, 0.0])
    assert_allclose(so2.act(FACING_LEFT[2:], ahead[:2]), [0, 1], atol=1e-15)
    assert_allclose(se2.act(FACING_LEFT, ahead[:2]), [1, 3], atol=1e-15)
    assert_allclose(se3.act(FACING_LEFT_3D, ahead), [1, 3, 3], atol=1e-15)


def test_steps_are_in_the_body_frame() -> None:
    step = np.array([2.0, 1.0, 0.1])
    assert_allclose(se2.retract(FACING_LEFT, step), [0, 4, PI / 2 + 0.1], atol=1e-15)
    step = np.array([2.0, 1.0, -1.0, 0.0, 0.0, 0.1])
    moved = se3.retract(FACING_LEFT_3D, step)
    assert_allclose(moved[:3], [0, 4, 2], atol=1e-15)
    assert_allclose(so3.log(moved[3:]), [0, 0, PI / 2 + 2 * np.arcsin(0.1)], atol=1e-15)


def test_headings_are_wrapped_everywhere() -> None:
    x, y = np.array([0.0, 0.0, 3.0]), np.array([0.0, 0.0, -3.0])
    gap = 2 * PI - 6.0
    assert_allclose(se2.compose(x, x)[2], -gap, atol=1e-15)
    assert_allclose(se2.between(x, y)[2], gap, atol=1e-15)
    assert_allclose(se2.local(y, x)[2], -gap, atol=1e-15)
    assert_allclose(se2.retract(x, x)[2], -gap, atol=1e-15)
    assert_allclose(se2.exp(2 * x)[2], -gap, atol=1e-15)
    assert_allclose(se2.inverse(np.array([0.0, 0.0, -PI]))[2], -PI, atol=0)
    assert_allclose(so2.local(x[2:], y[2:]), [gap], atol=1e-15)
    assert_allclose(se2.wrap(np.array([5.0, 6.0, 4.0])), [5, 6, 4 - 2 * PI], atol=1e-15)


def test_exp_of_a_quarter_turn_drives_a_quarter_circle() -> None:
    # An arc of length pi/2 with a turn of pi/2 has the radius 1.
    assert_allclose(se2.exp(np.array([PI / 2, 0.0, PI / 2])), [1, 1, PI / 2], atol=1e-15)
    pose = se3.exp(np.array([PI / 2, 0.0, 4.0, 0.0, 0.0, PI / 2]))
    assert_allclose(pose, [1, 1, 4, 0, 0, ROOT, ROOT], atol=1e-15)


def test_the_plane_is_part_of_space() -> None:
    random = np.random.default_rng(4)
    xi, eta = random.normal(size=(2, 20, 3))
    keep = [0, 1, 5]

    def lift(v: np.ndarray) -> np.ndarray:
        out = np.zeros((*v.shape[:-1], 6))
        out[..., keep] = v
        return out

    x, y = se2.exp(xi), se2.exp(eta)
    lifted, lifted_y = se3.exp(lift(xi)), se3.exp(lift(eta))
    assert_allclose(se3.log(se3.compose(lifted, lifted_y))[:, keep], se2.log(se2.compose(x, y)))
    square = np.ix_(range(20), keep, keep)
    for name in ("left_jacobian", "right_jacobian", "left_jacobian_inverse"):
        in_space = getattr(se3, name)(lift(xi))[square]
        assert_allclose(in_space, getattr(se2, name)(xi), rtol=0, atol=1e-14)
    assert_allclose(se3.adjoint(lifted)[square], se2.adjoint(x), rtol=0, atol=1e-14)


def test_between_keeps_digits_far_from_the_origin() -> None:
    x, y = np.array([5e5, 4e6, 0.7]), np.array([5e5 + 0.25, 4e6 + 0.5, 0.7])
    expected = se2.between(np.array([0.0, 0.0, 0.7]), np.array([0.25, 0.5, 0.7]))
    assert_allclose(se2.between(x, y), expected, rtol=0, atol=1e-15)
    spin = so3.exp(np.array([0.3, -0.2, 0.5]))
    x, y = (np.array([*p[:2], 9.0, *spin]) for p in (x, y))
    shift = so3.act(so3.inverse(spin), np.array([0.25, 0.5, 0.0]))
    for difference in (se3.between(x, y), se3.local(x, y)):
        assert_allclose(difference[:3], shift, rtol=0, atol=1e-15)


def test_matrix_off_by_a_scale_gives_the_nearest_rotation() -> None:
    assert_allclose(so2.from_matrix(2.5 * so2.to_matrix(np.array([0.4]))), [0.4], rtol=1e-15)
    half_turn = np.array([[-1.0, -0.0], [0.0, -1.0]])
    assert so2.from_matrix(half_turn)[0] == -PI


@pytest.mark.parametrize("module", ["scipy", "matplotlib"])
def test_import_stays_light(module: str) -> None:
    code = f"import sys, slamcli.geometry; sys.exit({module!r} in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
