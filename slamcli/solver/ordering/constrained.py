"""Minimum degree under constraints: groups of variables eliminated one after the other, as CAMD and CCOLAMD do it.

What is left of the graph after a group is eliminated does not depend on the order within the group. So every group
can be ordered by itself, by minimum degree on what the groups before it leave. (The Schur complement of bundle
adjustment is the case of two groups, points and cameras.)
"""

from __future__ import annotations

import numpy as np

from slamcli.graph.columns import IndexArray
from slamcli.solver.ordering.adjacency import edges
from slamcli.solver.ordering.minimum_degree import of_edges
from slamcli.solver.ordering.reduction import reduced_edges
from slamcli.solver.pattern import BlockPattern


def landmarks_first(pattern: BlockPattern) -> IndexArray:
    """All landmarks, then the poses; what is left in between is a graph of poses alone."""
    return in_groups(pattern, (pose_rank(pattern) >= 0).astype(np.intp))


def last_pose_last(pattern: BlockPattern) -> IndexArray:
    """The pose with the highest id at the end: its covariance is then L_nn^-T L_nn^-1 of the last block of L alone."""
    rank = pose_rank(pattern)
    return in_groups(pattern, ((rank >= 0) & (rank == rank.max(initial=-1))).astype(np.intp))


def pose_rank(pattern: BlockPattern) -> IndexArray:
    """(n,) place of each pose by its id, -1 for landmarks; where that is not known, blocks are poses in order."""
    return np.arange(len(pattern.sizes)) if pattern.pose_rank is None else pattern.pose_rank


def in_groups(pattern: BlockPattern, group: IndexArray) -> IndexArray:
    """Block elimination order of groups.

    Parameters
    ----------
    pattern
        The pattern.
    group
        (n,) number of each block's group: lower ones are eliminated before higher ones.
    """
    low, high = edges(pattern)
    parts = []
    for number in np.unique(group):
        members = np.flatnonzero(group == number)
        local = np.full(len(group), -1, dtype=np.intp)
        local[members] = np.arange(len(members))
        a, b = local[low], local[high]
        within = (a >= 0) & (b >= 0)
        parts.append(members[of_edges(len(members), a[within], b[within])])
        if number < group.max():
            low, high = reduced_edges(low, high, group <= number)
    return np.concatenate(parts) if parts else np.arange(0)
