"""The chordal start where priors or points tell where poses are and how they are turned."""

from dataclasses import replace

import numpy as np
import pytest
from chordal_graphs import PLANE, SPACE, assert_truth, landmark_graph, spoiled, start, with_factors
from graphs import exact_graph, information, random_values, variables
from numpy.testing import assert_allclose, assert_array_equal
from support import dataset

import slamcli
from slamcli import models
from slamcli.geometry import se3
from slamcli.graph import FactorGraph, Factors
from slamcli.models import FactorKind
from slamcli.solver import gauge
from slamcli.solver.result import Status


def test_pose_priors_orient_in_space_through_the_sensor_offset() -> None:
    truth = exact_graph(*SPACE, 15, 6)
    rng = np.random.default_rng(6)
    rows, offset = np.array([[3], [8]]), random_values(rng, models.SE3, 2)
    wanted = models.SE3.normalize(se3.compose(truth.values["SE3"][rows[:, 0]], offset))
    prior = Factors(models.POSE_PRIOR_3D, rows, wanted, information(rng, 2, 6), offset)
    assert_truth(truth, start(spoiled(with_factors(truth, prior), {})))


def test_pose_priors_orient_in_the_plane() -> None:
    truth = exact_graph(*PLANE, 15, 6)
    prior = Factors(models.POSE_PRIOR_2D, np.array([[3]]), truth.values["SE2"][[3]], np.eye(3)[None])
    assert_truth(truth, start(spoiled(with_factors(truth, prior), {})))


@pytest.mark.parametrize("space", [2, 3])
def test_priors_on_positions_turn_a_graph_that_nothing_else_orients(space: int) -> None:
    """Satellite fixes in metres far from the origin, and no value to start from."""
    truth = exact_graph(*(PLANE if space == 2 else SPACE), 15, 7)
    (name,) = truth.variables
    moved = truth.values[name].copy()
    moved[:, :space] += 5e5
    truth = truth.with_values({name: moved})
    rows = np.arange(6)[:, None]
    kind = models.POSITION_PRIOR_2D if space == 2 else models.POSITION_PRIOR_3D
    offsets = None if kind.parameter is None else np.tile(kind.parameter.identity, (6, 1))
    prior = Factors(kind, rows, moved[:6, :space], information(np.random.default_rng(7), 6, space), offsets)
    assert_truth(truth, start(spoiled(with_factors(truth, prior), {})), 1e-6)


@pytest.mark.parametrize(
    "kind",
    [models.POINT_OBSERVATION_2D, models.POINT_OBSERVATION_3D, models.RANGE_BEARING_2D, models.BEARING_2D],
    ids=lambda kind: kind.name,
)
def test_exact_landmarks(kind: FactorKind) -> None:
    """Points in the frames of poses or of sensors on them, ranges with bearings, and bearings alone."""
    truth = landmark_graph(kind)
    assert truth.chi2() == pytest.approx(0.0, abs=1e-18)
    assert_truth(truth, start(spoiled(truth)))


@pytest.mark.parametrize("kind", [models.POINT_OBSERVATION_2D, models.POINT_OBSERVATION_3D], ids=["plane", "space"])
def test_points_tell_rotations_where_no_chain_of_poses_does(kind: FactorKind) -> None:
    """Without any relative pose but one: the poses hang together through the points that they see."""
    truth = landmark_graph(kind)
    rng = np.random.default_rng(5)
    pairs = np.stack([np.repeat(np.arange(12), 6), np.tile(np.arange(8), 9)], axis=1)
    parameters = None if kind.parameter is None else random_values(rng, models.SE3, 72)
    zero = Factors(kind, pairs, np.zeros((72, kind.dimension)), information(rng, 72, kind.dimension), parameters)
    seen = replace(zero, measurements=zero.residual(truth.values))
    truth = replace(truth, factors=[truth.factors[0].part(slice(0, 1)), seen])
    assert_truth(truth, start(spoiled(truth)), 1e-7)


