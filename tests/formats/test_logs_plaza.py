"""Plaza folders and PyFG files: distances and turns, ranges between them, covariances, names."""

import numpy as np
import pytest
from logs_support import check_invariants, dead_reckoning, displacements, innovations, true_poses, write_folder
from support import dataset, write_file

from slamcli.errors import InputError, UsageError
from slamcli.formats.logs import read_log
from slamcli.models import POINT_OBSERVATION_2D, RANGE_2D

# a record each 2 s: 1 m straight on, then a turn of 0.2; ranges at 11 s (node 5), 13 s (node 0), 10.5 s (node 0)
PLAZA = {"A_DR__txt": "10 1 0.2\r\n12 1 0.2\r\n14 1 0.2\r\n", "A_TD__txt": "11 2 5 3\n13 2 0 4\n10.5 2 0 9\n99 2 0 1\n"}
TRUTH = """\
VERTEX_XY L0 1.0 2.0
VERTEX_XY L7 3.0 4.0
VERTEX_SE2 8 A0 5 6 0.5
VERTEX_SE2 10 A1 6 6 0.7
EDGE_SE2 10 A0 A1 1 0 0.2 1 0 0 1 0 1
EDGE_RANGE 13 A1 L0 4 1
EDGE_RANGE 11 A1 L7 3 1
"""
PYFG = """\
VERTEX_SE2 0.5 A0 0 0 0
VERTEX_SE2 1.5 A2 1 0.1 0.1
VERTEX_SE2 1.0 A1 0.5 0 7
VERTEX_SE2 0.5 B0 9 9 0
VERTEX_SE2 1.0 B1 9 9 1
VERTEX_XY L3 1.0 2.0
EDGE_SE2 1.0 A0 A1 1 2 3 0.5 0 0 0.25 0 0.1
EDGE_SE2 1.5 A1 A2 4 5 6.5 1 0 0 1 0 1
EDGE_SE2 1.5 A0 A2 4 5 6 1 0 0 1 0 1
EDGE_SE2 1.5 A0 B1 4 5 6 1 0 0 1 0 1
EDGE_SE2 1.5 B0 B1 7 8 9 1 0 0 1 0 1
EDGE_RANGE 1.5 A2 L3 4 0.04
EDGE_RANGE 1.0 A0 L3 5 0.25
EDGE_RANGE 1.0 A0 B1 5 0.25
EDGE_SE2_XY 1.0 A1 L3 5 6 1 0.5 2
VERTEX_SE2:PRIOR 0 A0 0 0 0 1 0 0 1 0 1
"""


def test_plaza_steps(tmp_path):
    """The first record's metre was driven from 8 s on; every record is shared out between the steps in it."""
    log = read_log(str(write_folder(tmp_path / "plaza", **PLAZA)))
    check_invariants(log)
    assert log.model == "odometry" and log.times.tolist() == [8, 10, 10.5, 11, 12, 13, 14]
    shares = np.array([1, 0.25, 0.25, 0.5, 0.5, 0.5])
    np.testing.assert_allclose(displacements(log), np.outer(shares, [1, 0, 0.2]), atol=1e-15)
    readings = log.observations[0]
    assert readings.kind is RANGE_2D and readings.steps.tolist() == [2, 3, 5]
    assert readings.landmarks.tolist() == [0, 5, 0] and readings.measurements[:, 0].tolist() == [9, 3, 4]
    notes = "\n".join(log.notes)
    assert "1 ranges before or after the odometry" in notes and "1 times go back in the ranges" in notes
    assert log.start.tolist() == [0, 0, 0] and log.true_trajectory is None


