"""What must not change covariances, what must, and covariances at the end of robust runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from graphs import bundled, differences, exact_graph, from_file, information, points, reordered
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import slamcli
from slamcli import models
from slamcli.graph import FactorGraph, Factors
from slamcli.solver.covariance import CovarianceRecovery, CovarianceRequest, recover, recovery_of
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.robust import kernels

KINDS = ((models.SE2, models.RELATIVE_POSE_2D), (models.SE3, models.RELATIVE_POSE_3D))
seeds = st.integers(0, 2**32 - 1)
spaces = st.sampled_from(KINDS)


def noisy(graph: FactorGraph, seed: int) -> FactorGraph:
    """The same graph with residuals: covariances are those of any linearization point."""
    rng = np.random.default_rng(seed)
    values = {
        name: column.kind.retract(column.values, 0.1 * rng.standard_normal((len(column), column.kind.dimension)))
        for name, column in graph.variables.items()
    }
    return graph.with_values(values)


def held_at(graph: FactorGraph, identifier: int) -> CovarianceRecovery:
    return CovarianceRecovery(graph, OptimizeOptions(fix=(identifier,)))


# -- what must not change them, and what must --------------------------------------------------------------------------


@given(spaces, seeds)
def test_a_relative_covariance_is_a_marginal_with_the_other_held(kinds: tuple, seed: int) -> None:
    """Whatever is held elsewhere: relative poses know nothing of the gauge."""
    graph = noisy(exact_graph(*kinds, 8, seed), seed)
    rng = np.random.default_rng(seed)
    i, j, k = rng.choice(8, 3, replace=False).tolist()
    wanted = held_at(graph, i).marginals()[kinds[0].name][j]
    for held in (i, j, k):
        (found,) = recover(held_at(graph, held), CovarianceRequest(relative=((i, j),))).relative
        assert_allclose(found.covariance, wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())


@given(spaces, seeds)
def test_another_gauge_transforms_by_the_adjoint(kinds: tuple, seed: int) -> None:
    """Swapping the roles of two poses turns the covariance of one seen from the other into its inverse's."""
    kind, relative = kinds
    graph = exact_graph(kind, relative, 6, seed)
    there = held_at(graph, 0).marginals()[kind.name][5]
    back = held_at(graph, 5).marginals()[kind.name][0]
    value = graph.values[kind.name]
    pose = kind.compose(kind.inverse(value[:1]), value[5:])
    # the error of X^-1 seen from its own frame is -Ad(X) times that of X
    adjoint = np.zeros((kind.dimension, kind.dimension))
    step = 1e-6
    for k in range(kind.dimension):
        delta = np.zeros((2, kind.dimension))
        delta[:, k] = step, -step
        moved = kind.inverse(kind.retract(np.tile(pose, (2, 1)), delta))
        error = kind.compose(np.tile(pose, (2, 1)), moved)  # the pose X^-1 is at home in the frame of its inverse
        adjoint[:, k] = (error[0] - error[1])[: kind.dimension] / (2.0 * step)
    assert_allclose(adjoint @ there @ adjoint.T, back, rtol=0, atol=1e-6 * np.abs(back).max())


@given(spaces, seeds)
def test_ids_and_the_order_of_edges_do_not_matter(kinds: tuple, seed: int) -> None:
    kind, relative = kinds
    graph = noisy(exact_graph(kind, relative, 9, seed), seed)
    rng = np.random.default_rng(seed)
    wanted = held_at(graph, 0).marginals()[kind.name]
    shuffled = FactorGraph(graph.variables, [reordered(graph.factors[0], rng.permutation(len(graph.factors[0])))])
    assert_allclose(held_at(shuffled, 0).marginals()[kind.name], wanted, rtol=1e-8, atol=1e-10 * wanted.max())
    column, order = graph.variables[kind.name], rng.permutation(9)
    ids = rng.choice(10**6, 9, replace=False)
    renamed = replace(column, ids=ids[order], values=column.values[order])
    place = np.empty(9, dtype=np.intp)
    place[order] = np.arange(9)
    factors = replace(graph.factors[0], indices=place[graph.factors[0].indices])
    found = held_at(FactorGraph({kind.name: renamed}, [factors]), int(ids[0])).marginals()[kind.name]
    assert_allclose(found[place], wanted, rtol=1e-8, atol=1e-10 * wanted.max())


