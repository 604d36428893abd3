"""The rows of each supernode below its columns: with them the block pattern of L is complete."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.graph.columns import IndexArray
from slamcli.solver.pattern import BlockPattern
from slamcli.solver.symbolic.analysis import eliminated_edges
from slamcli.solver.symbolic.supernodes import Supernodes


@dataclass(frozen=True, eq=False)
class RowStructure:
    """Block rows of all supernodes below their own columns, one after the other.

    Attributes
    ----------
    pointer
        (s + 1,) supernode k has ``rows[pointer[k] : pointer[k + 1]]``.
    rows
        Positions in the order of the supernodes, ascending within each.
    """

    pointer: IndexArray
    rows: IndexArray

    def of(self, supernode: int) -> IndexArray:
        """Block rows of one supernode below its columns."""
        return self.rows[self.pointer[supernode] : self.pointer[supernode + 1]]


def row_structure(pattern: BlockPattern, parts: Supernodes) -> RowStructure:
    """Block rows of each supernode: those of H in its columns, and what its children hand up (multifrontal)."""
    low, high = eliminated_edges(pattern, parts.order)
    count = len(parts.order)
    owner = parts.of_column[low]
    outside = high >= parts.first[owner + 1]
    keys = np.unique(owner[outside] * count + high[outside])
    own = np.split(keys % max(count, 1), np.searchsorted(keys // max(count, 1), np.arange(1, len(parts))))
    collected: list[list[IndexArray]] = [[part] for part in own] if len(parts) else []
    rows: list[IndexArray] = []
    ends = parts.first[1:].tolist()
    for s, above in enumerate(parts.parent.tolist()):
        pieces = collected[s]
        found = pieces[0] if len(pieces) == 1 else _union(pieces)
        collected[s] = []
        rows.append(found)
        if above >= 0:
            handed = found[np.searchsorted(found, ends[above]) :]
            if len(handed):
                collected[above].append(handed)
    lengths = np.array([len(found) for found in rows], dtype=np.intp)
    pointer = np.concatenate([[0], np.cumsum(lengths)]).astype(np.intp)
    return RowStructure(pointer, np.concatenate(rows) if rows else np.empty(0, dtype=np.intp))


def _union(pieces: list[IndexArray]) -> IndexArray:
    """Ascending union of ascending arrays. (A stable sort merges the runs; ``numpy.unique`` would hash.)"""
    merged = np.concatenate(pieces)
    merged.sort(kind="stable")
    return merged[np.concatenate([[True], merged[1:] != merged[:-1]])] if len(merged) else merged
