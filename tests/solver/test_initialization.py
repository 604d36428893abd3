"""Where a run starts: odometry chains, spanning trees, partial files, landmarks."""

from pathlib import Path

import numpy as np
import pytest
from graphs import FactorGraph, bundled, exact_graph, random_values, variables
from numpy.testing import assert_allclose, assert_array_equal
from support import write_file

import slamcli
from slamcli import models
from slamcli.graph import Factors
from slamcli.solver.result import Result

INFO = "1 0 0 1 0 1"


def start(tmp_path: Path, text: str, init: str) -> Result:
    return slamcli.optimize(slamcli.read(str(write_file(tmp_path, text))), init=init, max_iterations=0)


@pytest.mark.parametrize("init", ["odometry", "spanning-tree"])
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("space", [2, 3])
def test_exact_edges_place_every_pose_at_the_truth(init: str, seed: int, space: int) -> None:
    """From values that are far off: only the held pose's is used."""
    kind, relative = (models.SE2, models.RELATIVE_POSE_2D) if space == 2 else (models.SE3, models.RELATIVE_POSE_3D)
    truth = exact_graph(kind, relative, 40, seed)
    wrong = random_values(np.random.default_rng(99), kind, 40)
    wrong[0] = truth.values[kind.name][0]
    result = slamcli.optimize(truth.with_values({kind.name: wrong}), init=init, max_iterations=0)
    assert truth.with_values({kind.name: wrong}).chi2() > 1.0
    assert result.initial_chi2 == pytest.approx(0.0, abs=1e-15)
    found = result.graph.values[kind.name]
    assert_allclose(found[:, :space], truth.values[kind.name][:, :space], atol=1e-9)


def test_a_long_chain_is_composed_as_step_by_step() -> None:
    """5 000 poses, whatever the order in which the implementation composes them."""
    rng = np.random.default_rng(3)
    count = 5000
    steps = models.SE2.normalize(rng.standard_normal((count - 1, 3)) * [1.0, 0.1, 0.3])
    wanted = np.zeros((count, 3))
    for k in range(count - 1):
        wanted[k + 1] = models.SE2.compose(wanted[k : k + 1], steps[k : k + 1])[0]
    pairs = np.stack([np.arange(count - 1), np.arange(1, count)], axis=1)
    factors = Factors(models.RELATIVE_POSE_2D, pairs, steps, np.tile(np.eye(3), (count - 1, 1, 1)))
    graph = FactorGraph({"SE2": variables(models.SE2, range(count), np.zeros((count, 3)))}, [factors])
    result = slamcli.optimize(graph, init="odometry", max_iterations=0)
    assert_allclose(result.graph.values["SE2"][:, :2], wanted[:, :2], atol=1e-9)
    assert result.start == "integrated odometry"


# Odometry says that pose 3 is at (3, 0), a closure that it is at (0, 1).
CONTRADICTION = f"""\
VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 9 9 1
VERTEX_SE2 2 9 9 1
VERTEX_SE2 3 9 9 1
EDGE_SE2 0 3 0 1 0 {INFO}
EDGE_SE2 0 1 1 0 0 {INFO}
EDGE_SE2 1 2 1 0 0 {INFO}
EDGE_SE2 2 3 1 0 0 {INFO}
"""


@pytest.mark.parametrize(
    ("init", "last", "words"),
    [
        ("file", [9.0, 9.0, 1.0], "values of the file"),
        ("odometry", [3.0, 0.0, 0.0], "integrated odometry"),
        ("spanning-tree", [0.0, 1.0, 0.0], "spanning tree"),
    ],
)
def test_the_methods_differ_where_edges_contradict(init: str, last: list[float], words: str, tmp_path: Path) -> None:
    result = start(tmp_path, CONTRADICTION, init)
    assert_allclose(result.graph.values["SE2"][3], last, atol=1e-12)
    assert result.start == words
    assert result.initial_chi2 == pytest.approx(result.graph.chi2())


def test_the_tree_starts_at_the_held_pose(tmp_path: Path) -> None:
    text = CONTRADICTION.replace("VERTEX_SE2 2 9 9 1", "VERTEX_SE2 2 5 5 0") + "FIX 2\n"
    values = start(tmp_path, text, "odometry").graph.values["SE2"]
    assert_allclose(values[:, 0], [3.0, 4.0, 5.0, 6.0], atol=1e-12)
    assert_allclose(values[:, 1:], np.tile([5.0, 0.0], (4, 1)), atol=1e-12)


def test_gaps_in_the_odometry_are_bridged_by_closures(tmp_path: Path) -> None:
    text = CONTRADICTION.replace(f"EDGE_SE2 2 3 1 0 0 {INFO}\n", "")
    values = start(tmp_path, text, "odometry").graph.values["SE2"]
    assert_allclose(values, [[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]], atol=1e-12)


def test_vertices_of_the_file_stay_and_the_others_hang_on_them(tmp_path: Path) -> None:
    text = CONTRADICTION.replace("VERTEX_SE2 2 9 9 1\n", "").replace("VERTEX_SE2 1 9 9 1", "VERTEX_SE2 1 0 4 0")
    result = start(tmp_path, text, "file")
    assert_array_equal(result.graph.variables["SE2"].ids, [0, 1, 3, 2])
    assert_allclose(result.graph.values["SE2"][:3], [[0, 0, 0], [0, 4, 0], [9, 9, 1]])
    # pose 2 by its edge to pose 1 or to pose 3
    candidates = np.array([[1.0, 4.0, 0.0], [9.0 - np.cos(1.0), 9.0 - np.sin(1.0), 1.0]])
    assert np.abs(candidates - result.graph.values["SE2"][3]).max(axis=1).min() < 1e-12
    assert result.start == "values of the file; 1 without one placed by their edges"