def test_plaza_truth(tmp_path):
    """Landmarks of the PyFG file get the ids of the nodes that were ranged at the same times."""
    folder = write_folder(tmp_path / "plaza", **PLAZA, a__pyfg=TRUTH.replace("10 A1 6 6 0.7", "10 A1 6 7 0.7"))
    log = read_log(str(folder / "A_TD.txt"))
    assert log.start.tolist() == [5, 6, 0.5]
    assert log.true_trajectory is not None and log.true_trajectory.stamps is not None
    assert log.true_trajectory.stamps.tolist() == [8, 10] and log.true_trajectory.ids is None
    assert log.true_landmarks is not None and log.true_landmarks[0].tolist() == [0, 5]
    assert log.true_landmarks[1].tolist() == [[1, 2], [3, 4]]


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("A_DR.txt", "10 1 0\n10 1 0\n", r"A_DR.txt:2:1: the time goes back or stands still"),
        ("A_DR.txt", "10 1\n11 1\n", r"A_DR.txt:1:1: expected 3 numbers a line \(t distance turn\)"),
        ("A_TD.txt", "11 2 0.5 3\n", r"A_TD.txt:1:6: expected a node, a whole number"),
        ("A_TD.txt", "11 2 0 x\n", r"A_TD.txt:1:8: expected a finite number, found 'x'"),
        ("A_TD.txt", "99 2 0 1\n", r"plaza: holds no reading of a landmark"),
    ],
)
def test_plaza_defects(tmp_path, name, text, message):
    folder = write_folder(tmp_path / "plaza", **PLAZA)
    (folder / name).write_text(text)
    with pytest.raises(InputError, match=message):
        read_log(str(folder))


def test_plaza_folders(tmp_path):
    folder = write_folder(tmp_path / "plaza", **PLAZA, B_DR__txt="1 1 0\n2 1 0\n")
    with pytest.raises(InputError, match="holds several logs"):
        read_log(str(folder))
    with pytest.raises(InputError, match=r"B_TD.txt: is missing"):
        read_log(str(folder / "B_DR.txt"))
    with pytest.raises(UsageError, match="the log of one robot"):
        read_log(str(folder / "A_DR.txt"), robot=1)


def test_pyfg(tmp_path):
    """Poses in the order of their names, covariances inverted, angles wrapped."""
    log = read_log(str(write_file(tmp_path, PYFG, "log.pyfg")), robot=1)
    check_invariants(log)
    assert log.model == "body" and log.times.tolist() == [0.5, 1.0, 1.5]
    np.testing.assert_allclose(log.controls, [[1, 2, 3], [4, 5, 6.5 - 2 * np.pi]])
    assert log.information is not None
    np.testing.assert_allclose(log.information[0], np.diag([2, 4, 10]))
    ranges, points = log.observations
    assert ranges.kind is RANGE_2D and points.kind is POINT_OBSERVATION_2D
    assert ranges.steps.tolist() == [0, 2] and ranges.landmarks.tolist() == [3, 3]
    assert ranges.information is not None and points.information is not None
    np.testing.assert_allclose(ranges.information[:, 0, 0], [4, 25])
    np.testing.assert_allclose(points.information[0] @ [[1, 0.5], [0.5, 2]], np.eye(2), atol=1e-15)
    assert log.true_trajectory is not None
    np.testing.assert_allclose(log.true_trajectory.poses[1], [0.5, 0, 7 - 2 * np.pi])
    assert log.true_landmarks is not None and log.true_landmarks[0].tolist() == [3]
    notes = "\n".join(log.notes)
    assert "2 EDGE_SE2 records of other robots" in notes and "1 EDGE_RANGE records of other robots" in notes
    assert "1 VERTEX_SE2:PRIOR records are left out" in notes and "1 loop closures" in notes


def test_pyfg_robots(tmp_path):
    path = str(write_file(tmp_path, PYFG + "EDGE_RANGE 1 B1 L3 1 1\n", "log.pyfg"))
    assert any(note.startswith("robot A of 2 robots") for note in read_log(path).notes)
    assert read_log(path, robot=2).controls.tolist() == [[7, 8, 9 - 2 * np.pi]]
    with pytest.raises(UsageError, match="no robot 3"):
        read_log(path, robot=3)


