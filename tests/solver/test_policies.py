"""Step policies: what each promises about its steps, its damping and its trust radius."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from graphs import BUNDLED_NAMES, bundled, differences, from_file, make_problem, point_priors, points
from support import write_file

import slamcli
from slamcli import models
from slamcli.graph import FactorGraph
from slamcli.solver.result import Status

each_graph = pytest.mark.parametrize("name", BUNDLED_NAMES)


def spoiled(name: str, turn: float, seed: int = 3) -> FactorGraph:
    """A bundled graph of planar poses whose headings are off by up to a turn (radians)."""
    graph = bundled(name)
    values = dict(graph.values)
    wrong = values["SE2"].copy()
    wrong[:, 2] += np.random.default_rng(seed).uniform(-turn, turn, len(wrong))
    values["SE2"] = models.SE2.normalize(wrong)
    return graph.with_values(values)


def in_units(graph: FactorGraph, scale: float) -> FactorGraph:
    """The same planar graph with lengths in another unit: chi2 stays."""
    factors = []
    for f in graph.factors:
        unit = np.where(np.isin(f.kind.components, ("x", "y")), scale, 1.0)
        weight = 1.0 / (unit[:, None] * unit[None, :])
        factors.append(replace(f, measurements=f.measurements * unit, information=f.information * weight))
    units = {"SE2": np.array([scale, scale, 1.0]), "XY": np.array([scale, scale])}
    values = {name: column.values * units[name] for name, column in graph.variables.items()}
    return replace(graph.with_values(values), factors=factors)


@each_graph
@pytest.mark.parametrize("method", ["lm", "dogleg"])
def test_chi2_never_rises(name: str, method: str) -> None:
    graph = bundled(name) if "SE3" in bundled(name).variables else spoiled(name, 3.1)
    result = from_file(graph, method=method)
    before, stage = result.initial_chi2, result.trace[0].stage
    for record in result.trace:
        if record.stage != stage:  # with more landmarks there is more chi2
            before, stage = record.chi2 - record.chi2_change, record.stage
        assert record.chi2 <= before
        assert record.chi2_change == pytest.approx(
            record.chi2 - before, abs=0.0 if stage == result.trace[0].stage else 1e-9 * before
        )
        if not record.accepted:
            assert record.chi2 == before
        before = record.chi2
    assert result.final_chi2 == before < result.initial_chi2


def test_gauss_newton_takes_every_step() -> None:
    """It may go up on its way, which sets it apart from the others."""
    result = from_file(spoiled("landmarks_small.g2o", 3.1))
    assert all(record.accepted and record.trials == 1 and record.damping is None for record in result.trace)
    assert any(record.chi2_change > 0.0 for record in result.trace)


def test_dogleg_steps_stay_within_the_radius() -> None:
    """The radius recorded with an iteration is the one for the next; rejected trials only shrink it."""
    result = from_file(spoiled("landmarks_small.g2o", 3.1), method="dogleg")
    radius = 1e4
    for record in result.trace:
        assert record.step_norm <= radius * (1.0 + 1e-9)
        if record.step != "gauss-newton" and record.trials == 1:
            assert record.step_norm == pytest.approx(radius)
        assert record.damping is not None
        radius = record.damping
    kinds = {record.step for record in result.trace}
    assert kinds >= {"gauss-newton", "dogleg"} and kinds <= {"gauss-newton", "dogleg", "steepest-descent"}
    assert any(record.trials > 1 for record in result.trace)


def test_dogleg_cuts_steps_exactly_at_the_radius() -> None:
    """On a linear problem the model is exact: nothing is rejected, and every cut step is as long as the radius."""
    graph = points([(0.0, 0.0), (3e5, 4e5)], point_priors([(0, 0.0, 0.0), (1, 0.0, 0.0)]), differences([]))
    result = from_file(replace(graph, factors=graph.factors[:1]), method="dogleg")
    norms = [record.step_norm for record in result.trace if record.step != "gauss-newton"]
    radii = [1e4, *(record.damping for record in result.trace)]
    assert len(norms) >= 3
    assert norms == pytest.approx(radii[: len(norms)], rel=1e-12)
    assert radii[1] == pytest.approx(3e4)  # a good step triples the radius
    assert result.final_chi2 == pytest.approx(0.0, abs=1e-12)


@each_graph
def test_dogleg_is_gauss_newton_within_its_radius(name: str) -> None:
    graph = bundled(name)
    wanted = from_file(graph)
    result = from_file(graph, method="dogleg")
    assert {record.step for record in result.trace} == {"gauss-newton"}
    assert [r.chi2 for r in result.trace] == [r.chi2 for r in wanted.trace]


def test_damping_starts_as_in_g2o_and_falls_to_a_third() -> None:
    """On a linear problem the gain ratio is 1: lambda is 1e-5 of the largest diagonal entry, then a third each time."""
    edges = [(0, 1, 1.0, 0.0), (1, 2, 1.0, 0.0), (0, 2, 1.6, 0.0)]
    graph = points([(0.0, 0.0), (1.0, 0.0), (9.0, 4.0)], point_priors([(0, 0.0, 0.0)]), differences(edges))
    largest = make_problem(graph).diagonal(make_problem(graph).linearize(graph.values)).max()
    result = from_file(graph, method="lm", tolerance=0.0, max_iterations=3)
    damping = [record.damping for record in result.trace]
    assert damping[:2] == pytest.approx([1e-5 * largest / 3.0, 1e-5 * largest / 9.0], rel=1e-6)


@pytest.mark.parametrize(("turn", "seed", "limit"), [(2.5, 3, 1.0 / 3.0), (2.0, 1, None), (2.5, 1, 2.0 / 3.0)])
def test_damping_follows_the_gain_ratio(turn: float, seed: int, limit: float | None) -> None:
    """Nielsen's rule: lambda *= max(1/3, min(2/3, 1 - (2 rho - 1)^3)), with the actual over the predicted decrease."""
    graph = spoiled("square_toro.graph", turn, seed)
    problem = make_problem(graph)
    system = problem.linearize(graph.values)
    damping = 1e-5 * problem.diagonal(system).max()
    delta = problem.solve(system, np.full_like(system.gradient, damping))
    record = from_file(graph, method="lm", max_iterations=1).trace[0]
    rho = -record.chi2_change / float(delta @ (damping * delta - system.gradient))
    rule = 1.0 - (2.0 * rho - 1.0) ** 3
    assert record.trials == 1
    assert (limit is None) == (1.0 / 3.0 < rule < 2.0 / 3.0)
    assert record.damping == pytest.approx(damping * (limit or rule), rel=1e-6)


