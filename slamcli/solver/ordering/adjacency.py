"""The block graph of a pattern: one node for each block variable, an edge for each block off the diagonal."""

from __future__ import annotations

import numpy as np

from slamcli.graph.columns import IndexArray
from slamcli.solver.pattern import BlockPattern


def edges(pattern: BlockPattern) -> tuple[IndexArray, IndexArray]:
    """Lower and higher end of each edge, (e,) each."""
    off = pattern.rows != pattern.columns
    return pattern.rows[off], pattern.columns[off]


def neighbours(pattern: BlockPattern) -> tuple[IndexArray, IndexArray]:
    """Compressed adjacency: node k is joined to ``out[1][out[0][k] : out[0][k + 1]]``."""
    low, high = edges(pattern)
    nodes, others = np.concatenate([low, high]), np.concatenate([high, low])
    degrees = np.bincount(nodes, minlength=len(pattern.sizes))
    return np.concatenate([[0], np.cumsum(degrees)]), others[np.argsort(nodes, kind="stable")]
