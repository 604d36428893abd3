"""UTIAS MRCLAM folders: the logs of robots that see each other and bar-coded landmarks.

=========================  ==========================================================================================
``RobotN_Odometry.dat``    ``t v omega``: s, m/s, rad/s, commanded from this time on
``RobotN_Measurement.dat`` ``t barcode range bearing``: s, m, rad counterclockwise from straight ahead
``Barcodes.dat``           ``subject barcode``: subjects 1 to 5 are robots, the others landmarks
``Landmark_Groundtruth.dat``  ``subject x y sx sy`` in metres; may be absent
``RobotN_Groundtruth.dat`` ``t x y theta`` of motion capture; may be absent
=========================  ==========================================================================================

(K. Leung, Y. Halpern, T. Barfoot, H. Liu, "The UTIAS multi-robot cooperative localization and mapping dataset",
Int. J. Robotics Research 30, 2011.)
"""

from __future__ import annotations

import os
import re

import numpy as np

from slamcli.errors import InputError, UsageError
from slamcli.formats.logs.columns import Columns, read_columns
from slamcli.formats.logs.timeline import counted, interpolate, pose_ids, union
from slamcli.geometry import se2
from slamcli.graph.columns import IdArray
from slamcli.graph.sensor_log import Observations, SensorLog
from slamcli.graph.trajectory import Trajectory
from slamcli.models import RANGE_BEARING_2D, SE2
from slamcli.models.base import Array

#: Subjects up to here are robots.
LAST_ROBOT = 5
_ODOMETRY = re.compile(r"Robot(\d+)_Odometry\.dat\Z")
_OF_ROBOT = re.compile(r"Robot(\d+)_\w+\.dat\Z")


def recognizes(folder: str) -> bool:
    """Whether a folder holds such a log."""
    return bool(_robots(folder))


def robot_of(name: str) -> int | None:
    """The robot that a file of such a folder belongs to."""
    found = _OF_ROBOT.match(name)
    return int(found[1]) if found else None


def read(folder: str, *, lenient: bool = False, robot: int | None = None) -> SensorLog:
    """Read the log of one robot; the steps are the times of its odometry and of its readings of landmarks.

    Parameters
    ----------
    folder
        Its folder.
    lenient
        Skip malformed records instead of raising.
    robot
        Its number; if not given, the lowest.

    Raises
    ------
    UsageError
        If there is no such robot.
    InputError
        If a file is missing or not what it should be.
    """
    robots = _robots(folder)
    if robot is not None and robot not in robots:
        raise UsageError(f"{folder}: holds no robot {robot}", (f"  robots here: {', '.join(map(str, robots))}",))
    chosen = robots[0] if robot is None else robot
    notes = []
    if robot is None and len(robots) > 1:
        notes.append(f"robot {chosen} of the robots {', '.join(map(str, robots))}: --robot takes another one")
    prefix = f"Robot{chosen}_"
    odometry = read_columns(_needed(folder, prefix + "Odometry.dat"), "t v omega", lenient).ascending()
    readings = read_columns(_needed(folder, prefix + "Measurement.dat"), "t barcode range bearing", lenient)
    subjects, readings = _subjects(folder, readings, lenient)
    notes += odometry.notes + readings.notes
    keep = subjects > LAST_ROBOT
    notes += counted(np.count_nonzero(subjects < 0), "readings have a barcode of no subject and are left out")
    notes += counted(np.count_nonzero(~keep & (subjects >= 0)), "readings of other robots are left out")
    times, seen = odometry.numbers[:, 0], readings.numbers[:, 0]
    outside = keep & ((seen < times[0]) | (seen > times[-1]))
    notes += counted(np.count_nonzero(outside), "readings before or after the odometry are left out")
    rows = np.flatnonzero(keep & ~outside)
    notes += counted(np.count_nonzero(np.diff(seen[rows]) < 0), "times go back in the readings: they are sorted")
    order = rows[np.argsort(seen[rows], kind="stable")]
    line = union(times, seen[order])
    controls = np.zeros((len(line.records), 3))
    controls[:, :2] = odometry.numbers[line.records, 1:]
    truth, start, more = _truth(os.path.join(folder, prefix + "Groundtruth.dat"), lenient, float(times[0]))
    landmarks, absent = _landmarks(os.path.join(folder, "Landmark_Groundtruth.dat"), lenient)
    return SensorLog(
        times=line.times,
        ids=pose_ids(len(line.times), subjects[order]),
        model="velocity",
        controls=controls,
        information=None,
        observations=[
            Observations(
                kind=RANGE_BEARING_2D,
                steps=line.steps,
                landmarks=subjects[order],
                measurements=RANGE_BEARING_2D.normalize(readings.numbers[order, 2:]),
                information=None,
            )
        ],
        start=start,
        true_trajectory=truth,
        true_landmarks=landmarks,
        source=os.path.join(folder, prefix + "Odometry.dat"),
        notes=notes + more + absent,
    )