@pytest.mark.parametrize("scaling", ["none", "marquardt"])
def test_damped_step_solves_the_damped_system(scaling: str) -> None:
    """(H + lambda D) delta = -g, with the lambda before it was updated."""
    graph = bundled("square_toro.graph")
    problem = make_problem(graph)
    system = problem.linearize(graph.values)
    diagonal = problem.diagonal(system)
    damping = 1e-4 * diagonal if scaling == "marquardt" else np.full_like(diagonal, 1e-5 * diagonal.max())
    wanted = np.linalg.norm(problem.solve(system, damping))
    result = from_file(graph, method="lm", scaling=scaling, max_iterations=1)
    assert result.trace[0].trials == 1
    assert result.trace[0].step_norm == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize("name", ["manhattan_small.g2o", "landmarks_small.g2o"])
def test_marquardt_scaling_does_not_depend_on_units(name: str) -> None:
    metres = bundled(name)
    millimetres = in_units(metres, 1000.0)
    assert millimetres.chi2() == pytest.approx(metres.chi2(), rel=1e-9)
    paths = {
        scaling: [from_file(graph, method="lm", scaling=scaling).trace for graph in (metres, millimetres)]
        for scaling in ("marquardt", "none")
    }
    same, other = paths["marquardt"]
    assert [r.chi2 for r in same] == pytest.approx([r.chi2 for r in other], rel=1e-6)
    assert [r.damping for r in same] == pytest.approx([r.damping for r in other], rel=1e-6)
    plain, scaled = paths["none"]
    assert plain[0].chi2 != pytest.approx(scaled[0].chi2, rel=1e-6)


def test_damping_solves_what_gauss_newton_cannot(tmp_path: Path) -> None:
    """A landmark with one bearing is free along the ray; the damping holds it there."""
    text = "VERTEX_SE2 0 0 0 0\nVERTEX_XY 7 5 5\nEDGE_BEARING_SE2_XY 0 7 0.5 10\n"
    graph = slamcli.read(str(write_file(tmp_path, text)))
    assert from_file(graph, method="gn").status is Status.FAILED
    result = from_file(graph, method="lm", tolerance=1e-12)
    assert result.status is Status.CONVERGED
    assert result.final_chi2 == pytest.approx(0.0, abs=1e-9)
    x, y = result.graph.values["XY"][0]
    assert np.arctan2(y, x) == pytest.approx(0.5, abs=1e-5)


@each_graph
def test_trace_and_result_tell_the_same(name: str) -> None:
    result = from_file(bundled(name), method="lm")
    assert [record.iteration for record in result.trace] == list(range(1, result.iterations + 1))
    assert result.trace[-1].chi2 == result.final_chi2
    assert result.initial_chi2 + sum(r.chi2_change for r in result.trace) == pytest.approx(result.final_chi2, rel=1e-6)
    assert all(record.time > 0.0 and record.step_norm > 0.0 for record in result.trace)
    assert result.graph.chi2() == pytest.approx(result.final_chi2, rel=1e-12)
