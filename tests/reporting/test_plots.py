"""What figures hold: scales, units, lines and their numbers, names; and that the same input gives the same bytes."""

import json
import math
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import LogNorm, to_hex
from support import BUNDLED, write_file

from slamcli.cli.main import main
from slamcli.errors import InputError, UsageError
from slamcli.evaluation.alignment import Alignment
from slamcli.formats import read
from slamcli.formats.labels import Labels, outlier_masks
from slamcli.formats.trajectories import read_trajectory
from slamcli.graph.trajectory import of_graph
from slamcli.reporting.plots import maps, style
from slamcli.reporting.plots.errors import draw_errors
from slamcli.reporting.plots.files import format_of, render
from slamcli.reporting.plots.inputs import ErrorSeries, Run, kind_of, one_kind, read_errors, read_runs
from slamcli.reporting.plots.iterations import draw_iterations
from slamcli.reporting.plots.maps import MapOptions, draw_map
from slamcli.reporting.plots.regions import QUANTILE, outlines, read_regions
from slamcli.reporting.plots.scene import CLOSURE, OBSERVATION, estimate_of
from slamcli.reporting.plots.style import FigureOptions

SQUARE = """\
VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 2 0 1.5707963267948966
VERTEX_SE2 2 2 2 3.141592653589793
VERTEX_SE2 3 0 2 -1.5707963267948966
VERTEX_XY 10 1 1
EDGE_SE2 0 1 2 0 1.5707963267948966 1 0 0 1 0 1
EDGE_SE2 1 2 2 0 1.5707963267948966 1 0 0 1 0 1
EDGE_SE2 2 3 2 0 1.5707963267948966 1 0 0 1 0 1
EDGE_SE2 3 0 2.5 0 1.5707963267948966 4 0 0 1 0 1
EDGE_SE2_XY 0 10 1 1.1 100 0 100
"""
TRACE = """\
{"event": "start", "command": "optimize", "chi2": 100.0}
{"event": "iteration", "iteration": 1, "chi2": 10.0, "time": 0.5, "accepted": true}
{"event": "iteration", "iteration": 2, "chi2": 10.0, "time": 0.25, "accepted": false}
{"event": "end", "status": "not_converged"}
"""
ERRORS = """\
estimate,id,time_s,distance_m,x_m,y_m,z_m,translation_error_m,rotation_error_deg
a.g2o,0,,0.0,0,0,0,0.5,1.0
a.g2o,1,,1.0,1,0,0,0.25,2.0
"b, too.g2o",0,,0.0,0,0,0,0.125,3.0
"""


@pytest.fixture(autouse=True)
def in_house_style():
    with style.house_style():
        yield


def graph_of(tmp_path, text=SQUARE, name="graph.g2o"):
    return read(str(write_file(tmp_path, text, name)))


def scene(tmp_path, text=SQUARE, name="square"):
    return estimate_of(of_graph(graph_of(tmp_path, text), name), name)


def chain(poses, step=1.0):
    """Text of a straight path."""
    vertices = "".join(f"VERTEX_SE2 {i} {i * step} 0 0\n" for i in range(poses))
    return vertices + "".join(f"EDGE_SE2 {i} {i + 1} {step} 0 0 1 0 0 1 0 1\n" for i in range(poses - 1))


def labels_of(figure):
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def segments_of(axes, colour):
    """Lines of the collection in this colour."""
    lines = [c for c in axes.collections if isinstance(c, LineCollection)]
    return [part for c in lines if to_hex(c.get_colors()[0]) == colour.lower() for part in c.get_segments()]


def line_of(axes, colour, marked=False):
    """Points of the line in this colour."""
    return [
        line.get_xydata()
        for line in axes.lines
        if to_hex(line.get_color()) == colour.lower() and (line.get_linestyle() == "None") == marked
    ]


# -- scenes ------------------------------------------------------------------------------------------------------------


def test_a_scene_holds_what_the_graph_holds(tmp_path):
    square = scene(tmp_path)
    assert square.space == 2
    assert square.counts == {"poses": 4, "landmarks": 1, "edges": 5, "closures": 1}
    assert square.chi2 == pytest.approx(0.5**2 + 100 * 0.1**2)
    np.testing.assert_array_equal(square.path[:, :2], [[0, 0], [2, 0], [2, 2], [0, 2]])
    np.testing.assert_allclose(square.forward[1], [0, 1, 0], atol=1e-12)
    np.testing.assert_array_equal(square.landmarks, [[1, 1, 0]])
    closure = square.edges.role == CLOSURE
    np.testing.assert_array_equal(square.edges.segments[closure][0, :, :2], [[0, 2], [0, 0]])
    assert square.edges.chi2[closure] == pytest.approx(0.25), "along y of the measured frame"
    assert np.count_nonzero(square.edges.role == OBSERVATION) == 1


