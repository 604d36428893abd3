"""Which poses meet: earlier poses near a later one, found through a hash of places.

The space is cut into cells as wide as the reach. For every pose the earlier poses of its cell and the cells around it
are counted, and so many of them as wanted are looked at. Time and memory grow with the number of poses only, however
often a place is visited.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array
from slamcli.simulation.portable import portable

_CHUNK = 50_000  # poses looked at at a time


def meetings(positions: Array, reach: float, gap: int, per_pose: int, rng: np.random.Generator) -> IndexArray:
    """Pairs (m, 2) of rows (earlier, later) of poses within reach of each other, by the later pose.

    Parameters
    ----------
    positions
        (n, 2) or (n, 3), in the order of time.
    reach
        In metres.
    gap
        Least difference of the rows.
    per_pose
        How many earlier poses a pose looks at; if more are around, so many are picked at random.
    rng
        Picks them.
    """
    places = _Places(positions, reach)
    chunks = np.array_split(np.arange(len(positions)), max(len(positions) // _CHUNK, 1))
    return np.concatenate([places.met_before(rows, gap, per_pose, rng) for rows in chunks])


class _Places:
    """The hash: which poses are in which cell, in the order of time."""

    def __init__(self, positions: Array, reach: float) -> None:
        self.positions, self.reach = positions, reach
        cell = np.floor(np.asarray(positions) / reach).astype(np.int64)
        cell -= cell.min(axis=0)
        width = cell.max(axis=0) + 3  # room for the cells around
        self.key = _flat(cell + 1, width)
        self.cells, member = np.unique(self.key, return_inverse=True)
        self.stamp = np.sort(member * len(positions) + np.arange(len(positions)))  # by cell, then by time
        self.around = [int(_flat(np.array(shift), width)) for shift in product((-1, 0, 1), repeat=cell.shape[1])]

    def met_before(self, rows: IndexArray, gap: int, per_pose: int, rng: np.random.Generator) -> IndexArray:
        """Pairs of an earlier pose and one of the given rows."""
        count = len(self.positions)
        start, number = self._earlier(rows, gap)
        last = np.cumsum(number, axis=1)
        total = last[:, -1]
        looks = np.minimum(total, per_pose)
        later = np.repeat(np.arange(len(rows)), looks)
        turn = np.arange(len(later)) - np.repeat(np.cumsum(looks) - looks, looks)
        many = total[later] > per_pose
        turn[many] = rng.integers(0, total[later[many]])
        which = (turn[:, None] >= last[later]).sum(axis=1)
        within = turn - (last[later, which] - number[later, which])
        earlier = self.stamp[start[later, which] + within] % count
        both = np.unique(rows[later] * count + earlier)  # the same one may be picked twice
        pairs = np.stack([both % count, both // count], axis=1)
        difference = portable(self.positions[pairs[:, 0]]) - self.positions[pairs[:, 1]]
        return pairs[sum(np.square(difference[:, k]) for k in range(difference.shape[1])) <= self.reach * self.reach]

    def _earlier(self, rows: IndexArray, gap: int) -> tuple[IndexArray, IndexArray]:
        """Where in ``stamp`` the poses of the cells around begin (r, cells), and how many of them are early enough."""
        count = len(self.positions)
        start = np.empty((len(rows), len(self.around)), dtype=np.int64)
        number = np.empty_like(start)
        for k, shift in enumerate(self.around):
            wanted = self.key[rows] + shift
            place = np.minimum(np.searchsorted(self.cells, wanted), len(self.cells) - 1)
            start[:, k] = np.searchsorted(self.stamp, place * count)
            until = np.searchsorted(self.stamp, place * count + np.maximum(rows - gap + 1, 0))
            number[:, k] = np.where(self.cells[place] == wanted, until - start[:, k], 0)
        return start, number


def _flat(cell: IndexArray, width: IndexArray) -> IndexArray:
    """One number for each cell."""
    out = cell[..., 0]
    for k in range(1, cell.shape[-1]):
        out = out * width[k] + cell[..., k]
    return out
