"""The log of a graph: driven in the order of ids, it says what the graph's factors say."""

import numpy as np
import pytest
from support import BUNDLED, dataset, write_file

from slamcli import formats
from slamcli.errors import InputError
from slamcli.evaluation.drift import dead_reckoning
from slamcli.formats.logs import read_log
from slamcli.formats.logs.timeline import integrate
from slamcli.graph.graph_log import graph_log
from slamcli.models import BEARING_2D, POINT_OBSERVATION_2D, RANGE_2D, RANGE_BEARING_2D, RELATIVE_POSE_2D, SE2

GRAPH = """\
VERTEX_SE2 7 1 2 0.5
VERTEX_SE2 3 0.5 0.25 0.125
VERTEX_SE2 5 4 5 6
VERTEX_XY 90 1 1
EDGE_SE2 5 7 3 0 0.1 1 0 0 2 0 3
EDGE_SE2 3 5 1 2 0.5 10 1 0.5 20 0.2 30
EDGE_SE2 3 5 9 9 0 1 0 0 1 0 1
EDGE_SE2 3 7 9 9 0 1 0 0 1 0 1
EDGE_SE2_XY 7 90 1 2 10 1 20
EDGE_SE2_RB 3 90 2 7 10 1 20
EDGE_SE2_RB 5 90 3 0.5 10 0 20
LANDMARK2:RB 3 90 4 0.5 11 0 20
EDGE_PRIOR_SE2 3 0 0 0 1 0 0 1 0 1
"""


def graph_of(tmp_path, text):
    return formats.read(str(write_file(tmp_path, text)))


def test_order_and_what_is_left_out(tmp_path):
    log = graph_log(graph_of(tmp_path, GRAPH))
    assert log.ids.tolist() == [3, 5, 7] and log.model == "body" and log.times.tolist() == [0, 1, 2]
    assert log.start.tolist() == [0.5, 0.25, 0.125]
    np.testing.assert_allclose(log.controls, [[1, 2, 0.5], [3, 0, 0.1]])
    assert log.information is not None
    assert log.information[0].tolist() == [[10, 1, 0.5], [1, 20, 0.2], [0.5, 0.2, 30]]
    sensed, seen = log.observations
    assert sensed.kind is RANGE_BEARING_2D and seen.kind is POINT_OBSERVATION_2D
    assert sensed.steps.tolist() == [0, 0, 1] and sensed.measurements[:, 0].tolist() == [2, 4, 3]
    assert seen.steps.tolist() == [2] and seen.landmarks.tolist() == [90]
    notes = "\n".join(log.notes)
    assert "1 further measurements of a step" in notes and "1 loop closures" in notes
    assert "1 factors of the kind pose_prior_2d" in notes


def test_steps_measured_backward(tmp_path):
    """Turned round, an edge has the same chi2 near its optimum: to second order in a small residual."""
    backward = "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 2 0.5\nEDGE_SE2 1 0 -1.5 1 2.5 10 1 0.5 20 0.2 30\n"
    graph = graph_of(tmp_path, backward)
    log = graph_log(graph)
    assert "1 steps of the odometry were measured backward" in log.notes[-1] and log.information is not None
    rng = np.random.default_rng(5)
    first = rng.normal(size=(20, 3))
    second = SE2.retract(SE2.compose(first, np.tile(log.controls, (20, 1))), 1e-5 * rng.normal(size=(20, 3)))
    forward = RELATIVE_POSE_2D.residual((first, second), np.tile(log.controls, (20, 1)), None)
    original = RELATIVE_POSE_2D.residual((second, first), np.tile(graph.factors[0].measurements, (20, 1)), None)
    chi2 = np.einsum("mi,ij,mj->m", forward, log.information[0], forward)
    wanted = np.einsum("mi,ij,mj->m", original, graph.factors[0].information[0], original)
    np.testing.assert_allclose(chi2, wanted, rtol=1e-4)