def _robots(folder: str) -> list[int]:
    return sorted(int(found[1]) for name in os.listdir(folder) if (found := _ODOMETRY.match(name)))


def _needed(folder: str, name: str) -> str:
    path = os.path.join(folder, name)
    if not os.path.exists(path):
        raise InputError(
            f"{path}: is missing",
            ("  an MRCLAM folder holds RobotN_Odometry.dat, RobotN_Measurement.dat and Barcodes.dat",),
        )
    return path


def _subjects(folder: str, readings: Columns, lenient: bool) -> tuple[IdArray, Columns]:
    """The subject behind the barcode of each reading, -1 where there is none."""
    table, subjects = read_columns(_needed(folder, "Barcodes.dat"), "subject barcode", lenient).ids(0, "a subject")
    table, barcodes = table.ids(1, "a barcode")
    subjects = table.numbers[:, 0].astype(np.int64)
    order = np.argsort(barcodes, kind="stable")
    twice = np.zeros(len(order), dtype=bool)
    twice[order[1:]] = barcodes[order[1:]] == barcodes[order[:-1]]
    table = table.without(twice, "this barcode belongs to another subject already", column=1)
    barcodes, subjects = table.numbers[:, 1].astype(np.int64), table.numbers[:, 0].astype(np.int64)
    order = np.argsort(barcodes)
    readings, wanted = readings.ids(1, "a barcode")
    at = np.minimum(np.searchsorted(barcodes[order], wanted), len(order) - 1)
    found = order[at]
    return np.where(barcodes[found] == wanted, subjects[found], -1), readings


def _truth(path: str, lenient: bool, time: float) -> tuple[Trajectory | None, Array, list[str]]:
    """The true path, the pose at the start of the odometry, and what to say about both."""
    if not os.path.exists(path):
        return None, np.zeros(3), [f"{os.path.basename(path)} is not there: the start is the origin"]
    table = read_columns(path, "t x y theta", lenient).ascending(strictly=True)
    stamps, poses = table.numbers[:, 0], se2.normalize(table.numbers[:, 1:])
    start = interpolate(stamps, poses, np.array([time]))[0]
    notes = [*table.notes, "the start is the ground truth at the time of the first odometry"]
    if not stamps[0] <= time <= stamps[-1]:
        notes.append("the ground truth does not cover the start: its nearest end is taken")
    return Trajectory(SE2, poses, stamps=stamps, source=path), start, notes


def _landmarks(path: str, lenient: bool) -> tuple[tuple[IdArray, Array] | None, list[str]]:
    if not os.path.exists(path):
        return None, [f"{os.path.basename(path)} is not there: true landmarks are not known"]
    table, subjects = read_columns(path, "subject x y sx sy", lenient).ids(0, "a subject")
    return (subjects, table.numbers[:, 1:3]), table.notes