def test_paths_are_interrupted_between_robots_only(tmp_path):
    """Ids that leap break the path, unless an edge joins the poses; ids with gaps and odometry stay one path."""
    vertices = "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 5 1 0 0\nVERTEX_SE2 100 9 9 0\nVERTEX_SE2 101 9 8 0\n"
    edges = "EDGE_SE2 0 5 1 0 0 1 0 0 1 0 1\nEDGE_SE2 101 100 1 0 0 1 0 0 1 0 1\n"
    path = scene(tmp_path, vertices + edges).path[:, 0]
    np.testing.assert_array_equal(path, [0, 1, np.nan, 9, 9])
    assert np.isfinite(scene(tmp_path, vertices).path).all(), "without any edge there is nothing to go by"


def test_what_has_no_place_is_counted_and_left_out(tmp_path):
    square = scene(tmp_path, SQUARE + "EDGE_SE2 3 4 1 0 0 1 0 0 1 0 1\nEDGE_SE2_XY 0 11 1 1 1 0 1\n")
    assert len(square.path) == 4 and len(square.edges) == 5 and square.chi2 is None
    assert square.notes == [
        "square: not drawn: 1 pose without an estimate or of another kind",
        "square: not drawn: 1 landmark without an estimate",
    ]


def test_moved_scenes(tmp_path):
    turn = Alignment("sim", np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.array([1.0, 2, 3]), 2.0)
    square = scene(tmp_path)
    moved = square.moved(turn)
    np.testing.assert_allclose(moved.path[1], [1, 6, 3], atol=1e-12)
    np.testing.assert_allclose(moved.landmarks[0], [-1, 4, 3], atol=1e-12)
    np.testing.assert_allclose(moved.edges.segments[3, 0], moved.path[3], atol=1e-12)
    np.testing.assert_allclose(moved.forward[0], [0, 1, 0], atol=1e-12)
    assert moved.chi2 == square.chi2


# -- maps --------------------------------------------------------------------------------------------------------------


def test_map_of_a_graph(tmp_path):
    figure = draw_map([scene(tmp_path)])
    (axes,) = figure.axes
    assert axes.get_aspect() == 1.0
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x (m)", "y (m)")
    assert axes.get_title(loc="left") == "square"
    assert [text.get_text() for text in axes.texts] == ["4 poses, 1 landmark, 5 edges (1 loop closure), chi2 1.25"]
    assert labels_of(figure) == ["trajectory", "1 loop closure", "1 observation", "1 landmark", "start", "end"]
    (path,) = line_of(axes, style.BLUE)
    np.testing.assert_array_equal(path, [[0, 0], [2, 0], [2, 2], [0, 2]])
    (closure,) = segments_of(axes, style.VERMILLION)
    np.testing.assert_array_equal(closure, [[0, 2], [0, 0]])
    (headings,) = [c for c in axes.collections if isinstance(c, PolyCollection)]
    assert len(headings.get_paths()) == 4
    tip = headings.get_paths()[1].vertices[0]
    assert tip[0] == pytest.approx(2) and tip[1] > 0, "the second pose looks up"


def test_scales_are_equal_also_when_drawn(tmp_path):
    figure = draw_map([scene(tmp_path, chain(5, 100.0))], options=MapOptions(size=(4, 8)))
    render(figure, "png", 50)
    (axes,) = figure.axes
    box = axes.get_window_extent()
    x, y = np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())
    assert box.width / x == pytest.approx(box.height / y, rel=5e-3)  # what matplotlib tolerates
    assert axes.get_xlim()[0] < 0 and axes.get_xlim()[1] > 400


@pytest.mark.parametrize(
    ("view", "first", "second"), [("xy", "x (m)", "y (m)"), ("xz", "x (m)", "z (m)"), ("yz", "y (m)", "z (m)")]
)
def test_projections(view, first, second):
    trajectory = read_trajectory(str(BUNDLED / "sphere_small.g2o"))
    figure = draw_map([estimate_of(trajectory, "sphere")], options=MapOptions(view=view))
    (axes,) = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.name) == (first, second, "rectilinear")
    columns = ["xyz".index(label[0]) for label in (first, second)]
    (path,) = line_of(axes, style.BLUE)
    low, high = trajectory.positions.min(axis=0)[columns], trajectory.positions.max(axis=0)[columns]
    np.testing.assert_allclose(path.min(axis=0), low, atol=0.05)
    np.testing.assert_allclose(path.max(axis=0), high, atol=0.05)


