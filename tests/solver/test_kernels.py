"""Robust kernels: their derivatives, g2o's and GTSAM's numbers for them, whole optimizations with them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from graphs import bundled, mixed_graph
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from spoiled_graphs import apart, spoiled, without
from support import dataset, write_file

import slamcli
from slamcli import models
from slamcli.errors import UsageError
from slamcli.formats import write
from slamcli.formats.labels import outlier_masks, read_labels
from slamcli.graph import FactorGraph
from slamcli.models.base import Array
from slamcli.solver import options as solver_options
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.problem import Problem
from slamcli.solver.result import Status
from slamcli.solver.robust import kernels
from slamcli.solver.robust.kernels import KERNELS
from slamcli.solver.robust.loss import Weights
from slamcli.solver.stopwatch import Stopwatch

WIDTHS = (0.3, 1.0, 2.5)
SQUARED = (0.0, 0.01, 0.08, 0.5, 1.7, 5.0, 7.0, 90.0, 1e6)
G2O = {
    "huber": "Huber",
    "pseudo-huber": "PseudoHuber",
    "cauchy": "Cauchy",
    "geman-mcclure": "GemanMcClure",
    "welsch": "Welsch",
    "fair": "Fair",
    "tukey": "Tukey",
    "dcs": "DCS",
    "saturated": "Saturated",
}
every_kernel = pytest.mark.parametrize("name", KERNELS)
every_width = pytest.mark.parametrize("width", WIDTHS)


def evaluate(name: str, squared: float, width: float) -> tuple[float, float]:
    cost, weight = KERNELS[name](np.array([squared]), width)
    return float(cost[0]), float(weight[0])


def test_the_options_name_every_kernel() -> None:
    assert ("none", *KERNELS) == solver_options.KERNELS
    assert set(G2O) == set(KERNELS)


@every_kernel
@every_width
def test_weight_is_the_derivative_of_the_cost(name: str, width: float) -> None:
    s = np.geomspace(1e-3, 1e3, 200)
    kinks = np.array([width, width**2])
    s = s[np.abs(s[:, None] / kinks - 1.0).min(axis=1) > 1e-2]
    h = 1e-4 * s
    slope = (KERNELS[name](s + h, width)[0] - KERNELS[name](s - h, width)[0]) / (2.0 * h)
    assert_allclose(KERNELS[name](s, width)[1], slope, rtol=1e-5, atol=1e-8)


@every_kernel
@given(
    width=st.floats(1e-3, 1e3),
    squared=st.lists(st.floats(1e-6, 1e12), min_size=2, max_size=20),
)
def test_costs_rise_and_weights_fall_from_one(name: str, width: float, squared: list[float]) -> None:
    s = np.sort(np.array([0.0, *squared]))
    cost, weight = KERNELS[name](s, width)
    assert cost[0] == 0.0
    assert weight[0] == 1.0
    assert (np.diff(cost) >= -1e-8 * cost[1:]).all()
    assert (np.diff(weight) <= 0.0).all()
    assert (weight >= 0.0).all()
    assert (cost <= s * (1.0 + 1e-8)).all()


@every_kernel
def test_a_very_wide_kernel_is_least_squares(name: str) -> None:
    s = np.geomspace(1e-9, 1e9, 60)
    for width in (1e12, 1e100):
        cost, weight = KERNELS[name](s, width)
        assert_allclose(cost, s, rtol=1e-2 if width < 1e13 else 1e-12)
        assert_allclose(weight, 1.0, rtol=0, atol=1e-2)


@every_kernel
def test_what_is_not_finite_stays_so(name: str) -> None:
    loss = kernels.KernelLoss(KERNELS[name], 1.0, np.ones(3, dtype=bool))
    cost, weight = loss.evaluate(np.array([np.inf, np.nan, 2.0]), slice(None))
    assert np.isposinf(cost[0])
    assert np.isnan(cost[1])
    assert (cost[2], weight[2]) == pytest.approx(evaluate(name, 2.0, 1.0))


def test_a_square_that_rounding_made_negative_is_zero() -> None:
    loss = kernels.KernelLoss(KERNELS["fair"], 1.0, np.ones(1, dtype=bool))
    assert loss.evaluate(np.array([-1e-18]), slice(None)) == (0.0, 1.0)


# -- the same kernels elsewhere ---------------------------------------------------------------------------------------


def of_g2o(folder: Path, name: str, width: float, squared: float) -> tuple[float, float]:
    """Cost and weight of g2o's kernel: two priors of weight 1 pull a point, one of them through the kernel.

    From the middle of the other one, Gauss-Newton goes to d w / (1 + w) of the distance d.
    """
    g2o = pytest.importorskip("g2opy")
    d = float(np.sqrt(squared))
    text = f"VERTEX_XY 0 0 0\nEDGE_PRIOR_XY 0 {d!r} 0 1 0 1\nEDGE_PRIOR_XY 0 0 0 1 0 1\n"
    optimizer = peer(g2o, write_file(folder, text))
    for edge in optimizer.edges():
        if edge.measurement()[0] != 0.0:
            edge.set_robust_kernel(getattr(g2o, f"RobustKernel{G2O[name]}")(width))
    optimizer.initialize_optimization()
    optimizer.compute_active_errors()
    cost = float(optimizer.active_robust_chi2())
    optimizer.optimize(1)
    moved = float(optimizer.vertex(0).estimate()[0])
    return cost, moved / (d - moved)


def peer(g2o, path: Path):
    """g2o's optimizer, loaded."""
    optimizer = g2o.SparseOptimizer()
    optimizer.set_verbose(False)
    optimizer.set_algorithm(g2o.OptimizationAlgorithmGaussNewton(g2o.BlockSolverX(g2o.LinearSolverEigenX())))
    assert optimizer.load(str(path))
    return optimizer


