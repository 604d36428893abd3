"""Prediction, update and initialization against worked numbers, dense algebra, finite differences and batch solutions.

The first tests after the lesson's are those that wrong implementations in the wild have failed (PythonRobotics #972 and
#255, SLAM-Course-Solutions #5, ekf-slam #1, mrpt #909, feldfreund_devkit #47).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from sensor_logs import batch_covariance, by_id, exact, in_world, pose_nees, simulated, world_covariance
from support import dataset

import slamcli
from slamcli import models
from slamcli.errors import NumericalError, UsageError
from slamcli.filtering.ekf import keep_pose, predict, update
from slamcli.filtering.estimate import landmark_ids
from slamcli.filtering.innovation import SENSORS
from slamcli.filtering.options import EkfOptions
from slamcli.filtering.readings import Linearization, Reading, Sighting, Stream, linearize
from slamcli.filtering.run import run
from slamcli.filtering.state import State, local_covariance
from slamcli.geometry import se2, so2
from slamcli.graph.graph_log import graph_log
from slamcli.graph.sensor_log import Observations, SensorLog
from slamcli.models.base import Array
from slamcli.models.motion import BodyMotion

pytestmark = pytest.mark.filterwarnings("error")

each_sensor = pytest.mark.parametrize("sensor", SENSORS.values(), ids=SENSORS)


def a_state(landmarks: int = 3, seed: int = 0, capacity: int = 64) -> State:
    """A state with landmarks and a full covariance."""
    rng = np.random.default_rng(seed)
    state = State(np.array([1.0, -2.0, 0.7]), np.diag([0.04, 0.09, 0.01]), capacity)
    for _ in range(landmarks):
        state.append(rng.uniform(-9.0, 9.0, 2), np.arange(3), rng.normal(size=(2, 3)), np.diag([0.3, 0.5]))
    return state


def stream_of(name: str, measurements: Array, deviations: list[float]) -> Stream:
    count = len(measurements)
    noise = np.tile(np.diag(np.square(deviations)), (count, 1, 1))
    ones = np.ones(count, dtype=bool)
    return Stream(SENSORS[name], list(range(count)), measurements, noise, ones, np.ones(count), [0, count])


def sight(state: State, stream: Stream, rows: list[int] | None = None) -> Linearization:
    """Reading k of landmark k, linearized."""
    chosen = range(len(stream.landmarks)) if rows is None else rows
    return linearize(state, [stream], [Sighting(Reading(0, k), state.robot, state.blocks[k]) for k in chosen], False)


def readings_of(state: State, name: str) -> Stream:
    """Readings of all landmarks, a little off."""
    sensor = SENSORS[name]
    points = np.array([state.mean[block.start : block.start + 2] for block in state.blocks])
    h, _, _ = sensor.observe(np.tile(state.mean[:3], (len(points), 1)), points)
    return stream_of(name, sensor.kind.normalize(h + 0.03), [0.1, 0.05][: h.shape[1]])


def test_the_lesson_in_one_dimension() -> None:
    """Prior variances 0.01 and 100, z = l - p = 10, Q = 1: off-diagonal +0.0099, landmark 100 - 100^2 / 101.01."""
    state = State(np.zeros(3), np.diag([0.01, 0.0, 0.0]))
    block = state.append(np.array([8.0, 0.0]), np.zeros(1, dtype=int), np.zeros((2, 1)), np.diag([100.0, 1.0]))
    stream = stream_of("xy", np.array([[10.0, 0.0]]), [1.0, 1.0])
    found = update(state, sight(state, stream))
    covariance = state.covariance()
    assert covariance[0, block.start] == pytest.approx(0.01 * 100.0 / 101.01, rel=1e-13)
    assert covariance[0, block.start] == pytest.approx(0.0099, abs=1e-6)
    assert covariance[block.start, block.start] == pytest.approx(100.0 - 100.0**2 / 101.01, rel=1e-12)
    assert covariance[0, 0] == pytest.approx(0.01 - 0.01**2 / 101.01, rel=1e-13)
    assert state.mean[0] == pytest.approx(-0.01 * 2.0 / 101.01, rel=1e-12)
    assert state.mean[block.start] == pytest.approx(8.0 + 100.0 * 2.0 / 101.01, rel=1e-13)
    assert found.nis == pytest.approx(4.0 / 101.01, rel=1e-12)


def test_prediction_is_dense_algebra_with_cross_covariances() -> None:
    state = a_state()
    before, pose = state.covariance(), state.mean[:3].copy()
    displacement, noise = np.array([0.5, -0.2, 0.3]), np.diag([0.01, 0.02, 0.003])
    predict(state, displacement, noise)
    moved = se2.compose(pose, displacement)
    assert_allclose(state.mean[:3], moved, rtol=1e-14)
    transition = np.eye(state.size)
    transition[:2, 2] = -(moved[1] - pose[1]), moved[0] - pose[0]
    expected = transition @ before @ transition.T
    expected[:3, :3] += world_covariance(noise, moved[2])
    assert_allclose(state.covariance(), expected, rtol=1e-13, atol=1e-16)
    assert_allclose(state.covariance()[3:, 3:], before[3:, 3:], rtol=0, atol=0)  # the map is not touched
    assert np.abs(state.covariance()[3:, :2] - before[3:, :2]).max() > 0.01  # the cross-covariance is


def test_motion_jacobian_by_finite_differences() -> None:
    """Columns of F: predicted poses of displaced poses. Swapped sines or signs would show."""
    pose, displacement, step = np.array([1.0, -2.0, 2.9]), np.array([0.7, 0.4, 0.5]), 1e-6
    numeric = np.empty((3, 3))
    for k in range(3):
        ends = [se2.compose(pose + sign * step * np.eye(3)[k], displacement) for sign in (1.0, -1.0)]
        numeric[:, k] = np.concatenate([ends[0][:2] - ends[1][:2], so2.wrap(ends[0][2:] - ends[1][2:])]) / (2.0 * step)
    for k in range(3):  # a state that knows all but one number: its covariance is that column squared
        state = State(pose, np.diag(np.eye(3)[k]))
        predict(state, displacement, np.zeros((3, 3)))
        assert_allclose(state.pose_covariance(), np.outer(numeric[:, k], numeric[:, k]), atol=1e-8)


def test_the_bearing_falls_as_the_robot_turns() -> None:
    state = a_state(1)
    stacked = sight(state, readings_of(state, "range-bearing"))
    assert_allclose(stacked.jacobian[:, 2], [0.0, -1.0], atol=1e-15)


@each_sensor
def test_observation_jacobian_by_finite_differences(sensor: object) -> None:
    name = sensor.name  # type: ignore[attr-defined]
    state = a_state(2, seed=3)
    stream = readings_of(state, name)
    stacked = sight(state, stream)
    for column, entry in enumerate(stacked.entries.tolist()):
        innovations = []
        for sign in (1.0, -1.0):
            state.mean[entry] += sign * 1e-6
            innovations.append(sight(state, stream).innovation)
            state.mean[entry] -= sign * 1e-6
        numeric = -(innovations[0] - innovations[1]) / 2e-6
        assert_allclose(stacked.jacobian[:, column], numeric, atol=1e-7)


def test_a_landmark_behind_the_robot() -> None:
    """Bearings on either side of +-pi differ by 0.02 rad, not by 2 pi - 0.02."""
    state = State(np.zeros(3), np.diag([0.01, 0.01, 0.001]))
    state.append(np.array([-5.0, -0.05]), np.zeros(1, dtype=int), np.zeros((2, 1)), np.eye(2) * 0.01)
    stream = stream_of("range-bearing", np.array([[5.0, math.pi - 0.01]]), [0.1, 0.02])
    stacked = sight(state, stream)
    assert stacked.innovation[1] == pytest.approx(-0.02, abs=1e-6)
    update(state, stacked)
    assert abs(state.mean[2]) < 0.02


def test_a_heading_stays_in_its_range() -> None:
    """A correction across pi comes out at -pi."""
    state = State(np.array([0.0, 0.0, math.pi - 0.001]), np.diag([1e-6, 1e-6, 0.01]))
    state.append(np.array([-5.0, 0.0]), np.zeros(1, dtype=int), np.zeros((2, 1)), np.eye(2) * 1e-6)
    update(state, sight(state, stream_of("bearing", np.array([[-0.05]]), [0.001])))
    assert state.mean[2] == pytest.approx(-math.pi + 0.05, abs=1e-3)


@pytest.mark.parametrize("form", ["symmetric", "joseph"])
@each_sensor
def test_update_is_dense_algebra(sensor: object, form: str) -> None:
    state = a_state(4, seed=1)
    stacked = sight(state, readings_of(state, sensor.name))  # type: ignore[attr-defined]
    before, mean = state.covariance(), state.mean[: state.size].copy()
    h = np.zeros((len(stacked.innovation), state.size))
    h[:, stacked.entries] = stacked.jacobian
    s = h @ before @ h.T + stacked.noise
    gain = before @ h.T @ np.linalg.inv(s)
    rest = np.eye(state.size) - gain @ h
    found = update(state, stacked, joseph=form == "joseph")
    assert_allclose(state.covariance(), rest @ before @ rest.T + gain @ stacked.noise @ gain.T, rtol=1e-9, atol=1e-14)
    assert_allclose(state.mean[: state.size], mean + gain @ stacked.innovation, rtol=1e-10)
    assert found.nis == pytest.approx(stacked.innovation @ np.linalg.solve(s, stacked.innovation), rel=1e-10)


def test_several_readings_at_once_and_one_by_one_where_it_is_linear() -> None:
    """xy readings of a robot that knows its heading are linear: batch, sequence and reversed sequence are one."""
    states: list[State] = []
    stream = None
    for orders in ([[0, 1, 2]], [[0], [1], [2]], [[2], [0], [1]], [[2, 1, 0]]):
        state = a_state(3, seed=5)
        state._matrix[2, :] = state._matrix[:, 2] = 0.0
        stream = stream or readings_of(state, "xy")
        for rows in orders:
            update(state, sight(state, stream, rows))
        states.append(state)
    for other in states[1:]:
        assert_allclose(other.mean[:9], states[0].mean[:9], rtol=1e-12, atol=1e-13)
        assert_allclose(other.covariance(), states[0].covariance(), rtol=1e-10, atol=1e-13)


def test_linear_case_is_the_batch_solution() -> None:
    """No noise in the heading and xy readings: the last state and its covariance are those of least squares."""
    rng = np.random.default_rng(2)
    steps, count = 40, 6
    turns = rng.uniform(-0.5, 0.5, steps - 1)
    controls = np.column_stack([rng.uniform(0.5, 1.5, steps - 1), rng.uniform(-0.3, 0.3, steps - 1), turns])
    heading = 0.4 + np.concatenate([[0.0], np.cumsum(turns)])
    seen = [(k, j) for k in range(steps) for j in range(count) if rng.random() < 0.4]
    measured = rng.uniform(-5.0, 5.0, (len(seen), 2))  # anything: least squares fits it
    weight = np.array([[30.0, 5.0], [5.0, 20.0]])
    ids = np.array([j for _, j in seen])
    entry = Observations(
        models.POINT_OBSERVATION_2D, np.array([k for k, _ in seen]), ids, measured, np.tile(weight, (len(seen), 1, 1))
    )
    start, deviations = np.array([1.0, 2.0, 0.4]), (0.3, 0.2, 0.0)
    log = SensorLog(np.arange(steps) * 1.0, np.arange(steps), "body", controls, None, [entry], start)
    result = run(log, EkfOptions(motion=BodyMotion((0.1, 0.05, 0.0)), start_deviations=deviations))

    def rotation(angle: float) -> Array:
        return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])

    size = 2 * steps + 2 * count
    hessian, gradient = np.zeros((size, size)), np.zeros(size)

    def add(columns: list[tuple[int, Array]], value: Array, information: Array) -> None:
        row = np.zeros((2, size))
        for column, block in columns:
            row[:, column : column + 2] += block
        hessian[:] += row.T @ information @ row
        gradient[:] += row.T @ information @ value

    add([(0, np.eye(2))], start[:2], np.diag(1.0 / np.square(deviations[:2])))
    for k in range(steps - 1):  # noise in the frame of the later pose
        turned = rotation(heading[k + 1])
        information = turned @ np.diag([100.0, 400.0]) @ turned.T
        add([(2 * k + 2, np.eye(2)), (2 * k, -np.eye(2))], rotation(heading[k]) @ controls[k, :2], information)
    for (k, j), z in zip(seen, measured, strict=True):
        back = rotation(heading[k]).T
        add([(2 * steps + 2 * j, back), (2 * k, -back)], z, weight)
    covariance = np.linalg.inv(hessian)
    best = covariance @ gradient
    last = np.r_[2 * steps - 2 : size]
    assert_allclose(result.poses[-1], [*best[2 * steps - 2 : 2 * steps], so2.wrap(heading[-1:])[0]], rtol=1e-9)
    assert_allclose(by_id(result, result.landmarks.positions).ravel(), best[2 * steps :], rtol=1e-9)
    order = np.r_[0, 1, 3 + np.argsort(np.repeat(result.landmarks.ids, 2), kind="stable")]
    expected = covariance[np.ix_(last, last)]
    assert_allclose(result.covariance()[np.ix_(order, order)], expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


LANDMARKS = np.array([[4.0, 6.0], [9.0, -4.0], [-2.0, 5.0]])


def a_path(steps: int = 14) -> Array:
    """Poses on a curve, none of whose landmarks are near."""
    poses = np.zeros((steps, 3))
    poses[0, 2] = 0.3
    for k in range(1, steps):
        poses[k] = se2.compose(poses[k - 1], np.array([1.0, 0.1, 0.25]))
    return poses


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("jacobians", ["standard", "first-estimates"])
@each_sensor
def test_without_noise_the_filter_is_the_batch_solution(sensor: object, jacobians: str, compressed: bool) -> None:
    """All linearizations are at the truth then: initialization, delayed or not, loses and invents nothing."""
    kind = sensor.kind  # type: ignore[attr-defined]
    poses = a_path()
    log = exact(kind, poses, LANDMARKS)
    options = EkfOptions(
        start_deviations=(0.1, 0.2, 0.05), jacobians=jacobians, compressed=compressed, area_radius=3.0, max_views=20
    )
    result = run(log, options)
    assert_allclose(result.poses, poses, atol=1e-8)
    assert_allclose(by_id(result, result.landmarks.positions), LANDMARKS, atol=1e-7)
    start = local_covariance(np.diag(np.square(options.start_deviations)), poses[0, 2])
    expected = in_world(batch_covariance(log, poses, LANDMARKS, start), poses[-1, 2])
    order = np.r_[0:3, 3 + np.argsort(np.repeat(result.landmarks.ids, 2), kind="stable")]
    assert_allclose(result.covariance()[np.ix_(order, order)], expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())
    assert result.counts["dropped"] == result.counts["waiting"] == 0
    assert result.state.size == 3 + 2 * len(LANDMARKS)  # no copy of a pose is left


@pytest.mark.parametrize("kind", [models.BEARING_2D, models.RANGE_2D], ids=str)
def test_readings_that_waited_count_as_much_as_the_others(kind: models.FactorKind) -> None:
    """Where all poses are known, a landmark is the least-squares fit to its readings, whichever of them placed it."""
    poses, landmark = a_path(), LANDMARKS[:1]
    log = exact(kind, poses, landmark)
    assert log.information is not None
    log.information[:] = np.eye(3) * 1e14
    entry = log.observations[0]
    entry.measurements[:] += 0.0003 * np.random.default_rng(0).normal(size=entry.measurements.shape)
    result = run(log, EkfOptions())
    assert result.counts["waiting"] == result.counts["dropped"] == 0
    fit = landmark[0].copy()
    for _ in range(10):
        at = np.tile(fit, (len(poses), 1))
        error, (_, jacobian) = kind.linearize((poses, at), entry.measurements, None)
        fit = fit - np.linalg.lstsq(jacobian[:, 0], error[:, 0], rcond=None)[0]
    assert np.abs(fit - landmark[0]).max() > 5e-5
    assert_allclose(result.landmarks.positions[0], fit, atol=5e-6)


def test_bearings_wait_for_parallax() -> None:
    """A robot that drives at a landmark never sees parallax; one that passes it does."""
    straight = np.column_stack([np.arange(10.0), np.zeros(10), np.zeros(10)])
    ahead = run(exact(models.BEARING_2D, straight, np.array([[30.0, 0.001]])), EkfOptions())
    assert len(ahead.landmarks) == 0
    assert ahead.counts["waiting"] + ahead.counts["dropped"] == 10
    abeam = run(exact(models.BEARING_2D, straight, np.array([[5.0, 5.0]])), EkfOptions())
    assert_allclose(abeam.landmarks.positions, [[5.0, 5.0]], atol=1e-8)
    assert abeam.counts["initialized"] == 2


def test_ranges_wait_until_the_mirror_image_is_ruled_out() -> None:
    """From a straight line left and right are the same; a turn tells them apart."""
    straight = np.column_stack([np.arange(10.0), np.zeros(10), np.zeros(10)])
    landmark = np.array([[5.0, -5.0]])
    assert len(run(exact(models.RANGE_2D, straight, landmark), EkfOptions()).landmarks) == 0
    corner = np.concatenate([straight, [[9.0, 1.0 + k, math.pi / 2] for k in range(6)]])
    turned = run(exact(models.RANGE_2D, corner, landmark), EkfOptions())
    assert_allclose(turned.landmarks.positions, landmark, atol=1e-8)
    assert turned.landmarks.sightings[0] + turned.counts["dropped"] == 16


def test_first_estimates_gain_nothing_about_heading_and_position() -> None:
    """A turn of everything about the origin cannot be observed: v^T P^-1 v along it must not exceed the start's."""
    log = simulated(
        world="manhattan",
        poses=150,
        seed=1,
        robot={"noise": [0.05, 0.05, 0.02]},
        landmarks={"count": 30},
        sensors=[{"kind": "xy", "range": 8, "noise": [0.2, 0.2]}],
    )
    deviations = (1.0, 1.0, 0.3)
    gained = {}
    for jacobians in ("standard", "first-estimates"):
        state = run(log, EkfOptions(jacobians=jacobians, start_deviations=deviations)).state
        at = state.first if jacobians == "first-estimates" else state.mean
        direction = np.empty(state.size)
        direction[0::2][:1], direction[1], direction[2] = -at[1], at[0], 1.0
        for block in state.blocks:
            direction[block.start], direction[block.start + 1] = -at[block.start + 1], at[block.start]
        x, y = log.start[:2]
        before = y**2 + x**2 + 1.0 / 0.3**2
        gained[jacobians] = float(direction @ np.linalg.solve(state.covariance(), direction)) / before
    assert gained["first-estimates"] <= 1.0 + 1e-6
    assert gained["standard"] > 1.5