def test_graphs_in_space_are_drawn_in_space():
    trajectory = read_trajectory(str(BUNDLED / "sphere_small.g2o"))
    figure = draw_map([estimate_of(trajectory, "sphere")])
    (axes,) = figure.axes
    assert axes.name == "3d"
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_zlabel()) == ("x (m)", "y (m)", "z (m)")
    extents = np.array([np.ptp(limits) for limits in (axes.get_xlim(), axes.get_ylim(), axes.get_zlim())])
    shape = np.asarray(axes._box_aspect)  # has no getter
    np.testing.assert_allclose(shape / shape[0], extents / extents[0], rtol=1e-9)
    assert "380 loop closures" in labels_of(figure)


def test_flat_and_single_things_in_space_have_a_box(tmp_path):
    one = "VERTEX_SE3:QUAT 0 1 2 3 0 0 0 1\n"
    for text in (one, one + "VERTEX_SE3:QUAT 1 50 2 3 0 0 0 1\n"):
        data, _ = render(draw_map([scene(tmp_path, text)]), "png", 40)
        assert data.startswith(b"\x89PNG")


def test_several_estimates_and_the_truth(tmp_path):
    moved = SQUARE.replace("VERTEX_SE2 2 2 2", "VERTEX_SE2 2 2.5 2.5")
    estimates = [scene(tmp_path, moved, "before.g2o"), scene(tmp_path, SQUARE, "after.g2o")]
    figure = draw_map(estimates, truth=scene(tmp_path, SQUARE, "truth.g2o"))
    (axes,) = figure.axes
    assert labels_of(figure) == [
        f"before.g2o (chi2 {estimates[0].chi2:.6g})",
        "after.g2o (chi2 1.25)",
        "truth: truth.g2o",
        "1 true landmark",
        "start",
        "end",
    ]
    assert axes.get_title(loc="left") == ""
    assert [len(line_of(axes, colour)) for colour in style.COLOURS[:2]] == [1, 1]
    (truth,) = [line for line in axes.lines if line.is_dashed()]
    assert to_hex(truth.get_color()) == style.INK.lower()
    assert not [c for c in axes.collections if isinstance(c, LineCollection)], "closures of several inputs: on request"
    figure = draw_map(estimates, options=MapOptions(closures=True))
    assert len(segments_of(figure.axes[0], style.COLOURS[0])) == 1


def test_closures_can_be_left_out(tmp_path):
    figure = draw_map([scene(tmp_path)], options=MapOptions(closures=False))
    assert "1 loop closure" not in labels_of(figure)
    assert not [c for c in figure.axes[0].collections if isinstance(c, LineCollection)]


def test_many_closures_are_thinned_and_that_is_said(tmp_path, monkeypatch):
    monkeypatch.setattr(maps, "MOST_CLOSURES", 10)
    text = chain(60) + "".join(f"EDGE_SE2 {i} {i + 2} 2 0 0 1 0 0 1 0 1\n" for i in range(50))
    figure = draw_map([scene(tmp_path, text)])
    assert "10 of 50 loop closures drawn" in labels_of(figure)
    assert len(segments_of(figure.axes[0], style.VERMILLION)) == 10


def test_edges_by_chi2_have_the_worst_on_top(tmp_path):
    text = SQUARE + "EDGE_SE2 0 2 3 2 3.141592653589793 100 0 0 1 0 1\n"
    figure = draw_map([scene(tmp_path, text)], options=MapOptions(color_by="chi2"))
    axes, bar = figure.axes
    (lines,) = [c for c in axes.collections if isinstance(c, LineCollection)]
    chi2, widths = np.asarray(lines.get_array()), np.asarray(lines.get_linewidths())
    assert len(chi2) == 6 and chi2[-1] == pytest.approx(100.0)
    assert (np.diff(chi2) >= 0).all() and (np.diff(widths) >= 0).all()
    assert isinstance(lines.norm, LogNorm) and lines.norm.vmax == pytest.approx(100.0)
    assert "chi2" in bar.get_ylabel() and "6 edges by chi2" in labels_of(figure)
    np.testing.assert_array_equal(lines.get_segments()[-1], [[0, 0], [2, 2]])
    figure = draw_map([scene(tmp_path, text)], options=MapOptions(color_by="chi2", closures=False))
    assert "3 odometry edges by chi2" in labels_of(figure)