@pytest.mark.parametrize("name", [name for name in KERNELS if name != "dcs"])
@every_width
def test_kernels_equal_g2o(tmp_path: Path, name: str, width: float) -> None:
    for squared in SQUARED[1:-1]:
        expected = of_g2o(tmp_path, name, width, squared)
        assert evaluate(name, squared, width) == pytest.approx(expected, rel=1e-12, abs=1e-12)


@every_width
def test_dcs_equals_g2o_up_to_the_width_where_g2o_turns_its_weight_round(tmp_path: Path, width: float) -> None:
    for squared in SQUARED[1:-1]:
        cost, weight = of_g2o(tmp_path, "dcs", width, squared)
        if squared <= width:
            assert evaluate("dcs", squared, width) == pytest.approx((cost, weight), rel=1e-12)
        else:  # what it takes for the cost is the part of the edge without that of its scale
            assert cost == pytest.approx(squared * evaluate("dcs", squared, width)[1], rel=1e-12)
            assert weight < 0.0


@every_width
def test_kernels_equal_gtsam_where_they_are_the_same(width: float) -> None:
    """GTSAM's losses act on the norm and have a factor of one half; its Geman-McClure has the square for a width."""
    estimators = pytest.importorskip("gtsam").noiseModel.mEstimator
    same = {
        "huber": estimators.Huber.Create(width),
        "cauchy": estimators.Cauchy.Create(width),
        "fair": estimators.Fair.Create(width),
        "welsch": estimators.Welsch.Create(width),
        "tukey": estimators.Tukey.Create(width),
        "saturated": estimators.TruncatedLeastSquares.Create(width),
    }
    geman_mcclure = estimators.GemanMcClure.Create(np.sqrt(width))
    for squared in SQUARED[1:]:
        norm = float(np.sqrt(squared))
        for name, theirs in same.items():
            expected = (2.0 * theirs.loss(norm), theirs.weight(norm))
            assert evaluate(name, squared, width) == pytest.approx(expected, rel=1e-9, abs=1e-12), name
        expected = (2.0 * geman_mcclure.loss(norm), geman_mcclure.weight(norm))
        assert evaluate("geman-mcclure", squared, width) == pytest.approx(expected, rel=1e-9)
        dcs = estimators.DCS.Create(width)
        assert evaluate("dcs", squared, width)[1] == pytest.approx(dcs.weight(norm), rel=1e-12)


