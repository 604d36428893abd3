"""UTIAS MRCLAM folders: whose barcode is whose, velocities between the times of all records, truth."""

import numpy as np
import pytest
from logs_support import check_invariants, dead_reckoning, displacements, innovations, true_poses, write_folder
from support import dataset

from slamcli.errors import InputError, UsageError
from slamcli.formats.logs import read_log
from slamcli.models import RANGE_BEARING_2D

FILES = {
    "Barcodes__dat": "# Subject Barcode\n 1 5\n 2 14\n 6 63\n 7 81\n",
    # half a metre a second for 2 s, then a turn on the spot of a quarter in 1 s
    "Robot1_Odometry__dat": f"# t v w\n10.0 0.5 0\n12.0 0 {np.pi / 2}\n13.0 0 0\n",
    # subject 7 at 12.5; subject 6 at 11; robot 2; a barcode of nobody; before the odometry
    "Robot1_Measurement__dat": "12.5 81 2 7.0\n11 63 1 0.5\n11 14 1 0\n11 99 1 0\n9 63 1 0\n",
    "Landmark_Groundtruth__dat": "6 1 2 0 0\n7 3 4 0 0\n",
    "Robot1_Groundtruth__dat": "9 0 0 3.0\n11 2 4 -3.0\n20 2 4 0\n",
}


@pytest.fixture
def folder(tmp_path):
    return write_folder(tmp_path / "mrclam", **FILES)


def test_steps_and_controls(folder):
    """The interval of 2 s is split at 11 s, the one of 1 s at 12.5 s."""
    log = read_log(str(folder))
    check_invariants(log)
    assert log.model == "velocity" and log.information is None
    assert log.times.tolist() == [10.0, 11.0, 12.0, 12.5, 13.0]
    np.testing.assert_allclose(log.controls[:, :2], [[0.5, 0], [0.5, 0], [0, np.pi / 2], [0, np.pi / 2]])
    half = [0, 0, np.pi / 4]
    np.testing.assert_allclose(displacements(log), [[0.5, 0, 0], [0.5, 0, 0], half, half], atol=1e-15)
    readings = log.observations[0]
    assert readings.kind is RANGE_BEARING_2D and readings.information is None
    assert readings.steps.tolist() == [1, 3] and readings.landmarks.tolist() == [6, 7]
    np.testing.assert_allclose(readings.measurements, [[1, 0.5], [2, 7.0 - 2 * np.pi]])


def test_truth_and_what_is_left_out(folder):
    """The start lies half way between two true poses whose headings are on both sides of pi."""
    log = read_log(str(folder))
    np.testing.assert_allclose(log.start, [1, 2, -np.pi], atol=1e-12)
    assert log.true_landmarks is not None and log.true_landmarks[0].tolist() == [6, 7]
    assert log.true_landmarks[1].tolist() == [[1, 2], [3, 4]]
    assert log.true_trajectory is not None and log.true_trajectory.stamps is not None
    assert log.true_trajectory.stamps.tolist() == [9, 11, 20]
    notes = "\n".join(log.notes)
    assert "1 readings have a barcode of no subject" in notes
    assert "1 readings of other robots are left out" in notes
    assert "1 readings before or after the odometry are left out" in notes
    assert "1 times go back in the readings: they are sorted" in notes
    assert log.ids.tolist() == [1000, 1001, 1002, 1003, 1004]


def test_without_truth_the_start_is_the_origin(folder):
    (folder / "Robot1_Groundtruth.dat").unlink()
    (folder / "Landmark_Groundtruth.dat").unlink()
    log = read_log(str(folder))
    assert log.start.tolist() == [0, 0, 0] and log.true_trajectory is None and log.true_landmarks is None
    assert any("Robot1_Groundtruth.dat is not there" in note for note in log.notes)