def test_only_the_worst_of_very_many_edges_are_coloured(tmp_path, monkeypatch):
    monkeypatch.setattr(maps, "MOST_COLOURED", 2)
    figure = draw_map([scene(tmp_path)], options=MapOptions(color_by="chi2"))
    assert "the 2 worst of 5 edges by chi2" in labels_of(figure)


@pytest.mark.parametrize("text", [chain(3), chain(3).replace("EDGE_SE2 0 1 1.0 0 0", "EDGE_SE2 0 1 1e160 0 0")])
def test_chi2_of_zero_or_infinity_can_be_coloured(tmp_path, text):
    data, _ = render(draw_map([scene(tmp_path, text)], options=MapOptions(color_by="chi2")), "png", 40)
    assert data


def test_false_closures_stand_out(tmp_path):
    graph = graph_of(tmp_path)
    one, two = np.array([3]), np.array([0])
    masks = outlier_masks(Labels(one, two, np.array([True]), np.array([0]), False), graph)
    figure = draw_map([estimate_of(of_graph(graph), "square", masks)])
    assert "1 false edge" in labels_of(figure) and "1 loop closure" not in labels_of(figure)
    assert len(segments_of(figure.axes[0], style.VERMILLION)) == 1


def test_landmarks_without_poses(tmp_path):
    figure = draw_map([scene(tmp_path, "VERTEX_XY 1 1 1\nVERTEX_XY 2 3 1\n")])
    assert labels_of(figure) == ["2 landmarks"]
    (stars,) = [line.get_xydata() for line in figure.axes[0].lines]
    np.testing.assert_array_equal(stars, [[1, 1], [3, 1]])


def test_large_maps_are_images_in_vector_files(tmp_path):
    """The path and its closures are rasterized; axes and text are not."""
    text = chain(6000) + "".join(f"EDGE_SE2 {i} {i + 2} 2 0 0 1 0 0 1 0 1\n" for i in range(4000))
    figure = draw_map([scene(tmp_path, text)])
    (closures,) = [c for c in figure.axes[0].collections if isinstance(c, LineCollection)]
    assert closures.get_rasterized()
    data, _ = render(figure, "svg", 60)
    assert len(data) < 400_000 and b"<image" in data


@pytest.mark.parametrize("view", ["xy", "3d"])
@pytest.mark.parametrize(("x", "step"), [(1e99, 1.0), (5.4e6, 10.0), (1e17, 0.0), (0.0, 1e-300), (0.0, 0.0)])
def test_far_and_tiny_maps(tmp_path, view, x, step):
    text = f"VERTEX_SE2 0 {x} 0 0\nVERTEX_SE2 1 {x + step} 0 0\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n"
    with np.errstate(all="raise", under="ignore"):
        figure = draw_map([scene(tmp_path, text)], options=MapOptions(view=view, color_by="chi2"))
        assert render(figure, "png", 40)[0].startswith(b"\x89PNG")


def test_too_far_away(tmp_path):
    with pytest.raises(InputError, match=r"square: a position is 1e\+300 m from the origin"):
        draw_map([scene(tmp_path, SQUARE.replace("VERTEX_SE2 2 2 2", "VERTEX_SE2 2 2 -1e300"))])


# -- thinning ----------------------------------------------------------------------------------------------------------


def test_thinned_paths_stay_close():
    from slamcli.reporting.plots.thinning import thin_path

    rng = np.random.default_rng(1)
    path = np.cumsum(rng.normal(0.0, 0.1, (5000, 2)), axis=0)
    rows = thin_path(path, 0.5)
    assert len(rows) < 2500 and rows[0] == 0 and rows[-1] == 4999
    kept = path[rows[np.searchsorted(rows, np.arange(5000), side="right") - 1]]
    assert np.abs(path - kept).max() <= 0.5 + 1e-12
    np.testing.assert_array_equal(thin_path(path, 0.0), np.arange(5000))


def test_gaps_survive_thinning():
    from slamcli.reporting.plots.thinning import thin_path

    path = np.zeros((9, 2))
    path[4] = np.nan
    np.testing.assert_array_equal(thin_path(path, 1.0), [0, 3, 4, 5, 8])