def test_symmetric_and_positive_definite_after_20000_steps() -> None:
    """One triangle cannot be unsymmetric; its eigenvalues stay positive under exact and inexact readings in turns."""
    state = a_state(6, seed=4)
    rng = np.random.default_rng(0)
    exactly, roughly = (
        stream_of("range-bearing", readings_of(state, "range-bearing").measurements, noise)
        for noise in ([1e-4, 1e-5], [1.0, 0.5])
    )
    for k in range(20_000):
        predict(state, np.array([0.1, 0.0, 0.05]), np.diag([1e-4, 1e-4, 1e-6]))
        state.mean[:3] = 1.0, -2.0, 0.7  # where the readings are from
        update(state, sight(state, exactly if k % 2 else roughly, [int(rng.integers(6))]))
    covariance = state.covariance()
    assert np.isfinite(covariance).all()
    assert np.linalg.eigvalsh(covariance)[0] > 0.0


def test_joseph_and_symmetric_agree_on_a_run() -> None:
    log = simulated(world="manhattan", poses=200, landmarks={"count": 30}, robot={"noise": [0.05, 0.05, 0.01]})
    results = [run(log, EkfOptions(form=form)) for form in ("symmetric", "joseph")]
    assert_allclose(results[0].poses, results[1].poses, atol=1e-10)
    assert_allclose(results[0].covariance(), results[1].covariance(), rtol=1e-7, atol=1e-12)


