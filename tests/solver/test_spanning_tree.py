"""Spanning trees from several roots: against brute force, and where nothing or everything is uncertain."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from slamcli.solver.initialization.spanning_tree import Edges, breadth_first, least_uncertain


def random_edges(seed: int, nodes: int = 30, count: int = 70) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs without parallel or self edges, and their uncertainties."""
    rng = np.random.default_rng(seed)
    pairs = np.array([(a, b) for a in range(nodes) for b in range(a)])
    pairs = rng.permutation(pairs)[:count]
    flip = rng.random(count) < 0.5
    pairs[flip] = pairs[flip, ::-1]
    return pairs[:, 0], pairs[:, 1], rng.random(count) + 0.01


def totals(parent: np.ndarray, edge: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Length of the path from each node up to its root."""
    out = np.zeros(len(parent))
    for node in range(len(parent)):
        at = node
        while edge[at] >= 0:
            out[node] += length[edge[at]]
            at = parent[at]
    return out


@pytest.mark.parametrize("seed", range(5))
def test_paths_are_the_shortest(seed: int) -> None:
    first, second, length = random_edges(seed)
    roots = np.zeros(30, dtype=bool)
    roots[[seed, 20]] = True
    matrix = csr_matrix((length, (first, second)), shape=(30, 30))
    wanted = dijkstra(matrix, directed=False, indices=np.flatnonzero(roots)).min(axis=0)
    parent, edge = least_uncertain(Edges.of(30, first, second), length, roots, list(range(30)))
    reached = np.isfinite(wanted)
    assert_allclose(totals(parent, edge, length)[reached], wanted[reached], rtol=1e-12)
    for node in np.flatnonzero(edge >= 0):
        assert {node, parent[node]} == {first[edge[node]], second[edge[node]]}
    assert_array_equal(parent[edge < 0], np.flatnonzero(edge < 0))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("value", [1.0, np.inf])
def test_equal_uncertainties_count_edges(seed: int, value: float) -> None:
    """Even if there is no information at all: then the depths are those of breadth first."""
    first, second, length = random_edges(seed)
    edges, roots = Edges.of(30, first, second), np.arange(30) == 7
    order = list(range(30))
    depth = totals(*breadth_first(edges, roots, order), np.ones(len(length)))
    found = totals(*least_uncertain(edges, np.full(len(length), value), roots, order), np.ones(len(length)))
    assert_array_equal(found, depth)


@pytest.mark.parametrize("tree", ["breadth", "uncertain"])
def test_what_no_root_reaches_starts_its_own_tree(tree: str) -> None:
    """In the given order; and without any edge each node is a tree."""
    first, second = np.array([0, 2]), np.array([1, 3])
    for roots, wanted in ((np.array([False, True, False, False]), [1, 1, 3, 3]), (np.zeros(4, bool), [0, 0, 3, 3])):
        edges, order = Edges.of(4, first, second), [3, 0, 2, 1]
        run = breadth_first if tree == "breadth" else lambda e, r, o: least_uncertain(e, np.ones(2), r, o)
        assert run(edges, roots, order)[0].tolist() == wanted
    none = np.empty(0, dtype=np.intp)
    parent, edge = least_uncertain(Edges.of(3, none, none), np.empty(0), np.zeros(3, bool), [0, 1, 2])
    assert parent.tolist() == [0, 1, 2] and edge.tolist() == [-1, -1, -1]


def test_a_sure_detour_beats_an_unsure_edge() -> None:
    first, second, length = np.array([0, 0, 1]), np.array([2, 1, 2]), np.array([10.0, 1.0, 1.0])
    edges, roots = Edges.of(3, first, second), np.array([True, False, False])
    assert least_uncertain(edges, length, roots, [0, 1, 2])[0].tolist() == [0, 0, 1]
    assert breadth_first(edges, roots, [0, 1, 2])[0].tolist() == [0, 0, 0]
