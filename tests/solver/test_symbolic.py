"""Symbolic analysis against dense elimination, and against CHOLMOD itself."""

import hypothesis.strategies as st
import numpy as np
import pytest
from cvxopt import cholmod, matrix, spmatrix
from graphs import BUNDLED_NAMES, bundled, make_problem
from hypothesis import given, settings
from numpy.testing import assert_array_equal
from numpy.typing import NDArray

from slamcli.solver import ordering, symbolic
from slamcli.solver.pattern import BlockPattern

Bools = NDArray[np.bool_]


@st.composite
def patterns_and_orders(draw: st.DrawFn) -> tuple[BlockPattern, NDArray[np.intp]]:
    """Random block graphs, connected or not, with blocks of 1 to 6 rows, and an order of elimination."""
    count = draw(st.integers(1, 10))
    sizes = draw(st.lists(st.integers(1, 6), min_size=count, max_size=count))
    pairs = [(i, j) for j in range(count) for i in range(j)]
    edges = draw(st.sets(st.sampled_from(pairs))) if pairs else set()
    blocks = sorted(edges | {(k, k) for k in range(count)}, key=lambda block: (block[1], block[0]))
    rows, columns = (np.array(part, dtype=np.intp) for part in zip(*blocks, strict=True))
    order = draw(st.permutations(range(count)))
    return BlockPattern(np.array(sizes, dtype=np.intp), rows, columns), np.array(order, dtype=np.intp)


def eliminated(pattern: BlockPattern, order: NDArray[np.intp]) -> Bools:
    """Pattern of L by elimination on the dense boolean matrix."""
    full = np.zeros((pattern.dimension, pattern.dimension), dtype=bool)
    full[pattern.scalar_rows, pattern.scalar_columns] = True
    full |= full.T
    permutation = ordering.expand(pattern, order)
    factor = np.tril(full[np.ix_(permutation, permutation)])
    for k in range(pattern.dimension):
        below = np.flatnonzero(factor[:, k])
        below = below[below > k]
        for row in below:
            factor[row, below[below <= row]] = True
    return factor


@given(patterns_and_orders())
@settings(max_examples=150)
def test_equals_dense_elimination(case: tuple[BlockPattern, NDArray[np.intp]]) -> None:
    pattern, order = case
    factor = eliminated(pattern, order)
    counts = factor.sum(axis=0)
    found = symbolic.analyze(pattern, order)
    sizes = pattern.sizes[order]
    starts = np.cumsum(sizes) - sizes
    assert found.nnz_factor == counts.sum()
    assert found.flops == np.square(counts.astype(float)).sum()
    assert_array_equal(found.counts, counts[starts])
    # the parent of a column is its first row below the diagonal block
    block = np.repeat(np.arange(len(sizes)), sizes)
    for k, start in enumerate(starts):
        below = np.flatnonzero(factor[:, start])
        below = below[below >= start + sizes[k]]
        assert found.parent[k] == (block[below[0]] if len(below) else -1)


@pytest.mark.parametrize("name", BUNDLED_NAMES)
@pytest.mark.parametrize("order", ["amd", "natural"])
def test_equals_cholmod(name: str, order: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """CHOLMOD's own factor, simplicial so that its columns are not padded, has these counts and this flop count."""
    graph = bundled(name)
    problem = make_problem(graph)
    pattern = problem.pattern
    blocks = ordering.order(order, pattern)
    found = symbolic.analyze(pattern, blocks)
    monkeypatch.setitem(cholmod.options, "supernodal", 0)
    monkeypatch.setitem(cholmod.options, "nmethods", 1)  # this order, without a look at others
    shape = (pattern.dimension, pattern.dimension)
    hessian = spmatrix(
        matrix(problem.linearize(graph.values).hessian),
        matrix(pattern.scalar_rows),
        matrix(pattern.scalar_columns),
        shape,
    )
    permutation = matrix(ordering.expand(pattern, blocks))
    handle = cholmod.symbolic(hessian, permutation, "U")
    cholmod.numeric(hessian, handle)
    factor = cholmod.getfactor(handle)
    counts = np.diff(np.array(factor.CCS[0]).ravel())
    assert found.nnz_factor == counts.sum()
    assert found.flops == np.square(counts.astype(float)).sum()


@pytest.mark.parametrize("name", BUNDLED_NAMES)
def test_minimum_degree_fills_no_more_than_the_natural_order(name: str) -> None:
    graph = bundled(name)
    by_order = {order: make_problem(graph, ordering=order).sparsity for order in ("amd", "natural")}
    amd, natural = by_order["amd"], by_order["natural"]
    assert amd.nnz_hessian == natural.nnz_hessian <= amd.nnz_factor <= natural.nnz_factor
    assert amd.factor_flops <= natural.factor_flops
    assert amd.fill_in == amd.nnz_factor / amd.nnz_hessian
    assert (amd.ordering, natural.ordering) == ("amd", "natural")


def test_a_chain_has_no_fill() -> None:
    """Blocks of 2 in a chain: every column but the last has 2 rows of its neighbour below its own block."""
    sizes = np.full(4, 2)
    rows, columns = np.array([0, 0, 1, 1, 2, 2, 3]), np.array([0, 1, 1, 2, 2, 3, 3])
    found = symbolic.analyze(BlockPattern(sizes, rows, columns), np.arange(4))
    assert_array_equal(found.parent, [1, 2, 3, -1])
    assert_array_equal(found.counts, [4, 4, 4, 2])
    assert found.nnz_factor == 3 * (4 + 3) + (2 + 1)
    assert found.flops == 3 * (16 + 9) + (4 + 1)


def test_a_star_depends_on_its_order() -> None:
    """The centre eliminated first joins all leaves, eliminated last it fills nothing."""
    sizes = np.ones(5, dtype=np.intp)
    rows, columns = np.array([0, 0, 1, 0, 2, 0, 3, 0, 4]), np.array([0, 1, 1, 2, 2, 3, 3, 4, 4])
    star = BlockPattern(sizes, rows, columns)
    assert symbolic.analyze(star, np.array([0, 1, 2, 3, 4])).nnz_factor == 15
    assert symbolic.analyze(star, np.array([4, 3, 2, 1, 0])).nnz_factor == 9


def test_density_counts_both_triangles() -> None:
    graph = bundled("square_toro.graph")
    sparsity = make_problem(graph).sparsity
    full = 2 * sparsity.nnz_hessian - sparsity.dimension
    assert sparsity.density == full / sparsity.dimension**2
    assert sparsity.dimension == 3 * 40