def test_choice_of_a_robot(folder):
    (folder / "Robot3_Odometry.dat").write_text("10 1 0\n14 1 0\n")
    (folder / "Robot3_Measurement.dat").write_text("11 63 1 0\n")
    assert any(note.startswith("robot 1 of the robots 1, 3") for note in read_log(str(folder)).notes)
    assert read_log(str(folder), robot=3).times.tolist() == [10, 11, 14]
    assert read_log(str(folder / "Robot3_Odometry.dat")).times.tolist() == [10, 11, 14]
    with pytest.raises(UsageError, match="no robot 2") as error:
        read_log(str(folder), robot=2)
    assert "1, 3" in error.value.details[0]


def test_several_records_at_one_time(folder):
    """Of two velocities at one time the last one holds; two readings at one time are of one step."""
    (folder / "Robot1_Odometry.dat").write_text("10 9 0\n10 1 0\n12 0 0\n")
    (folder / "Robot1_Measurement.dat").write_text("11 63 1 0\n11 81 2 0\n")
    log = read_log(str(folder))
    assert log.times.tolist() == [10, 11, 12] and log.controls[:, 0].tolist() == [1, 1]
    assert log.observations[0].steps.tolist() == [1, 1]


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("Robot1_Odometry.dat", "10 0 0\n9 0 0\n", r"Robot1_Odometry.dat:2:1: the time goes back"),
        ("Robot1_Odometry.dat", "10 0 0\n11 nan 0\n", r"Robot1_Odometry.dat:2:4: expected a finite number"),
        ("Robot1_Odometry.dat", "10 0 0\n11 0\n12 0 0\n", r"Robot1_Odometry.dat:2:5: expected 3 numbers, found 2"),
        ("Robot1_Odometry.dat", "10 0\n11 0\n", r"Robot1_Odometry.dat:1:1: expected 3 numbers a line \(t v omega\)"),
        ("Robot1_Odometry.dat", "# nothing\n", r"Robot1_Odometry.dat: holds no record at all"),
        ("Robot1_Measurement.dat", "11 6.5 1 0\n", r"Robot1_Measurement.dat:1:4: expected a barcode, a whole number"),
        ("Barcodes.dat", "6 63\n7 63\n", r"Barcodes.dat:2:3: this barcode belongs to another subject"),
        ("Robot1_Groundtruth.dat", "1 0 0 0\n1 0 0 0\n", r"Robot1_Groundtruth.dat:2:1: the time goes back or stands"),
    ],
)
def test_defects(folder, name, text, message):
    (folder / name).write_text(text)
    with pytest.raises(InputError, match=message):
        read_log(str(folder))


def test_lenient_skips_and_says_so(folder):
    (folder / "Robot1_Odometry.dat").write_text("10 1 0\n9 5 0\n11 nan 0\n12 0 0\n")
    log = read_log(str(folder), lenient=True)
    assert log.times.tolist() == [10, 11, 12] and log.controls[:, 0].tolist() == [1, 1]
    assert sum("skipped" in note for note in log.notes) == 2


@pytest.mark.parametrize("name", ["Barcodes.dat", "Robot1_Measurement.dat"])
def test_missing_companion(folder, name):
    (folder / name).unlink()
    with pytest.raises(InputError, match=f"{name}: is missing"):
        read_log(str(folder))


@pytest.mark.parametrize(
    ("robot", "steps", "landmarks", "robots"), [(1, 62750, 1534, 407), (2, 66853, 3239, 792), (3, 63235, 4348, 1277)]
)
def test_dataset_6(robot, steps, landmarks, robots):
    """The readings agree with motion capture: the conventions are right. Odometry leads there, for a while."""
    log = read_log(str(dataset("raw/mrclam/MRCLAM_Dataset6")), robot=robot)
    check_invariants(log)
    assert len(log) == steps and len(log.observations[0]) == landmarks
    assert f"{robots} readings of other robots are left out" in log.notes
    poses = true_poses(log, log.times[log.observations[0].steps])
    distance, bearing = np.median(np.abs(innovations(log, poses)), axis=0)
    assert distance < 0.15 and bearing < 0.008
    path = dead_reckoning(log)
    at = np.searchsorted(log.times, log.times[0] + 30.0)
    error = path[at, :2] - true_poses(log, log.times[at : at + 1])[0, :2]
    assert np.hypot(*error) < 0.3
