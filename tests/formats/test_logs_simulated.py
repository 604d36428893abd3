"""Logs of slamcli simulate --log, read back: the same numbers as in the simulation that wrote them."""

import numpy as np
import pytest
from logs_support import check_invariants, displacements
from support import write_file

from slamcli import formats
from slamcli.errors import InputError
from slamcli.formats.log import write_log
from slamcli.formats.logs import read_log
from slamcli.graph.graph_log import graph_log
from slamcli.models import POINT_OBSERVATION_2D, RANGE_BEARING_2D
from slamcli.simulation.record import log_blocks
from slamcli.simulation.settings import scenario_of
from slamcli.simulation.simulate import simulate

HEAD = "time_s,kind,pose,other,z1,z2,z3,i11,i12,i13,i22,i23,i33\n"
LOG = (
    HEAD
    + """\
0,xy,5,9,1,2,,4,1,5,,,
2,velocity,6,5,0.5,0,0,,,,,,
2,odometry,6,5,1,0,0,10,0,1,20,0,30
3,closure,7,5,1,0,0,10,0,0,20,0,30
3,velocity,7,6,0,1,0,,,,,,
3,odometry,7,6,0,0,1,10,0,0,20,0,30
3,range-bearing,7,-1,3,7,,4,0,5,,,
3,gps,7,,3,7,,4,0,5,,,
"""
)


def read_text(tmp_path, text, **options):
    return read_log(str(write_file(tmp_path, text, "log.csv")), **options)


def test_log(tmp_path):
    log = read_text(tmp_path, "# a comment\n" + LOG)
    check_invariants(log)
    assert log.model == "velocity" and log.times.tolist() == [0, 2, 3] and log.ids.tolist() == [5, 6, 7]
    assert log.controls.tolist() == [[0.5, 0, 0], [0, 1, 0]]
    assert log.information is not None and log.information[0].tolist() == [[10, 0, 1], [0, 20, 0], [1, 0, 30]]
    xy, sensed = log.observations
    assert xy.kind is POINT_OBSERVATION_2D and xy.steps.tolist() == [0] and xy.landmarks.tolist() == [9]
    assert xy.information is not None and xy.information[0].tolist() == [[4, 1], [1, 5]]
    assert sensed.kind is RANGE_BEARING_2D and sensed.landmarks.tolist() == [-1]
    np.testing.assert_allclose(sensed.measurements, [[3, 7 - 2 * np.pi]])
    notes = "\n".join(log.notes)
    assert "1 readings come from nothing" in notes and "1 closure records" in notes and "1 gps records" in notes
    assert "the start is the origin" in notes


def test_controls_that_miss_the_relative_poses_are_not_used(tmp_path):
    log = read_text(tmp_path, LOG.replace("velocity,6,5,0.5", "velocity,6,5,0.6"))
    assert log.model == "body" and log.controls.tolist() == [[1, 0, 0], [0, 0, 1]]
    assert any("velocity controls of the log are not used" in note for note in log.notes)


def test_truth_is_the_start(tmp_path):
    truth = write_file(tmp_path, "VERTEX_SE2 4 1 1 1\nVERTEX_SE2 5 7 8 0.5\nVERTEX_XY 9 3 4\n", "truth.g2o")
    log = read_text(tmp_path, LOG, truth=str(truth))
    assert log.start.tolist() == [7, 8, 0.5]
    assert log.true_trajectory is not None and len(log.true_trajectory) == 2
    assert log.true_landmarks is not None and log.true_landmarks[0].tolist() == [9]
    stamped = write_file(tmp_path, "0 1 2 0 0 0 0 1\n9 5 5 0 0 0 0 1\n", "truth.tum")
    assert read_text(tmp_path, LOG, truth=str(stamped)).start.tolist() == [1, 2, 0]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("0,xy,5,9,1,2,,", "0,xy,5,9,1,2,", r":2:1: expected 13 cells between commas, found 12"),
        ("0,xy,5,9,1,2,", "0,xy,5,9,1,,", r":2:12: expected a number in the column z2 of a record xy"),
        ("0,xy,5,9,1,2,", "0,xy,5,9,1,2,3", r":2:14: expected an empty cell in the column z3"),
        ("0,xy,5,9,1,2,", "0,xy,5,9,1,nan,", r":2:12: expected a finite number in the column z2, found 'nan'"),
        ("0,xy,5,9,1,2,", "0,xy,5,9,1,1_0,", r":2:12: expected a finite number in the column z2, found '1_0'"),
        ("0,xy,5,9,", "0,xy,5,9.5,", r":2:8: expected an id, a whole number, in the column other"),
        ("0,xy,5,9,", "0,sonar,5,9,", r":2:3: expected a kind of record \(.*\), found 'sonar'"),
        ("0,xy,5,", "0,xy,8,", r"log.csv:2: no odometry leads to pose 8"),
        ("3,odometry,7,6", "3,odometry,7,5", r"log.csv:7: the odometry leads from pose 5 to 7, expected .* pose 6"),
        ("3,odometry,7,6", "1,odometry,7,6", r"log.csv:7: the time goes back"),
        ("time_s,kind", "kind,time_s", r"holds no record of a known format"),
        ("0,xy,", "0,point,", r"the log of a spatial simulation"),
    ],
)
def test_defects(tmp_path, old, new, message):
    assert old in LOG
    with pytest.raises(InputError, match=message):
        read_text(tmp_path, LOG.replace(old, new))


def test_lenient(tmp_path):
    log = read_text(tmp_path, LOG.replace("0,xy,5,9,1,2,", "0,xy,5,9,1,x,") + "3,sonar,,,,,,,,,,,\n", lenient=True)
    assert len(log.observations) == 1 and sum("skipped" in note for note in log.notes) == 2
    with pytest.raises(InputError, match="holds no odometry"):
        read_text(tmp_path, HEAD + "0,xy,5,9,1,2,,4,1,5,,,\n")


@pytest.mark.parametrize("model", ["body", "velocity", "odometry", "differential"])
def test_round_trip(tmp_path, model):
    """The log of a simulation is that of its graph, but for the controls behind the relative poses."""
    content = {"world": "square", "poses": 40, "robot": {"model": model}, "landmarks": {"density": 0.02}}
    simulation = simulate(scenario_of({**content, "sensors": [{"kind": "range-bearing"}]}, "test"))
    path = tmp_path / "log.csv"
    write_log(log_blocks(simulation), str(path), ["a comment"])
    formats.write(simulation.truth, str(tmp_path / "truth.g2o"))
    log, wanted = read_log(str(path), truth=str(tmp_path / "truth.g2o")), graph_log(simulation.graph)
    check_invariants(log)
    assert log.model == ("body" if model == "differential" else model)
    np.testing.assert_allclose(displacements(log), wanted.controls, atol=1e-8)
    np.testing.assert_allclose(log.information, wanted.information, rtol=1e-6)
    np.testing.assert_allclose(log.times, np.arange(40) * simulation.scenario.robot.period)
    (found,), (expected,) = log.observations, wanted.observations
    assert found.kind is expected.kind
    np.testing.assert_array_equal(found.steps, expected.steps)
    np.testing.assert_array_equal(found.landmarks, expected.landmarks)
    np.testing.assert_allclose(found.measurements, expected.measurements, atol=1e-8)
    np.testing.assert_array_equal(log.ids, wanted.ids)
