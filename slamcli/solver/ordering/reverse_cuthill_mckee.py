"""Reverse Cuthill-McKee (George 1971): a small bandwidth, for solvers of banded matrices and as a yardstick."""

from __future__ import annotations

import numpy as np

from slamcli.graph.columns import IndexArray
from slamcli.solver.ordering.adjacency import neighbours
from slamcli.solver.pattern import BlockPattern


def rcm(pattern: BlockPattern) -> IndexArray:
    """Block elimination order by breadth-first search, reversed."""
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    pointer, others = neighbours(pattern)
    count = len(pattern.sizes)
    graph = csr_matrix((np.ones(len(others)), others, pointer), shape=(count, count))
    return reverse_cuthill_mckee(graph, symmetric_mode=True).astype(np.intp)
