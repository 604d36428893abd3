"""Reads a sensor log of any format: which one it is, is told by what a file or a folder holds."""

from __future__ import annotations

import os
from dataclasses import replace

from slamcli.errors import InputError, UsageError
from slamcli.formats.logs import course, graphs, mrclam, plaza, pyfg, simulated, victoria_park
from slamcli.formats.source import read_bytes
from slamcli.formats.trajectories import read_trajectory
from slamcli.graph.sensor_log import SensorLog
from slamcli.graph.trajectory import Trajectory
from slamcli.models import XY

_BOM = b"\xef\xbb\xbf"
_FORMATS = (
    "a landmark graph (g2o, TORO), a log of slamcli simulate --log, PyFG text, or ODOMETRY and SENSOR records,",
    "or a folder: UTIAS MRCLAM (RobotN_Odometry.dat, ...), Victoria Park (aa3_DRS.csv, ...), Plaza (NAME_DR.txt, ...)",
)


def read_log(
    path: str,
    *,
    dialect: str | None = None,
    lenient: bool = False,
    truth: str | None = None,
    robot: int | None = None,
) -> SensorLog:
    """Read a sensor log.

    Parameters
    ----------
    path
        A file, ``-`` for standard input, or the folder of a log of several files (or one of those files).
    dialect
        ``"g2o"`` or ``"toro"``: the file is a graph of this dialect.
    lenient
        Skip malformed records instead of raising; the notes say which.
    truth
        A graph or trajectory file with the truth, whose landmarks have the ids of the log's. It replaces the truth
        that a log brings.
    robot
        Which robot of a log of several (MRCLAM, PyFG), from 1.

    Raises
    ------
    InputError
        If the log is of no known format, a file is missing or malformed, or no landmark is observed.
    UsageError
        If a robot is asked for that the log does not have, or a dialect for a folder.
    """
    path = str(path)
    known = None if truth is None else read_trajectory(truth)
    folder, member = _folder_of(path)
    if folder is not None:
        if dialect is not None:
            raise UsageError(f"{path}: is no graph: it has no dialect")
        log = _read_folder(folder, member, lenient, robot)
    else:
        log = _read_file(path, dialect, lenient, robot, known)
    if not any(len(observations) for observations in log.observations):
        raise InputError(f"{path}: holds no reading of a landmark", tuple(f"  {note}" for note in log.notes))
    return log if known is None else _with_truth(log, known)


def _folder_of(path: str) -> tuple[str | None, str]:
    """The folder of a log of several files and the file that was named; None if the path is a log by itself."""
    if os.path.isdir(path):
        return path, ""
    folder, name = os.path.split(path)
    whole = mrclam.robot_of(name) or plaza.name_of(name) or victoria_park.is_file(name)
    return (folder or ".", name) if whole and os.path.isfile(path) else (None, "")


def _read_folder(folder: str, member: str, lenient: bool, robot: int | None) -> SensorLog:
    if mrclam.recognizes(folder):
        return mrclam.read(folder, lenient=lenient, robot=mrclam.robot_of(member) if robot is None else robot)
    if plaza.recognizes(folder):
        _require_one_robot(folder, robot)
        return plaza.read(folder, lenient=lenient, name=plaza.name_of(member))
    if victoria_park.recognizes(folder):
        _require_one_robot(folder, robot)
        return victoria_park.read(folder, lenient=lenient)
    single = os.path.join(folder, course.FILE)
    if os.path.exists(single):
        return _read_file(single, None, lenient, robot, None)
    raise InputError(f"{os.path.join(folder, member)}: holds no sensor log of a known format", _expected())


def _read_file(path: str, dialect: str | None, lenient: bool, robot: int | None, truth: Trajectory | None) -> SensorLog:
    raw, data = read_bytes(path)
    record = _first_record(data)
    words = record.split()
    if not words:
        raise InputError(f"{path}: holds no record at all", _expected())
    if dialect is None and pyfg.recognizes(words):
        return pyfg.read(path, data, lenient=lenient, robot=robot)
    _require_one_robot(path, robot)
    if dialect is None and simulated.recognizes(record):
        return simulated.read(path, data, lenient=lenient, truth=truth)
    if dialect is None and course.recognizes(words):
        return course.read(path, data, lenient=lenient)
    if dialect is None and not words[0][:1].isalpha():
        raise InputError(f"{path}: is a table of numbers, which could be anything", _expected())
    return graphs.read(path, raw, data, dialect=dialect, lenient=lenient)


def _first_record(data: bytes) -> bytes:
    """The first line that holds more than a comment."""
    begin = len(_BOM) if data.startswith(_BOM) else 0
    while begin < len(data):
        end = data.find(b"\n", begin)
        end = len(data) if end < 0 else end
        record = data[begin:end].partition(b"#")[0].strip()
        if record:
            return record
        begin = end + 1
    return b""


def _require_one_robot(path: str, robot: int | None) -> None:
    if robot is not None:
        raise UsageError(f"{path}: is the log of one robot: --robot is of no use")


def _expected() -> tuple[str, ...]:
    return (f"  expected {_FORMATS[0]}", f"  {_FORMATS[1]}")


def _with_truth(log: SensorLog, truth: Trajectory) -> SensorLog:
    """The log with another truth."""
    points = truth.graph.variables.get(XY.name) if truth.graph else None
    landmarks = None if points is None else (points.ids[points.known], points.values[points.known])
    return replace(log, true_trajectory=truth, true_landmarks=landmarks, notes=[*log.notes, *truth.notes])
