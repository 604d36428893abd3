"""The block pattern: its index arrays against dense matrices."""

import numpy as np
import pytest
from graphs import BUNDLED_NAMES, bundled, dense, dense_assembly, differences, make_problem, mixed_graph, points
from numpy.testing import assert_allclose, assert_array_equal

from slamcli.solver import gauge, ordering
from slamcli.solver.linear_system import Linearizer
from slamcli.solver.pattern import BlockPattern
from slamcli.solver.stopwatch import Stopwatch

seeds = pytest.mark.parametrize("seed", range(8))


def made(seed: int, count: int = 4) -> BlockPattern:
    graph, held = mixed_graph(seed, count)
    return Linearizer(graph, held, Stopwatch()).pattern


@seeds
def test_entries_are_sorted_by_column_and_row(seed: int) -> None:
    """That is the compressed-column order which the factorizations rely on."""
    pattern = made(seed)
    keys = pattern.scalar_columns * pattern.dimension + pattern.scalar_rows
    assert len(keys) == pattern.stored
    assert (np.diff(keys) > 0).all()


@seeds
def test_blocks_are_dense_and_upper(seed: int) -> None:
    """Every entry of each stored block, once; no block below the diagonal; every diagonal block."""
    pattern = made(seed)
    block = np.repeat(np.arange(len(pattern.sizes)), pattern.sizes)
    found = np.stack([block[pattern.scalar_rows], block[pattern.scalar_columns]], axis=1)
    pairs, counts = np.unique(found, axis=0, return_counts=True)
    assert (pairs[:, 0] <= pairs[:, 1]).all()
    assert_array_equal(counts, pattern.sizes[pairs[:, 0]] * pattern.sizes[pairs[:, 1]])
    assert {(k, k) for k in range(len(pattern.sizes))} <= set(map(tuple, pairs.tolist()))
    assert sorted(map(tuple, pairs.tolist())) == sorted(
        zip(pattern.rows.tolist(), pattern.columns.tolist(), strict=True)
    )


@seeds
def test_pattern_is_that_of_the_dense_matrix(seed: int) -> None:
    """A block is stored exactly where a factor joins two free variables."""
    graph, held = mixed_graph(seed, 3)
    pattern = Linearizer(graph, held, Stopwatch()).pattern
    hessian = dense_assembly(graph, held, graph.values)[0]
    ends = pattern.offsets
    stored = set(zip(pattern.rows.tolist(), pattern.columns.tolist(), strict=True))
    for i in range(len(pattern.sizes)):
        for j in range(i, len(pattern.sizes)):
            block = hessian[ends[i] : ends[i + 1], ends[j] : ends[j + 1]]
            assert ((i, j) in stored) == (i == j or bool(np.abs(block).max() > 1e-12))


@seeds
def test_diagonal_and_quadratic_form(seed: int) -> None:
    pattern = made(seed)
    rng = np.random.default_rng(seed)
    values = rng.standard_normal(pattern.stored)
    # a symmetric matrix: its diagonal blocks are stored in full
    full = dense(pattern, values)
    symmetric = (full + full.T) / 2.0
    values = symmetric[pattern.scalar_rows, pattern.scalar_columns]
    assert_array_equal(values[pattern.diagonal], np.diag(symmetric))
    x = rng.standard_normal(pattern.dimension)
    assert pattern.quadratic_form(values, x) == pytest.approx(x @ symmetric @ x, rel=1e-11, abs=1e-11)


@seeds
def test_weights_count_every_entry_of_the_full_matrix(seed: int) -> None:
    pattern = made(seed)
    full = dense(pattern, np.ones(pattern.stored))
    assert float(np.asarray(pattern.weight).sum()) == np.count_nonzero(full)
    triangle = np.count_nonzero(np.triu(full))
    assert pattern.nnz == triangle


@pytest.mark.parametrize("name", BUNDLED_NAMES)
def test_counts_of_the_bundled_graphs(name: str) -> None:
    graph = bundled(name)
    held = gauge.choose(graph)[1]
    pattern = Linearizer(graph, held, Stopwatch()).pattern
    free = {key: len(column) - int(held[key].sum()) for key, column in graph.variables.items()}
    assert pattern.dimension == sum(free[key] * graph.variables[key].kind.dimension for key in free)
    assert len(pattern.sizes) == sum(free.values())


def test_blocks_of_a_chain_by_hand() -> None:
    """Points 0 - 1 - 2 with point 0 held: blocks (1, 1), (1, 2), (2, 2) of a 4 x 4 matrix."""
    graph = points([(0.0, 0.0)] * 3, differences([(0, 1, 1.0, 0.0), (1, 2, 1.0, 0.0)]))
    pattern = make_problem(graph).pattern
    assert_array_equal(pattern.sizes, [2, 2])
    assert_array_equal(pattern.rows, [0, 0, 1])
    assert_array_equal(pattern.columns, [0, 1, 1])
    assert_array_equal(pattern.scalar_columns, [0, 0, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3])
    assert_array_equal(pattern.scalar_rows, [0, 1, 0, 1, 0, 1, 2, 3, 0, 1, 2, 3])
    assert_array_equal(pattern.diagonal, [0, 3, 6, 11])
    assert pattern.nnz == 10  # of a full 4 x 4 triangle


def test_self_edges_add_no_block() -> None:
    graph = points([(0.0, 0.0)] * 3, differences([(0, 1, 1.0, 0.0), (2, 2, 0.0, 0.0)]))
    pattern = make_problem(graph).pattern
    assert_array_equal(pattern.rows, pattern.columns)


def test_expand_by_hand() -> None:
    pattern = BlockPattern(np.array([3, 2, 1]), np.arange(3), np.arange(3))
    assert_array_equal(ordering.expand(pattern, np.array([2, 0, 1])), [5, 0, 1, 2, 3, 4])
    assert_array_equal(ordering.expand(pattern, np.array([0, 1, 2])), np.arange(6))


@seeds
@pytest.mark.parametrize("name", ["amd", "natural"])
def test_orders_are_permutations_that_keep_blocks_together(seed: int, name: str) -> None:
    pattern = made(seed)
    blocks = ordering.order(name, pattern)
    assert_array_equal(np.sort(blocks), np.arange(len(pattern.sizes)))
    scalar = ordering.expand(pattern, blocks)
    wanted = [np.arange(pattern.offsets[b], pattern.offsets[b + 1]) for b in blocks]
    assert_array_equal(scalar, np.concatenate(wanted))


def test_natural_order_is_the_order_of_the_file() -> None:
    pattern = made(0)
    assert_array_equal(ordering.order("natural", pattern), np.arange(len(pattern.sizes)))


def test_quadratic_form_of_the_hessian_is_the_curvature_of_the_model() -> None:
    problem = make_problem(bundled("square_toro.graph"))
    system = problem.linearize(bundled("square_toro.graph").values)
    x = np.random.default_rng(1).standard_normal(problem.pattern.dimension)
    full = dense(problem.pattern, system.hessian)
    assert_allclose(problem.pattern.quadratic_form(system.hessian, x), x @ full @ x, rtol=1e-12)