def test_capacity_changes_nothing() -> None:
    small, large = a_state(20, capacity=3), a_state(20, capacity=500)
    assert small.capacity < 100
    for state in (small, large):
        update(state, sight(state, readings_of(state, "range-bearing")))
        predict(state, np.array([1.0, 0.0, 0.1]), np.eye(3) * 1e-3)
    assert_allclose(small.covariance(), large.covariance(), rtol=1e-13, atol=1e-15)
    assert_allclose(small.mean[: small.size], large.mean[: large.size], rtol=1e-14)


def test_removed_blocks_leave_the_rest() -> None:
    state = a_state(5)
    keep_pose(state)
    before, mean = state.covariance(), state.mean[: state.size].copy()
    gone = [state.blocks[0], state.blocks[3]]
    kept = np.setdiff1d(np.arange(state.size), np.concatenate([np.arange(b.start, b.start + 2) for b in gone]))
    state.remove(gone)
    assert_allclose(state.covariance(), before[np.ix_(kept, kept)], rtol=0, atol=0)
    assert_allclose(state.mean[: state.size], mean[kept], rtol=0, atol=0)
    assert [block.start for block in state.blocks] == [3, 5, 7, 9]
    state.append(np.zeros(2), np.arange(3), np.ones((2, 3)), np.eye(2))
    assert np.linalg.eigvalsh(state.covariance())[0] > -1e-12


