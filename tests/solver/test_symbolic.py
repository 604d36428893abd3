"""Symbolic analysis against dense elimination, and against CHOLMOD itself."""

import hypothesis.strategies as st
import numpy as np
import pytest
from cvxopt import cholmod
from graphs import BUNDLED_NAMES, bundled, make_problem
from hypothesis import given, settings
from numpy.testing import assert_array_equal
from numpy.typing import NDArray
from orderings import skip_without_library
from support import dataset

import slamcli
from slamcli.solver import ordering, symbolic
from slamcli.solver.backends.cholmod import Cholmod
from slamcli.solver.options import ORDERINGS
from slamcli.solver.ordering.calibration import laplacian
from slamcli.solver.pattern import BlockPattern
from slamcli.solver.symbolic.cells import factor_blocks, factor_cells

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
    assert_array_equal(found.order, order)
    assert_array_equal(found.sizes, sizes)
    assert found.nnz_factor == counts.sum()
    assert found.flops == np.square(counts.astype(float)).sum()
    assert_array_equal(found.counts, counts[starts])
    # the parent of a column is its first row below the diagonal block
    block = np.repeat(np.arange(len(sizes)), sizes)
    for k, start in enumerate(starts):
        below = np.flatnonzero(factor[:, start])
        below = below[below >= start + sizes[k]]
        assert found.parent[k] == (block[below[0]] if len(below) else -1)


def cholmod_counts(pattern: BlockPattern, blocks: NDArray[np.intp], supernodal: bool) -> NDArray[np.intp]:
    """Entries of the columns of CHOLMOD's own factor of a matrix of this pattern; supernodal ones are padded."""
    factorization = Cholmod(pattern, ordering.expand(pattern, blocks), supernodal=supernodal)
    factorization.factorize(laplacian(pattern))
    return np.diff(np.array(cholmod.getfactor(factorization._factor).CCS[0]).ravel())


def check_against_cholmod(pattern: BlockPattern, order: str) -> None:
    blocks = ordering.order(order, pattern)
    found = symbolic.analyze(pattern, blocks)
    counts = cholmod_counts(pattern, blocks, supernodal=False)
    assert found.nnz_factor == counts.sum()
    assert found.flops == np.square(counts.astype(float)).sum()
    relaxed = symbolic.supernodes(found)
    assert relaxed.stored == cholmod_counts(pattern, blocks, supernodal=True).sum()
    assert symbolic.supernodes(found, relaxed=False).stored == found.nnz_factor


@pytest.mark.parametrize("name", BUNDLED_NAMES)
@pytest.mark.parametrize("order", ORDERINGS)
def test_equals_cholmod(name: str, order: str) -> None:
    """CHOLMOD's simplicial factor has these counts, its supernodal one the same explicit zeros."""
    skip_without_library(order)
    check_against_cholmod(make_problem(bundled(name)).pattern, order)


@pytest.mark.datasets
@pytest.mark.parametrize("order", ["amd", "colamd", "metis", "amd-last-pose-last"])
@pytest.mark.parametrize(
    "name", ["pose2d/manhattan_sesync", "pose2d/intel_sesync", "landmark2d/victoriaPark_from_isam"]
)
def test_equals_cholmod_on_standard_sets(name: str, order: str) -> None:
    skip_without_library(order)
    check_against_cholmod(make_problem(slamcli.read(str(dataset(f"{name}.g2o")))).pattern, order)


@given(patterns_and_orders())
@settings(max_examples=100)
def test_supernodes_and_their_rows_are_those_of_dense_elimination(case: tuple[BlockPattern, NDArray[np.intp]]) -> None:
    pattern, order = case
    analysis = symbolic.analyze(pattern, order)
    for relaxed in (False, True):
        parts = symbolic.supernodes(analysis, relaxed=relaxed)
        structure = symbolic.row_structure(pattern, parts)
        assert_array_equal(np.sort(parts.order), np.arange(len(order)))
        assert parts.first[0] == 0 and parts.first[-1] == len(order) and (np.diff(parts.first) > 0).all()
        factor = eliminated(pattern, parts.order)
        assert factor.sum() == analysis.nnz_factor, "a postorder fills in as much"
        sizes = pattern.sizes[parts.order]
        starts = np.concatenate([[0], np.cumsum(sizes)])
        covered = np.zeros_like(factor)
        for s in range(len(parts)):
            begin, end = starts[parts.first[s]], starts[parts.first[s + 1]]
            rows = structure.of(s)
            below = np.concatenate([np.arange(starts[r], starts[r + 1]) for r in rows] + [np.arange(0)])
            assert parts.columns[s] == end - begin
            assert parts.front[s] == end - begin + len(below)
            assert parts.parent[s] == (parts.of_column[rows[0]] if len(rows) else -1)
            covered[begin:end, begin:end] = np.tril(np.ones((end - begin, end - begin), dtype=bool))
            covered[np.ix_(below, np.arange(begin, end))] = True
        if relaxed:
            assert not (factor & ~covered).any()
        else:
            assert_array_equal(covered, factor)
        assert parts.stored == covered.sum()