@pytest.mark.parametrize("name", ["huber", "cauchy", "fair"])
def test_an_optimization_ends_where_that_of_g2o_does(tmp_path: Path, name: str) -> None:
    g2o = pytest.importorskip("g2opy")
    graph, false = spoiled("manhattan_small.g2o", count=3)
    graph = graph.with_values(slamcli.optimize(without(graph, false)).graph.values)
    path = tmp_path / "spoiled.g2o"
    write(graph, str(path))
    optimizer = peer(g2o, path)
    for edge in optimizer.edges():
        edge.set_robust_kernel(getattr(g2o, f"RobustKernel{G2O[name]}")(4.0))
    optimizer.vertex(int(graph.variables["SE2"].ids.min())).set_fixed(True)
    optimizer.initialize_optimization()
    optimizer.optimize(200)
    optimizer.compute_active_errors()
    options = OptimizeOptions(
        method="gn", init="file", kernel=name, kernel_width=4.0, kernel_on="all", tolerance=1e-13, max_iterations=200
    )
    found = slamcli.optimize(slamcli.read(str(path)), options=options)
    assert found.status is Status.CONVERGED
    assert found.final_chi2 == pytest.approx(optimizer.active_robust_chi2(), rel=1e-9)
    assert found.plain_chi2 == pytest.approx(optimizer.active_chi2(), rel=1e-6)
    theirs = np.array([optimizer.vertex(int(i)).estimate().to_vector() for i in graph.variables["SE2"].ids])
    assert_allclose(found.graph.values["SE2"][:, :2], theirs[:, :2], rtol=0, atol=1e-5)


# -- in the linear system and in a run --------------------------------------------------------------------------------


@every_kernel
def test_gradient_is_half_the_slope_of_the_cost(name: str) -> None:
    graph, held = mixed_graph(1)
    options = OptimizeOptions(kernel=name, kernel_width=20.0, kernel_on="all")
    losses = kernels.losses(graph, options)
    problem = Problem(graph, held, options, Stopwatch(), losses)
    system = problem.linearize(graph.values)
    assert system.chi2 == pytest.approx(problem.chi2(graph.values), rel=1e-12)
    direction = np.random.default_rng(0).standard_normal(problem.pattern.dimension)
    h = 1e-6
    ahead, behind = (problem.chi2(problem.retract(graph.values, sign * h * direction)) for sign in (1.0, -1.0))
    scale = np.abs(system.gradient) @ np.abs(direction)
    assert 2.0 * system.gradient @ direction == pytest.approx((ahead - behind) / (2.0 * h), abs=1e-5 * scale)


def test_a_kernel_acts_on_loop_closures_or_on_all_edges() -> None:
    graph, false = spoiled("manhattan_small.g2o")
    plain = [len(factors) for factors in graph.factors]
    none = kernels.affected(graph, OptimizeOptions())
    assert [mask.sum() for mask in none] == [0, 0]
    assert kernels.losses(graph, OptimizeOptions()) is None
    closing = kernels.affected(graph, OptimizeOptions(kernel="huber"))
    assert closing[1].all()
    assert 0 < closing[0].sum() == plain[0] - (len(graph.variables["SE2"]) - 1)
    everything = kernels.affected(graph, OptimizeOptions(kernel="huber", kernel_on="all"))
    assert [mask.sum() for mask in everything] == plain
    assert len(false) == plain[1]


def test_the_width_is_that_of_the_largest_chi2_in_a_hundred_where_none_is_given() -> None:
    """11.3449 and 16.8119 are the 99 % quantiles of chi2 with three and six degrees of freedom (any table)."""
    graph, _ = spoiled("manhattan_small.g2o")
    for name in KERNELS:
        options = OptimizeOptions(kernel=name)
        squared = name in ("geman-mcclure", "dcs")
        for dimension, quantile in ((3, 11.3449), (6, 16.8119)):
            expected = quantile if squared else np.sqrt(quantile)
            assert kernels.width(options, dimension) == pytest.approx(expected, rel=1e-5)
            assert kernels.width(replace(options, kernel_width=2.0), dimension) == 2.0
    found = slamcli.optimize(graph, kernel="dcs", kernel_on="all", max_iterations=1)
    assert found.kernel_widths == pytest.approx((11.3449,), rel=1e-5)
    assert slamcli.optimize(graph, max_iterations=1).kernel_widths == ()


