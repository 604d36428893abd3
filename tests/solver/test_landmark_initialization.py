"""Landmarks without a value: exact sightings lead to them, whatever their kind, frame and order."""

from dataclasses import replace

import numpy as np
import pytest
from graphs import reordered, variables
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from slamcli import models
from slamcli.geometry import se2
from slamcli.graph import FactorGraph, Factors
from slamcli.models import FactorKind
from slamcli.models.base import Array
from slamcli.solver.initialization import landmarks

KINDS = (models.BEARING_2D, models.RANGE_2D, models.RANGE_BEARING_2D, models.POINT_OBSERVATION_2D)
quick = settings(max_examples=40, deadline=None)
seeds = st.integers(0, 2**32 - 1)


def sighted(kind: FactorKind, poses: Array, points: Array, pairs: Array, weight: float = 100.0) -> Factors:
    """Sightings without noise."""
    pairs = np.asarray(pairs, dtype=np.intp).reshape(-1, 2)
    zero = Factors(
        kind,
        pairs,
        np.zeros((len(pairs), kind.measurement_size)),
        np.tile(weight * np.eye(kind.dimension), (len(pairs), 1, 1)),
    )
    sign = 1.0 if kind is models.POINT_OBSERVATION_2D else -1.0
    return replace(zero, measurements=sign * zero.residual({"SE2": poses, "XY": points}))


def unknown(poses: Array, count: int, *factors: Factors) -> FactorGraph:
    """Known poses, and landmarks without values."""
    points = variables(models.XY, range(1000, 1000 + count), np.zeros((count, 2)))
    columns = {
        "SE2": variables(models.SE2, range(len(poses)), poses),
        "XY": replace(points, known=np.zeros(count, dtype=bool)),
    }
    return FactorGraph(columns, list(factors))


def placed(graph: FactorGraph) -> tuple[Array, Array]:
    """Places of the landmarks, and which have one."""
    values = graph.values
    firm = {name: column.known.copy() for name, column in graph.variables.items()}
    landmarks.place(graph, values, firm)
    return values["XY"], firm["XY"]


def world(seed: int, poses: int = 6, points: int = 3) -> tuple[Array, Array, Array]:
    """Poses that stand round about, points among them at a distance from each, and all pairs of them."""
    rng = np.random.default_rng(seed)
    where = np.column_stack([rng.uniform(-5.0, 5.0, (poses, 2)), rng.uniform(-np.pi, np.pi, poses)])
    what = rng.uniform(-8.0, 8.0, (points, 2))
    assume(np.linalg.norm(where[:, None, :2] - what[None], axis=2).min() > 0.3)
    spread = np.linalg.svd(where[:, :2] - where[:, :2].mean(axis=0), compute_uv=False)
    assume(spread[1] > 0.2 * spread[0])
    return where, what, np.stack(np.meshgrid(np.arange(poses), np.arange(points)), axis=2).reshape(-1, 2)


@quick
@given(seed=seeds, kind=st.sampled_from(KINDS))
def test_exact_sightings_lead_to_the_landmark(seed: int, kind: FactorKind) -> None:
    poses, points, pairs = world(seed)
    found, firm = placed(unknown(poses, 3, sighted(kind, poses, points, pairs)))
    assert firm.all()
    assert_allclose(found, points, atol=1e-8)


@quick
@given(seed=seeds)
def test_sightings_of_several_kinds_count_together(seed: int) -> None:
    """A third of the pairs each by bearing, range, and both."""
    poses, points, pairs = world(seed)
    kinds = (models.BEARING_2D, models.RANGE_2D, models.RANGE_BEARING_2D)
    factors = [sighted(kind, poses, points, pairs[k::3]) for k, kind in enumerate(kinds)]
    assert_allclose(placed(unknown(poses, 3, *factors))[0], points, atol=1e-8)


def noisy(seed: int, kind: FactorKind) -> tuple[FactorGraph, Array]:
    poses, points, pairs = world(seed)
    exact = sighted(kind, poses, points, pairs)
    noise = 0.01 * np.random.default_rng(seed + 1).standard_normal(exact.measurements.shape)
    return unknown(poses, 3, replace(exact, measurements=exact.measurements + noise)), poses