def test_pyfg_vertices_that_are_odometry_are_no_truth(tmp_path):
    log = read_log(str(write_file(tmp_path, TRUTH.replace("6 6 0.7", "5.8775825618903725 6.479425538604203 0.7"))))
    assert log.true_trajectory is None and log.true_landmarks is not None
    assert any("there is no true trajectory" in note for note in log.notes)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("A2 L3 4 0.04", "A2 L3 4", r":12:1: EDGE_RANGE expects 5 words, found 4"),
        ("A2 L3 4 0.04", "A2 L3 4 nan", r":12:24: expected a finite number or a name, found 'nan'"),
        ("A2 L3 4 0.04", "A2 L3 4 0", r":12:24: the covariance is not positive definite"),
        ("A2 L3 4 0.04", "A2 L 4 0.04", r":12:19: expected a name, a letter and a number"),
        ("A2 L3 4 0.04", "A2 33 4 0.04", r":12:19: expected a name, a letter and a number"),
        ("A2 L3 4 0.04", "A2 Lx 4 0.04", r":12:19: expected a finite number or a name, found 'Lx'"),
        ("A2 L3 4 0.04", "A2 L9 4 0.04", r":12:19: names what no vertex defines"),
        ("A1 0.5 0 7", "A2 0.5 0 7", r":3:16: this name is defined twice"),
        ("EDGE_SE2 1.5 A1 A2", "EDGE_SE2 1.5 A2 A0", r"no edge joins pose 1 to the next one, 2"),
        ("VERTEX_XY L3 1.0 2.0", "VERTEX_XYZ L3 1 2 3", r"holds spatial records"),
    ],
)
def test_pyfg_defects(tmp_path, old, new, message):
    assert old in PYFG
    with pytest.raises(InputError, match=message):
        read_log(str(write_file(tmp_path, PYFG.replace(old, new), "log.pyfg")), robot=1)


def test_pyfg_lenient(tmp_path):
    text = PYFG.replace("A2 L3 4 0.04", "A2 L3 4 0").replace("1.5 A0 B1 4 5 6", "1.5 A0 B1 4 x 6")
    log = read_log(str(write_file(tmp_path, text, "log.pyfg")), robot=1, lenient=True)
    assert sum("skipped" in note for note in log.notes) == 2
    assert [len(readings) for readings in log.observations] == [1, 1]


def test_plaza_dataset():
    """The radios' ranges are 1 / 0.935 of the true ones, in the median; the PyFG file holds calibrated ones."""
    log = read_log(str(dataset("raw/plaza")))
    check_invariants(log)
    assert len(log) == 13184 and len(log.observations[0]) == 3529
    assert np.unique(log.observations[0].landmarks).tolist() == [0, 1, 5, 6]
    miss = innovations(log, true_poses(log, log.times[log.observations[0].steps]))[:, 0]
    scaled = miss - 0.065 * log.observations[0].measurements[:, 0]
    assert np.median(miss) > 2.5 and abs(np.median(scaled)) < 0.1 and np.median(np.abs(scaled)) < 0.36
    path = dead_reckoning(log)
    at = np.searchsorted(log.times, log.times[0] + 60.0)
    assert np.hypot(*(path[at] - true_poses(log, log.times[at : at + 1])[0])[:2]) < 1.0


def test_pyfg_datasets():
    log = read_log(str(dataset("raw/plaza/plaza1.pyfg")))
    check_invariants(log)
    readings = log.observations[0]
    assert len(log) == 9658 and len(readings) == 3326 and log.true_trajectory is not None
    miss = innovations(log, log.true_trajectory.poses[readings.steps])
    assert abs(np.median(miss)) < 0.02 and np.median(np.abs(miss)) < 0.34
    goats = read_log(str(dataset("raw/range_only/goats_15.pyfg")))
    check_invariants(goats)
    assert len(goats) == 473 and len(goats.observations[0]) == 786 and goats.true_trajectory is None
