"""Absolute and relative errors: numbers worked by hand, and what must not change them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from noisy_paths import moved, planar, spatial

from slamcli.errors import InputError, NumericalError, UsageError
from slamcli.evaluation import EvaluateOptions, evaluate
from slamcli.evaluation.alignment import align, umeyama
from slamcli.evaluation.errors import relative_pairs, statistics
from slamcli.graph.trajectory import Trajectory
from slamcli.models import SE2, SE3


def path(*poses: tuple[float, float, float]) -> Trajectory:
    return Trajectory(SE2, np.array(poses, dtype=float), ids=np.arange(len(poses)), source="path")


def test_statistics_by_hand() -> None:
    found = statistics(np.array([0.0, 3.0, 0.0, 5.0]))
    assert (found.mean, found.median, found.min, found.max, found.sse, found.count) == (2.0, 1.5, 0.0, 5.0, 34.0, 4)
    assert found.rmse == pytest.approx(np.sqrt(8.5), rel=1e-15)
    assert found.std == pytest.approx(np.sqrt(4.5), rel=1e-15)  # of n, not of n - 1


def test_absolute_errors_by_hand() -> None:
    """The second pose is 3 m east and 4 m north of the truth and turned by 90 degrees."""
    truth, estimate = path((0, 0, 0), (1, 0, 0)), path((0, 0, 0), (4, 4, np.pi / 2))
    result = evaluate([estimate], truth, options=EvaluateOptions(align="none")).estimates[0]
    assert result.absolute is not None and result.table is not None
    np.testing.assert_allclose(result.table.errors.translation, [0.0, 5.0], atol=1e-15)
    np.testing.assert_allclose(result.table.errors.rotation, [0.0, 90.0], atol=1e-13)
    # E - I of a quarter turn: entries -1 -1 1 -1 of the rotation, and a translation of length 5
    np.testing.assert_allclose(result.table.errors.full, [0.0, np.sqrt(25.0 + 4.0)], rtol=1e-15)
    assert result.absolute["translation"].rmse == pytest.approx(5.0 / np.sqrt(2.0))


def test_relative_errors_by_hand() -> None:
    """Between two frames the truth goes 1 m ahead; the estimate goes 2 m ahead, then turns in place."""
    truth = path((0, 0, 0), (1, 0, 0), (2, 0, 0))
    estimate = path((0, 0, np.pi / 2), (0, 2, np.pi / 2), (0, 2, np.pi))
    result = evaluate([estimate], truth, options=EvaluateOptions(align="none", deltas=(1.0, 2.0))).estimates[0]
    one, two = (relative.statistics for relative in result.relative)
    assert one is not None and two is not None
    assert (one["translation"].mean, one["translation"].count) == (pytest.approx(1.0), 2)
    assert one["rotation"].max == pytest.approx(90.0)
    assert one["rotation"].min == pytest.approx(0.0, abs=1e-12)
    assert (two["translation"].max, two["rotation"].max) == (pytest.approx(0.0, abs=1e-15), pytest.approx(90.0))


@pytest.mark.parametrize("make", [planar, spatial])
def test_alignment_finds_a_known_motion_and_scale(make: Callable[..., Trajectory]) -> None:
    truth = make()
    motion = np.array([5.0, -3.0, 2.0]) if truth.kind is SE2 else np.array([5.0, -3.0, 2.0, 0.5, 0.5, 0.5, 0.5])
    for method, scale in (("origin", 1.0), ("se", 1.0), ("sim", 0.25)):
        result = evaluate([moved(truth, motion, scale)], truth, options=EvaluateOptions(align=method)).estimates[0]
        assert result.absolute is not None and result.alignment is not None
        assert result.absolute["translation"].max < 1e-11
        assert result.absolute["rotation"].max < 1e-10
        assert result.alignment.scale == pytest.approx(1.0 / scale, rel=1e-12)


@pytest.mark.parametrize("make", [planar, spatial])
@pytest.mark.parametrize("method", ["origin", "se", "sim"])
def test_a_rigid_motion_of_the_estimate_changes_nothing(make: Callable[..., Trajectory], method: str) -> None:
    truth, estimate = make(), make(noise=0.05)
    motion = np.array([50.0, -3.0, 2.0]) if truth.kind is SE2 else np.array([50.0, -3.0, 2.0, -0.1, 0.1, 0.7, 0.7])
    options = EvaluateOptions(align=method, deltas=(1.0, 7.0), all_pairs=True)
    before = evaluate([estimate], truth, options=options).estimates[0]
    after = evaluate([moved(estimate, truth.kind.normalize(motion[None])[0])], truth, options=options).estimates[0]
    for a, b in [(before.absolute, after.absolute)] + [
        (x.statistics, y.statistics) for x, y in zip(before.relative, after.relative, strict=True)
    ]:
        assert a is not None and b is not None
        for name in a:
            assert a[name].rmse == pytest.approx(b[name].rmse, rel=1e-10)
            assert a[name].max == pytest.approx(b[name].max, rel=1e-10)
    assert before.gap.translation == pytest.approx(after.gap.translation, rel=1e-10)


def test_ids_and_the_order_of_a_file_do_not_matter() -> None:
    truth, estimate = planar(), planar(noise=0.05)
    renamed = replace(truth, ids=truth.ids * 7 - 3, stamps=None), replace(estimate, ids=estimate.ids * 7 - 3)
    shuffle = np.random.default_rng(0).permutation(len(truth))
    shuffled = replace(truth, ids=truth.ids[shuffle], poses=truth.poses[shuffle], stamps=None)
    expected = evaluate([estimate], truth).estimates[0].absolute
    assert evaluate([renamed[1]], renamed[0]).estimates[0].absolute == expected
    assert evaluate([estimate], shuffled).estimates[0].absolute == expected


def test_sim_is_not_worse_than_se_and_se_not_than_none() -> None:
    truth = planar()
    estimate = moved(planar(noise=0.2), np.array([0.3, 0.2, 0.1]), 1.1)
    rmse = []
    for method in ("sim", "se", "none"):
        found = evaluate([estimate], truth, options=EvaluateOptions(align=method)).estimates[0].absolute
        assert found is not None
        rmse.append(found["translation"].rmse)
    assert rmse[0] < rmse[1] < rmse[2]


def test_a_mirrored_planar_path_stays_in_its_plane() -> None:
    """In space it would be turned over, which no planar robot does."""
    truth = planar()
    mirrored = replace(truth, poses=truth.poses * [1.0, -1.0, -1.0])
    result = evaluate([mirrored], truth).estimates[0]
    assert result.alignment is not None and result.absolute is not None
    np.testing.assert_array_equal(result.alignment.rotation[2], [0.0, 0.0, 1.0])
    assert result.absolute["translation"].rmse > 1.0
    in_space = align(mirrored.lifted(), truth.lifted(), "se")
    assert in_space.rotation[2, 2] == pytest.approx(-1.0)


@given(st.integers(0, 2**31), st.integers(2, 3))
@settings(max_examples=30, deadline=None)
def test_umeyama_is_a_minimum(seed: int, dimension: int) -> None:
    """No small turn, shift or change of scale brings the points closer."""
    rng = np.random.default_rng(seed)
    x, y = rng.normal(size=(20, dimension)), rng.normal(size=(20, dimension))
    rotation, translation, scale = umeyama(x, y, with_scale=True)
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(dimension), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)

    def cost(r: np.ndarray, t: np.ndarray, c: float) -> float:
        return float(np.square(y - (c * x @ r.T + t)).sum())

    best = cost(rotation, translation, scale)
    turn = np.eye(dimension)
    turn[:2, :2] = [[np.cos(1e-3), -np.sin(1e-3)], [np.sin(1e-3), np.cos(1e-3)]]
    for other in (turn, turn.T):
        assert cost(other @ rotation, translation, scale) >= best - 1e-12
    assert cost(rotation, translation + 1e-3, scale) >= best
    assert cost(rotation, translation, scale * 1.001) >= best - 1e-12
    assert cost(rotation, translation, scale * 0.999) >= best - 1e-12


def test_positions_that_do_not_determine_the_alignment() -> None:
    line = np.zeros((10, 7))
    line[:, 0], line[:, 6] = np.arange(10), 1.0
    with pytest.raises(NumericalError, match="on one line"):
        align(line, line, "se")
    assert align(line, line, "se", planar=True).rotation == pytest.approx(np.eye(3))
    with pytest.raises(NumericalError, match="in one point"):
        align(line[[0, 0]], line[[0, 0]], "sim", planar=True)


def brute_force(distance: np.ndarray, delta: float) -> list[tuple[int, int]]:
    out = []
    for i in range(len(distance) - 1):
        off = np.abs((distance[i + 1 :] - distance[i]) - delta)
        if off.min() <= 0.1 * delta:
            out.append((i, i + 1 + int(np.argmin(off))))
    return out


@given(st.lists(st.sampled_from([0.0, 0.5, 1.0, 1.7]), min_size=1, max_size=40), st.sampled_from([0.5, 1.0, 2.2]))
@settings(max_examples=60, deadline=None)
def test_all_pairs_by_distance(steps: list[float], delta: float) -> None:
    """Also where the robot stands still, or two candidates are as near."""
    poses = np.zeros((len(steps) + 1, 7))
    poses[1:, 0], poses[:, 6] = np.cumsum(steps), 1.0
    found = relative_pairs(poses, delta, "m", all_pairs=True)
    distance = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(poses[:, 0])))])
    assert [tuple(pair) for pair in found.tolist()] == brute_force(distance, delta)


def test_pairs_by_hand() -> None:
    poses = planar(10).lifted()
    poses[:, :3] = 0.0
    poses[:, 0] = [0, 1, 2, 3, 4, 4, 4, 5, 6, 7]
    assert relative_pairs(poses, 4, "frames").tolist() == [[0, 4], [4, 8]]
    assert relative_pairs(poses, 8, "frames", all_pairs=True).tolist() == [[0, 8], [1, 9]]
    assert relative_pairs(poses, 2.5, "m").tolist() == [[0, 3], [3, 8]]
    assert relative_pairs(poses, 2, "m").tolist() == [[0, 2], [2, 4], [4, 8]]  # exactly 2 m suffice
    assert relative_pairs(poses, 10, "frames").shape == (0, 2)
    quarter = np.zeros((5, 7))
    angles = np.radians([0.0, 45.0, 90.0, 135.0, 180.0])
    quarter[:, 5], quarter[:, 6] = np.sin(angles / 2), np.cos(angles / 2)
    assert relative_pairs(quarter, 89.0, "deg").tolist() == [[0, 2], [2, 4]]
    assert relative_pairs(quarter, 1.55, "rad").tolist() == [[0, 2], [2, 4]]


@pytest.mark.parametrize(
    ("delta", "unit", "all_pairs", "message"),
    [
        (0.0, "m", False, "positive"),
        (np.nan, "m", False, "positive"),
        (1.5, "frames", False, "whole number"),
        (1.0, "miles", False, "miles"),
        (10.0, "deg", True, "not by angles"),
    ],
)
def test_pairs_that_make_no_sense(delta: float, unit: str, all_pairs: bool, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        relative_pairs(planar(5).lifted(), delta, unit, all_pairs)


def test_no_pairs_are_said() -> None:
    evaluation = evaluate([planar(5)], planar(5), options=EvaluateOptions(deltas=(9.0,)))
    assert evaluation.estimates[0].relative[0].statistics is None
    assert "no two of 5 poses are 9 frames apart" in evaluation.notes[0]


def test_planar_and_spatial_poses_can_be_compared() -> None:
    truth = planar()
    lifted = replace(planar(noise=0.05), kind=SE3, poses=planar(noise=0.05).lifted())
    flat = evaluate([planar(noise=0.05)], truth).estimates[0].absolute
    mixed = evaluate([lifted], truth).estimates[0].absolute
    assert flat is not None and mixed is not None
    assert mixed["translation"].rmse == pytest.approx(flat["translation"].rmse, rel=1e-12)
    assert mixed["rotation"].rmse == pytest.approx(flat["rotation"].rmse, rel=1e-9)


def test_positions_whose_squares_overflow_are_refused() -> None:
    path = Trajectory(SE2, np.array([[0.0, 0.0, 0.0], [2e200, 0.0, 0.0]]), ids=np.arange(2), source="far.g2o")
    with pytest.raises(InputError, match=r"far\.g2o: a position is 2e\+200 m"):
        evaluate([path], path)
