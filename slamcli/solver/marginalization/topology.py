"""Which links stand for a marginal: the best tree, and what to add to it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.models.base import Array
from slamcli.solver.initialization.spanning_tree import kruskal
from slamcli.solver.marginalization.descent import padded_inverse, total
from slamcli.solver.marginalization.links import Links
from slamcli.solver.marginalization.nodes import Nodes


def spanning_tree(
    nodes: Nodes, blanket: Sequence[int], links: list[Links], covariances: list[Array]
) -> list[BoolArray]:
    """The links of the minimum spanning tree of log det T_i, as one mask for each kind of links.

    Poses and the world are joined first (Kruskal 1956); points, which carry no orientation any further, are then
    leaves. Without poses, points take their part.
    """
    count = len(blanket)
    is_pose = nodes.is_pose[list(blanket)]
    inner = is_pose if is_pose.any() else ~is_pose
    ends, weights, origin = _flattened(links, covariances, count)
    joins_inner = np.append(inner, True)[ends].all(axis=1)
    picked = _kruskal(ends, weights, np.flatnonzero(joins_inner), count + 1).tolist()
    leaves = np.flatnonzero(~inner)
    if len(leaves):
        rest = np.flatnonzero(~joins_inner)
        leaf = np.where(np.append(inner, True)[ends[rest, 0]], ends[rest, 1], ends[rest, 0])
        order = rest[np.lexsort((weights[rest], leaf))]
        ordered = leaf[np.lexsort((weights[rest], leaf))]
        picked += order[np.unique(ordered, return_index=True)[1]].tolist()
    return _masks(links, origin, picked)


def add_links(
    links: list[Links],
    covariances: list[Array],
    information: list[Array],
    tree: list[BoolArray],
    free: IndexArray,
    count: int,
    context: Array,
) -> list[BoolArray]:
    """The tree and as many links more as asked for: those that lower the divergence most if they are added alone.

    With C = J S^-1 J^T under the tree and the eigenvalues m of T C^-1, a link lowers 2 KLD by the sum of
    m - 1 - log m over those below 1.
    """
    sigma = padded_inverse(context + total(links, information, len(context)), free)
    gains = []
    for part, covariance, mask in zip(links, covariances, tree, strict=True):
        here = part.covariance(sigma)
        m = np.linalg.eigvals(np.linalg.solve(here, covariance)).real
        m = np.clip(m, 1e-12, 1.0)
        gains.append(np.where(mask, -1.0, (m - 1.0 - np.log(m)).sum(axis=1)))
    flat = np.concatenate(gains)
    best = np.argsort(-flat, kind="stable")[:count]
    best = best[flat[best] > 1e-12]
    added = np.zeros(len(flat), dtype=bool)
    added[best] = True
    parts = np.split(added, np.cumsum([len(part) for part in links])[:-1])
    return [mask | more for mask, more in zip(tree, parts, strict=True)]


def _flattened(links: list[Links], covariances: list[Array], world: int) -> tuple[IndexArray, Array, IndexArray]:
    """Ends (m, 2), the world for those of priors, log det T and the kind of all links."""
    ends, weights, origin = [], [], []
    for k, (part, covariance) in enumerate(zip(links, covariances, strict=True)):
        outer = np.full((len(part), 1), world)
        ends.append(np.concatenate([part.ends, outer], axis=1) if part.ends.shape[1] == 1 else part.ends)
        weights.append(np.linalg.slogdet(covariance)[1])
        origin.append(np.full(len(part), k))
    return np.concatenate(ends), np.concatenate(weights), np.concatenate(origin)


def _kruskal(ends: IndexArray, weights: Array, allowed: IndexArray, nodes: int) -> IndexArray:
    """Of the allowed links those of the lightest forest."""
    ordered = allowed[np.argsort(weights[allowed], kind="stable")]
    return ordered[kruskal(nodes, *ends[ordered].T)]


def _masks(links: list[Links], origin: IndexArray, picked: list[int]) -> list[BoolArray]:
    chosen = np.zeros(len(origin), dtype=bool)
    chosen[picked] = True
    return np.split(chosen, np.cumsum([len(part) for part in links])[:-1])