@given(patterns_and_orders())
@settings(max_examples=100)
def test_cells_of_the_factor(case: tuple[BlockPattern, NDArray[np.intp]]) -> None:
    pattern, order = case
    analysis = symbolic.analyze(pattern, order)
    count = len(order)
    found = np.zeros((count, count), dtype=int)
    for rows, columns in factor_cells(pattern, analysis):
        np.add.at(found, (rows, columns), 1)
    starts = np.cumsum(analysis.sizes) - analysis.sizes
    assert_array_equal(found, eliminated(pattern, order)[np.ix_(starts, starts)])
    assert factor_blocks(pattern, analysis) == found.sum()


@given(patterns_and_orders())
def test_height_is_the_longest_way_to_a_root(case: tuple[BlockPattern, NDArray[np.intp]]) -> None:
    analysis = symbolic.analyze(*case)
    longest = 0
    for start in range(len(analysis.parent)):
        node, steps = start, 0
        while node >= 0:
            node, steps = analysis.parent[node], steps + 1
        longest = max(longest, steps)
    assert analysis.height == longest


def test_a_dense_matrix_is_one_supernode() -> None:
    """Six blocks of 3, all joined: a triangle of 18 rows, and the sum of the squares up to 18 flops."""
    columns, rows = np.divmod(np.arange(36), 6)
    upper = rows <= columns
    pattern = BlockPattern(np.full(6, 3), rows[upper], columns[upper])
    found = symbolic.analyze(pattern, np.arange(6))
    assert found.nnz_factor == 18 * 19 // 2 == pattern.nnz
    assert found.flops == 18 * 19 * 37 / 6
    assert found.height == 6
    parts = symbolic.supernodes(found, relaxed=False)
    assert (len(parts), parts.largest_front, parts.height) == (1, 18, 1)


def test_a_band_fills_in_to_the_band_and_no_further() -> None:
    """Scalars joined at distance 1 and 4. Column 0 has rows 1 and 4, column 1 has 2, 5 and, by fill, 4; then all."""
    count = 12
    pairs = [(k, k) for k in range(count)] + [(k - d, k) for d in (1, 4) for k in range(d, count)]
    rows, columns = (np.array(part) for part in zip(*sorted(pairs, key=lambda pair: pair[::-1]), strict=True))
    pattern = BlockPattern(np.ones(count, dtype=np.intp), rows, columns)
    found = symbolic.analyze(pattern, np.arange(count))
    assert_array_equal(found.counts, [3, 4] + [5] * 6 + [4, 3, 2, 1])
    assert found.nnz_factor == 3 + 4 + 6 * 5 + 10
    assert found.flops == 9 + 16 + 6 * 25 + 16 + 9 + 4 + 1
    assert_array_equal(found.parent, [*range(1, count), -1])
    # all columns up to the dense end have rows that the next one lacks
    assert_array_equal(symbolic.supernodes(found, relaxed=False).columns, [1] * 7 + [5])


def test_small_supernodes_are_merged_as_cholmod_does() -> None:
    """A chain of four scalars becomes one front of four, with three explicit zeros, since that is never more work."""
    rows, columns = np.array([0, 0, 1, 1, 2, 2, 3]), np.array([0, 1, 1, 2, 2, 3, 3])
    found = symbolic.analyze(BlockPattern(np.ones(4, dtype=np.intp), rows, columns), np.arange(4))
    assert_array_equal(symbolic.supernodes(found, relaxed=False).columns, [1, 1, 2])
    relaxed = symbolic.supernodes(found)
    assert_array_equal(relaxed.columns, [4])
    assert relaxed.stored == found.nnz_factor + 3 == 10


def test_nothing_to_eliminate() -> None:
    nothing = np.empty(0, dtype=np.intp)
    pattern = BlockPattern(nothing, nothing, nothing)
    found = symbolic.analyze(pattern, nothing)
    parts = symbolic.supernodes(found)
    assert (found.nnz_factor, found.flops, found.height, len(parts), parts.stored) == (0, 0.0, 0, 0, 0)
    assert len(symbolic.row_structure(pattern, parts).rows) == 0


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
