"""How many blocks beside the diagonal H has before and after variables are marginalized out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.graph.columns import BoolArray, IndexArray


@dataclass(frozen=True)
class Blocks:
    """Pairs of variables that H couples.

    Attributes
    ----------
    before
        Of all variables.
    among_kept
        Of kept ones, before anything is removed.
    dense
        Of kept ones in the marginal: removing a group couples all pairs of its blanket.
    result
        In the reduced graph.
    """

    before: int
    among_kept: int
    dense: int
    result: int

    @property
    def fill_in(self) -> int:
        """Blocks that the removal creates."""
        return self.dense - self.among_kept


def block_counts(
    pairs: IndexArray, gone: BoolArray, blankets: list[list[int]], result: IndexArray, nodes: int
) -> Blocks:
    """Count blocks.

    Parameters
    ----------
    pairs
        (e, 2) nodes that factors of the source join.
    gone
        (n,) which nodes are removed.
    blankets
        The blanket of each removed group.
    result
        (f, 2) nodes that factors of the reduced graph join, in its own numbers.
    nodes
        Nodes of the source.
    """
    kept = pairs[~gone[pairs].any(axis=1)]
    filled = [_keys(kept, nodes)]
    for blanket in blankets:
        members = np.array(blanket, dtype=np.intp)
        a, b = np.triu_indices(len(members), 1)
        filled.append(members[a] * nodes + members[b])
    return Blocks(
        before=len(np.unique(_keys(pairs, nodes))),
        among_kept=len(np.unique(filled[0])),
        dense=len(np.unique(np.concatenate(filled))),
        result=len(np.unique(_keys(result, nodes))),
    )


def _keys(pairs: IndexArray, nodes: int) -> IndexArray:
    """One number for each pair of different nodes."""
    proper = pairs[pairs[:, 0] != pairs[:, 1]]
    return proper.min(axis=1) * nodes + proper.max(axis=1) if len(proper) else np.empty(0, dtype=np.intp)