def test_peaks_survive_thinning():
    from slamcli.reporting.plots.thinning import envelope, spread

    x = np.linspace(0.0, 10.0, 10_000)
    y = np.sin(x)
    y[1234], y[4321], y[77] = 50.0, -50.0, np.nan
    rows = envelope(x, y, 100)
    assert len(rows) <= 204 and {0, 1234, 4321, 9999} <= set(rows.tolist())
    np.testing.assert_array_equal(envelope(np.zeros(1000), y[:1000], 10)[[0, -1]], [0, 999])
    np.testing.assert_array_equal(spread(10, 5), [0, 2, 4, 6, 8])
    np.testing.assert_array_equal(spread(3, 5), [0, 1, 2])


# -- regions -----------------------------------------------------------------------------------------------------------


def write_npz(tmp_path, name="covariances.npz", frame="local", **arrays):
    path = tmp_path / name
    np.savez(path, frame=np.array(frame), **{key: np.asarray(value) for key, value in arrays.items()})
    return str(path)


def test_pose_covariances_turn_into_the_world(tmp_path):
    """The second pose of the square looks along y: what is uncertain ahead is uncertain in y."""
    graph = graph_of(tmp_path)
    ahead = np.diag([0.04, 0.01, 0.1])
    path = write_npz(tmp_path, ids=[0, 1], covariance=[ahead, ahead])
    regions = read_regions([path], graph)
    np.testing.assert_allclose(regions.pose_covariances[0], np.diag([0.04, 0.01, 0.0]), atol=1e-15)
    np.testing.assert_allclose(regions.pose_covariances[1], np.diag([0.01, 0.04, 0.0]), atol=1e-15)
    (first, second) = outlines(regions.poses, regions.pose_covariances, (0, 1))
    half = math.sqrt(QUANTILE[2])
    np.testing.assert_allclose(np.ptp(first, axis=0), 2 * half * np.array([0.2, 0.1]), rtol=0.01)
    np.testing.assert_allclose(np.ptp(second, axis=0), 2 * half * np.array([0.1, 0.2]), rtol=0.01)
    np.testing.assert_allclose(second[0], second[-1], atol=1e-12)


def test_landmark_regions_and_their_legend(tmp_path):
    graph = graph_of(tmp_path)
    shape = np.array([[0.05, 0.02], [0.02, 0.03]])
    files = [
        write_npz(tmp_path, "landmarks.npz", ids=[10], covariance=[shape]),
        write_npz(tmp_path, "poses.npz", ids=[3, 2], covariance=[np.eye(3)] * 2),
    ]
    regions = read_regions(files, graph)
    np.testing.assert_array_equal(regions.landmarks, [[1, 1, 0]])
    (loop,) = outlines(regions.landmarks, regions.landmark_covariances, (0, 1)) - regions.landmarks[0, :2]
    squared = np.vecdot(loop, np.linalg.solve(shape, loop.T).T)
    np.testing.assert_allclose(squared, -2.0 * math.log(0.05), rtol=1e-9)
    figure = draw_map([estimate_of(of_graph(graph), "square")], regions=regions)
    assert {"2 poses: 95 % region", "1 landmark: 95 % region"} <= set(labels_of(figure))
    turn = Alignment("sim", np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.zeros(3), 2.0)
    np.testing.assert_allclose(
        regions.moved(turn).landmark_covariances[0, :2, :2], 4.0 * np.array([[0.03, -0.02], [-0.02, 0.05]])
    )


def test_ellipsoids_are_three_ellipses():
    shape = np.diag([1.0, 4.0, 9.0])[None]
    loops = outlines(np.zeros((1, 3)), shape, (0, 1, 2))
    assert loops.shape[0] == 3 and loops.shape[2] == 3
    squared = np.vecdot(loops, loops / np.array([1.0, 4.0, 9.0]))
    np.testing.assert_allclose(squared, QUANTILE[3])


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"ids": [77], "covariance": [np.eye(3)]}, "no variable 77 with 3 tangent dimensions"),
        ({"ids": [0], "covariance": [np.eye(6)]}, "no variable 0 with 6"),
        ({"ids": [0, 1], "covariance": [np.eye(3)]}, "covariance must be (2, 2, 2)"),
        ({"ids": [0.5], "covariance": [np.eye(3)]}, "ids must be whole numbers (n,), found float64 (1,)"),
        ({"ids": [0], "covariance": [np.full((3, 3), np.nan)]}, "variable 0 is not finite"),
        ({"ids": [0], "covariance": [np.eye(3)], "frame": "world"}, "the frame is 'world'"),
        ({"ids": [0]}, "lacks covariance"),
    ],
)
def test_covariances_that_do_not_fit(tmp_path, arrays, message):
    with pytest.raises(InputError) as error:
        read_regions([write_npz(tmp_path, **arrays)], graph_of(tmp_path))
    assert message in str(error.value)


