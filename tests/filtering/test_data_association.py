"""Gates, nearest neighbours and joint compatibility against brute force; runs without ids."""

from __future__ import annotations

import itertools
import math

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from numpy.testing import assert_allclose
from sensor_logs import simulated

from slamcli.filtering.association import Pairs, compare, gate, joint_compatibility, nearest
from slamcli.filtering.innovation import SENSORS
from slamcli.filtering.options import EkfOptions
from slamcli.filtering.readings import Reading, Stream
from slamcli.filtering.run import run
from slamcli.filtering.state import State
from slamcli.models.base import Array

pytestmark = pytest.mark.filterwarnings("error")


def a_map(points: Array, pose_covariance: Array, landmark_deviation: float) -> State:
    """A robot at the origin and landmarks whose errors are independent."""
    state = State(np.zeros(3), pose_covariance)
    for point in points:
        blank = np.zeros((2, 1))
        state.append(point, np.zeros(1, dtype=int), blank, np.eye(2) * landmark_deviation**2)
    return state


def readings(points: Array, deviation: float, name: str = "xy") -> tuple[list[Stream], list[Reading]]:
    """Readings at these points in the frame of the robot."""
    values = points if name == "xy" else np.column_stack([np.hypot(*points.T), np.arctan2(points[:, 1], points[:, 0])])
    count, distance = len(points), np.hypot(points[:, 0], points[:, 1])
    scale = np.ones((count, 2)) if name == "xy" else np.column_stack([np.ones(count), 1.0 / distance])
    noise = np.stack([np.diag(np.square(deviation * row)) for row in scale])
    stream = Stream(SENSORS[name], [-1] * count, values, noise, np.ones(count, dtype=bool), distance, [0, count])
    return [stream], [Reading(0, k) for k in range(count)]


def joint_distance(pairs: Pairs, chosen: list[int]) -> float:
    rows = [row for pair in chosen for row in (2 * pair, 2 * pair + 1)]
    nu = pairs.innovation[chosen].ravel()
    return float(nu @ np.linalg.solve(pairs.covariance[np.ix_(rows, rows)], nu))


def hypotheses(pairs: Pairs) -> list[list[int]]:
    """All sets of pairs with no reading and no landmark twice."""
    by_reading = [[None, *np.flatnonzero(pairs.readings == reading).tolist()] for reading in np.unique(pairs.readings)]
    out = []
    for choice in itertools.product(*by_reading):
        chosen = [pair for pair in choice if pair is not None]
        if len(set(pairs.landmarks[chosen].tolist())) == len(chosen):
            out.append(chosen)
    return out


def test_gates() -> None:
    """Two degrees of freedom have a closed form, and the 95 % bounds are in every table."""
    assert gate(2, 0.99) == pytest.approx(-2.0 * math.log(0.01), rel=1e-12)
    assert gate(1, 0.95) == pytest.approx(3.841459, abs=1e-6)
    assert gate(6, 0.95) == pytest.approx(12.591587, abs=1e-6)


@given(st.integers(0, 10_000), st.sampled_from(["xy", "range-bearing"]))
@settings(max_examples=40)
def test_distances_and_searches_against_brute_force(seed: int, name: str) -> None:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 3)) * [[0.4], [0.4], [0.05]]
    state = a_map(rng.uniform(2.0, 5.0, (5, 2)), root @ root.T, 0.3)
    streams, given_readings = readings(rng.uniform(2.0, 5.0, (4, 2)), 0.2, name)
    pairs = compare(state, streams, given_readings, state.blocks, 50.0)
    for k in range(len(pairs)):
        assert pairs.distance[k] == pytest.approx(joint_distance(pairs, [k]), rel=1e-8)
    pairs = pairs.inside(gate(2, 0.99))
    every = hypotheses(pairs)

    distances = {tuple(chosen): joint_distance(pairs, chosen) if chosen else 0.0 for chosen in every}
    compatible = [chosen for chosen in every if not chosen or distances[tuple(chosen)] <= gate(2 * len(chosen), 0.99)]
    # a branch is cut at its first incompatible pair: what is compatible as a whole must be so in the order of search
    found = joint_compatibility(pairs, 0.99, 1_000_000)
    assert found.complete
    chosen = [
        int(np.flatnonzero((pairs.readings == i) & (pairs.landmarks == j))[0]) for i, j in found.landmarks.items()
    ]
    assert found.distance == pytest.approx(joint_distance(pairs, chosen) if chosen else 0.0, rel=1e-7, abs=1e-9)
    most = max(len(option) for option in compatible)
    assert len(found.landmarks) <= most
    reachable = [option for option in compatible if _reachable(pairs, option)]
    most = max(len(option) for option in reachable)
    assert len(found.landmarks) == most
    least = min(distances[tuple(option)] for option in reachable if len(option) == most)
    assert found.distance == pytest.approx(least, rel=1e-7, abs=1e-9)

    bound = gate(2, 0.99)
    price = min(sum(pairs.distance[o]) + bound * (len(np.unique(pairs.readings)) - len(o)) for o in every)
    taken = nearest(pairs, bound)
    total = sum(float(pairs.distance[(pairs.readings == i) & (pairs.landmarks == j)][0]) for i, j in taken.items())
    assert total + bound * (len(np.unique(pairs.readings)) - len(taken)) == pytest.approx(price, rel=1e-9)
    assert len(set(taken.values())) == len(taken)


