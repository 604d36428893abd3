"""Many blocks of a matrix that is stored by its pattern, as pieces of one scalar column each.

The entries of a scalar column of a block lie one behind the other. So blocks are read and written piece by piece, and
only where pieces begin is kept: a ninth of the positions of all entries, for blocks of nine rows.
"""

from __future__ import annotations

import numpy as np

from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.models.base import Array
from slamcli.solver.pattern import BlockPattern


class BlockPieces:
    """Blocks of one shape.

    Parameters
    ----------
    pattern
        Of the matrix.
    blocks
        (m,) which stored blocks; negative for none.
    shape
        Rows and columns of each, as they are read and written.
    flipped
        (m,) whether it is stored transposed.
    """

    def __init__(self, pattern: BlockPattern, blocks: IndexArray, shape: tuple[int, int], flipped: BoolArray) -> None:
        self._shape = (len(blocks), *shape)
        # the blocks that are stored one way or the other (usually all are): which, whether transposed, their pieces
        self._parts: list[tuple[slice | IndexArray, bool, IndexArray]] = []
        for transposed in (True, False):
            mine = (flipped == transposed) & (blocks >= 0)
            if not mine.any():
                continue
            some = blocks[mine]
            columns = np.arange(shape[0] if transposed else shape[1])
            first = pattern.base[some, None] + columns * pattern.heights[pattern.columns[some], None]
            # what lies outside of blocks that are smaller than the shape must be somewhere
            first = np.minimum(first, pattern.stored)
            self._parts.append((slice(None) if mine.all() else np.flatnonzero(mine), transposed, first))

    def read(self, values: Array) -> Array:
        """The blocks (m, rows, columns).

        Where a block is smaller than the shape, something else stands outside of it; ``values`` then needs as many more
        entries as the longer side of the shape.
        """
        out = None
        for chosen, transposed, first in self._parts:
            pieces = _windows(values, self._shape[2] if transposed else self._shape[1])[first]
            blocks = pieces if transposed else pieces.transpose(0, 2, 1)
            if isinstance(chosen, slice):
                return blocks
            out = np.zeros(self._shape) if out is None else out
            out[chosen] = blocks
        return np.zeros(self._shape) if out is None else out

    def write(self, values: Array, blocks: Array) -> None:
        """Write blocks (rows, columns, m) of exactly the shape."""
        for chosen, transposed, first in self._parts:
            pieces = np.ascontiguousarray(_stored(blocks[:, :, chosen], transposed))
            _windows(values, pieces.shape[2])[first] = pieces

    def add(self, values: Array, blocks: Array) -> None:
        """Add blocks (rows, columns, m) of exactly the shape; the same one may occur several times."""
        for chosen, transposed, first in self._parts:
            pieces = _stored(blocks[:, :, chosen], transposed)
            np.add.at(values, (first[:, :, None] + np.arange(pieces.shape[2])).ravel(), pieces.ravel())


def _stored(blocks: Array, transposed: bool) -> Array:
    """Blocks (rows, columns, m) as (m, stored columns, stored rows)."""
    return blocks.transpose((2, 0, 1) if transposed else (2, 1, 0))


def _windows(values: Array, length: int) -> Array:
    """All ranges of this length of contiguous values, as the rows of a view."""
    step = values.itemsize
    return np.ndarray((len(values) - length + 1, length), buffer=values, strides=(step, step))