def test_covariances_that_are_none(tmp_path):
    for content in (b"not a zip", b"PK\x03\x04 broken", b""):
        with pytest.raises(InputError, match=r"holds no covariance|no record|expected"):
            read_regions([str(write_file(tmp_path, content, "c.npz"))], graph_of(tmp_path))
    with pytest.raises(InputError, match="cannot be read"):
        read_regions([str(tmp_path / "nowhere.npz")], graph_of(tmp_path))


# -- iterations --------------------------------------------------------------------------------------------------------


def test_iterations_of_a_trace_and_of_a_document_are_the_same(tmp_path):
    trace, document = tmp_path / "trace.jsonl", tmp_path / "result.json"
    words = ["optimize", str(BUNDLED / "manhattan_small.g2o"), "-q"]
    assert main([*words, "--trace", str(trace)]) == 0
    events = [json.loads(line) for line in trace.read_text().splitlines()]
    records = [event for event in events if event["event"] == "iteration"]
    document.write_text(
        json.dumps(
            {"command": "optimize", "initial_chi2": events[0]["chi2"], "trace": records, "status": "converged"},
            indent=2,
        )
    )
    (first,), (second,) = read_runs(str(trace), "trace"), read_runs(str(document), "document")
    np.testing.assert_array_equal(first.chi2, second.chi2)
    np.testing.assert_array_equal(first.seconds, second.seconds)
    assert first.chi2[0] == events[0]["chi2"] and first.chi2[-1] == events[-1]["final_chi2"]
    assert first.status == second.status == "converged"


def test_figure_of_iterations(tmp_path):
    (run,) = read_runs(str(write_file(tmp_path, TRACE)), "slow.jsonl")
    np.testing.assert_array_equal(run.seconds, [0.0, 0.5, 0.75])
    other = Run("fast.jsonl", np.array([100.0, 5.0]), np.array([0.0, 0.1]), np.array([True, True]), "converged")
    figure = draw_iterations([run, other])
    (axes,) = figure.axes
    assert axes.get_yscale() == "log" and (axes.get_xlabel(), axes.get_ylabel()) == ("iteration", "chi2 (no unit)")
    assert labels_of(figure) == [
        "slow.jsonl: chi2 10 after 2 iterations, not converged",
        "fast.jsonl: chi2 5 after 1 iteration",
        "no step accepted",
    ]
    np.testing.assert_array_equal(axes.lines[0].get_xydata(), [[0, 100], [1, 10], [2, 10]])
    (axes,) = draw_iterations([run, other], "time").axes
    assert axes.get_xlabel() == "time in iterations (ms)"
    np.testing.assert_array_equal(axes.lines[0].get_xdata(), [0, 500, 750])
    looks = {(line.get_color(), line.get_marker()) for line in draw_iterations([other] * 9).axes[0].lines}
    assert len(looks) == 9, "colour and marker together tell all apart"


def test_chi2_that_hardly_changes_has_a_linear_axis():
    run = Run("a", np.array([3.0, 2.0]), np.array([0.0, 2.0]), np.array([True, True]), None)
    (axes,) = draw_iterations([run], "time").axes
    assert axes.get_yscale() == "linear" and axes.get_xlabel() == "time in iterations (s)"


def test_traces_one_after_the_other_are_several_runs(tmp_path):
    runs = read_runs(str(write_file(tmp_path, TRACE + TRACE)), "t")
    assert [run.name for run in runs] == ["t (1)", "t (2)"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (TRACE.splitlines()[0] + "\n" + TRACE.splitlines()[3], "holds no iterations"),
        (TRACE.splitlines()[0], "holds no iterations"),
        (TRACE + "{broken\n", ":5:2: is not JSON"),
        ('{\n "command": "optimize",\n "trace": [\n', ":4:1: is not JSON"),
        ('{"command": "info"}', "a JSON document of slamcli info"),
        ('{"command": "optimize", "trace": 3}', "a JSON document of slamcli optimize"),
        ("{}", "without 'command'"),
        ('{"a": 1}\n{"b": 2}\n', ":1: is no event of a trace"),
        ("[1, 2]", ":1: is no event"),
        (TRACE.replace('"chi2": 10.0', '"chi2": "ten"'), "are no numbers"),
        (TRACE.replace('"chi2": 10.0, ', ""), "lacks 'chi2'"),
        (TRACE.replace("10.0", "null").replace("100.0", "null"), "no chi2 in it is finite"),
    ],
)
def test_traces_that_cannot_be_drawn(tmp_path, text, message):
    with pytest.raises(InputError) as error:
        read_runs(str(write_file(tmp_path, text)), "t")
    assert message in str(error.value) and str(tmp_path) in str(error.value)