@quick
@given(seed=seeds, kind=st.sampled_from(KINDS))
def test_landmarks_move_with_the_poses(seed: int, kind: FactorKind) -> None:
    """A rigid motion of the poses, by kilometres, moves every landmark as well."""
    graph, poses = noisy(seed, kind)
    motion = np.array([[1234.5, -6789.0, 2.1]])
    moved = se2.compose(np.repeat(motion, len(poses), axis=0), poses)
    there = replace(graph, variables={**graph.variables, "SE2": variables(models.SE2, range(len(poses)), moved)})
    found, other = placed(graph)[0], placed(there)[0]
    assert_allclose(other, se2.act(np.repeat(motion, 3, axis=0), found), atol=1e-6)


@quick
@given(seed=seeds, kind=st.sampled_from(KINDS))
def test_the_order_of_edges_does_not_matter(seed: int, kind: FactorKind) -> None:
    graph, _ = noisy(seed, kind)
    order = np.random.default_rng(seed).permutation(len(graph.factors[0]))
    shuffled = replace(graph, factors=[reordered(graph.factors[0], order)])
    assert_allclose(placed(shuffled)[0], placed(graph)[0], atol=1e-8)


def test_ranges_of_a_straight_path_leave_the_side_open_and_a_bearing_tells() -> None:
    poses = np.column_stack([np.arange(5.0), np.zeros((5, 2))])
    points = np.array([[2.0, -3.0]])
    pairs = [(k, 0) for k in range(5)]
    ranges = sighted(models.RANGE_2D, poses, points, pairs)
    assert_allclose(placed(unknown(poses, 1, ranges))[0], [[2.0, 3.0]], atol=1e-8)  # left of the path, by agreement
    bearing = sighted(models.BEARING_2D, poses, points, [(0, 0)])
    assert_allclose(placed(unknown(poses, 1, ranges, bearing))[0], points, atol=1e-8)


def test_the_value_of_the_file_decides_between_equals() -> None:
    poses = np.column_stack([np.arange(5.0), np.zeros((5, 2))])
    graph = unknown(poses, 1, sighted(models.RANGE_2D, poses, np.array([[2.0, 3.0]]), [(k, 0) for k in range(5)]))
    point = replace(graph.variables["XY"], values=np.array([[1.0, -0.5]]), known=np.array([True]))
    values = {**graph.values, "XY": point.values}
    landmarks.place(
        replace(graph, variables={**graph.variables, "XY": point}),
        values,
        {"SE2": np.ones(5, dtype=bool), "XY": np.zeros(1, dtype=bool)},
    )
    assert_allclose(values["XY"], [[2.0, -3.0]], atol=1e-8)


def test_a_range_and_a_bearing_from_one_pose_are_a_point() -> None:
    poses, points = np.array([[1.0, 2.0, 0.5]]), np.array([[4.0, -2.0]])
    factors = [sighted(kind, poses, points, [(0, 0)]) for kind in (models.RANGE_2D, models.BEARING_2D)]
    assert_allclose(placed(unknown(poses, 1, *factors))[0], points, atol=1e-8)


def test_all_points_seen_count_by_their_information() -> None:
    """Hand-worked: (1, 0) with the weight 3 and (5, 0) with the weight 1 make (2, 0)."""
    poses = np.zeros((2, 3))
    seen = Factors(
        models.POINT_OBSERVATION_2D,
        np.array([[0, 0], [1, 0]]),
        np.array([[1.0, 0.0], [5.0, 0.0]]),
        np.array([3.0 * np.eye(2), np.eye(2)]),
    )
    assert_allclose(placed(unknown(poses, 1, seen))[0], [[2.0, 0.0]], atol=1e-12)


@pytest.mark.parametrize(
    ("kind", "places", "count"),
    [
        (models.BEARING_2D, [[0.0, 0.0]], 1),
        (models.RANGE_2D, [[0.0, 0.0]], 1),
        (models.RANGE_2D, [[0.0, 0.0], [0.0, 0.0]], 2),
        (models.BEARING_2D, [[0.0, 0.0], [0.0, 0.0]], 2),
        (models.BEARING_2D, [[0.0, 0.0], [1.0, 1.0]], 2),  # along one line
    ],
)
def test_what_determines_no_place(kind: FactorKind, places: list[list[float]], count: int) -> None:
    poses = np.column_stack([places, np.zeros(count)])
    factors = sighted(kind, poses, np.array([[4.0, 4.0]]), [(k, 0) for k in range(count)])
    assert not placed(unknown(poses, 1, factors))[1].any()