def test_local_and_world_covariances_are_inverse() -> None:
    covariance = a_state().pose_covariance() + 0.01
    assert_allclose(world_covariance(local_covariance(covariance, np.array(0.7)), np.array(0.7)), covariance)
    turned = local_covariance(np.diag([1.0, 4.0, 9.0]), np.array(math.pi / 2))
    assert_allclose(turned, np.diag([4.0, 1.0, 9.0]), atol=1e-14)


def test_compressed_is_exact() -> None:
    log = simulated(
        world="manhattan",
        poses=400,
        landmarks={"count": 120},
        robot={"noise": [0.05, 0.05, 0.01]},
        sensors=[{"kind": "xy", "range": 3}],
    )
    for association, radius in (("known", None), ("nearest", None), ("known", 12.0)):
        plain = run(log, EkfOptions(association=association))
        local = run(log, EkfOptions(association=association, compressed=True, area_radius=radius))
        assert local.areas > (20 if radius is None else 2)
        assert_allclose(local.poses, plain.poses, atol=1e-9)
        assert_allclose(local.covariances, plain.covariances, atol=1e-11)
        assert_allclose(local.landmarks.positions, plain.landmarks.positions, atol=1e-9)
        assert_allclose(local.covariance(), plain.covariance(), atol=1e-11)
        assert (local.dimension == plain.dimension).all()
        assert local.counts == plain.counts


