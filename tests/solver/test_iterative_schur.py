"""The complement as a product, conjugate gradients on it, and the steps and optima that come of them."""

import numpy as np
import pytest
from bundle_scenes import perturbed, ring
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from support import BUNDLED, dataset
from test_schur import SCENES, dense, problem

import slamcli
from slamcli.errors import UsageError
from slamcli.models.base import Array
from slamcli.reporting import iterations
from slamcli.solver import schur
from slamcli.solver.backends import NotPositiveDefiniteError
from slamcli.solver.covariance.recovery import CovarianceRecovery
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.pattern import BlockPattern
from slamcli.solver.schur import NotSolvedError, links
from slamcli.solver.schur import conjugate_gradients as cg
from slamcli.solver.schur.implicit import ImplicitSchur
from slamcli.solver.schur.links import Links
from slamcli.solver.schur.preconditioner import BlockJacobi


def complement(matrix: Array, kept: Array, gone: Array) -> Array:
    """A - W V^-1 W^T."""
    crossing = matrix[np.ix_(kept, gone)]
    return matrix[np.ix_(kept, kept)] - crossing @ np.linalg.solve(matrix[np.ix_(gone, gone)], crossing.T)


def random_system(seed: int) -> tuple[BlockPattern, Array, Array]:
    """A pattern with cameras of different widths among its points, values of a definite matrix, which blocks go."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(4, 14))
    gone = rng.random(count) < 0.5
    gone[:2] = True, False
    sizes = np.where(gone, rng.integers(1, 4), rng.integers(1, 10, count))
    there = np.triu(rng.random((count, count)) < 0.6)
    there &= ~(gone[:, None] & gone)
    there |= np.eye(count, dtype=bool)
    columns, rows = np.nonzero(there.T)
    pattern = BlockPattern(sizes, rows, columns)
    lower = np.tril(rng.normal(size=(pattern.dimension, pattern.dimension)))
    matrix = lower + np.tril(lower, -1).T + 4.0 * pattern.dimension * np.eye(pattern.dimension)
    return pattern, matrix[pattern.scalar_rows, pattern.scalar_columns], gone


@given(st.integers(0, 10**6), st.sampled_from([1, 2, 10**9]))
@settings(max_examples=60, deadline=None)
def test_the_product_is_that_of_the_explicit_complement(seed: int, long: int) -> None:
    pattern, values, gone = random_system(seed)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(links, "_LONG", long)
        patch.setattr(links, "_CHUNK", 3)
        own = Links.of(pattern, gone)
        solver = ImplicitSchur(own)
        solver.factorize(values)
        matrix = dense(pattern, values)
        explicit = complement(matrix, own.rows[~own.padding], own.point_rows.ravel())
        x = np.random.default_rng(seed).normal(size=len(explicit))
        padded = np.zeros(own.rows.shape)
        padded[~own.padding] = x
        product = solver.product(padded)
        blocks = solver.diagonal_blocks()
        solution = solver.solve(matrix @ np.arange(1.0, pattern.dimension + 1.0))
    assert_allclose(product[~own.padding], explicit @ x, rtol=0, atol=1e-12 * np.abs(matrix).max())
    assert (product[own.padding] == 0.0).all()
    ends = np.cumsum(pattern.sizes[own.kept])
    for block, size, end in zip(blocks, pattern.sizes[own.kept], ends, strict=True):
        assert_allclose(block[:size, :size], explicit[end - size : end, end - size : end], rtol=1e-10, atol=1e-10)
    assert_allclose(solution, np.arange(1.0, pattern.dimension + 1.0), rtol=1e-8)


@pytest.mark.parametrize("scene", SCENES)
def test_an_exact_step_is_that_of_the_whole_system(scene: str) -> None:
    graph = SCENES[scene]()
    own = problem(graph, reduced_solver="iterative")
    assert own.iterative
    system = own.linearize(graph.values)
    damping = 1e-3 * own.diagonal(system) + 1e-9
    expected = np.linalg.solve(dense(own.pattern, system.hessian) + np.diag(damping), -system.gradient)
    assert_allclose(own.solve(system, damping), expected, rtol=0, atol=1e-8 * np.abs(expected).max())
    assert_allclose(own.solve_again(system), expected, rtol=0, atol=1e-8 * np.abs(expected).max())


@pytest.mark.parametrize("scene", SCENES)
def test_a_tight_forcing_term_gives_the_direct_step_and_a_loose_one_a_good_share_of_it(scene: str) -> None:
    graph = SCENES[scene]()
    own = problem(graph, reduced_solver="iterative")
    system = own.linearize(graph.values)
    damping = 1e-3 * own.diagonal(system) + 1e-9
    exact = problem(graph).solve(system, damping)
    before = own.linear_iterations or 0
    loose = own.solve(system, damping, inexact=True)
    taken = (own.linear_iterations or 0) - before
    assert own._iterative is not None
    tight = own._iterative.solve_inexactly(-system.gradient, 1e-18)
    assert_allclose(tight, exact, rtol=0, atol=1e-8 * np.abs(exact).max())
    # what a step promises is by the same formula for both
    promised, most = -float(system.gradient @ loose), -float(system.gradient @ exact)
    curvature = float(loose @ (dense(own.pattern, system.hessian) + np.diag(damping)) @ loose)
    assert promised == pytest.approx(curvature, rel=1e-9)
    assert 0.5 * most < promised <= most * (1.0 + 1e-12)
    assert 1 <= taken < (own.linear_iterations or 0) - before - taken


def laplacian(size: int) -> Array:
    return 2.0 * np.eye(size) - np.eye(size, k=1) - np.eye(size, k=-1)


def test_conjugate_gradients_end_after_as_many_iterations_as_there_are_eigenvalues() -> None:
    matrix = np.diag([1.0, 1.0, 5.0, 5.0, 5.0, 9.0])
    found = cg.exact(lambda x: matrix @ x, lambda x: x, np.arange(1.0, 7.0))
    assert found.reached
    assert found.iterations == 3
    assert_allclose(matrix @ found.x, np.arange(1.0, 7.0), rtol=1e-12)


def test_the_inexact_criterion_is_that_of_nash_and_sofer() -> None:
    matrix, rhs = laplacian(40), np.random.default_rng(0).normal(size=40)

    def decrease(x: Array) -> float:
        return float(2.0 * rhs @ x - x @ matrix @ x)

    found = cg.inexact(lambda x: matrix @ x, lambda x: x, rhs, 0.1)
    k, gained, basis = 0, [0.0], np.empty((40, 0))
    following = rhs
    while True:  # the k-th iterate is the best of the Krylov subspace
        k += 1
        for _ in range(2):
            following = following - basis @ (basis.T @ following)
        basis = np.column_stack([basis, following / np.linalg.norm(following)])
        following = matrix @ basis[:, -1]
        x = basis @ np.linalg.solve(basis.T @ matrix @ basis, basis.T @ rhs)
        gained.append(decrease(x))
        if k * (gained[-1] - gained[-2]) <= 0.1 * gained[-1]:
            break
    assert found.iterations == k > 3
    assert_allclose(found.x, x, rtol=1e-6)


def test_what_does_not_come_to_an_end_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    matrix, rhs = laplacian(60), np.ones(60)
    rhs[0] = 7.0
    monkeypatch.setattr(cg, "EXACT_LIMIT", 5)
    monkeypatch.setattr(cg, "INEXACT_LIMIT", 5)
    with pytest.raises(NotSolvedError, match="in 5 iterations"):
        cg.exact(lambda x: matrix @ x, lambda x: x, rhs)
    found = cg.inexact(lambda x: matrix @ x, lambda x: x, rhs, 1e-9)
    assert (found.reached, found.iterations) == (False, 5)
    assert found.residual == pytest.approx(float(np.linalg.norm(rhs - matrix @ found.x) / np.linalg.norm(rhs)))


def test_no_right_hand_side_takes_no_iteration() -> None:
    found = cg.exact(lambda x: x, lambda x: x, np.zeros(3))
    assert (found.iterations, found.reached) == (0, True)


@pytest.mark.parametrize("matrix", [np.diag([1.0, -2.0]), np.zeros((2, 2))])
def test_a_direction_without_curvature_is_refused(matrix: Array) -> None:
    for method in (cg.exact, cg.inexact):
        with pytest.raises(NotPositiveDefiniteError, match="curvature"):
            method(lambda x: matrix @ x, lambda x: x, np.array([0.0, 1.0]))


def test_a_preconditioner_is_the_inverse_of_its_blocks_and_refuses_others() -> None:
    rng = np.random.default_rng(0)
    half = rng.normal(size=(3, 4, 4))
    blocks, padding = half @ half.transpose(0, 2, 1), np.zeros((3, 4), dtype=bool)
    units = np.array([1e-6, 1.0, 1e3, 1e8])
    blocks *= units[:, None] * units
    blocks[1, 3], blocks[1, :, 3], padding[1, 3] = 0.0, 0.0, True
    x = rng.normal(size=(3, 4)) * units
    found = BlockJacobi(blocks, padding).solve(x)
    for k in (0, 2):
        assert_allclose(blocks[k] @ found[k], x[k], rtol=1e-6)
    assert_allclose(blocks[1, :3, :3] @ found[1, :3], x[1, :3], rtol=1e-6)
    with pytest.raises(NotPositiveDefiniteError):  # a row of zeros that is there
        BlockJacobi(blocks, np.zeros_like(padding))
    with pytest.raises(NotPositiveDefiniteError):
        BlockJacobi(np.ones((1, 2, 2)), np.zeros((1, 2), dtype=bool))


@pytest.mark.parametrize("damaged", ["point", "camera"])
def test_what_is_not_positive_definite_is_refused(damaged: str) -> None:
    graph = perturbed(ring())
    own = problem(graph, reduced_solver="iterative")
    assert isinstance(own.schur, schur.ImplicitSelection)
    system = own.linearize(graph.values)
    rows = own.schur.links.point_rows[3] if damaged == "point" else own.schur.links.rows[0]
    damping = 1e-3 * own.diagonal(system)
    damping[rows] = -0.5 * own.diagonal(system)[rows]
    with pytest.raises(NotPositiveDefiniteError):
        own.solve(system, damping)


@pytest.mark.parametrize("method", ["gn", "lm", "dogleg", "auto"])
def test_all_methods_come_to_the_same_optimum(method: str) -> None:
    graph = SCENES["landmarks"]()
    result = slamcli.optimize(graph, reduced_solver="iterative", method=method)
    assert result.exit_code == 0
    assert result.problem is not None and result.problem.iterative
    assert result.final_chi2 == pytest.approx(slamcli.optimize(graph, elimination="none").final_chi2, rel=1e-7)


def test_a_scene_comes_to_the_same_optimum_and_its_trace_says_by_how_many_iterations() -> None:
    graph = perturbed(ring(cameras=12, points=60))
    result = slamcli.optimize(graph, reduced_solver="iterative")
    assert result.exit_code == 0
    assert result.final_chi2 == pytest.approx(slamcli.optimize(graph, reduced_solver="dense").final_chi2, rel=1e-8)
    counts = [record.linear_iterations for record in result.trace]
    assert all(count is not None and count > 0 for count in counts)
    assert result.linear_iterations == sum(count or 0 for count in counts)
    assert f"cg {counts[0]}" in iterations.line(result.trace[0].chi2, result.trace[0])
    assert result.sparsity is not None and result.sparsity.reduced is not None
    assert (result.sparsity.nnz_factor, result.sparsity.reduced.nnz) == (None, None)
    assert (result.sparsity.reduced.dimension, result.sparsity.reduced.solver) == (108, "iterative")
    direct = slamcli.optimize(graph, reduced_solver="sparse")
    assert (direct.linear_iterations, direct.trace[0].linear_iterations) == (None, None)
    assert direct.sparsity is not None and direct.sparsity.reduced is not None
    assert direct.sparsity.reduced.solver == "sparse"


def test_a_step_at_the_limit_of_iterations_is_taken_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cg, "INEXACT_LIMIT", 1)
    graph = perturbed(ring())
    result = slamcli.optimize(graph, reduced_solver="iterative", max_iterations=3)
    assert result.final_chi2 < 0.5 * result.initial_chi2
    assert result.unfinished == sum(record.trials for record in result.trace)


def test_a_run_whose_exact_solution_is_not_found_fails_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cg, "EXACT_LIMIT", 3)
    result = slamcli.optimize(SCENES["landmarks"](), reduced_solver="iterative", method="gn", init="file")
    assert result.exit_code == 5
    assert "in 3 iterations" in result.reason
    assert "--reduced-solver sparse" in result.diagnosis[0]


def test_covariances_are_by_a_factorization() -> None:
    graph = SCENES["landmarks"]()
    result = slamcli.optimize(graph, reduced_solver="iterative", method="lm")
    assert result.problem is not None and result.problem.iterative
    found = CovarianceRecovery(result.graph, result.options, result.problem).marginals()
    expected = CovarianceRecovery(result.graph, OptimizeOptions()).marginals()
    for name, covariances in expected.items():
        assert_allclose(found[name], covariances, rtol=1e-8, atol=1e-12)


def test_who_asks_for_a_reduced_solver_asks_for_a_complement() -> None:
    graph = SCENES["landmarks"]()
    assert problem(graph, "auto").schur is None
    for name in ("dense", "sparse"):
        own = problem(graph, "auto", reduced_solver=name)
        assert isinstance(own.schur, schur.Selection)
        assert own.schur.dense == (name == "dense")
    with pytest.raises(UsageError, match="what an elimination leaves"):
        problem(graph, "none", reduced_solver="dense")
    poses = slamcli.read(str(BUNDLED / "manhattan_small.g2o"))
    with pytest.raises(UsageError, match="reduced solver 'iterative' needs points"):
        problem(poses, "auto", reduced_solver="iterative")


def test_the_choice_of_a_solver_is_by_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    graph = perturbed(ring())
    assert isinstance(problem(graph, "auto", method="lm").schur, schur.Selection)
    monkeypatch.setattr(schur.selection, "_PAIR", 1.0)  # as if each point were seen by thousands
    assert isinstance(problem(graph, "auto", method="lm").schur, schur.ImplicitSelection)
    assert isinstance(problem(graph, "auto", method="gn").schur, schur.Selection)  # its steps must be exact
    monkeypatch.setattr(schur.selection, "_PAIR", 0.0)
    monkeypatch.setattr(schur.selection, "_RATE", 1.0)  # as if there were thousands of cameras
    assert isinstance(problem(graph, "auto", method="lm").schur, schur.ImplicitSelection)


@pytest.mark.datasets
def test_dubrovnik_ends_at_the_same_cost() -> None:
    graph = slamcli.read(str(dataset("bal/problem-16-22106-pre.txt")))
    result = slamcli.optimize(graph, reduced_solver="iterative")
    assert result.exit_code == 0
    assert 0.5 * result.final_chi2 == pytest.approx(18033.903479, rel=1e-8)
