"""What ``slamcli info`` tells of a graph: numbers by hand on small graphs."""

from pathlib import Path

import numpy as np
import pytest
from support import BUNDLED, vectors, write_file

import slamcli
from slamcli.graph import analyze
from slamcli.graph.describe import describe, worst_edges

SQUARE = """\
VERTEX_SE2 4 0 4 0
VERTEX_SE2 0 0 0 0
VERTEX_SE2 2 3 4 0
VERTEX_SE2 1 3 0 0
VERTEX_XY 10 5 -1
VERTEX_XY 77 0 0
FIX 0
EDGE_SE2 0 1 3 0 0 2 0 0 3 0 5
EDGE_SE2 1 2 0 4 0 2 0 0 3 0 5
EDGE_SE2 2 4 -3 1 0 2 0 0 3 0 5
EDGE_SE2 4 0 0 -4 0 1 2 0 1 0 1
EDGE_SE2_XY 1 10 2 -1 4 0 9
"""


def test_a_small_graph(tmp_path: Path) -> None:
    description = describe(slamcli.read(str(write_file(tmp_path, SQUARE))))
    poses, points = description.variables
    assert (poses.kind, poses.count, poses.lowest_id, poses.highest_id) == ("SE2", 4, 0, 4)
    assert (poses.consecutive_ids, poses.without_estimate, poses.fixed) == (False, 0, 1)
    assert (points.kind, points.count, points.fixed) == ("XY", 2, 0)
    assert description.dimension == 4 * 3 + 2 * 2
    assert description.residuals == 4 * 3 + 2
    assert description.component_sizes == [5, 1]
    assert description.isolated == 1
    assert (description.degree_min, description.degree_max) == (0, 3)
    assert description.degree_mean == pytest.approx(2 * 5 / 6)
    assert description.loop_closures == 1
    assert description.path_length == 3.0 + 4.0 + 3.0
    assert description.bounding_box == [(0.0, 5.0), (-1.0, 4.0)]
    assert description.chi2 == 3.0  # the third edge is off by one metre in y


def test_information_by_tag(tmp_path: Path) -> None:
    relative, observation = describe(slamcli.read(str(write_file(tmp_path, SQUARE)))).factors
    assert (relative.tag, relative.kind, relative.count, relative.loop_closures) == (
        "EDGE_SE2",
        "relative_pose_2d",
        4,
        1,
    )
    assert relative.chi2 == 3.0
    assert relative.smallest_eigenvalue == pytest.approx(-1.0)  # of 1 2 / 2 1
    assert relative.largest_eigenvalue == pytest.approx(5.0)
    assert relative.indefinite == 1
    assert (observation.smallest_eigenvalue, observation.largest_eigenvalue) == (pytest.approx(4.0), pytest.approx(9.0))
    assert (observation.indefinite, observation.loop_closures, observation.chi2) == (0, 0, 0.0)


def test_without_estimates_there_is_no_extent_and_no_chi2(tmp_path: Path) -> None:
    edges = "".join(line + "\n" for line in SQUARE.splitlines() if line.startswith("EDGE"))
    graph = slamcli.read(str(write_file(tmp_path, edges)))
    description = describe(graph)
    assert [summary.without_estimate for summary in description.variables] == [4, 1]
    assert description.path_length is description.bounding_box is description.chi2 is None
    assert [factors.chi2 for factors in description.factors] == [None, None]
    assert description.component_sizes == [5]


@pytest.mark.parametrize(
    "name", ["manhattan_small.g2o", "sphere_small.g2o", "landmarks_small.g2o", "square_toro.graph"]
)
def test_sums_of_the_parts(name: str) -> None:
    graph = slamcli.read(str(BUNDLED / name))
    description = describe(graph)
    topology = analyze(graph)
    assert sum(summary.count for summary in description.variables) == graph.poses + graph.landmarks
    assert sum(summary.count for summary in description.factors) == graph.edges
    assert sum(summary.loop_closures for summary in description.factors) == description.loop_closures
    assert sum(summary.chi2 or 0.0 for summary in description.factors) == pytest.approx(graph.chi2(), rel=1e-13)
    assert sum(description.component_sizes) == graph.poses + graph.landmarks
    assert topology.degrees.sum() == 2 * sum(len(f) for f in graph.factors if len(f.kind.variables) == 2)
    assert description.residuals - description.dimension == graph.degrees_of_freedom()
    assert description.bounding_box is not None
    for axis, (low, high) in enumerate(description.bounding_box):
        coordinates = np.concatenate([column.values[:, axis] for column in graph.variables.values()])
        assert (low, high) == (coordinates.min(), coordinates.max())


def test_a_mixture_of_planar_and_spatial_kinds_has_a_box_in_space(tmp_path: Path) -> None:
    description = describe(slamcli.read(str(write_file(tmp_path, vectors))))
    assert description.bounding_box == [(0.1, 2.5), (0.2, 2.0), (0.2, 5.0)]
    kinds = ["SE2", "XY", "SE3", "XYZ", "SBA_CAMERA", "SE3_EXPMAP", "SWITCH"]
    assert [summary.kind for summary in description.variables] == kinds


def test_worst_edges_come_worst_first_with_their_lines(tmp_path: Path) -> None:
    graph = slamcli.read(str(write_file(tmp_path, vectors)))
    lines = vectors.splitlines()
    worst = worst_edges(graph, graph.edges)
    costs = [edge.chi2 for edge in worst]
    assert costs == sorted(costs, reverse=True)
    assert sum(costs) == pytest.approx(graph.chi2(), rel=1e-13)
    for edge in worst:
        tag, *numbers = lines[edge.line - 1].split()
        assert tag == edge.tag
        assert [str(i) for i in edge.ids] == numbers[: len(edge.ids)]
    assert [edge.tag for edge in worst[:4:3]] == ["EDGE_PROJECT_P2SC", "EDGE_SE3_TRACKXYZ"]
    # EDGE_POINTXYZ_PRIOR 30 1.1 1.9 5.2 for the point 1 2 5
    prior = next(edge for edge in worst if edge.tag == "EDGE_POINTXYZ_PRIOR")
    assert prior.residual == pytest.approx((-0.1, 0.1, -0.2))


def test_how_many_worst_edges(tmp_path: Path) -> None:
    graph = slamcli.read(str(write_file(tmp_path, vectors)))
    everything = worst_edges(graph, 10**6)
    assert len(everything) == graph.edges
    assert worst_edges(graph, 3) == everything[:3]
    assert worst_edges(graph, 0) == worst_edges(graph, -1) == []
    assert worst_edges(slamcli.read(str(write_file(tmp_path, "VERTEX_SE2 0 0 0 0\n"))), 5) == []