@pytest.mark.parametrize("jacobians", ["standard", "first-estimates"])
def test_consistent_on_a_simulation(jacobians: str) -> None:
    """Average NEES over runs is near 3; a filter that neglects a term of its covariance is far from it."""
    values = []
    for seed in range(4):
        log = simulated(
            world="manhattan", poses=150, seed=seed, landmarks={"count": 40}, robot={"noise": [0.05, 0.05, 0.01]}
        )
        values.append(pose_nees(run(log, EkfOptions(jacobians=jacobians)), log).mean())
    assert 1.5 < np.mean(values) < 5.0


def test_readings_that_are_not_used_are_counted() -> None:
    poses = a_path()
    log = exact(models.RANGE_BEARING_2D, poses, LANDMARKS)
    near = run(log, EkfOptions(sensor_range=7.0))
    distance = log.observations[0].measurements[:, 0]
    assert near.counts["out-of-range"] == np.count_nonzero(distance > 7.0) > 0
    assert sum(near.counts.values()) == len(distance)
    log.observations[0].landmarks[:3] = -1
    assert run(log, EkfOptions()).counts["no-id"] == 3
    log.observations[0].measurements[20, 0] += 5.0
    gated = run(log, EkfOptions(gate_known=True))
    assert gated.counts["outlier"] == 1
    assert gated.assignments[0][20] == -1