def test_a_kernel_on_all_edges_leaves_the_priors_of_switches_alone() -> None:
    graph, _ = mixed_graph(0)
    masks = kernels.affected(graph, OptimizeOptions(kernel="huber", kernel_on="all"))
    for factors, mask in zip(graph.factors, masks, strict=True):
        assert mask.all() == (factors.kind is not models.SWITCH_PRIOR)
        assert mask.any() == mask.all()


def test_without_closures_a_kernel_changes_nothing() -> None:
    graph = bundled("landmarks_small.g2o")
    closing = kernels.affected(graph, OptimizeOptions(kernel="cauchy"))
    graph = replace(graph, factors=[f for f, mask in zip(graph.factors, closing, strict=True) if not mask.any()])
    plain, robust = (slamcli.optimize(graph, kernel=name) for name in ("none", "cauchy"))
    assert robust.kernel_edges == 0
    assert robust.final_chi2 == plain.final_chi2 == plain.plain_chi2


@pytest.mark.parametrize("name", ["cauchy", "geman-mcclure", "welsch", "tukey", "dcs", "saturated"])
def test_redescending_kernels_ignore_false_closures(name: str) -> None:
    graph, false = spoiled("manhattan_small.g2o")
    clean = slamcli.optimize(without(graph, false))
    start = graph.with_values(clean.graph.values)
    width = 30.0 if name in ("geman-mcclure", "dcs") else 5.0
    found = slamcli.optimize(start, method="lm", init="file", kernel=name, kernel_width=width, max_iterations=300)
    assert found.status is Status.CONVERGED
    weights = kernels.weights(found.graph, found.options)
    assert weights[1].max() < 0.05
    bent = slamcli.optimize(start, init="file", method="lm")
    truth, values = clean.graph.values["SE2"][:, :2], found.graph.values["SE2"][:, :2]
    assert apart(values, truth) < 0.1 * apart(bent.graph.values["SE2"][:, :2], truth)
    assert found.plain_chi2 > found.final_chi2


def test_a_minimum_under_dcs_is_one_of_its_weighted_squares() -> None:
    graph, _ = spoiled("manhattan_small.g2o")
    found = slamcli.optimize(graph, method="lm", init="file", kernel="dcs", tolerance=1e-13, max_iterations=500)
    weights = [Weights(weight) for weight in kernels.weights(found.graph, found.options)]
    held = {name: np.isin(column.ids, found.gauge.held) for name, column in graph.variables.items()}
    plain = Problem(graph, held, found.options, Stopwatch()).linearize(found.graph.values)
    weighted = Problem(graph, held, found.options, Stopwatch(), weights).linearize(found.graph.values)
    assert weighted.gradient_norm < 1e-5 * plain.gradient_norm


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"kernel": "hubert"}, "kernel 'hubert' does not exist"),
        ({"kernel_on": "none"}, "kernel_on 'none' does not exist"),
        ({"kernel_width": 0.0}, "kernel_width must be positive"),
        ({"kernel_width": 1e200}, "kernel_width must be positive, from 1e-100 to 1e100"),
        ({"kernel_width": float("nan")}, "kernel_width must be positive"),
    ],
)
def test_wrong_options_are_refused(wrong: dict[str, object], says: str) -> None:
    with pytest.raises(UsageError, match=says):
        OptimizeOptions(**wrong)  # type: ignore[arg-type]


def inlier_chi2(graph: FactorGraph, false: list[Array], values: Array) -> float:
    costs = graph.edge_chi2({**graph.values, "SE2": values})
    return float(sum(cost[~mask].sum() for cost, mask in zip(costs, false, strict=True)))


def test_false_closures_of_m3500_are_ignored() -> None:
    """100 false closures of 2054: least squares ends far off, dcs within 1 % of the optimum without them."""
    path = dataset("outliers/M3500_false100_random_seed1.g2o")
    graph = slamcli.read(str(path))
    false = outlier_masks(read_labels(str(path.with_suffix(".labels.txt"))), graph)
    plain = slamcli.optimize(graph, method="dogleg", init="file", max_iterations=50)
    robust = slamcli.optimize(graph, method="lm", init="file", kernel="dcs")
    best = 137.912951  # of M3500 itself
    assert inlier_chi2(graph, false, plain.graph.values["SE2"]) > 100.0 * best
    assert inlier_chi2(graph, false, robust.graph.values["SE2"]) < 1.01 * best