def _reachable(pairs: Pairs, chosen: list[int]) -> bool:
    """Whether every beginning of a hypothesis, in the order of the search, is compatible too."""
    levels: dict[int, list[int]] = {}
    for pair in np.argsort(pairs.distance, kind="stable").tolist():
        levels.setdefault(int(pairs.readings[pair]), []).append(pair)
    order = sorted(levels.values(), key=lambda options: (len(options), pairs.distance[options[0]]))
    ranked = sorted(chosen, key=lambda pair: next(k for k, options in enumerate(order) if pair in options))
    return all(joint_distance(pairs, ranked[:k]) <= gate(2 * k, 0.99) * (1 + 1e-12) for k in range(1, len(ranked) + 1))


def test_no_landmark_is_taken_twice() -> None:
    state = a_map(np.array([[3.0, 0.0]]), np.diag([0.01, 0.01, 1e-6]), 0.1)
    streams, given_readings = readings(np.array([[3.2, 0.0], [3.1, 0.0]]), 0.1)
    pairs = compare(state, streams, given_readings, state.blocks, 50.0)
    assert nearest(pairs, gate(2, 0.99)) == {1: 0}
    assert joint_compatibility(pairs.inside(gate(2, 0.99)), 0.99, 1000).landmarks == {1: 0}


def test_joint_compatibility_where_the_nearest_is_wrong() -> None:
    """A pose error of 0.6 m brings every reading next to a neighbour; only one shift explains them together."""
    points = np.array([[0.0, 5.0], [1.0, 5.0], [3.0, 5.0], [3.7, 5.0]])
    state = a_map(points, np.diag([0.36, 1e-4, 1e-8]), 0.02)
    streams, given_readings = readings(points[[0, 2]] + [0.6, 0.0], 0.05)
    pairs = compare(state, streams, given_readings, state.blocks, 50.0)
    assert nearest(pairs, gate(2, 0.99)) == {0: 1, 1: 3}
    assert joint_compatibility(pairs.inside(gate(2, 0.99)), 0.99, 1000).landmarks == {0: 0, 1: 2}


def test_a_landmark_behind_the_robot_is_associated() -> None:
    """Its bearings are on either side of +-pi."""
    state = a_map(np.array([[-5.0, -0.05]]), np.diag([0.01, 0.01, 1e-4]), 0.05)
    streams, given_readings = readings(np.array([[-5.0, 0.05]]), 0.05, "range-bearing")
    pairs = compare(state, streams, given_readings, state.blocks, gate(2, 0.99))
    assert pairs.distance[0] < 2.0


def test_a_search_that_is_cut_short_says_so() -> None:
    points = np.column_stack([np.arange(6.0) * 0.1, np.full(6, 5.0)])
    state = a_map(points, np.diag([1.0, 1.0, 1e-4]), 0.3)
    streams, given_readings = readings(points, 0.3)
    pairs = compare(state, streams, given_readings, state.blocks, gate(2, 0.99))
    cut = joint_compatibility(pairs, 0.99, 3)
    assert not cut.complete
    assert cut.nodes == 3
    assert joint_compatibility(pairs, 0.99, 100_000).complete


def world(**more: object) -> dict[str, object]:
    return {
        "world": "manhattan",
        "poses": 150,
        "landmarks": {"count": 50},
        "robot": {"noise": [0.05, 0.05, 0.02]},
        **more,
    }


@pytest.mark.parametrize("association", ["nearest", "jcbb"])
def test_a_run_without_ids_finds_them(association: str) -> None:
    log = simulated(**world(sensors=[{"kind": "xy", "range": 8}]))
    result = run(log, EkfOptions(association=association))
    counts = result.association
    assert counts.correct > 100
    assert counts.wrong <= 0.02 * counts.made
    assert counts.made == result.counts["used"] == counts.correct + counts.wrong
    truth = dict(zip(log.true_landmarks[0].tolist(), log.true_landmarks[1], strict=True))  # type: ignore[index]
    seen = result.landmarks.sightings >= 10
    errors = np.array([truth[k] for k in result.landmarks.ids[seen].tolist()]) - result.landmarks.positions[seen]
    assert np.hypot(errors[:, 0], errors[:, 1]).max() < 1.0
    assert (result.assignments[0] >= 0).sum() == result.counts["used"] + result.counts["initialized"]


def test_clutter_is_deleted() -> None:
    """Readings of nothing start landmarks that are not seen again: they go, and none of them is confirmed."""
    log = simulated(**world(sensors=[{"kind": "xy", "range": 8, "false_alarms": 0.3}]))
    result = run(log, EkfOptions(association="jcbb", provisional_steps=10))
    confirmed = result.landmarks.ids[result.landmarks.confirmed]
    assert result.association.deleted > 10
    assert np.count_nonzero(confirmed < 0) <= 1
    assert result.association.started == result.association.deleted + len(result.landmarks)
    assert_allclose(result.covariance(), result.covariance().T)
