"""Compressed EKF-SLAM: only a local area of the map is kept up to date, the rest when the robot leaves it; exact.

While all readings are of an area A, the rest B is not needed, and what happens to it can be summed up (Guivant and
Nebot, "Optimization of the simultaneous localization and map-building algorithm for real-time implementation", 2001).
With A as it was when the area was entered, and V = P H^T L^-T and y as in ``State.correct``:

    P_AB   is   Phi P_A0,B            Phi <- F Phi (prediction),  Phi <- Phi - V_A Y (update)
    V_B    is   P_B,A0 Y^T            with the rows Y = L^-1 H Phi of each update
    x_B   gains P_B,A0 theta          theta <- theta + Y^T y

so that the rest catches up with one rank-r product, P_BB <- P_BB - (P_B,A0 Y^T)(P_B,A0 Y^T)^T with all rows Y of the
stay below each other. If they are more than A has dimensions, an orthogonal triangularization makes them as few.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from slamcli.filtering.blas import subtract_square
from slamcli.filtering.state import POSE, Block, State
from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array

#: Rows of Y are made fewer when they are this many times the dimension of the area, to bound their memory.
_ROWS = 4


class CompressedState(State):
    """A local area as a state of its own, and the whole state behind it.

    Attributes
    ----------
    whole
        Everything, as it was when the area was entered.
    radius
        Landmarks up to this far from the robot come into a new area, in metres.
    areas
        Number of areas so far.
    """

    def __init__(self, pose: Array, covariance: Array, capacity: int = 64, radius: float = 0.0) -> None:
        super().__init__(pose, covariance)
        self.whole = State(pose, covariance, capacity)
        self.radius = radius
        self.areas = 1
        self._home: dict[Block, Block] = {}  # block of the area or outside -> block of the whole state
        self._gone: list[Block] = []  # blocks of the whole state that were removed in this area
        self._rest_trace = 0.0
        self._centre = np.array(pose[:2], dtype=np.float64)
        self._outside = np.empty((0, 2))
        self._begin(np.arange(POSE))

    def _begin(self, index: IndexArray) -> None:
        """Start a stay in the area of these entries of the whole state."""
        self._entered = index
        self._transition = np.eye(len(index))
        self._rows: list[Array] = []
        self._count = 0
        self._gain = np.zeros(len(index))

    @property
    def dimension(self) -> int:
        """See ``State.dimension``."""
        lost = sum(block.size for block in self._gone)
        return self.whole.size - lost + sum(block.size for block in self.blocks if block not in self._home)

    @property
    def nbytes(self) -> int:
        """Bytes of both covariances and of what is summed up between them."""
        rows = sum(part.nbytes for part in self._rows)
        return super().nbytes + self.whole.nbytes + self._transition.nbytes + rows

    @property
    def reserved_bytes(self) -> int:
        """Bytes of the arrays that hold both."""
        return super().reserved_bytes + self.whole.reserved_bytes

    def map_trace(self) -> float:
        """Of the area, and of the rest as it was when the area was entered."""
        return super().map_trace() + self._rest_trace

    def move(self, pose: tuple[float, float, float], shift: tuple[float, float], noise: Array) -> None:
        """See ``State.move``."""
        super().move(pose, shift, noise)
        self._transition[0] += shift[0] * self._transition[2]
        self._transition[1] += shift[1] * self._transition[2]

    def correct(self, factor: Array, whitened: Array, index: IndexArray, lower: Array, jacobian: Array) -> None:
        """See ``State.correct``."""
        rows = np.asarray(np.linalg.solve(lower, jacobian @ self._transition[index]), dtype=np.float64)
        self._transition -= factor @ rows
        self._gain += whitened @ rows
        self._rows.append(rows)
        self._count += len(rows)
        if self._count > _ROWS * len(self._entered):
            self._rows = [self._fewest_rows()]
            self._count = len(self._rows[0])
        super().correct(factor, whitened, index, lower, jacobian)

    def correct_joseph(self, gain: Array, cross: Array, innovation_covariance: Array, innovation: Array) -> None:
        """There is no compressed form of it: the options refuse the pair."""
        raise NotImplementedError

    def append(self, values: Array, index: IndexArray, jacobian: Array, noise: Array) -> Block:
        """See ``State.append``; the whole state learns of it at the end of the stay."""
        block = super().append(values, index, jacobian, noise)
        self._transition = np.concatenate([self._transition, jacobian @ self._transition[index]])
        return block

    def remove(self, blocks: Iterable[Block]) -> None:
        """See ``State.remove``."""
        gone = set(blocks)
        here = [block for block in gone if block.start >= 0]
        kept = np.ones(self.size, dtype=bool)
        for block in here:
            kept[block.start : block.start + block.size] = False
        self._transition = self._transition[kept]
        super().remove(here)
        self._gone += [self._home.pop(block) for block in gone if block in self._home]

    def require(self, blocks: Iterable[Block]) -> None:
        """See ``State.require``: a block outside of the area starts a new one, and so does leaving its middle."""
        wanted = set(blocks)
        if self._away() or any(block.start < 0 for block in wanted):
            self.complete()
            self._enter(wanted)

    def require_around(self, radius: float) -> None:
        """See ``State.require_around``; what is outside counts where it was when the area was entered."""
        gaps = np.square(self._outside - self.mean[:2]).sum(axis=1)
        if self._away() or (len(gaps) and gaps.min() <= radius * radius):
            self.complete()
            self._enter(set())

    def _away(self) -> bool:
        """Whether the robot is more than half the radius away from where it entered the area."""
        gap = self.mean[:2] - self._centre
        return bool(4.0 * float(gap @ gap) > self.radius * self.radius)

    def complete(self) -> State:
        """See ``State.complete``: brings the rest of the map up to date."""
        whole, area = self.whole, self._entered
        reach = whole.columns(area)  # P_.,A0
        reach[area] = 0.0
        if self._count:
            factor = np.asfortranarray(reach @ self._fewest_rows().T)
            subtract_square(whole.lower, factor)
        whole.mean[: whole.size] += reach @ self._gain
        cross = reach @ self._transition.T  # P_B,A
        self._write_area(cross)
        whole.remove(self._gone)
        self._gone = []
        self._begin(self._homes())
        return whole

    def _write_area(self, cross: Array) -> None:
        """Put the area, new blocks included, into the whole state; ``cross`` (n, a) is its covariance with the rest."""
        whole, old = self.whole, self.whole.size
        for block in self.blocks:
            if block not in self._home:
                blank = np.zeros((block.size, block.size))
                values = np.zeros(block.size)
                self._home[block] = whole.append(values, np.zeros(1, dtype=np.intp), np.zeros((block.size, 1)), blank)
        homes = self._homes()
        columns = np.zeros((whole.size, self.size))
        columns[:old] = cross
        columns[homes] = self.covariance()
        whole.overwrite(homes, columns)
        whole.mean[homes], whole.first[homes] = self.mean[: self.size], self.first[: self.size]

    def _homes(self) -> IndexArray:
        """(a,) where the entries of the area are in the whole state."""
        parts = [np.arange(POSE)]
        parts += [np.arange(home.start, home.start + home.size) for home in map(self._home.__getitem__, self.blocks)]
        return np.concatenate(parts)

    def _fewest_rows(self) -> Array:
        """Y (r, a0) with r up to a0, or another one with the same Y^T Y."""
        rows = np.concatenate(self._rows)
        if len(rows) <= rows.shape[1]:
            return rows
        return np.asarray(np.linalg.qr(rows, mode="r"), dtype=np.float64)

    def _enter(self, wanted: set[Block]) -> None:
        """Make a new area of what is near the robot, what is wanted and all kept poses. The whole is up to date."""
        whole, outside = self.whole, []
        self.blocks = []
        for block, home in self._home.items():
            gap = whole.mean[home.start : home.start + 2] - whole.mean[:2]
            near = float(gap @ gap) <= self.radius * self.radius
            if near or block.size == POSE or block in wanted:
                self.blocks.append(block)
            else:
                block.start = -1
                outside.append(home.start)
        homes = self._homes()
        n = self.size = POSE  # what was in the local matrix is in the whole one now
        for block in self.blocks:
            block.start, n = n, n + block.size
        self.reserve(n)
        self.size = n
        self._matrix[:n, :n] = whole.block(homes)
        self.mean[:n], self.first[:n] = whole.mean[homes], whole.first[homes]
        starts = np.array(outside, dtype=np.intp)
        self._outside = whole.mean[starts[:, None] + np.arange(2)]
        self._rest_trace = float(whole.variances()[(starts[:, None] + np.arange(2)).ravel()].sum())
        self._begin(homes)
        self._centre = self.mean[:2].copy()
        self.areas += 1

    def place_of(self, block: Block) -> int:
        """See ``State.place_of``."""
        return self._home[block].start
