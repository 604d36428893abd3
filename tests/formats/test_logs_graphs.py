"""Graph files as logs: readings without a landmark; and files and folders that are no log."""

import gzip

import numpy as np
import pytest
from logs_support import write_folder
from support import write_file

from slamcli.errors import InputError, UsageError
from slamcli.formats.logs import read_log

FEATURES = """\
VERTEX_SE2 5 1 2 0
DATA_FEATURE_POINTXY 0 2 1 2 300 1 200
VERTEX_SE2 3 0 0 0
FIX 3
DATA_FEATURE_POINTXY 0 2 3 4 300 0 300
DATA_FEATURE_POINTXY 0 2 5 6 300 0 300
EDGE_SE2 3 5 1 2 0 1 0 0 1 0 1
"""


def read_text(tmp_path, text, **options):
    return read_log(str(write_file(tmp_path, text)), **options)


def test_features_belong_to_the_vertex_above(tmp_path):
    log = read_text(tmp_path, FEATURES)
    (found,) = log.observations
    assert log.ids.tolist() == [3, 5] and found.steps.tolist() == [0, 0, 1]
    assert found.landmarks.tolist() == [-1, -1, -1] and found.measurements.tolist() == [[3, 4], [5, 6], [1, 2]]
    assert found.information is not None and found.information[2].tolist() == [[300, 1], [1, 200]]
    assert any("not known (landmark -1)" in note for note in log.notes)
    assert not any("DATA_FEATURE" in note for note in log.notes)


def test_features_beside_observations_are_counted(tmp_path):
    log = read_text(tmp_path, FEATURES + "EDGE_SE2_XY 3 90 1 2 1 0 1\n")
    assert log.observations[0].landmarks.tolist() == [90]
    assert "3 DATA_FEATURE_POINTXY records are left out" in log.notes


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (FEATURES.replace("3 4 300 0 300", "3 4 300 0"), r":5:1: DATA_FEATURE_POINTXY expects 7 numbers, found 6"),
        (FEATURES.replace("3 4 300 0 300", "3 x 300 0 300"), r":5:28: expected a finite number, found 'x'"),
        ("DATA_FEATURE_POINTXY 0 2 1 2 3 0 3\n" + FEATURES, r":1:1: DATA_FEATURE_POINTXY belongs to the vertex above"),
    ],
)
def test_defects(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        read_text(tmp_path, text)
    assert sum("skipped" in note for note in read_text(tmp_path, text, lenient=True).notes) == 1


def test_toro_and_gzip(tmp_path):
    text = "VERTEX2 0 0 0 0\nVERTEX2 1 1 0 0\nEDGE2 0 1 1 0 0 1 0 1 1 0 0\n"
    with pytest.raises(InputError, match="holds no reading of a landmark"):
        read_text(tmp_path, text)
    packed = write_file(tmp_path, gzip.compress(FEATURES.encode()), "log.gz")
    assert len(read_log(str(packed))) == 2
    assert len(read_text(tmp_path, FEATURES, dialect="g2o")) == 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no record at all"),
        ("# only a comment\n", "holds no record at all"),
        ("1 2 3\n4 5 6\n", "is a table of numbers"),
        ("ODOMETRY 0 1 1 0 0 1 0 0 1 0 1\n", "belong to iSAM or GTSAM files"),
    ],
)
def test_files_that_are_no_log(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        read_text(tmp_path, text)


def test_folders_that_are_no_log(tmp_path):
    with pytest.raises(InputError, match="holds no sensor log of a known format") as error:
        read_log(str(write_folder(tmp_path / "empty")))
    assert "MRCLAM" in "".join(error.value.details)
    with pytest.raises(InputError, match="cannot be read"):
        read_log(str(tmp_path / "nothing.g2o"))
    with pytest.raises(UsageError, match="has no dialect"):
        read_log(str(tmp_path / "empty"), dialect="g2o")
    with pytest.raises(UsageError, match="the log of one robot"):
        read_text(tmp_path, FEATURES, robot=1)


def test_truth_of_a_graph(tmp_path):
    truth = write_file(tmp_path, "VERTEX_SE2 3 0 0 0\nVERTEX_SE2 5 1 2 0\nVERTEX_XY 90 3 4\n", "truth.g2o")
    log = read_text(tmp_path, FEATURES, truth=str(truth))
    assert log.true_trajectory is not None and log.true_landmarks is not None
    np.testing.assert_array_equal(log.true_landmarks[1], [[3, 4]])
