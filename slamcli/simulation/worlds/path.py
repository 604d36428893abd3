"""What a world is: the true path through it, and which of its poses meet by construction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array
from slamcli.simulation.portable import portable


@dataclass(frozen=True, eq=False)
class Path:
    """The true path of a robot.

    Attributes
    ----------
    poses
        (n, 3) planar or (n, 7) spatial poses in the world frame, x forward.
    neighbours
        (m, 2) rows (earlier, later) of poses that see each other because of how the world is built (one turn of a
        helix and the next), or None where only the places tell.
    """

    poses: Array
    neighbours: IndexArray | None = None

    @property
    def space(self) -> int:
        """2 or 3."""
        return 2 if self.poses.shape[1] == 3 else 3

    @property
    def positions(self) -> Array:
        """(n, space) in metres."""
        return self.poses[:, : self.space]

    def steps(self) -> Array:
        """(n - 1,) distances between consecutive poses in metres."""
        moved = self.positions[1:] - self.positions[:-1]
        return np.asarray(np.sqrt(sum(moved[:, k] * moved[:, k] for k in range(self.space))))


#: Unit steps along the four headings of a lattice, east first, counterclockwise.
_EAST = np.array([1, 0, -1, 0])
_NORTH = np.array([0, 1, 0, -1])


def lattice(turns: IndexArray, spacing: float) -> Array:
    """Poses (n, 3) of a robot that moves one step ahead, then turns by quarter turns, n - 1 times; all exact.

    ``turns`` (n - 1,) counts quarter turns to the left at the end of each step. It starts at the origin, heading east.
    """
    quarters = np.concatenate([[0], np.cumsum(turns)]) % 4
    east = np.concatenate([[0], np.cumsum(_EAST[quarters[:-1]])])
    north = np.concatenate([[0], np.cumsum(_NORTH[quarters[:-1]])])
    headings = np.array([0.0, 0.5 * np.pi, -np.pi, -0.5 * np.pi])[quarters]
    return portable(np.stack([east * spacing, north * spacing, headings], axis=1))


def rounds(corners: list[tuple[int, int]], steps: int) -> IndexArray:
    """Turns (steps,) for ``lattice`` of a robot that goes round through corners of the lattice again and again.

    It starts at the last corner, heading east; the legs from corner to corner run along the axes.
    """
    legs = np.diff(np.array([corners[-1], *corners]), axis=0)
    lengths = np.abs(legs).sum(axis=1)
    headings = np.select([legs[:, 0] > 0, legs[:, 1] > 0, legs[:, 0] < 0], [0, 1, 2], 3)
    turns = np.zeros(lengths.sum(), dtype=np.intp)
    turns[np.cumsum(lengths) - 1] = (np.roll(headings, -1) - headings + 1) % 4 - 1
    return np.resize(turns, steps)


def rotation(axis: int, angle: Array) -> Array:
    """Quaternions (n, 4), x y z w, of turns by some angles (n,) about one axis of the world."""
    half = portable(angle) * 0.5
    out = np.zeros((len(half), 4))
    out[:, axis], out[:, 3] = np.sin(half), np.cos(half)
    return portable(out)


def lagged(count: int, lag: int) -> IndexArray:
    """Pairs (k - lag, k) of a path of ``count`` poses."""
    later = np.arange(min(lag, count), count)
    return np.stack([later - lag, later], axis=1)
