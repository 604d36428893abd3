"""All factorizations and all orderings give the step that a dense solver gives, and refuse indefinite matrices."""

import sys

import numpy as np
import pytest
from cvxopt import cholmod
from graphs import BUNDLED_NAMES, bundled, dense, make_problem
from numpy.testing import assert_allclose
from orderings import skip_without_library

from slamcli.errors import UsageError
from slamcli.solver import backends, ordering, symbolic
from slamcli.solver.backends import Factorization, NotPositiveDefiniteError
from slamcli.solver.options import LINEAR_SOLVERS, ORDERINGS
from slamcli.solver.pattern import BlockPattern

all_backends = pytest.mark.parametrize("backend", LINEAR_SOLVERS)
all_orderings = pytest.mark.parametrize("order", ORDERINGS)


def factorization(backend: str, order: str, pattern: BlockPattern) -> Factorization:
    if backend == "pardiso":
        pytest.importorskip("pypardiso")
    skip_without_library(order)
    return backends.make(backend, pattern, ordering.expand(pattern, ordering.order(order, pattern)))


@all_backends
@all_orderings
@pytest.mark.parametrize("name", BUNDLED_NAMES)
def test_step_is_that_of_a_dense_solver(backend: str, order: str, name: str) -> None:
    graph = bundled(name)
    problem = make_problem(graph)
    system = problem.linearize(graph.values)
    factor = factorization(backend, order, problem.pattern)
    factor.factorize(system.hessian)
    step = factor.solve(-system.gradient)
    wanted = np.linalg.solve(dense(problem.pattern, system.hessian), -system.gradient)
    assert_allclose(step, wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())


@all_backends
@all_orderings
def test_factorizes_again_with_other_values(backend: str, order: str) -> None:
    """The symbolic analysis serves every matrix of the pattern; right-hand sides stay as they are."""
    graph = bundled("square_toro.graph")
    problem = make_problem(graph)
    system = problem.linearize(graph.values)
    factor = factorization(backend, order, problem.pattern)
    for scale in (1.0, 7.0, 1.0):
        factor.factorize(scale * system.hessian)
        rhs = -system.gradient
        step = factor.solve(rhs)
        assert_allclose(rhs, -system.gradient, rtol=0, atol=0)
        wanted = np.linalg.solve(scale * dense(problem.pattern, system.hessian), rhs)
        assert_allclose(step, wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())


@all_backends
@all_orderings
def test_one_negative_eigenvalue_is_found(backend: str, order: str) -> None:
    """A shift of half the smallest eigenvalue leaves H positive definite, one and a half of it does not."""
    graph = bundled("landmarks_small.g2o")
    problem = make_problem(graph)
    system = problem.linearize(graph.values)
    smallest = np.linalg.eigvalsh(dense(problem.pattern, system.hessian))[0]
    factor = factorization(backend, order, problem.pattern)
    shifted = system.hessian.copy()
    shifted[problem.pattern.diagonal] -= 0.5 * smallest
    factor.factorize(shifted)
    shifted[problem.pattern.diagonal] -= smallest
    with pytest.raises(NotPositiveDefiniteError):
        factor.factorize(shifted)
    factor.factorize(system.hessian)  # and it recovers
    wanted = np.linalg.solve(dense(problem.pattern, system.hessian), -system.gradient)
    assert_allclose(factor.solve(-system.gradient), wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())


@all_backends
@all_orderings
def test_zero_matrix_is_refused(backend: str, order: str) -> None:
    problem = make_problem(bundled("square_toro.graph"))
    factor = factorization(backend, order, problem.pattern)
    with pytest.raises(NotPositiveDefiniteError):
        factor.factorize(np.zeros(problem.pattern.stored))


def test_cholmod_eliminates_in_the_given_order() -> None:
    """Left to itself CHOLMOD also tries its own orders, and takes the best."""
    graph = bundled("manhattan_small.g2o")
    problem = make_problem(graph)
    found = {}
    for order in ("amd", "natural", "rcm"):
        blocks = ordering.order(order, problem.pattern)
        factor = backends.make("cholmod", problem.pattern, ordering.expand(problem.pattern, blocks))
        factor.factorize(problem.linearize(graph.values).hessian)
        found[order] = len(cholmod.getfactor(factor._factor).V)  # type: ignore[attr-defined]
        assert found[order] >= symbolic.analyze(problem.pattern, blocks).nnz_factor
    assert found["natural"] > 5 * found["amd"]


@all_backends
def test_whole_runs_agree(backend: str) -> None:
    """The backends are interchangeable from start to end, not only for one step."""
    if backend == "pardiso":
        pytest.importorskip("pypardiso")
    import slamcli

    graph = bundled("sphere_small.g2o")
    wanted = slamcli.optimize(graph)
    result = slamcli.optimize(graph, linear_solver=backend, ordering="natural")
    assert [record.chi2 for record in result.trace] == pytest.approx([record.chi2 for record in wanted.trace], rel=1e-9)


def test_unknown_backend() -> None:
    problem = make_problem(bundled("square_toro.graph"))
    with pytest.raises(UsageError, match="does not exist"):
        backends.make("umfpack", problem.pattern, np.arange(problem.pattern.dimension))


def test_missing_pardiso_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = make_problem(bundled("square_toro.graph"))
    monkeypatch.setitem(sys.modules, "pypardiso", None)
    monkeypatch.delitem(sys.modules, "slamcli.solver.backends.pardiso", raising=False)
    with pytest.raises(UsageError, match="not installed") as caught:
        backends.make("pardiso", problem.pattern, np.arange(problem.pattern.dimension))
    assert any("pip install" in line for line in caught.value.details)
