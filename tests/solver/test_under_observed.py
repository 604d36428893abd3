"""Landmarks that their edges do not determine are named and held back; those with two places are named."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from support import dataset, write_file

import slamcli
from slamcli.errors import InputError, NumericalError
from slamcli.formats.writer import render
from slamcli.graph import FactorGraph
from slamcli.simulation.settings import scenario_of
from slamcli.simulation.simulate import Simulation, simulate
from slamcli.solver.covariance import CovarianceRequest, recover, recovery_at, recovery_of
from slamcli.solver.result import Result, Status

# Five poses along a bent path, and the landmark 9, which is all right.
PATH = """\
VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1 0 0
VERTEX_SE2 2 2 0 0
VERTEX_SE2 3 2 1 1.5707963267948966
EDGE_SE2 0 1 1 0 0 100 0 0 100 0 1000
EDGE_SE2 1 2 1 0 0 100 0 0 100 0 1000
EDGE_SE2 2 3 0 1 1.5707963267948966 100 0 0 100 0 1000
EDGE_SE2_XY 0 9 3 2.1 10 0 10
EDGE_SE2_XY 2 9 1 2 10 0 10
"""


def optimized(tmp_path: Path, text: str, **options: object) -> Result:
    graph = slamcli.read(str(write_file(tmp_path, text)))
    return slamcli.optimize(graph, **options)  # type: ignore[arg-type]


def ids(result: Result) -> list[int]:
    return [landmark.id for landmark in result.under_observed]


@pytest.mark.parametrize(
    ("edges", "reason"),
    [
        ("EDGE_BEARING_SE2_XY 0 7 0.8 400\n", "a single bearing"),
        ("EDGE_RANGE_SE2_XY 0 7 2.5 100\n", "a single range"),
        ("EDGE_RANGE_SE2_XY 0 7 2.5 100\nEDGE_RANGE_SE2_XY 0 7 2.6 100\n", "2 ranges from one direction"),
        ("EDGE_BEARING_SE2_XY 0 7 0 400\nEDGE_BEARING_SE2_XY 1 7 0 400\n", "2 bearings that do not cross"),
        ("EDGE_BEARING_SE2_XY 0 7 0.3 400\nEDGE_BEARING_SE2_XY 1 7 0.28 400\n", "2 bearings that do not cross"),
        ("", "no edge"),
        ("EDGE_SE2_XY 0 7 3 1 1 0 0\n", "a single edge"),  # nothing weighs y
        ("EDGE_SE2_XY 0 7 3 1 0 0 0\n", "1 edge without information"),
    ],
)
@pytest.mark.parametrize("value", ["VERTEX_XY 7 4.25 -1.5\n", ""])
@pytest.mark.parametrize("init", ["auto", "file", "odometry", "chordal"])
def test_it_is_named_and_left_as_it_was(edges: str, reason: str, value: str, init: str, tmp_path: Path) -> None:
    if not edges and not value:
        return  # then it is not there at all
    result = optimized(tmp_path, value + PATH + edges, init=init)
    alone = optimized(tmp_path, PATH, init=init)
    (found,) = result.under_observed
    assert (found.id, found.kind, found.edges) == (7, "XY", edges.count("\n"))
    assert (found.reason, found.has_value) == (reason, bool(value))
    assert result.status is Status.CONVERGED
    assert (result.final_chi2, result.dof) == (pytest.approx(alone.final_chi2, rel=1e-9), alone.dof)
    lines = render(result.graph).data.decode().splitlines()
    assert [line for line in lines if line.startswith("VERTEX_XY 7")] == value.splitlines()
    assert [line for line in lines if line.startswith("EDGE")] == (PATH + edges).splitlines()[4:]


JOINED = "EDGE_BEARING_SE2_XY 0 7 0.8 400\nEDGE_POINTXY 7 8 1 0 100 0 100\n"


@pytest.mark.parametrize("values", ["VERTEX_XY 7 2 2\nVERTEX_XY 8 3 2\n", ""])
def test_landmarks_do_not_determine_each_other(values: str, tmp_path: Path) -> None:
    """A single bearing for two that are joined is too little for both; a point seen of either is enough for both."""
    result = optimized(tmp_path, values + PATH + JOINED)
    assert [(one.id, one.edges, one.reason) for one in result.under_observed] == [
        (7, 2, "2 edges that leave a direction open"),
        (8, 1, "a single edge"),
    ]
    assert result.held_back is not None
    assert result.held_back.edges == 2
    assert result.final_chi2 == pytest.approx(optimized(tmp_path, PATH).final_chi2, rel=1e-9)
    seen = optimized(tmp_path, values + PATH + JOINED + "EDGE_SE2_XY 1 8 2 2 10 0 10\n")
    assert (seen.under_observed, seen.status) == ((), Status.CONVERGED)
    rays = "EDGE_BEARING_SE2_XY 1 8 0.8 400\nEDGE_BEARING_SE2_XY 2 8 1.2 400\n"
    assert optimized(tmp_path, values + PATH + JOINED + rays).under_observed == ()


def test_joined_landmarks_apart_from_all_poses_are_for_the_gauge(tmp_path: Path) -> None:
    alone = "VERTEX_XY 7 2 2\nVERTEX_XY 8 3 2.5\nEDGE_POINTXY 7 8 1 0 100 0 100\n"
    result = optimized(tmp_path, PATH + alone)
    assert (result.under_observed, result.gauge.held) == ((), (0, 7))


def test_edges_that_are_none_are_not_hidden(tmp_path: Path) -> None:
    """An indefinite information matrix is an error, whatever the landmark is."""
    result = optimized(tmp_path, PATH + "EDGE_SE2_XY 0 7 1 1 -100 0 100\n")
    assert result.status is Status.FAILED
    assert "indefinite" in result.reason


def test_what_is_fixed_needs_a_value(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="XY 7 is fixed, and has no value"):
        optimized(tmp_path, PATH + "EDGE_BEARING_SE2_XY 0 7 0.8 400\n", fix=(7,))


def test_the_gauge_of_a_landmark_that_is_held_back_is_not_said(tmp_path: Path) -> None:
    assert optimized(tmp_path, PATH + "VERTEX_XY 7 1 1\n").gauge.held == (0,)


def test_what_is_fixed_is_not_held_back(tmp_path: Path) -> None:
    text = PATH + "VERTEX_XY 7 3 3\nEDGE_BEARING_SE2_XY 0 7 0.8 400\n"
    for result in (optimized(tmp_path, text + "FIX 7\n"), optimized(tmp_path, text, fix=(7,))):
        assert result.under_observed == ()
        assert result.final_chi2 > 0.01  # the bearing is off by 0.8 - pi / 4


def test_crossing_sightings_of_any_noise_are_enough(tmp_path: Path) -> None:
    """Information matrices of 1 for want of better ones: 57 degrees of noise, but rays that cross at 90 degrees."""
    text = PATH + "EDGE_BEARING_SE2_XY 0 7 0.7853981633974483 1\nEDGE_BEARING_SE2_XY 2 7 2.356194490192345 1\n"
    result = optimized(tmp_path, text)
    assert result.under_observed == ()
    column = result.graph.variables["XY"]
    assert_allclose(column.values[column.row_of(7)], [1.0, 1.0], atol=0.05)


def test_bearings_without_parallax_beyond_the_noise_are_too_few(tmp_path: Path) -> None:
    """The same two rays, 0.02 rad between them: determined by a noise of 0.002 rad, not by one of 0.02 rad."""
    text = PATH + "EDGE_BEARING_SE2_XY 0 7 0.30 {0}\nEDGE_BEARING_SE2_XY 1 7 0.32 {0}\n"
    assert ids(optimized(tmp_path, text.format(1 / 0.002**2))) == []
    assert ids(optimized(tmp_path, text.format(1 / 0.02**2))) == [7]


def test_two_places_are_named(tmp_path: Path) -> None:
    """Ranges from a straight path: the mirror image fits as well, until a range from off the line tells."""
    ranges = "EDGE_RANGE_SE2_XY 0 7 3.605551 400\nEDGE_RANGE_SE2_XY 1 7 3.162278 400\nEDGE_RANGE_SE2_XY 2 7 3 400\n"
    (found,) = optimized(tmp_path, PATH + ranges).ambiguous
    assert found.id == 7
    assert sorted(round(place[1], 1) for place in (found.place, found.other)) == [-3.0, 3.0]
    assert abs(found.chi2_difference) < 1.0
    told = optimized(tmp_path, PATH + ranges + "EDGE_RANGE_SE2_XY 3 7 4 400\n")
    assert told.ambiguous == ()
    column = told.graph.variables["XY"]
    assert_allclose(column.values[column.row_of(7)], [2.0, -3.0], atol=0.05)


def test_covariances_are_those_of_what_is_optimized(tmp_path: Path) -> None:
    held_back = optimized(tmp_path, "VERTEX_XY 7 1 1\nEDGE_BEARING_SE2_XY 0 7 0.8 400\n" + PATH)
    found, alone = (recover(recovery_of(r), CovarianceRequest()) for r in (held_back, optimized(tmp_path, PATH)))
    for mine, other in zip(found.marginals, alone.marginals, strict=True):
        assert_array_equal(mine.ids, other.ids)
        assert_allclose(mine.covariance, other.covariance, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("value", ["VERTEX_XY 7 1 1\n", ""])
def test_covariances_of_a_file_hold_back_as_well(value: str, tmp_path: Path) -> None:
    """Everything else has the covariances that it has alone; what is held back has none."""
    point = "VERTEX_XY 9 3 2\n"
    graphs = [
        slamcli.read(str(write_file(tmp_path, text)))
        for text in (value + "EDGE_BEARING_SE2_XY 0 7 0.8 400\n" + point + PATH, point + PATH)
    ]
    found, alone = (recover(recovery_at(graph), CovarianceRequest()) for graph in graphs)
    assert [(landmark.id, landmark.reason) for landmark in found.under_observed] == [(7, "a single bearing")]
    assert alone.under_observed == ()
    for mine, other in zip(found.marginals, alone.marginals, strict=True):
        assert_array_equal(mine.ids, other.ids)
        assert_allclose(mine.covariance, other.covariance, rtol=1e-9)
    with pytest.raises(NumericalError, match="landmark 7 do not determine it"):
        recover(recovery_at(graphs[0]), CovarianceRequest(ids=(7,)))


def test_robust_runs_hold_back_as_well(tmp_path: Path) -> None:
    text = PATH + "EDGE_SE2 0 3 2 1 1.5707963267948966 100 0 0 100 0 1000\nEDGE_BEARING_SE2_XY 0 7 0.8 400\n"
    result = optimized(tmp_path, text, robust="pcm+gnc")
    assert ids(result) == [7]
    assert result.rejection is not None
    assert [len(mask) for mask in result.rejection.rejected] == [len(f) for f in result.graph.factors]


def test_nothing_but_a_bearing_is_told_as_before(tmp_path: Path) -> None:
    """Without it no edge would be left."""
    result = optimized(tmp_path, "VERTEX_SE2 0 0 0 0\nVERTEX_XY 7 3 3\nEDGE_BEARING_SE2_XY 0 7 0.8 400\n")
    assert result.status is Status.FAILED
    assert result.under_observed == ()


def drawn(kind: str, seed: int, poses: int = 200) -> Simulation:
    """Poses in streets, with landmarks that one kind of sensor sees."""
    content = {"world": "manhattan", "poses": poses, "seed": seed, "landmarks": {"density": 0.02}}
    return simulate(scenario_of({**content, "sensors": [{"kind": kind}]}, "test"))


def without_landmarks(graph: FactorGraph) -> FactorGraph:
    points = graph.variables["XY"]
    unknown = replace(points, values=np.zeros_like(points.values), known=np.zeros(len(points), dtype=bool))
    return replace(graph, variables={**graph.variables, "XY": unknown})


@pytest.mark.parametrize("kind", ["bearing", "range"])
@pytest.mark.parametrize("seed", [1, 2])
def test_simulated_landmarks_come_to_their_truth(kind: str, seed: int) -> None:
    """From odometry, with and without values of the landmarks: chi2 within five deviations, landmarks at the truth."""
    simulation = drawn(kind, seed)
    graph = simulation.graph
    results = [slamcli.optimize(graph), slamcli.optimize(without_landmarks(graph))]
    for result in results:
        assert result.status is Status.CONVERGED
        assert abs(result.final_chi2 - result.dof) < 5.0 * np.sqrt(2.0 * result.dof)
        named = ids(result) + [landmark.id for landmark in result.ambiguous]
        points = result.graph.variables["XY"]
        sure = ~np.isin(points.ids, named)
        assert sure.sum() > 0.8 * len(points)
        off = points.values - simulation.truth.variables["XY"].values
        assert np.sqrt(np.square(off[sure]).sum(axis=1).mean()) < 0.7
    assert results[0].final_chi2 == pytest.approx(results[1].final_chi2, rel=1e-6)


@pytest.mark.datasets
def test_the_bearing_only_set_converges_from_everywhere() -> None:
    graph = slamcli.read(str(dataset("landmark2d/slam-2d-bearingOnly.g2o")))
    for result in (
        slamcli.optimize(graph),
        slamcli.optimize(graph, init="odometry"),
        slamcli.optimize(without_landmarks(graph)),
    ):
        assert result.status is Status.CONVERGED
        assert result.final_chi2 == pytest.approx(855.565405, abs=1e-4)
        assert {89, 107, 142, 272} <= set(ids(result))  # a single bearing


@pytest.mark.datasets
def test_the_range_only_set_comes_to_its_truth() -> None:
    truth = slamcli.read(str(dataset("landmark2d/slam2d_range_only_ground_truth.g2o")))
    result = slamcli.optimize(slamcli.read(str(dataset("landmark2d/slam2d_range_only_initial_guess.g2o"))))
    assert ids(result) == [62]
    named = [landmark.id for landmark in result.ambiguous]
    assert named == [7, 36, 41, 42, 73, 79]
    assert result.final_chi2 == pytest.approx(1.864038, abs=1e-5)
    poses, points = result.graph.variables["SE2"], result.graph.variables["XY"]
    wanted, found = truth.variables["SE2"], poses.values[poses.rows_of(truth.variables["SE2"].ids)]
    sure = truth.variables["XY"].ids[~np.isin(truth.variables["XY"].ids, [62, *named])]
    a, b = found[:, :2], wanted.values[:, :2]
    u, _, v = np.linalg.svd((b - b.mean(axis=0)).T @ (a - a.mean(axis=0)))
    rotation = u @ np.diag([1.0, np.linalg.det(u @ v)]) @ v
    off = (a - a.mean(axis=0)) @ rotation.T + b.mean(axis=0) - b
    assert np.sqrt(np.square(off).sum(axis=1).mean()) < 0.03
    mine = (points.values[points.rows_of(sure)] - a.mean(axis=0)) @ rotation.T + b.mean(axis=0)
    off = mine - truth.variables["XY"].values[truth.variables["XY"].rows_of(sure)]
    assert np.sqrt(np.square(off).sum(axis=1).mean()) < 0.03
    assert np.abs(off).max() < 0.1


def test_a_landmark_that_runs_away_is_not_left_out_but_reached_by_bounded_steps() -> None:
    """From the odometry of 1000 poses a step of Gauss-Newton sends a landmark to where H is singular."""
    graph = without_landmarks(drawn("bearing", 1, poses=1000).graph)
    result = slamcli.optimize(graph, init="odometry")
    assert (result.status, result.options.method) == (Status.CONVERGED, "auto")
    assert "dogleg" in result.start
    assert result.final_chi2 / result.dof < 1.1
    assert len(result.under_observed) <= 1