# -- errors ------------------------------------------------------------------------------------------------------------


def test_figure_of_errors(tmp_path):
    series = read_errors(str(write_file(tmp_path, ERRORS)), "errors.csv")
    assert [one.name for one in series] == ["a.g2o", "b, too.g2o"]
    figure = draw_errors(series)
    upper, lower = figure.axes
    assert (upper.get_ylabel(), lower.get_ylabel()) == ("translation error (m)", "rotation error (°)")
    assert lower.get_xlabel() == "distance (m)"
    assert labels_of(figure) == ["a.g2o", "b, too.g2o"]
    np.testing.assert_array_equal(upper.lines[0].get_xydata(), [[0, 0.5], [1, 0.25]])
    with pytest.raises(UsageError, match="has no time_s"):
        draw_errors(series, "time")


def test_time_is_x_where_all_have_it_and_nees_has_a_panel():
    columns = {
        "time_s": np.array([2.0, 1.0]),
        "distance_m": np.array([0.0, 1.0]),
        "translation_error_m": np.array([1.0, 2.0]),
        "rotation_error_deg": np.array([1.0, 2.0]),
        "nees": np.array([3.0, 30.0]),
    }
    figure = draw_errors([ErrorSeries("a", columns)])
    assert [axes.get_ylabel() for axes in figure.axes][-1] == "NEES (no unit)"
    assert figure.axes[-1].get_xlabel() == "time (s)" and figure.axes[-1].get_yscale() == "log"
    np.testing.assert_array_equal(figure.axes[0].lines[0].get_xydata(), [[1, 2], [2, 1]])
    without = {**columns, "time_s": np.full(2, np.nan)}
    figure = draw_errors([ErrorSeries("a", columns), ErrorSeries("b", without)])
    assert figure.axes[-1].get_xlabel() == "distance (m)"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (ERRORS.replace("0.25", "x"), ":3: translation_error_m is 'x'"),
        (ERRORS + "a,1\n", ":5: expected 9 columns, found 2"),
        (ERRORS.splitlines()[0], "holds no errors"),
        ("estimate,id\na,1\n", "has no column 'translation_error_m'"),
    ],
)
def test_errors_that_cannot_be_read(tmp_path, text, message):
    with pytest.raises(InputError) as error:
        read_errors(str(write_file(tmp_path, text)), "errors.csv")
    assert message in str(error.value)


def test_errors_without_a_number_cannot_be_drawn():
    with pytest.raises(InputError, match="no error in it is finite"):
        draw_errors([ErrorSeries("a", {"distance_m": np.zeros(1), "translation_error_m": np.full(1, np.nan)})])


# -- recognition -------------------------------------------------------------------------------------------------------


def test_kinds_are_recognized_by_content(tmp_path):
    import gzip

    expected = {
        SQUARE: "map",
        "# TUM\n0 1 2 3 0 0 0 1\n": "map",
        TRACE: "iterations",
        "\n  {}": "iterations",
        ERRORS: "errors",
        "\ufeff" + ERRORS: "errors",
        "": "map",
    }
    for number, (text, kind) in enumerate(expected.items()):
        assert kind_of(str(write_file(tmp_path, text, f"{number}.txt"))) == kind
        assert kind_of(str(write_file(tmp_path, gzip.compress(text.encode()), f"{number}.gz"))) == kind


def test_mixed_kinds_are_refused_by_name(tmp_path):
    paths = [str(write_file(tmp_path, text, name)) for name, text in (("g", SQUARE), ("t", TRACE), ("e", ERRORS))]
    with pytest.raises(UsageError) as error:
        one_kind(paths)
    assert [line.partition(": ")[2] for line in error.value.details] == [
        "a graph or a trajectory",
        "iterations of optimize (--trace or --json)",
        "errors of evaluate (--errors)",
    ]


# -- files -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "magic"), [("png", b"\x89PNG\r\n\x1a\n"), ("svg", b"<?xml"), ("pdf", b"%PDF-")])
def test_formats_begin_with_their_magic_and_do_not_change(tmp_path, kind, magic):
    text = (BUNDLED / "landmarks_small.g2o").read_text()
    first, second = (render(draw_map([scene(tmp_path, text)]), kind, 60)[0] for _ in range(2))
    assert first.startswith(magic)
    assert first == second
    assert b"Date" not in first.replace(b"/CreationDate", b"Date") or kind == "png"