def test_a_robot_on_its_landmark() -> None:
    """No derivative exists there: the reading is left out and said so, and nothing is lost."""
    poses = np.column_stack([np.arange(4.0), np.zeros(4), np.zeros(4)])
    log = exact(models.RANGE_BEARING_2D, poses, np.array([[2.0, 0.0], [5.0, 5.0]]))
    result = run(log, EkfOptions())
    assert result.counts["undefined"] == 1
    assert np.isfinite(result.covariances).all()


def test_a_first_reading_from_on_top_of_the_landmark_starts_nothing() -> None:
    """Its bearing says nothing there: the next reading starts the landmark."""
    poses = np.column_stack([np.arange(4.0), np.zeros(4), np.zeros(4)])
    log = exact(models.RANGE_BEARING_2D, poses, np.array([[0.0, 0.0], [5.0, 5.0]]))
    for association in ("known", "nearest", "jcbb"):
        result = run(log, EkfOptions(association=association))
        assert result.counts["undefined"] == 1
        assert len(result.landmarks) == 2
        assert np.isfinite(result.landmarks.positions).all() and np.isfinite(result.covariance()).all()


def test_second_reading_of_the_first_step_is_gated_too() -> None:
    poses = np.column_stack([np.arange(2.0), np.zeros(2), np.zeros(2)])
    log = exact(models.RANGE_BEARING_2D, poses, np.array([[2.0, 3.0], [2.0, 3.0]]))
    log.observations[0].landmarks[:] = 7
    log.observations[0].measurements[1, 0] += 5.0
    result = run(log, EkfOptions(gate_known=True))
    assert result.counts["outlier"] == 1 and result.assignments[0][1] == -1