def test_bundled_graph():
    """Its displacements add up to dead reckoning, and its readings are the factors' at any state."""
    graph = formats.read(str(BUNDLED / "landmarks_small.g2o"))
    log = graph_log(graph)
    path = SE2.normalize(integrate(log.controls, log.start))
    poses = graph.variables["SE2"]
    expected = dead_reckoning(graph).values["SE2"][np.argsort(poses.rank)]
    np.testing.assert_allclose(SE2.compose(SE2.inverse(expected), path), np.zeros(path.shape), atol=1e-9)
    values = poses.values[np.argsort(poses.rank)]
    points = graph.variables["XY"]
    for readings in log.observations:
        factors = [f for f in graph.factors if f.kind is readings.kind]
        x = values[readings.steps], points.values[points.rows_of(readings.landmarks)]
        residual = readings.kind.residual(x, readings.measurements, None)
        chi2 = np.vecdot(residual, np.matvec(readings.information, residual)).sum()
        assert chi2 == pytest.approx(sum(f.chi2(graph.values).sum() for f in factors), rel=1e-12)
    assert sum(map(len, log.observations)) == sum(len(f) for f in graph.factors if f.kind is not RELATIVE_POSE_2D)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (GRAPH.replace("EDGE_SE2 5 7", "EDGE_SE2 3 7"), "no edge joins pose 5 to the next one, 7"),
        ("VERTEX_XY 1 0 0\n", "needs planar poses"),
        (GRAPH + "VERTEX_TRACKXYZ 100 1 2 3\n", "spatial variables"),
        (GRAPH.replace(" 90 ", " -2 "), "the id of a landmark of a sensor log must be from 0"),
    ],
)
def test_graphs_that_are_no_log(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        graph_log(graph_of(tmp_path, text))


def test_poses_without_values_start_at_the_origin(tmp_path):
    log = graph_log(graph_of(tmp_path, "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\nEDGE_SE2_XY 1 9 1 2 1 0 1\n"))
    assert log.start.tolist() == [0, 0, 0] and any("gives pose 0 no value" in note for note in log.notes)


@pytest.mark.parametrize(
    ("name", "kind", "steps", "readings", "landmarks"),
    [
        ("victoriaPark-full", POINT_OBSERVATION_2D, 6969, 3640, 151),
        ("victoriaPark_from_isam", POINT_OBSERVATION_2D, 6969, 3640, 151),
        ("cityTrees10000_from_isam", POINT_OBSERVATION_2D, 10000, 4443, 100),
        ("world-2000-full", POINT_OBSERVATION_2D, 2001, 3812, 69),
        ("world-2000-default", POINT_OBSERVATION_2D, 2001, 2768, 463),
        ("slam-2d-bearingOnly", BEARING_2D, 101, 1187, 142),
    ],
)
def test_standard_graphs(name, kind, steps, readings, landmarks):
    log = read_log(str(dataset(f"landmark2d/{name}.g2o")))
    (found,) = log.observations
    assert found.kind is kind and len(log) == steps and len(found) == readings
    assert len(np.unique(found.landmarks)) == landmarks


@pytest.mark.parametrize("name", ["victoriaPark", "world-2000"])
def test_graphs_without_association(name):
    """The same readings at the same steps as in the graph that knows their landmarks."""
    unknown, known = (read_log(str(dataset(f"landmark2d/{name}-{end}.g2o"))) for end in ("noassoc", "full"))
    np.testing.assert_array_equal(unknown.controls, known.controls)
    (a,), (b,) = unknown.observations, known.observations
    assert (a.landmarks == -1).all() and a.kind is b.kind is POINT_OBSERVATION_2D and RANGE_2D is not a.kind
    rows = [np.lexsort((o.measurements[:, 1], o.measurements[:, 0], o.steps)) for o in (a, b)]
    np.testing.assert_array_equal(a.steps[rows[0]], b.steps[rows[1]])
    np.testing.assert_array_equal(a.measurements[rows[0]], b.measurements[rows[1]])
    assert a.information is not None and b.information is not None
    np.testing.assert_array_equal(a.information[rows[0]], b.information[rows[1]])
