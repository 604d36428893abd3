"""ODOMETRY and SENSOR records of robot mapping courses."""

import numpy as np
import pytest
from logs_support import check_invariants, dead_reckoning, displacements, innovations, write_folder
from support import dataset

from slamcli.errors import InputError
from slamcli.formats.logs import read_log

LOG = """\
SENSOR 2 9 0.5
ODOMETRY 0.5 2 -0.5
SENSOR 1 1.5 3.5
SENSOR 2 -0.1 0
ODOMETRY 0 1 0
ODOMETRY 0 0 1
SENSOR 1 4 0
"""


def read_text(tmp_path, text, **options):
    return read_log(str(write_folder(tmp_path / "course", sensor_data__dat=text) / "sensor_data.dat"), **options)


def test_log(tmp_path):
    log = read_text(tmp_path, LOG)
    check_invariants(log)
    assert log.model == "odometry" and log.times.tolist() == [0, 1, 2, 3] and log.start.tolist() == [0, 0, 0]
    np.testing.assert_allclose(displacements(log)[0], [2 * np.cos(0.5), 2 * np.sin(0.5), 0])
    readings = log.observations[0]
    assert readings.steps.tolist() == [0, 1, 1, 3] and readings.landmarks.tolist() == [2, 1, 2, 1]
    np.testing.assert_allclose(readings.measurements[1], [1.5, 3.5 - 2 * np.pi])
    assert "1 ranges are negative" in log.notes and log.true_landmarks is None


def test_world(tmp_path):
    folder = write_folder(tmp_path / "course", sensor_data__dat=LOG, world__dat="2 5 6\n1 3 4\n")
    log = read_log(str(folder))
    assert log.true_landmarks is not None and log.true_landmarks[0].tolist() == [2, 1]
    assert log.true_landmarks[1].tolist() == [[5, 6], [3, 4]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("ODOMETRY 1 2 3\nSENSOR 1 2\n", r":2:1: SENSOR expects 3 numbers, found 2"),
        ("ODOMETRY 1 2 3\nSENSOR 1 2 inf\n", r":2:12: expected a finite number, found 'inf'"),
        ("ODOMETRY 1 2 3\nSENSOR 1.5 2 3\n", r":2:8: expected the id of a landmark"),
        ("ODOMETRY 1 2 3\nLASER 1 2 3\n", r":2:1: expected ODOMETRY or SENSOR, found 'LASER'"),
        ("ODOMETRY 1 2 3\n", r"holds no reading of a landmark"),
        ("", r"holds no record at all"),
    ],
)
def test_defects(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        read_text(tmp_path, text)


def test_lenient(tmp_path):
    log = read_text(tmp_path, LOG + "SENSOR 1 x 0\nLASER\n", lenient=True)
    assert len(log.observations[0]) == 4 and sum("skipped" in note for note in log.notes) == 2


def test_dataset():
    """The odometry has little noise: readings agree with the world from where it leads."""
    log = read_log(str(dataset("raw/robot_mapping_course")))
    check_invariants(log)
    assert len(log) == 332 and len(log.observations[0]) == 1212
    miss = innovations(log, dead_reckoning(log)[log.observations[0].steps])
    assert (np.median(np.abs(miss), axis=0) < [0.1, 0.05]).all() and (np.abs(np.median(miss, axis=0)) < 0.01).all()