def test_covariance_beyond_the_range_of_numbers() -> None:
    log = exact(models.RANGE_BEARING_2D, a_path(), LANDMARKS)
    with np.errstate(all="ignore"), pytest.raises(NumericalError):
        run(log, EkfOptions(start_deviations=(1e200, 1.0, 1.0)))


def test_an_interruption_before_the_first_step() -> None:
    result = run(exact(models.RANGE_BEARING_2D, a_path(), LANDMARKS), EkfOptions(), interrupted=lambda: True)
    assert result.interrupted and len(result.poses) == 1


def test_ids_of_unknown_landmarks_are_not_those_of_the_truth() -> None:
    """Or the errors of the map would be those of pairs that mean nothing."""
    log = exact(models.RANGE_BEARING_2D, a_path(), LANDMARKS)
    log.observations[0].landmarks[:] = -1
    steps = len(log)
    truth = (np.arange(steps, steps + len(LANDMARKS)), LANDMARKS)
    result = run(replace(log, true_landmarks=truth), EkfOptions(association="nearest"))
    assert not set(landmark_ids(result).tolist()) & {*truth[0].tolist(), *log.ids.tolist()}


@pytest.mark.parametrize("last", [np.uint64(2**64 - 1), np.int64(2**63 - 1)])
def test_new_ids_where_the_largest_ones_are_taken(last: np.integer[Any]) -> None:
    log = exact(models.RANGE_BEARING_2D, a_path(), LANDMARKS)
    log.observations[0].landmarks[:] = -1
    ids = log.ids.astype(last.dtype)
    ids[-1] = last
    found = landmark_ids(run(replace(log, ids=ids), EkfOptions(association="nearest")))
    assert len(set(found.tolist()) | {int(known) for known in ids}) == len(found) + len(ids)
    assert (found >= 0).all()