def test_svg_is_well_formed_and_has_no_date(tmp_path):
    data, _ = render(draw_map([scene(tmp_path)]), "svg", 60)
    root = ElementTree.fromstring(data)
    assert root.tag.endswith("svg")
    assert b"dc:date" not in data


def test_the_ending_decides():
    assert [format_of(path) for path in ("a.png", "b.SVG", "c.d/e.pdf", "-")] == ["png", "svg", "pdf", "png"]
    for path in ("figure", "a.jpg", "png", ".png", "a.png.gz", "folder/"):
        with pytest.raises(UsageError, match=r"expected|has no ending|ends in"):
            format_of(path)


@pytest.mark.parametrize("name", ["$x^2$", "_hidden.g2o", "a\nb", "$", "x" * 500, "100 %", r"\frac{1}", "{}"])
def test_any_name_can_be_a_label(tmp_path, name):
    """Nothing is a formula, nothing is hidden, nothing breaks the legend's lines."""
    figure = draw_map([scene(tmp_path, SQUARE, name), scene(tmp_path, SQUARE, "other")], options=MapOptions(title=name))
    _, notes = render(figure, "png", 40)
    labels = labels_of(figure)
    assert len(labels) == 4 and not notes
    shown = labels[0].replace("\N{ZERO WIDTH SPACE}", "").replace(r"\$", "$")
    assert shown.startswith(name[:20].replace("\n", "\N{REPLACEMENT CHARACTER}"))
    assert len(shown) < 120


def test_characters_that_the_font_lacks_are_said(tmp_path):
    _, notes = render(draw_map([scene(tmp_path, SQUARE, "地図")]), "png", 40)
    assert len(notes) == 1 and "not in the font" in notes[0]


def test_the_user_s_settings_do_not_matter(tmp_path):
    import matplotlib

    expected, _ = render(draw_map([scene(tmp_path)]), "png", 40)
    with matplotlib.rc_context({"lines.linewidth": 9.0, "font.size": 20.0, "axes.grid": True}), style.house_style():
        assert render(draw_map([scene(tmp_path)]), "png", 40)[0] == expected


def test_house_style_leaves_no_trace():
    import matplotlib

    with matplotlib.rc_context({"font.size": 33.0}):
        with style.house_style():
            assert matplotlib.rcParams["font.size"] == 9.0
        assert matplotlib.rcParams["font.size"] == 33.0


def test_size_and_title_are_as_asked(tmp_path):
    figure = draw_iterations(read_runs(str(write_file(tmp_path, TRACE)), "t"), options=FigureOptions("", (3.0, 2.0)))
    assert figure.get_size_inches().tolist() == [3.0, 2.0]
    assert figure.axes[0].get_title(loc="left") == ""
    data, _ = render(figure, "png", 100)
    assert (int.from_bytes(data[16:20]), int.from_bytes(data[20:24])) == (300, 200)


def test_the_command_writes_png_to_a_pipe_without_pyplot():
    """pyplot has state of its own, looks for a display and takes as long again to import."""
    script = (
        "import sys; from slamcli.cli.main import main; code = main(sys.argv[1:]);"
        "sys.exit(code or 9 * ('matplotlib.pyplot' in sys.modules))"
    )
    words = [sys.executable, "-c", script, "plot", str(BUNDLED / "square_toro.graph"), "-o", "-"]
    done = subprocess.run(words, capture_output=True, timeout=120)
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.startswith(b"\x89PNG") and done.stdout.endswith(b"IEND\xaeB`\x82")


# -- palette -----------------------------------------------------------------------------------------------------------


def _lightness(colour):
    """CIE L*."""
    rgb = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return 116.0 * np.cbrt(linear @ [0.2126, 0.7152, 0.0722]) - 16.0


def test_palette():
    """Before and after differ in grey; all differ in colour or style; chi2 darkens evenly."""
    first, second = style.COLOURS[:2]
    assert _lightness(first) - _lightness(second) > 20.0
    assert len(set(style.COLOURS)) == 6
    looks = [style.look(k, 36, 1.0) for k in range(36)]
    assert len({(look["color"], str(look["linestyle"])) for look in looks}) >= 30
    ramp = [_lightness(to_hex(style.severity()(k / 10.0))) for k in range(11)]
    assert (np.diff(ramp) < -3.0).all()
