"""What elimination leaves of a graph: the fill-in of a Schur complement."""

from __future__ import annotations

import numpy as np

from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.graph.topology import connected_components


def reduced_edges(low: IndexArray, high: IndexArray, gone: BoolArray) -> tuple[IndexArray, IndexArray]:
    """Edges between the nodes that stay once the others are eliminated, in whatever order.

    Two nodes that stay are joined if they were, or if a path through eliminated nodes joined them: the neighbours of
    each connected component of eliminated nodes become a clique.

    Parameters
    ----------
    low, high
        (e,) ends of the edges, ``low < high``.
    gone
        (n,) which nodes are eliminated.

    Returns
    -------
    tuple
        Lower and higher end of each edge, (k,) each; an edge that stays and comes again in a clique is there twice.
    """
    from cvxopt import matrix, spmatrix  # here: what only reads graphs needs no solver

    count, members = len(gone), np.flatnonzero(gone)
    local = np.full(count, -1, dtype=np.intp)
    local[members] = np.arange(len(members))
    a, b = local[low], local[high]
    within = (a >= 0) & (b >= 0)
    component = connected_components(len(members), np.stack([a[within], b[within]], axis=1))
    crossing = (a >= 0) != (b >= 0)
    outside = np.where(a >= 0, high, low)[crossing]
    touched = component[np.where(a >= 0, a, b)[crossing]]
    incidence = spmatrix(1.0, matrix(touched), matrix(outside), (max(len(members), 1), count))
    cliques = incidence.T * incidence
    rows, columns = (np.array(part, dtype=np.intp).ravel() for part in (cliques.I, cliques.J))
    upper = rows < columns
    left = (a < 0) & (b < 0)
    return np.concatenate([low[left], rows[upper]]), np.concatenate([high[left], columns[upper]])