def test_an_interrupted_run_keeps_its_steps() -> None:
    log = exact(models.RANGE_BEARING_2D, a_path(), LANDMARKS)
    steps: list[int] = []
    whole = run(log, EkfOptions())
    part = run(log, EkfOptions(), progress=steps.append, interrupted=lambda: len(steps) == 5)
    assert part.interrupted
    assert not whole.interrupted
    assert steps == list(range(5))
    assert_allclose(part.poses, whole.poses[:5], rtol=0)


def test_records_of_steps() -> None:
    log = exact(models.RANGE_BEARING_2D, a_path(), LANDMARKS)
    records: list[object] = []
    result = run(log, EkfOptions(), on_step=records.append)
    assert [len(record.readings) for record in records] == [3] * 14  # type: ignore[attr-defined]
    first, last = records[0], records[-1]
    assert {r.decision for r in first.readings} == {"initialized"}  # type: ignore[attr-defined]
    assert {r.decision for r in last.readings} == {"used"}  # type: ignore[attr-defined]
    assert all(r.nis < 1e-12 and len(r.innovation) == 2 for r in last.readings)  # type: ignore[attr-defined]
    assert_allclose(last.covariance, result.covariances[-1], rtol=1e-12)  # type: ignore[attr-defined]
    plain = run(log, EkfOptions())
    assert_allclose(plain.poses, result.poses, rtol=0)


def test_coupling_grows_to_one() -> None:
    """Common errors of the start correlate the map: known apart, unknown together."""
    log = exact(models.POINT_OBSERVATION_2D, a_path(), LANDMARKS)
    loose = run(log, EkfOptions(start_deviations=(10.0, 10.0, 0.0))).coupling()
    tight = run(log, EkfOptions(start_deviations=(0.0, 0.0, 0.0))).coupling()
    assert tight < loose
    assert loose > 0.99


def test_what_cannot_be_filtered_is_refused() -> None:
    bearings = exact(models.BEARING_2D, a_path(), LANDMARKS)
    with pytest.raises(UsageError, match="do not place a landmark"):
        run(bearings, EkfOptions(association="nearest"))
    with pytest.raises(UsageError, match="joseph"):
        EkfOptions(form="joseph", compressed=True)
    log = SensorLog(bearings.times, bearings.ids, "body", bearings.controls, None, [], bearings.start)
    with pytest.raises(UsageError, match="how precise its odometry"):
        run(log, EkfOptions())
    with pytest.raises(NumericalError, match="not positive definite"):
        state = State(np.zeros(3), np.zeros((3, 3)))
        state.append(np.array([1.0, 1.0]), np.zeros(1, dtype=int), np.zeros((2, 1)), np.zeros((2, 2)))
        stacked = sight(state, stream_of("xy", np.ones((1, 2)), [0.0, 0.0]))
        update(state, stacked)


@pytest.mark.datasets
def test_victoria_park() -> None:
    """The whole run with known association; first-estimates landmarks are where the smoother has them."""
    graph = slamcli.read(str(dataset("landmark2d/victoriaPark_from_isam.g2o")))
    result = run(graph_log(graph), EkfOptions(jacobians="first-estimates"))
    assert result.counts["used"] + result.counts["initialized"] == 3640
    assert len(result.landmarks) == 151
    values = {name: value.copy() for name, value in graph.values.items()}
    values["SE2"][np.argsort(graph.variables["SE2"].rank)] = result.poses
    points = graph.variables["XY"]
    values["XY"][[points.row_of(int(k)) for k in result.landmarks.ids]] = result.landmarks.positions
    optimum = slamcli.optimize(graph.with_values(values)).graph.variables["XY"]
    error = optimum.values[[points.row_of(int(k)) for k in result.landmarks.ids]] - result.landmarks.positions
    solved = np.linalg.solve(result.landmarks.covariances, error[:, :, None])[:, :, 0]
    assert ((error * solved).sum(axis=1) < 9.0).mean() > 0.95  # three sigmas of a plane: 98.9 %
