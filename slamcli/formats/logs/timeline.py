"""Odometry and readings that come at times of their own, on one time line.

Instruments have their own clocks: a reading falls between two records of the odometry. The interval is split at the
reading's time, with the velocity that holds in it, so that every reading is made where the robot was.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from slamcli.geometry import se2, so2
from slamcli.graph.columns import IdArray, IndexArray
from slamcli.models.base import Array

#: Smallest id of the first pose where landmarks have ids of their own: graphs share one range of ids.
FIRST_POSE = 1000


@dataclass(frozen=True, eq=False)
class Timeline:
    """Steps at all times of odometry and readings.

    Attributes
    ----------
    times
        (t,) seconds, ascending.
    records
        (t - 1,) row of the odometry that holds between a step and the next.
    steps
        (m,) step of each reading.
    """

    times: Array
    records: IndexArray
    steps: IndexArray


def union(odometry: Array, readings: Array) -> Timeline:
    """The time line of odometry (n,) and readings (m,).

    Both must be ascending, and all readings must lie between the odometry's first and its last time. Of odometry
    records at one time the last one counts.
    """
    times = np.unique(np.concatenate([odometry, readings]))
    records = np.searchsorted(odometry, times[:-1], side="right") - 1
    return Timeline(times, records, np.searchsorted(times, readings))


def integrate(displacements: Array, start: Array | None = None) -> Array:
    """Dead reckoning: the poses (t, 3) that displacements (t - 1, 3) lead through; headings are not wrapped."""
    return se2.chain(np.zeros(3) if start is None else start, displacements)


def interpolate(stamps: Array, poses: Array, times: Array) -> Array:
    """Planar poses (m, 3) between stamped ones, headings the short way round; held before the first and after the last.

    ``stamps`` (n,) must ascend.
    """
    heading = np.unwrap(poses[:, 2])
    x, y, turn = (np.interp(times, stamps, column) for column in (poses[:, 0], poses[:, 1], heading))
    return so2.pack(x, y, so2.wrap(turn))


def pose_ids(count: int, landmarks: IdArray) -> IdArray:
    """Ids for poses that have none: from 0, or from a power of ten (1000 or more) above known landmarks' ids."""
    known = int(landmarks.max(initial=-1))
    first = 0 if known < 0 else max(FIRST_POSE, 10 ** len(str(known)))
    return first + np.arange(count, dtype=np.int64)


def counted(count: int | np.integer[Any], what: str) -> list[str]:
    """A note that begins with a count, if it is not 0."""
    return [f"{count} {what}"] if count else []
