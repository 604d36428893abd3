"""What multiplies with a Schur complement that is never formed: links, no pairs of links.

H is ``[[A, W], [W^T, V]]`` as in ``structure``. A link is a block of W; there are as many as observations, where the
pairs of links of one point, which a complement is formed from, can be a hundred times as many.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.models.base import Array
from slamcli.solver.pattern import BlockPattern

#: Links of a camera from which on one product of matrices for the camera is faster than one for each link.
_LONG = 16
#: Links whose blocks are gathered at a time.
_CHUNK = 16384


@dataclass(frozen=True, eq=False)
class Links:
    """Positions of the blocks among the values of H.

    Vectors of the complement are (c, width) arrays, one row for each block that stays ("camera"); cameras smaller than
    the largest one are padded with zeros. Links are sorted by camera, then point, those of cameras with few links
    last.

    Attributes
    ----------
    pattern
        Of H.
    kept, gone
        Blocks of H that stay and those that are eliminated, ascending.
    size, width
        Rows of a point's block, and of the largest camera.
    points
        (p, size, size) positions of the entries of V.
    camera, point
        (m,) of each link.
    first, flipped
        (m,) position of the first entry of each block of W, and whether it is stored with the rows of the point.
    own
        (c, width, width) positions of the diagonal blocks of A, ``pattern.stored`` for padding.
    inner
        (e, width, width) positions of the other blocks of A.
    upper, lower
        (e,) their cameras: of the rows, and of the columns.
    """

    pattern: BlockPattern
    kept: IndexArray
    gone: IndexArray
    size: int
    width: int
    points: IndexArray
    camera: IndexArray
    point: IndexArray
    first: IndexArray
    flipped: BoolArray
    own: IndexArray
    inner: IndexArray
    upper: IndexArray
    lower: IndexArray

    @classmethod
    def of(cls, pattern: BlockPattern, eliminated: BoolArray) -> Links:
        """The links for a mask (n,) of blocks, which must be of one size and have no block in common."""
        gone, kept = np.flatnonzero(eliminated), np.flatnonzero(~eliminated)
        local = np.empty(len(eliminated), dtype=np.intp)
        local[gone], local[kept] = np.arange(len(gone)), np.arange(len(kept))
        row_gone, column_gone = eliminated[pattern.rows], eliminated[pattern.columns]
        crossing = np.flatnonzero(row_gone != column_gone)
        flipped = row_gone[crossing]
        camera = local[np.where(flipped, pattern.columns[crossing], pattern.rows[crossing])]
        point = local[np.where(flipped, pattern.rows[crossing], pattern.columns[crossing])]
        few = np.bincount(camera, minlength=len(kept)) < _LONG
        order = np.lexsort((point, camera, few[camera]))
        inner = np.flatnonzero(~row_gone & ~column_gone)
        own = inner[pattern.rows[inner] == pattern.columns[inner]]
        others = inner[pattern.rows[inner] != pattern.columns[inner]]
        size, width = int(pattern.sizes[gone[0]]), int(pattern.sizes[kept].max(initial=1))
        return cls(
            pattern=pattern,
            kept=kept,
            gone=gone,
            size=size,
            width=width,
            points=_entries(pattern, np.flatnonzero(row_gone & column_gone), size),
            camera=camera[order],
            point=point[order],
            first=pattern.base[crossing[order]],
            flipped=flipped[order],
            own=_entries(pattern, own, width),
            inner=_entries(pattern, others, width),
            upper=local[pattern.rows[others]],
            lower=local[pattern.columns[others]],
        )

    def __len__(self) -> int:
        return len(self.camera)

    @property
    def dimension(self) -> int:
        """Rows of the complement."""
        return int(self.pattern.sizes[self.kept].sum())

    @cached_property
    def long(self) -> list[tuple[int, int, int]]:
        """Cameras with many links: number, where its links begin and where they end."""
        inside = self.camera[: self.short]
        starts = np.flatnonzero(np.diff(inside, prepend=-1))
        ends = np.append(starts[1:], len(inside))[: len(starts)]
        return list(zip(inside[starts].tolist(), starts.tolist(), ends.tolist(), strict=True))

    @cached_property
    def short(self) -> int:
        """Where the links of cameras with few of them begin."""
        few = np.bincount(self.camera, minlength=len(self.kept)) < _LONG
        return int(np.count_nonzero(~few[self.camera]))

    @cached_property
    def short_runs(self) -> tuple[IndexArray, IndexArray]:
        """The cameras with few links and where the links of each begin, counted from ``short``."""
        cameras = self.camera[self.short :]
        starts = np.flatnonzero(np.diff(cameras, prepend=-1))
        return cameras[starts], starts

    @cached_property
    def rows(self) -> IndexArray:
        """(c, width) scalar rows of each camera in H, its dimension for padding."""
        return _rows(self.pattern, self.kept, self.width)

    @cached_property
    def padding(self) -> BoolArray:
        """(c, width) which rows of a camera are not there."""
        return self.rows == self.pattern.dimension

    @cached_property
    def point_rows(self) -> IndexArray:
        """(p, size) scalar rows of each point in H."""
        return _rows(self.pattern, self.gone, self.size)

    def divided(self, source: Array, inverse: Array, out: Array) -> None:
        """Z^T = L^-1 W^T of all links, (m, size, width).

        Parameters
        ----------
        source
            Values of H, and a zero behind them for padding.
        inverse
            (p, size, size) L^-1 of each point.
        out
            Where they go.
        """
        pattern = self.pattern
        down, right = np.arange(self.size)[:, None], np.arange(self.width)
        for begin in range(0, len(self), _CHUNK):
            part = slice(begin, begin + _CHUNK)
            camera, flipped = self.kept[self.camera[part]], self.flipped[part]
            height = pattern.heights[np.where(flipped, camera, self.gone[self.point[part]])]
            # where the block has the rows of the camera, W^T goes down along its columns
            position = self.first[part, None, None] + (
                np.where(flipped, 1, height)[:, None, None] * down + np.where(flipped, height, 1)[:, None, None] * right
            )
            sizes = pattern.sizes[camera]
            if (sizes < self.width).any():
                position[np.broadcast_to(right >= sizes[:, None, None], position.shape)] = pattern.stored
            np.matmul(np.take(inverse, self.point[part], axis=0), source[position], out=out[part])


def _rows(pattern: BlockPattern, blocks: IndexArray, width: int) -> IndexArray:
    inside = np.arange(width) < pattern.sizes[blocks][:, None]
    return np.where(inside, pattern.offsets[blocks][:, None] + np.arange(width), pattern.dimension)


def _entries(pattern: BlockPattern, blocks: IndexArray, width: int) -> IndexArray:
    """Positions (e, width, width) of the entries of stored blocks, ``stored`` outside of them."""
    first, height = pattern.base[blocks][:, None, None], pattern.heights[pattern.columns[blocks]][:, None, None]
    rows, columns = np.arange(width)[:, None], np.arange(width)
    inside = (rows < pattern.sizes[pattern.rows[blocks]][:, None, None]) & (
        columns < pattern.sizes[pattern.columns[blocks]][:, None, None]
    )
    return np.where(inside, first + rows + columns * height, pattern.stored)