@pytest.mark.parametrize("kind", [models.POINT_OBSERVATION_2D, models.POINT_OBSERVATION_3D], ids=["plane", "space"])
def test_a_pose_prior_orients_poses_and_points(kind: FactorKind) -> None:
    truth = landmark_graph(kind)
    pose = kind.variables[0]
    prior, offsets = models.POSE_PRIOR_2D, None
    if pose is models.SE3:
        prior, offsets = models.POSE_PRIOR_3D, np.array([models.SE3.identity])
    at = Factors(prior, np.array([[3]]), truth.values[pose.name][[3]], np.eye(pose.dimension)[None], offsets)
    assert_truth(truth, start(spoiled(with_factors(truth, at), {})))


def test_two_fixed_landmarks_orient_the_poses() -> None:
    truth = landmark_graph(models.POINT_OBSERVATION_2D).with_fixed([101, 105])
    assert gauge.choose(truth)[0].held == (101, 105)
    assert_truth(truth, start(spoiled(truth, {"XY": [1, 5]})))


def test_bearings_from_one_place_leave_the_point_where_it_is() -> None:
    truth = landmark_graph(models.BEARING_2D)
    bearings = truth.factors[1]
    blind = np.flatnonzero((bearings.indices[:, 1] != 3) | (np.arange(40) == 3))
    graph = spoiled(replace(truth, factors=[truth.factors[0], bearings.part(blind)]))
    found = start(graph)
    assert_array_equal(found["XY"][3], graph.values["XY"][3])
    assert_allclose(np.delete(found["XY"], 3, axis=0), np.delete(truth.values["XY"], 3, axis=0), atol=1e-8)


def test_a_point_without_value_that_one_bearing_sees_is_held_back() -> None:
    truth = landmark_graph(models.BEARING_2D)
    points = truth.variables["XY"]
    known = points.known.copy()
    known[3] = False
    bearings = truth.factors[1].part(np.flatnonzero((truth.factors[1].indices[:, 1] != 3) | (np.arange(40) == 3)))
    graph = FactorGraph({**truth.variables, "XY": replace(points, known=known)}, [truth.factors[0], bearings])
    result = slamcli.optimize(graph, init="chordal")
    assert result.status is Status.CONVERGED
    assert [(landmark.id, landmark.reason) for landmark in result.under_observed] == [(103, "a single bearing")]


def test_points_hang_off_triangulated_points() -> None:
    truth = landmark_graph(models.BEARING_2D)
    point = variables(models.XY, [200], np.add(truth.values["XY"][:1], [1.0, 2.0]))
    points = truth.variables["XY"].followed_by(replace(point, known=np.array([False])))
    step = Factors(models.POINT_DIFFERENCE_2D, np.array([[0, 8]]), np.array([[1.0, 2.0]]), np.eye(2)[None])
    unknown = replace(points, known=np.zeros(9, dtype=bool))
    graph = with_factors(replace(truth, variables={**truth.variables, "XY": unknown}), step)
    assert_allclose(start(graph)["XY"], points.values, atol=1e-8)


def test_points_alone_are_solved() -> None:
    rng = np.random.default_rng(2)
    values = rng.standard_normal((6, 3))
    pairs = np.array([[0, 1], [1, 2], [2, 3], [3, 4], [4, 5], [5, 0]])
    steps = Factors(
        models.POINT_DIFFERENCE_3D, pairs, values[pairs[:, 1]] - values[pairs[:, 0]], information(rng, 6, 3)
    )
    truth = FactorGraph({"XYZ": variables(models.XYZ, range(6), values)}, [steps])
    assert_truth(truth, start(spoiled(truth, {"XYZ": [0]})))


@pytest.mark.datasets
def test_victoria_park() -> None:
    """Loops close through trees only; from the file's values Gauss-Newton ends at 30 607."""
    result = slamcli.optimize(slamcli.read(str(dataset("landmark2d/victoriaPark-full.g2o"))), init="chordal")
    assert result.status is Status.CONVERGED
    assert result.final_chi2 == pytest.approx(389.787423, rel=1e-6)
    assert result.iterations <= 10
