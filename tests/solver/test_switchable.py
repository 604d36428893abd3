"""Switchable loop closures: what they amount to, how they hang in a graph, the way there and back."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from graphs import bundled, dense, dense_assembly, exact_graph, variables
from numpy.testing import assert_allclose, assert_array_equal
from spoiled_graphs import apart, closures, spoiled, without
from support import dataset, write_file

import slamcli
from slamcli import models
from slamcli.graph import FactorGraph, Factors, analyze
from slamcli.graph.describe import describe
from slamcli.solver import gauge
from slamcli.solver.initialization import initialize
from slamcli.solver.linear_system import Linearizer
from slamcli.solver.options import INITS, METHODS
from slamcli.solver.result import Status
from slamcli.solver.robust import kernels, switchable
from slamcli.solver.stopwatch import Stopwatch

NAMES = ("manhattan_small.g2o", "sphere_small.g2o")
both = pytest.mark.parametrize("name", NAMES)


def switched(name: str, information: float = 1.0) -> tuple[FactorGraph, FactorGraph, Factors]:
    """A spoiled graph, the same with switches, and the false closures."""
    graph, false = spoiled(name)
    return graph, switchable.with_switches(graph, closures(graph), information), false


def poses(graph: FactorGraph) -> np.ndarray:
    return next(column for column in graph.variables.values() if column.kind.is_pose).values


@both
@pytest.mark.parametrize("information", [1.0, 20.0])
def test_switches_are_the_kernel_of_geman_and_mcclure(name: str, information: float) -> None:
    """The minimum over a switch is Xi s / (Xi + s), at the switch Xi / (Xi + s)."""
    graph, with_switches, false = switched(name, information)
    start = slamcli.optimize(without(graph, false)).graph.values
    common = {"init": "file", "tolerance": 1e-14, "max_iterations": 500}
    kernel = slamcli.optimize(graph.with_values(start), kernel="geman-mcclure", kernel_width=information, **common)
    squared = kernel.graph.edge_chi2()
    best = [information / (information + s[mask]) for s, mask in zip(squared, closures(graph), strict=True)]
    values = {**kernel.graph.values, "SWITCH": np.concatenate(best)[:, None]}
    at_best = with_switches.with_values(values)
    assert at_best.chi2() == pytest.approx(kernel.final_chi2, rel=1e-12)
    free = slamcli.optimize(at_best, **common)
    assert free.final_chi2 == pytest.approx(kernel.final_chi2, rel=1e-9)
    assert free.dof == kernel.dof
    assert apart(poses(free.graph), poses(kernel.graph)) < 1e-3
    weights = switchable.source_weights(free.graph, closures(graph))
    for weight, expected in zip(weights, kernels.weights(kernel.graph, kernel.options), strict=True):
        assert_allclose(weight, expected, rtol=0, atol=1e-4)
    assert weights[1].max() < 0.01  # the false closures are off


def test_switches_find_the_minimum_of_the_kernel() -> None:
    graph, with_switches, false = switched("manhattan_small.g2o", 20.0)
    start = slamcli.optimize(without(graph, false)).graph.values
    common = {"method": "lm", "init": "file", "tolerance": 1e-12}
    free = slamcli.optimize(with_switches.with_values({**with_switches.values, **start}), **common)
    kernel = slamcli.optimize(graph.with_values(start), kernel="geman-mcclure", kernel_width=20.0, **common)
    assert free.final_chi2 == pytest.approx(kernel.final_chi2, rel=1e-9)
    back = switchable.without_switches(free.graph, graph)
    assert apart(poses(back), poses(kernel.graph)) < 1e-3


@both
def test_dynamic_covariance_scaling_takes_twice_the_best_switch_but_at_most_one(name: str) -> None:
    graph = bundled(name)
    squared = graph.edge_chi2()[0]
    _, weight = kernels.KERNELS["dcs"](squared, 3.0)
    assert_allclose(weight, np.minimum(2.0 * 3.0 / (3.0 + squared), 1.0) ** 2, rtol=1e-14)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("init", INITS)
def test_every_method_and_start_takes_switches(method: str, init: str) -> None:
    graph, _ = spoiled("manhattan_small.g2o", count=1)
    made = switchable.with_switches(graph, closures(graph))
    found = slamcli.optimize(made, method=method, init=init, max_iterations=300)
    assert found.status in (Status.CONVERGED, Status.NOT_CONVERGED)
    assert found.final_chi2 <= found.initial_chi2
    switches = found.graph.values["SWITCH"]
    assert ((switches >= 0.0) & (switches <= 1.0)).all()
    assert found.gauge.held == (0,)


@pytest.mark.parametrize("init", ["odometry", "spanning-tree", "chordal"])
def test_starts_take_closures_with_the_weight_of_their_switches(init: str) -> None:
    graph, with_switches, false = switched("manhattan_small.g2o")
    off = np.ones((len(with_switches.variables["SWITCH"]), 1))
    off[-len(false) :] = 0.0
    held = gauge.choose(with_switches)[1]
    values, _ = initialize(with_switches.with_values({**with_switches.values, "SWITCH": off}), init, held)
    clean = without(graph, false)
    expected, _ = initialize(clean, init, gauge.choose(clean)[1])
    assert apart(values["SE2"], expected["SE2"]) < 1e-6
    assert_array_equal(values["SWITCH"], off)
    with_all, _ = initialize(with_switches, init, held)
    spoiled_start, _ = initialize(graph, init, gauge.choose(graph)[1])
    assert apart(with_all["SE2"], spoiled_start["SE2"]) < 1e-9


def test_the_gauge_is_that_of_the_graph_without_switches() -> None:
    graph, with_switches, _ = switched("manhattan_small.g2o")
    plain, plain_held = gauge.choose(graph)
    chosen, held = gauge.choose(with_switches)
    assert chosen == plain
    assert_array_equal(held["SE2"], plain_held["SE2"])
    assert not held["SWITCH"].any()


def test_a_switch_that_is_held_stays_and_is_named() -> None:
    _, with_switches, _ = switched("manhattan_small.g2o")
    wanted = int(with_switches.variables["SWITCH"].ids[-1])
    half = np.full((len(with_switches.variables["SWITCH"]), 1), 0.5)
    start = with_switches.with_values({**with_switches.values, "SWITCH": half})
    found = slamcli.optimize(start, init="file", fix=(wanted,), max_iterations=5)
    assert found.gauge.held == (0, wanted)  # the switch holds no pose
    assert found.graph.values["SWITCH"][-1] == 0.5
    assert (found.graph.values["SWITCH"][:-1] != 0.5).all()


def test_a_graph_hangs_together_as_without_switches() -> None:
    graph, with_switches, _ = switched("sphere_small.g2o")
    plain, found = analyze(graph), analyze(with_switches)
    assert found.component_count == 1
    assert_array_equal(np.sort(found.degrees), np.sort(plain.degrees))
    assert found.loop_closure_count == plain.loop_closure_count
    assert (found.parallel_edges, found.self_edges) == (plain.parallel_edges, plain.self_edges)
    told, before = describe(with_switches), describe(graph)
    assert told.bounding_box == before.bounding_box
    assert told.component_sizes == before.component_sizes
    assert told.isolated == 0
    assert (with_switches.landmarks, with_switches.poses, with_switches.space) == (0, graph.poses, 3)
    assert with_switches.switches == plain.loop_closure_count
    assert with_switches.degrees_of_freedom() == graph.degrees_of_freedom()


def test_a_graph_of_switches_alone_can_be_optimized(tmp_path: Path) -> None:
    graph = slamcli.read(str(write_file(tmp_path, "VERTEX_SWITCH 3 0.25\nEDGE_SWITCH_PRIOR 3 0.75 4\n")))
    assert (graph.space, graph.landmarks, graph.switches) == (2, 0, 1)
    assert describe(graph).chi2 == 1.0
    found = slamcli.optimize(graph)
    assert found.final_chi2 == pytest.approx(0.0, abs=1e-20)
    assert found.graph.values["SWITCH"][0, 0] == pytest.approx(0.75)
    assert found.gauge.held == ()


@pytest.mark.parametrize("held_pose", [True, False])
@pytest.mark.parametrize("fixed_switch", [True, False])
def test_blocks_of_three_variables_are_where_they_belong(held_pose: bool, fixed_switch: bool) -> None:
    """Also where pose and switch are both held, and for an edge from a pose to itself, whose switch still counts."""
    graph = exact_graph(models.SE2, models.RELATIVE_POSE_2D, 4, seed=1, extra=3)
    edges = graph.factors[0]
    indices = edges.indices.copy()
    indices[-1, 1] = indices[-1, 0]
    graph = replace(graph, factors=[replace(edges, indices=indices)])
    made = switchable.with_switches(graph, [np.arange(len(edges)) >= len(edges) - 4])
    rng = np.random.default_rng(0)
    switches = rng.uniform(0.2, 0.8, (4, 1))
    values = {"SE2": rng.standard_normal((4, 3)), "SWITCH": switches}
    held = {"SE2": np.arange(4) == (0 if held_pose else 9), "SWITCH": np.full(4, fixed_switch)}
    linearizer = Linearizer(made, held, Stopwatch())
    system = linearizer.linearize(values)
    hessian, gradient, chi2 = dense_assembly(made, held, values)
    assert system.chi2 == pytest.approx(chi2, rel=1e-12)
    assert_allclose(system.gradient, gradient, rtol=0, atol=1e-10)
    assert_allclose(dense(linearizer.pattern, system.hessian), hessian, rtol=0, atol=1e-9)


# -- there and back ---------------------------------------------------------------------------------------------------


def test_only_what_is_marked_becomes_switchable() -> None:
    graph, false = spoiled("manhattan_small.g2o")
    marked = [np.zeros(len(graph.factors[0]), dtype=bool), np.ones(len(false), dtype=bool)]
    marked[0][[3, 7]] = True
    made = switchable.with_switches(graph, marked, 5.0)
    kinds = [factors.kind for factors in made.factors]
    switched_kind = models.SWITCHABLE_RELATIVE_POSE_2D
    assert kinds == [models.RELATIVE_POSE_2D, switched_kind, switched_kind, models.SWITCH_PRIOR]
    assert [len(factors) for factors in made.factors] == [len(graph.factors[0]) - 2, 2, len(false), 2 + len(false)]
    assert (made.factors[-1].information == 5.0).all()
    assert made.chi2() == pytest.approx(graph.chi2(), rel=1e-12)
    half = {**made.values, "SWITCH": np.linspace(0.1, 0.9, 2 + len(false))[:, None]}
    weights = switchable.source_weights(made.with_values(half), marked)
    assert_allclose(weights[0][[3, 7]], half["SWITCH"][:2, 0] ** 2)
    assert weights[0].sum() == pytest.approx(len(weights[0]) - 2 + (half["SWITCH"][:2] ** 2).sum())
    assert_allclose(weights[1], half["SWITCH"][2:, 0] ** 2)
    assert [len(w) for w in switchable.weights(made)] == [len(factors) for factors in made.factors]
    assert_allclose(switchable.weights(made.with_values(half))[2], weights[1])


def test_the_way_back_keeps_the_factors_of_the_source() -> None:
    graph, made, _ = switched("sphere_small.g2o")
    moved = made.with_values({**made.values, "SE3": made.values["SE3"][::-1].copy()})
    back = switchable.without_switches(moved, graph)
    assert back.factors is graph.factors
    assert list(back.variables) == ["SE3"]
    assert_array_equal(back.values["SE3"], graph.values["SE3"][::-1])


def test_nothing_marked_changes_nothing() -> None:
    graph = bundled("landmarks_small.g2o")
    assert switchable.with_switches(graph, [np.zeros(len(f), dtype=bool) for f in graph.factors]) is graph


def test_what_is_no_relative_pose_cannot_be_switched() -> None:
    graph = bundled("landmarks_small.g2o")
    marked = [np.full(len(f), not f.kind.relative_pose) for f in graph.factors]
    with pytest.raises(ValueError, match="cannot be switched"):
        switchable.with_switches(graph, marked)


def test_a_graph_with_switches_gets_more_of_them() -> None:
    graph, false = spoiled("manhattan_small.g2o")
    first = [np.zeros(len(graph.factors[0]), dtype=bool), np.ones(len(false), dtype=bool)]
    once = switchable.with_switches(graph, first)
    more = [np.zeros(len(f), dtype=bool) for f in once.factors]
    more[0][[2, 5]] = True
    twice = switchable.with_switches(once, more)
    assert twice.switches == len(false) + 2
    assert len(np.unique(np.concatenate([c.ids for c in twice.variables.values()]))) == twice.poses + twice.switches
    values = {**twice.values, "SWITCH": np.linspace(0.0, 1.0, twice.switches)[:, None]}
    weights = switchable.source_weights(twice.with_values(values), more)
    assert_allclose(weights[0][[2, 5]], values["SWITCH"][-2:, 0] ** 2)
    back = switchable.without_switches(twice.with_values(values), once)
    assert_array_equal(back.values["SWITCH"], values["SWITCH"][:-2])


@pytest.mark.parametrize("highest", [np.iinfo(np.int64).max, np.iinfo(np.uint64).max])
def test_ids_of_switches_are_free_where_64_bits_end(highest: int) -> None:
    graph = exact_graph(models.SE2, models.RELATIVE_POSE_2D, 4, seed=0)
    ids = np.array([0, 2, 5, highest], dtype=np.int64 if highest < 2**63 else np.uint64)
    column = replace(variables(models.SE2, range(4), graph.values["SE2"]), ids=ids)
    made = switchable.with_switches(
        replace(graph, variables={"SE2": column}), [np.ones(len(f), dtype=bool) for f in graph.factors]
    )
    found = made.variables["SWITCH"].ids
    assert found.dtype == ids.dtype
    assert len(np.unique(found)) == made.switches
    assert not np.isin(found, ids).any()


def test_false_closures_of_m3500_are_switched_off() -> None:
    path = dataset("outliers/M3500_false100_random_seed1.g2o")
    graph = slamcli.read(str(path))
    made = switchable.with_switches(graph, closures(graph))
    found = slamcli.optimize(made, method="gn", init="odometry")
    weight = switchable.source_weights(found.graph, closures(graph))[0]
    assert weight[-100:].max() < 0.05  # the last hundred edges are the false ones
    assert np.mean(weight[:-100] > 0.5) > 0.99
