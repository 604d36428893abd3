"""Dead reckoning and landmarks: a drift worked by hand, and what the odometry of a graph says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from noisy_paths import planar
from support import BUNDLED, write_file

from slamcli.evaluation import dead_reckoning, evaluate, gap
from slamcli.evaluation.alignment import align
from slamcli.evaluation.landmarks import landmark_errors, landmarks
from slamcli.formats import read
from slamcli.graph.trajectory import of_graph

#: A square of 10 m whose odometry turns by 80 instead of 90 degrees at each corner; a landmark seen from the last pose.
TURN = np.radians(80.0)
INFO = "1 0 0 1 0 1"
SQUARE = f"""\
VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 10 0 {np.pi / 2}
VERTEX_SE2 2 10 10 {np.pi}
VERTEX_SE2 3 0 10 {-np.pi / 2}
VERTEX_SE2 4 0 0 0
VERTEX_XY 9 3 0
EDGE_SE2 0 1 10 0 {TURN} {INFO}
EDGE_SE2 1 2 10 0 {TURN} {INFO}
EDGE_SE2 2 3 10 0 {TURN} {INFO}
EDGE_SE2 3 4 10 0 {TURN} {INFO}
EDGE_SE2 4 0 0 0 0 {INFO}
EDGE_SE2_XY 4 9 3 0 1 0 1
"""


def test_gap_of_a_square(tmp_path: Path) -> None:
    graph = read(str(write_file(tmp_path, SQUARE)))
    integrated = dead_reckoning(graph)
    truth, path = of_graph(graph), of_graph(integrated)
    # the corners: 10 m along headings 0, 80, 160 and 240 degrees; then a heading of 320
    end = 10.0 * sum(np.exp(1j * k * TURN) for k in range(4))
    np.testing.assert_allclose(path.poses[-1], [end.real, end.imag, np.radians(-40.0)], atol=1e-12)
    found = gap(path, truth)
    assert found.translation == pytest.approx(abs(end))
    assert found.rotation == pytest.approx(40.0)
    assert found.path_length == 40.0
    assert found.drift_translation == pytest.approx(100.0 * abs(end) / 40.0)
    assert found.drift_rotation == pytest.approx(1.0)
    assert (found.closing_distance, found.closing_rotation) == (pytest.approx(abs(end)), pytest.approx(40.0))
    # the landmark hangs off the drifted end: 3 m ahead of it
    _, points = landmarks(integrated)
    seen = end + 3.0 * np.exp(4j * TURN)
    np.testing.assert_allclose(points, [[seen.real, seen.imag, 0.0]], atol=1e-12)
    np.testing.assert_array_equal(graph.values["SE2"][1], [10.0, 0.0, np.pi / 2])  # the graph itself stays


def test_gap_without_truth() -> None:
    path = planar(50)
    found = gap(path)
    assert (found.translation, found.rotation, found.drift_translation, found.drift_rotation) == (None,) * 4
    assert found.path_length == pytest.approx(path.length)
    assert found.closing_distance == pytest.approx(float(np.linalg.norm(path.poses[-1, :2] - path.poses[0, :2])))


def test_no_path_no_drift() -> None:
    still = gap(planar(1), planar(1))
    assert (still.translation, still.path_length, still.drift_translation) == (0.0, 0.0, None)


@pytest.mark.parametrize("name", ["manhattan_small.g2o", "sphere_small.g2o", "landmarks_small.g2o"])
def test_bundled_files_hold_their_odometry(name: str) -> None:
    """Their poses are what odometry alone says (datasets/README.md), up to the digits of the file.

    Their landmarks are where the first sighting puts them; dead reckoning has them where all sightings do.
    """
    graph = read(str(BUNDLED / name))
    reckoned = dead_reckoning(graph)
    result = evaluate([of_graph(reckoned)], of_graph(graph)).estimates[0]
    assert result.absolute is not None
    assert result.absolute["translation"].max < 1e-5
    assert (result.landmarks is not None) == ("landmarks" in name)
    if result.landmarks is not None and result.landmarks.error is not None:
        assert result.landmarks.matched == graph.landmarks > 0
        assert reckoned.chi2() < graph.chi2()


def test_landmark_errors_by_hand(tmp_path: Path) -> None:
    """Two of three landmarks have a partner; the estimate is shifted by (1, 1), which the alignment takes out."""
    poses = "".join(f"VERTEX_SE2 {k} {k} {k * k} 0\n" for k in range(4))
    shifted = "".join(f"VERTEX_SE2 {k} {k + 1} {k * k + 1} 0\n" for k in range(4))
    truth = read(str(write_file(tmp_path, poses + "VERTEX_XY 10 5 5\nVERTEX_XY 11 6 6\nVERTEX_XY 12 0 0\n")))
    estimate = read(
        str(write_file(tmp_path, shifted + "VERTEX_XY 11 7 11\nVERTEX_XY 10 9 6\nVERTEX_XY 13 0 0\n", "estimate.g2o"))
    )
    pair = of_graph(estimate).lifted(), of_graph(truth).lifted()
    found = landmark_errors(estimate, truth, align(*pair, "se", planar=True))
    assert found is not None and found.error is not None
    assert (found.matched, found.unmatched_estimate, found.unmatched_truth) == (2, 1, 1)
    assert found.error.max == pytest.approx(4.0)  # landmark 11; landmark 10 is off by 3
    assert found.error.rmse == pytest.approx(np.sqrt((9.0 + 16.0) / 2.0))
    off = landmark_errors(estimate, truth, align(*pair, "none"))
    assert off is not None and off.error is not None
    assert off.error.max == pytest.approx(np.hypot(1.0, 5.0))


def test_landmarks_that_do_not_match_are_said(tmp_path: Path) -> None:
    poses = "".join(f"VERTEX_SE2 {k} {k} {k * k} 0\n" for k in range(4))
    truth = of_graph(read(str(write_file(tmp_path, poses + "VERTEX_XY 10 5 5\n"))))
    other = of_graph(read(str(write_file(tmp_path, poses + "VERTEX_XY 11 5 5\n"))), "other")
    none = of_graph(read(str(write_file(tmp_path, poses))), "none")
    evaluation = evaluate([other, none], truth)
    assert evaluation.estimates[0].landmarks is not None and evaluation.estimates[0].landmarks.error is None
    assert evaluation.estimates[1].landmarks is None
    assert evaluation.notes == ["other: none of its 1 landmarks has the id of one of the truth"]
