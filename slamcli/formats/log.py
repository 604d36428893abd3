"""Sensor logs: what a robot measures, line by line in the order of time, as CSV.

A log has the columns ``time_s,kind,pose,other,z1,...,zk,i11,i12,...``: when, what was measured, at which pose, of what
(the earlier pose of a loop closure, the landmark, -1 for a reading that comes from nothing, empty for a position), the
reading in metres and radians, and the upper triangle of its information, row by row. Fields that a record does not
need are empty.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.formats.source import write_bytes
from slamcli.formats.writer import format_records
from slamcli.graph.columns import IdArray
from slamcli.models.base import Array
from slamcli.models.information import to_upper_triangle


@dataclass(frozen=True, eq=False)
class LogBlock:
    """Records of one kind, in the order of time.

    Attributes
    ----------
    kind
        One word.
    times
        (m,) seconds.
    poses
        (m,) ids of the poses at which they were measured.
    others
        (m,) ids of what was measured, or None.
    readings
        (m, k).
    information
        (m, d, d), or None where it says nothing.
    """

    kind: str
    times: Array
    poses: IdArray
    others: IdArray | None
    readings: Array
    information: Array | None


def write_log(blocks: list[LogBlock], path: str, comments: list[str]) -> None:
    """Write a log, atomically. Records of one time keep the order of the blocks.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    readings = max((block.readings.shape[1] for block in blocks), default=0)
    weights = max((block.information.shape[1] for block in blocks if block.information is not None), default=0)
    triangle = [f"i{i + 1}{j + 1}" for i in range(weights) for j in range(i, weights)]
    head = ["time_s", "kind", "pose", "other", *(f"z{k + 1}" for k in range(readings)), *triangle]
    lines = [line for block in blocks for line in _lines(block, readings, len(triangle))]
    times = np.concatenate([block.times for block in blocks]) if blocks else np.empty(0)
    ordered = [lines[k] for k in np.argsort(times, kind="stable").tolist()]
    text = [*(f"# {comment}" for comment in comments), ",".join(head), *ordered]
    write_bytes(path, ("\n".join(text) + "\n").encode())


def _lines(block: LogBlock, readings: int, weights: int) -> list[str]:
    numbers = _joined(block.readings, readings)
    triangle = None if block.information is None else to_upper_triangle(block.information)
    information = ["," * (weights - 1)] * len(numbers) if triangle is None else _joined(triangle, weights)
    others = [""] * len(numbers) if block.others is None else map(str, block.others.tolist())
    columns = zip(block.times.tolist(), block.poses.tolist(), others, numbers, information, strict=True)
    return [f"{time:.12g},{block.kind},{pose},{other},{z},{i}" for time, pose, other, z, i in columns]


def _joined(numbers: Array, width: int) -> list[str]:
    """The numbers of each row between commas, padded with empty fields."""
    rest = "," * (width - numbers.shape[1])
    none = np.empty((len(numbers), 0), dtype=np.int64)
    return [row.replace(" ", ",") + rest for row in format_records(none, numbers + 0.0)]  # -0 becomes 0
