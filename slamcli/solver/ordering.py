"""Elimination orders, found on the block graph and expanded to scalar rows."""

from __future__ import annotations

import numpy as np
from cvxopt import amd, matrix, spmatrix

from slamcli.graph.columns import IndexArray
from slamcli.solver.pattern import BlockPattern


def order(name: str, pattern: BlockPattern) -> IndexArray:
    """Block elimination order of a name of ``options.ORDERINGS``: position k holds the block eliminated k-th."""
    count = len(pattern.sizes)
    if name == "natural" or count == 0:
        return np.arange(count)
    # approximate minimum degree (Amestoy, Davis, Duff 1996), as SuiteSparse has it
    graph = spmatrix(1.0, matrix(pattern.rows), matrix(pattern.columns), (count, count))
    return np.array(amd.order(graph, "U"), dtype=np.intp).ravel()


def expand(pattern: BlockPattern, blocks: IndexArray) -> IndexArray:
    """Scalar elimination order of a block order."""
    sizes = pattern.sizes[blocks]
    ends = np.cumsum(sizes)
    return np.repeat(pattern.offsets[blocks] - ends + sizes, sizes) + np.arange(pattern.dimension)
