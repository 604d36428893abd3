"""H, gradient and chi2 against a dense assembly, and against differences of chi2."""

import numpy as np
import pytest
from graphs import dense, dense_assembly, differences, mixed_graph, points, reordered
from numpy.testing import assert_allclose, assert_array_equal

from slamcli.graph import FactorGraph
from slamcli.solver.gauge import Held
from slamcli.solver.linear_system import Linearizer
from slamcli.solver.stopwatch import Stopwatch

seeds = pytest.mark.parametrize("seed", range(8))


def linearizer(graph: FactorGraph, held: Held) -> Linearizer:
    return Linearizer(graph, held, Stopwatch())


@seeds
def test_equals_the_dense_assembly(seed: int) -> None:
    """All kinds of factors, held variables, self edges (whose total derivative vanishes) and parallel edges."""
    graph, held = mixed_graph(seed)
    system = linearizer(graph, held).linearize(graph.values)
    pattern = linearizer(graph, held).pattern
    hessian, gradient, chi2 = dense_assembly(graph, held, graph.values)
    assert pattern.dimension == len(gradient)
    assert system.chi2 == pytest.approx(chi2, rel=1e-12)
    assert_allclose(system.gradient, gradient, rtol=0, atol=1e-11 * np.abs(gradient).max())
    assert_allclose(dense(pattern, system.hessian), hessian, rtol=0, atol=1e-11 * np.abs(hessian).max())


@seeds
def test_chi2_is_that_of_the_graph(seed: int) -> None:
    graph, held = mixed_graph(seed)
    made = linearizer(graph, held)
    assert made.chi2(graph.values) == pytest.approx(made.linearize(graph.values).chi2, rel=1e-12)
    assert made.chi2(graph.values) == pytest.approx(graph.chi2(), rel=1e-12)


@seeds
def test_gradient_is_half_the_slope_of_chi2(seed: int) -> None:
    graph, held = mixed_graph(seed)
    made = linearizer(graph, held)
    system = made.linearize(graph.values)
    direction = np.random.default_rng(seed).standard_normal(made.pattern.dimension)
    h = 1e-6
    ahead, behind = (made.chi2(made.retract(graph.values, sign * h * direction)) for sign in (1.0, -1.0))
    slope = (ahead - behind) / (2.0 * h)
    scale = np.abs(system.gradient) @ np.abs(direction)
    assert 2.0 * system.gradient @ direction == pytest.approx(slope, abs=1e-6 * scale)


@seeds
def test_can_be_used_again_at_another_state(seed: int) -> None:
    graph, held = mixed_graph(seed)
    made = linearizer(graph, held)
    before = made.linearize(graph.values)
    step = 0.1 * np.random.default_rng(seed).standard_normal(made.pattern.dimension)
    elsewhere = made.retract(graph.values, step)
    fresh = linearizer(graph, held).linearize(elsewhere)
    again = made.linearize(elsewhere)
    assert_array_equal(again.hessian, fresh.hessian)
    assert_array_equal(again.gradient, fresh.gradient)
    back = made.linearize(graph.values)
    assert_array_equal(back.hessian, before.hessian)


@seeds
def test_retract_moves_the_free_variables_only(seed: int) -> None:
    graph, held = mixed_graph(seed)
    made = linearizer(graph, held)
    moved = made.retract(graph.values, np.full(made.pattern.dimension, 0.25))
    for name, mask in held.items():
        changed = (moved[name] != graph.values[name]).any(axis=1)
        assert_array_equal(changed, ~mask)
    stay = made.retract(graph.values, np.zeros(made.pattern.dimension))
    for name, values in graph.values.items():
        assert_allclose(stay[name], values, rtol=0, atol=1e-15)


def test_columns_of_factors_add_up() -> None:
    """H of two columns of factors is the sum of theirs."""
    graph, held = mixed_graph(3)
    whole = linearizer(graph, held)
    total = np.zeros((whole.pattern.dimension, whole.pattern.dimension))
    chi2 = 0.0
    for factors in graph.factors:
        part = linearizer(FactorGraph(graph.variables, [factors]), held)
        system = part.linearize(graph.values)
        total += dense(part.pattern, system.hessian)
        chi2 += system.chi2
    system = whole.linearize(graph.values)
    assert system.chi2 == pytest.approx(chi2)
    assert_allclose(dense(whole.pattern, system.hessian), total, rtol=0, atol=1e-11 * np.abs(total).max())


def test_long_columns_add_up() -> None:
    """Columns so long that they are worked on in parts give the sum of short ones, at the first and at later calls."""
    graph, held = mixed_graph(5, count=6000)
    whole = linearizer(graph, held)
    step = 0.1 * np.random.default_rng(0).standard_normal(whole.pattern.dimension)
    for values in (graph.values, whole.retract(graph.values, step)):
        system = whole.linearize(values)
        hessian = np.zeros((whole.pattern.dimension, whole.pattern.dimension))
        gradient, chi2 = np.zeros(whole.pattern.dimension), 0.0
        for start in range(0, 6000, 200):
            rows = np.arange(start, start + 200)
            short = FactorGraph(graph.variables, [reordered(factors, rows) for factors in graph.factors])
            part = linearizer(short, held)
            added = part.linearize(values)
            hessian += dense(part.pattern, added.hessian)
            gradient += added.gradient
            chi2 += added.chi2
        assert system.chi2 == pytest.approx(chi2, rel=1e-12)
        assert_allclose(system.gradient, gradient, rtol=0, atol=1e-11 * np.abs(gradient).max())
        assert_allclose(dense(whole.pattern, system.hessian), hessian, rtol=0, atol=1e-11 * np.abs(hessian).max())


def test_not_finite_is_seen() -> None:
    graph = points([(0.0, 0.0), (1.0, 0.0)], differences([(0, 1, 1.0, 0.0)]))
    held = {"XY": np.array([True, False])}
    made = linearizer(graph, held)
    assert made.linearize(graph.values).is_finite
    for bad in (np.nan, np.inf):
        assert not made.linearize({"XY": np.array([[0.0, 0.0], [bad, 0.0]])}).is_finite


def test_gradient_norm_is_the_largest_component() -> None:
    graph = points([(0.0, 0.0), (3.0, -7.0)], differences([(0, 1, 1.0, 0.0)]))
    held = {"XY": np.array([True, False])}
    system = linearizer(graph, held).linearize(graph.values)
    assert_allclose(system.gradient, [2.0, -7.0])
    assert system.gradient_norm == 7.0