@given(spaces, seeds)
def test_another_edge_never_makes_anything_less_certain(kinds: tuple, seed: int) -> None:
    kind, relative = kinds
    graph = noisy(exact_graph(kind, relative, 8, seed), seed)
    rng = np.random.default_rng(seed)
    pair = rng.choice(8, 2, replace=False)[None]
    measured = graph.values[kind.name][:1]
    more = Factors(relative, pair, measured, information(rng, 1, relative.dimension))
    before = held_at(graph, 0).marginals()[kind.name]
    after = held_at(FactorGraph(graph.variables, [*graph.factors, more]), 0).marginals()[kind.name]
    gained = np.linalg.eigvalsh(before - after)
    assert gained.min() > -1e-9 * np.abs(before).max()
    assert gained.max() > 0.0


def test_several_components_each_have_their_gauge() -> None:
    """Two chains that nothing joins: each has its lowest id held, and the covariances that it has alone."""
    two = points([(0.0, 0.0)] * 6, differences([(0, 1, 0, 0), (1, 2, 0, 0), (3, 4, 0, 0), (4, 5, 0, 0)]))
    recovery = CovarianceRecovery(two)
    assert recovery.gauge.held == (0, 3)
    found = recovery.marginals()["XY"]
    assert_allclose(found[:, 0, 0], [0, 1, 2, 0, 1, 2], atol=1e-15)
    assert not recovery.joint([("XY", 2), ("XY", 5)])[:2, 2:].any()


# -- at the end of a run -----------------------------------------------------------------------------------------------


def test_a_kernel_weighs_the_factors() -> None:
    """The Hessian of a run with a kernel has each factor's information times its weight at the end."""
    graph = bundled("manhattan_small.g2o")
    result = from_file(graph, kernel="cauchy")
    found = recovery_of(result)
    (loss,) = kernels.losses(graph, result.options)
    _, weight = loss.evaluate(result.graph.edge_chi2()[0], slice(None))
    assert 0.0 < weight.min() < 0.9
    weighted = replace(graph.factors[0], information=weight[:, None, None] * graph.factors[0].information)
    wanted = CovarianceRecovery(replace(result.graph, factors=[weighted])).marginals()["SE2"]
    assert_allclose(found.marginals()["SE2"], wanted, rtol=1e-9, atol=1e-12)
    assert found.predicted_decrease < 1e-4


def test_rejected_closures_inform_nothing() -> None:
    """A false closure among true ones: covariances are those of the graph without it."""
    graph = from_file(bundled("manhattan_small.g2o")).graph
    factors = graph.factors[0]
    wrong = Factors(
        factors.kind, np.array([[3, 350]]), np.array([[30.0, 5.0, 1.0]]), factors.information[:1], tag="EDGE_SE2"
    )
    joined = replace(
        factors,
        **{
            name: np.concatenate([getattr(factors, name), getattr(wrong, name)])
            for name in ("indices", "measurements", "information")
        },
        lines=np.append(factors.lines, 0),
    )
    result = slamcli.optimize(replace(graph, factors=[joined]), robust="gnc", init="file")
    assert result.rejection.rejected[0][-1]
    found = recovery_of(result).marginals()["SE2"]
    wanted = CovarianceRecovery(graph).marginals()["SE2"]
    assert_allclose(found[1:], wanted[1:], rtol=0.05, atol=1e-4 * np.abs(wanted).max())
