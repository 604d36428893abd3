"""The Plaza logs: a robot's odometry and its radio ranges to fixed nodes.

================  ===================================================================================================
``NAME_DR.txt``   ``t distance turn``: s, m, rad since the record before; goes straight, then turns
``NAME_TD.txt``   ``t sender receiver range``: s, the robot's radio, the node, m
``NAME.pyfg``     the truth, if it is there (``pyfg``)
================  ===================================================================================================

(J. Djugash, B. Hamner, S. Roth, "Navigating with ranging radios: five data sets with ground truth", J. Field Robotics
26, 2009. GTSAM ships the files and reads a record of odometry as the pose (distance, 0, turn).)
"""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np

from slamcli.errors import InputError
from slamcli.formats.logs import pyfg
from slamcli.formats.logs.columns import read_columns
from slamcli.formats.logs.timeline import counted, pose_ids, union
from slamcli.formats.source import read_bytes
from slamcli.graph.columns import IdArray
from slamcli.graph.sensor_log import Observations, SensorLog
from slamcli.models import RANGE_2D
from slamcli.models.base import Array

_ODOMETRY, _RANGES = "_DR.txt", "_TD.txt"
#: Seconds by which the times of one reading may differ between two files.
_SAME_TIME = 1e-4


def recognizes(folder: str) -> bool:
    """Whether a folder holds such logs."""
    return bool(_names(folder))


def name_of(file: str) -> str | None:
    """The log that a file of such a folder belongs to."""
    return next((file.removesuffix(end) for end in (_ODOMETRY, _RANGES) if file.endswith(end)), None)


def read(folder: str, *, lenient: bool = False, name: str | None = None) -> SensorLog:
    """Read a log; the steps are the times of its odometry and of its ranges, controls are (0, distance, turn).

    Parameters
    ----------
    folder
        Its folder.
    lenient
        Skip malformed records instead of raising.
    name
        Which one, where the folder holds several.

    Raises
    ------
    InputError
        If a file is missing or not what it should be, or if the folder holds several logs and no name is given.
    """
    names = _names(folder)
    if name is None and len(names) > 1:
        raise InputError(f"{folder}: holds several logs", (f"  name one: {', '.join(n + _ODOMETRY for n in names)}",))
    stem = os.path.join(folder, names[0] if name is None else name)
    for end in (_ODOMETRY, _RANGES):
        if not os.path.exists(stem + end):
            raise InputError(f"{stem + end}: is missing", (f"  a Plaza log is NAME{_ODOMETRY} and NAME{_RANGES}",))
    odometry = read_columns(stem + _ODOMETRY, "t distance turn", lenient).ascending(strictly=True)
    ranges, nodes = read_columns(stem + _RANGES, "t sender receiver range", lenient).ids(2, "a node")
    clock = odometry.numbers[:, 0]
    before = 2.0 * clock[0] - clock[1] if len(clock) > 1 else clock[0] - 1.0
    clock = np.concatenate([[before], clock])
    seen = ranges.numbers[:, 0]
    inside = np.flatnonzero((seen >= clock[0]) & (seen <= clock[-1]))
    back = np.count_nonzero(np.diff(seen[inside]) < 0.0)
    order = inside[np.argsort(seen[inside], kind="stable")]
    line = union(clock, seen[order])
    share = np.diff(line.times) / np.diff(clock)[line.records]
    controls = np.zeros((len(line.records), 3))
    controls[:, 1:] = odometry.numbers[line.records, 1:] * share[:, None]
    log = SensorLog(
        times=line.times,
        ids=pose_ids(len(line.times), nodes[order]),
        model="odometry",
        controls=controls,
        information=None,
        observations=[
            Observations(
                kind=RANGE_2D,
                steps=line.steps,
                landmarks=nodes[order],
                measurements=ranges.numbers[order, 3:],
                information=None,
            )
        ],
        start=np.zeros(3),
        source=stem + _ODOMETRY,
        notes=[
            *odometry.notes,
            *ranges.notes,
            *counted(len(seen) - len(inside), "ranges before or after the odometry are left out"),
            *counted(back, "times go back in the ranges: they are sorted"),
            "ranges are as the radios gave them, with their bias and their outliers",
            "the odometry begins one interval before its first record",
        ],
    )
    return _with_truth(log, stem, seen, nodes)


def _names(folder: str) -> list[str]:
    return sorted(name.removesuffix(_ODOMETRY) for name in os.listdir(folder) if name.endswith(_ODOMETRY))


def _with_truth(log: SensorLog, stem: str, seen: Array, nodes: IdArray) -> SensorLog:
    """The log with the truth of a PyFG file beside it, whose landmarks have names of their own."""
    folder, name = os.path.split(stem)
    beside = [file for file in os.listdir(folder or ".") if file.lower() == f"{name.lower()}.pyfg"]
    if not beside:
        return replace(log, notes=[*log.notes, "the start is the origin: no PyFG file with the truth is there"])
    path = os.path.join(folder, beside[0])
    data = read_bytes(path)[1]
    truth = pyfg.read(path, data)
    notes = [*log.notes, f"start and truth are those of {beside[0]}"]
    landmarks = _renamed(truth, pyfg.parse(path, data), seen, nodes)
    if landmarks is None:
        notes.append(f"the ranges of {beside[0]} are not these: true landmarks are not known")
    trajectory = truth.true_trajectory
    if trajectory is None:
        return replace(log, true_landmarks=landmarks, notes=notes)
    # its ids are not those of this log's steps: the times tell which pose is which
    trajectory = replace(trajectory, ids=None)
    start = trajectory.poses[0]
    return replace(log, start=start, true_trajectory=trajectory, true_landmarks=landmarks, notes=notes)


def _renamed(truth: SensorLog, file: pyfg.PyFG, seen: Array, nodes: IdArray) -> tuple[IdArray, Array] | None:
    """True landmarks with the ids of the nodes that were ranged at the same times, None where there are none."""
    if truth.true_landmarks is None or "EDGE_RANGE" not in file.rows:
        return None
    stamps, names = file.rows["EDGE_RANGE"].numbers[:, 0], file.ids("EDGE_RANGE", 1)
    order = np.argsort(seen, kind="stable")
    at = order[np.minimum(np.searchsorted(seen[order], stamps - _SAME_TIME), len(seen) - 1)]
    same = np.abs(seen[at] - stamps) < _SAME_TIME
    ids, positions = [], []
    for name, position in zip(*truth.true_landmarks, strict=True):
        partners = nodes[at[same & (names == name)]]
        if len(partners):
            ids.append(int(np.bincount(partners).argmax()))
            positions.append(position)
    if not ids or len(set(ids)) < len(ids):
        return None
    return np.array(ids, dtype=np.int64), np.array(positions)
