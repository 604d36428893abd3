"""The raw log of Victoria Park: the car's kinematics, where its laser sits, and what its readings are of."""

import numpy as np
import pytest
from logs_support import check_invariants, write_folder
from support import dataset

from slamcli.errors import InputError
from slamcli.formats.logs import read_log
from slamcli.formats.logs.timeline import integrate
from slamcli.formats.logs.victoria_park import A, B, H, L
from slamcli.geometry import se2

FILES = {
    "aa3_DRS__csv": "1.0,0,0\n1.5,2,0\n2.5,0,0\n",
    "lasersampling__txt": "  0.5e+003\r\n 2.0e+003\r\n 3.0e+003\r\n",
    "ObservationDistance__txt": "0 0 0\n5 7 0\n0 0 0\n",
    "ObservationAngle__txt": f"2e-8 2e-8 2e-8\n{np.pi / 2} 0 2e-8\n2e-8 2e-8 2e-8\n",
    "aa3_GPS__csv": "1,10,20\n2,11,21\n",
}


@pytest.fixture
def folder(tmp_path):
    return write_folder(tmp_path / "park", **FILES)


def test_straight_on(folder):
    """2 m/s from 1.5 s to 2.5 s: 1 m before the scan at 2 s and 1 m behind it. Before 1 s the car stands."""
    log = read_log(str(folder))
    check_invariants(log)
    assert log.model == "body" and log.times.tolist() == [0.5, 2.0, 3.0]
    np.testing.assert_allclose(log.controls, [[1, 0, 0], [1, 0, 0]], atol=1e-12)
    readings = log.observations[0]
    assert readings.steps.tolist() == [1, 1] and readings.landmarks.tolist() == [-1, -1]
    np.testing.assert_allclose(readings.measurements, [[5, 0], [7, -np.pi / 2]], atol=1e-12)
    assert log.true_trajectory is not None
    assert log.true_trajectory.positions.tolist() == [[10, 20], [11, 21]]
    assert any(note.startswith("2 scans lie before or after the odometry") for note in log.notes)


def test_a_bend(folder):
    """On a circle of radius r = L / tan(steering) about a point left of the rear axle, the laser turns with the car.

    The rear left wheel drives on the smaller circle of radius r - H.
    """
    steering, speed = 0.3, 4.0
    (folder / "aa3_DRS.csv").write_text(f"0,{speed},{steering}\n9,0,0\n")
    (folder / "lasersampling.txt").write_text("0\n1000\n2000\n")
    log = read_log(str(folder))
    radius = L / np.tan(steering)
    turn = speed / (radius - H)  # in one second
    centre = np.array([-A, radius - B])  # seen from the laser
    cosine, sine = np.cos(turn), np.sin(turn)
    moved = centre + np.array([[cosine, -sine], [sine, cosine]]) @ (-centre)
    np.testing.assert_allclose(log.controls, [[*moved, turn]] * 2, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("ObservationAngle.txt", "0 0 0\n0 0 0\n", r"ObservationAngle.txt: holds 2 rows of 3 numbers"),
        ("ObservationAngle.txt", "0 0\n0 0\n0 0\n", r"ObservationAngle.txt: holds 3 rows of 2 numbers"),
        ("ObservationDistance.txt", "0 0 0\n0 -1 0\n0 0 0\n", r"ObservationDistance.txt:2:3: a distance is negative"),
        ("lasersampling.txt", "500\n500\n600\n", r"lasersampling.txt:2:1: the time goes back or stands still"),
        ("aa3_DRS.csv", "1,2,3,4\n", r"aa3_DRS.csv:1:1: expected 3 numbers a line"),
        ("aa3_DRS.csv", "1,2,3\n2,inf,3\n", r"aa3_DRS.csv:2:3: expected a finite number, found 'inf'"),
    ],
)
def test_defects(folder, name, text, message):
    (folder / name).write_text(text)
    with pytest.raises(InputError, match=message):
        read_log(str(folder))


def test_missing_files(folder):
    (folder / "aa3_GPS.csv").unlink()
    assert read_log(str(folder)).true_trajectory is None
    (folder / "aa3_DRS.csv").unlink()
    with pytest.raises(InputError, match=r"aa3_DRS.csv: is missing") as error:
        read_log(str(folder))
    assert "aa3_dr.mat" in error.value.details[0]


def test_dataset_against_its_graph():
    """The way and the turns of the rear axle are those of the landmark graph that others made of the same drive."""
    log = read_log(str(dataset("raw/victoria_park")))
    check_invariants(log)
    assert len(log) == 7249 and len(log.observations[0]) == 52974 and log.observations[0].steps[-1] == 7248
    laser = integrate(log.controls, np.array([A, B, 0.0]))
    axle = se2.compose(laser, np.tile(se2.inverse(np.array([A, B, 0.0])), (len(laser), 1)))
    steps = se2.between(axle[:-1], axle[1:])
    graph = read_log(str(dataset("landmark2d/victoriaPark-full.g2o")))
    way, turns = (np.hypot(*s[:, :2].T).sum() for s in (steps, graph.controls)), (steps, graph.controls)
    assert np.isclose(*way, rtol=2e-4)
    assert np.isclose(*(np.abs(s[:, 2]).sum() for s in turns), rtol=2e-4)


def test_dataset_against_gps():
    """Over 30 s, aligned, the path of the laser is within half a metre of the GPS; without the encoder's place, not."""
    log = read_log(str(dataset("raw/victoria_park")))
    truth = log.true_trajectory
    assert truth is not None and truth.stamps is not None and len(truth) == 4466
    path = integrate(log.controls)
    errors = []
    for begin in np.arange(log.times[0], log.times[-1] - 30.0, 30.0):
        rows = (truth.stamps >= begin) & (truth.stamps < begin + 30.0)
        p = np.stack([np.interp(truth.stamps[rows], log.times, path[:, k]) for k in (0, 1)], axis=1)
        q = truth.positions[rows]
        if len(p) < 60 or np.hypot(*np.ptp(p, axis=0)) < 15.0:
            continue
        p, q = p - p.mean(axis=0), q - q.mean(axis=0)
        angle = np.arctan2((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum(), (p * q).sum())
        turned = p @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        errors.append(np.median(np.hypot(*(q - turned).T)))
    assert len(errors) > 25 and np.median(errors) < 0.6
