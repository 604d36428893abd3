"""Approximate minimum degree (Amestoy, Davis, Duff 1996), as SuiteSparse has it."""

from __future__ import annotations

import numpy as np

from slamcli.graph.columns import IndexArray
from slamcli.solver.ordering.adjacency import edges
from slamcli.solver.pattern import BlockPattern


def amd(pattern: BlockPattern) -> IndexArray:
    """Block elimination order in which each variable has few neighbours when its turn comes."""
    return of_edges(len(pattern.sizes), *edges(pattern))


def of_edges(count: int, low: IndexArray, high: IndexArray) -> IndexArray:
    """The same for a graph of so many nodes and edges (e,), ``low < high``; parallel edges count once."""
    if len(low) == 0:
        return np.arange(count)
    from cvxopt import amd as suitesparse  # here: what only reads graphs needs no solver
    from cvxopt import matrix, spmatrix

    graph = spmatrix(1.0, matrix(low), matrix(high), (count, count))
    return np.array(suitesparse.order(graph, "U"), dtype=np.intp).ravel()
