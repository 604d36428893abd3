"""What a robot would believe before anything is optimized: dead reckoning, the landmarks hung off the drifting path."""

from __future__ import annotations

import numpy as np

from slamcli.geometry import se2, se3
from slamcli.models import SE3
from slamcli.models.base import Array
from slamcli.simulation.portable import portable
from slamcli.simulation.robots import Odometry
from slamcli.simulation.sensing import Readings
from slamcli.simulation.worlds import Path


def guess(
    wanted: str, path: Path, landmarks: Array, odometry: Odometry, readings: list[Readings]
) -> tuple[tuple[Array, Array], list[str]]:
    """Values of poses (n, size) and landmarks (k, space) to start from, and what is assumed for them.

    ``wanted`` is one of ``scenario.GUESSES``; all but ``odometry`` are the truth (``none`` is not written).
    """
    if wanted != "odometry":
        return (path.poses, landmarks), []
    poses = integrate(np.asarray(path.poses[0]), odometry.measurements)
    placed = np.zeros(len(landmarks), dtype=bool)
    values = np.array(landmarks)
    seeing = [reading for reading in readings if len(reading.landmarks)]
    for reading in seeing:
        good = np.flatnonzero(~reading.false & ~placed[reading.landmarks])
        rows, which = np.unique(reading.landmarks[good], return_index=True)
        first = good[which]
        spatial = reading.kind.parameter is not None
        offset = portable(np.tile(SE3.identity, (len(first), 1))) if spatial else None
        value = reading.kind.place(poses[reading.poses[first]], portable(reading.measurements[first]), offset)
        if value is not None:
            values[rows], placed[rows] = np.asarray(value), True
    lost = np.flatnonzero(~placed)
    if len(lost) == 0:
        return (poses, values), []
    # what one bearing or one range cannot place stands where a perfect look would put it
    seen_from = np.zeros(len(landmarks), dtype=np.intp)
    for reading in seeing:
        seen_from[reading.landmarks[::-1]] = reading.poses[::-1]
    group = se2 if path.space == 2 else se3
    local = group.act(portable(group.inverse(path.poses[seen_from[lost]])), landmarks[lost])
    values[lost] = np.asarray(group.act(poses[seen_from[lost]], portable(local)))
    assumed = f"{len(lost)} landmarks that no single reading places start at their true place in a first view"
    return (poses, values), [assumed]


def integrate(start: Array, steps: Array) -> Array:
    """Poses (n, size) that begin at ``start`` (size,) and follow n - 1 relative poses."""
    if steps.shape[1] == 3:
        return portable(se2.normalize(se2.chain(start, portable(steps))))
    return _spatial(start, steps)


def _spatial(start: Array, steps: Array) -> Array:
    """Prefix products by doubling: after round r every pose holds the product of the last 2^r steps."""
    chain = np.concatenate([np.asarray(start)[None], np.asarray(steps)])
    reach = 1
    while reach < len(chain):
        joined = se3.compose(portable(chain[:-reach]), portable(chain[reach:]))
        chain[reach:] = se3.normalize(portable(joined))
        reach *= 2
    return portable(chain)