@pytest.mark.parametrize("init", ["file", "odometry", "spanning-tree"])
def test_edges_alone_start_at_the_origin(init: str, tmp_path: Path) -> None:
    text = f"EDGE_SE2 4 5 1 2 0.5 {INFO}\nEDGE_SE2 5 6 1 0 0 {INFO}\n"
    result = start(tmp_path, text, init)
    wanted = [[0, 0, 0], [1, 2, 0.5], [1 + np.cos(0.5), 2 + np.sin(0.5), 0.5]]
    assert_allclose(result.graph.values["SE2"], wanted, atol=1e-12)
    assert result.initial_chi2 == pytest.approx(0.0, abs=1e-20)


def test_a_pose_without_vertex_starts_at_its_prior(tmp_path: Path) -> None:
    text = f"EDGE_PRIOR_SE2 4 7 8 0 {INFO}\nEDGE_SE2 4 5 1 0 0 {INFO}\n"
    result = start(tmp_path, text, "file")
    assert_allclose(result.graph.values["SE2"], [[7, 8, 0], [8, 8, 0]], atol=1e-12)


@pytest.mark.parametrize("init", ["odometry", "spanning-tree"])
def test_every_component_keeps_its_own_held_pose(init: str, tmp_path: Path) -> None:
    other = f"VERTEX_SE2 11 5 5 0\nVERTEX_SE2 10 -5 -5 0\nEDGE_SE2 10 11 1 0 0 {INFO}\n"
    result = start(tmp_path, CONTRADICTION + other, init)
    assert result.gauge.held == (0, 10)
    assert_allclose(result.graph.values["SE2"][4:], [[-4, -5, 0], [-5, -5, 0]], atol=1e-12)


@pytest.mark.parametrize("init", ["file", "odometry", "spanning-tree"])
def test_landmarks_are_placed_by_an_observation(init: str, tmp_path: Path) -> None:
    text = (
        f"VERTEX_SE2 0 1 1 {np.pi / 2}\nVERTEX_SE2 1 1 2 {np.pi / 2}\nEDGE_SE2 0 1 1 0 0 {INFO}\n"
        f"EDGE_BEARING_SE2_XY 0 9 {np.arctan2(1, 3)} 1\nEDGE_SE2_XY 1 9 2 1 1 0 1\n"
    )
    result = start(tmp_path, text, init)
    assert_allclose(result.graph.values["XY"], [[0.0, 4.0]], atol=1e-12)


def test_spatial_landmarks_see_the_offset_of_the_sensor(tmp_path: Path) -> None:
    text = (
        "PARAMS_SE3OFFSET 0 0 0 1 0 0 0 1\nVERTEX_SE3:QUAT 0 1 0 0 0 0 0 1\nEDGE_SE3_TRACKXYZ 0 9 0 1 2 3 1 0 0 1 0 1\n"
    )
    result = start(tmp_path, text, "file")
    assert_allclose(result.graph.values["XYZ"], [[2.0, 2.0, 4.0]], atol=1e-12)
    assert result.initial_chi2 == pytest.approx(0.0, abs=1e-20)


def test_a_landmark_that_a_single_bearing_sees_is_held_back(tmp_path: Path) -> None:
    text = "VERTEX_SE2 0 0 0 0\nEDGE_BEARING_SE2_XY 0 7 0.8 10\nEDGE_SE2_XY 0 8 2 1 1 0 1\n"
    result = start(tmp_path, text, "file")
    assert [landmark.id for landmark in result.under_observed] == [7]
    assert result.graph.variables["XY"].known.tolist() == [False, True]


@pytest.mark.parametrize("name", ["manhattan_small.g2o", "sphere_small.g2o", "square_toro.graph"])
def test_odometry_of_the_bundled_sets_is_their_file(name: str) -> None:
    """Their vertices hold what odometry alone says, to the digits of the file."""
    graph = bundled(name)
    result = slamcli.optimize(graph, init="odometry", max_iterations=0)
    assert result.initial_chi2 == pytest.approx(graph.chi2(), rel=1e-4)
    for kind, values in graph.values.items():
        space = graph.variables[kind].kind.space
        assert_allclose(result.graph.values[kind][:, :space], values[:, :space], atol=1e-3)


@pytest.mark.parametrize("method", ["odometry", "spanning-tree"])
def test_fixed_landmarks_stay(tmp_path: Path, method: str) -> None:
    text = (
        "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nVERTEX_XY 10 5 5\nFIX 10\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n"
        "EDGE_SE2_XY 0 10 2 2 1 0 1\nEDGE_SE2_XY 1 10 1 2 1 0 1\nEDGE_PRIOR_SE2 0 0 0 0 1 0 0 1 0 1\n"
    )
    assert start(tmp_path, text, method).graph.values["XY"].tolist() == [[5.0, 5.0]]


def test_points_hang_off_points(tmp_path: Path) -> None:
    text = (
        "EDGE_POINTXY 11 12 1 0 1 0 1\nEDGE_POINTXY 10 11 0 1 1 0 1\nVERTEX_SE2 0 0 0 0\nEDGE_SE2_XY 0 10 2 2 1 0 1\n"
    )
    graph = start(tmp_path, text, "file").graph
    placed = dict(zip(graph.variables["XY"].ids.tolist(), graph.values["XY"].tolist(), strict=True))
    assert placed == {10: [2.0, 2.0], 11: [2.0, 3.0], 12: [3.0, 3.0]}
