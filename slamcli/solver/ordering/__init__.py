"""Elimination orders, found on the block graph and expanded to scalar rows.

An order decides how much L fills in, and nothing else: every one gives the same step. All work on the pattern alone.
"""

from __future__ import annotations

from collections import OrderedDict

import numpy as np

from slamcli.graph.columns import IndexArray
from slamcli.solver.ordering.automatic import choose
from slamcli.solver.ordering.found import FoundOrder, named
from slamcli.solver.pattern import BlockPattern

__all__ = ["FoundOrder", "expand", "find", "order"]

#: Orders that were found, by name and pattern. A run asks for few: of its own system and of its starts'.
_FOUND: OrderedDict[tuple[str, tuple[int, ...]], FoundOrder] = OrderedDict()
_REMEMBERED = 8


def find(name: str, pattern: BlockPattern) -> FoundOrder:
    """The elimination order of a name of ``options.ORDERINGS``, remembered for patterns that were seen lately.

    Raises
    ------
    UsageError
        If the name does not exist, or the library that it needs is not installed.
    """
    key = (name, _digest(pattern))
    found = _FOUND.get(key)
    if found is None:
        found = choose(pattern) if name == "auto" else named(name, pattern)
        _FOUND[key] = found
        while len(_FOUND) > _REMEMBERED:
            _FOUND.popitem(last=False)
    _FOUND.move_to_end(key)
    return found


def order(name: str, pattern: BlockPattern) -> IndexArray:
    """Block elimination order of a name of ``options.ORDERINGS``: position k holds the block eliminated k-th."""
    return find(name, pattern).order


def expand(pattern: BlockPattern, blocks: IndexArray) -> IndexArray:
    """Scalar elimination order of a block order."""
    sizes = pattern.sizes[blocks]
    ends = np.cumsum(sizes)
    return np.repeat(pattern.offsets[blocks] - ends + sizes, sizes) + np.arange(pattern.dimension)


def _digest(pattern: BlockPattern) -> tuple[int, ...]:
    """What tells patterns apart: lengths and 64-bit hashes (hashlib takes as long to import as many runs take)."""
    parts = (part for part in (pattern.sizes, pattern.rows, pattern.columns, pattern.pose_rank) if part is not None)
    return tuple(number for part in parts for number in (len(part), hash(part.tobytes())))
