"""Graduated non-convexity: weights, quantiles, exact recovery on labelled worlds, invariances, GTSAM."""

from dataclasses import replace

import numpy as np
import pytest
from loop_worlds import moved, renumbered, reordered, world
from scipy.stats import chi2 as chi2_distribution

from slamcli.errors import UsageError
from slamcli.solver.optimize import optimize
from slamcli.solver.robust.gnc import first_mu_gm, first_mu_tls, gm_weights, tls_weights
from slamcli.solver.robust.quantile import chi2_quantile

METHODS = ["gnc", "pcm", "pcm+gnc"]


@pytest.mark.parametrize("dof", [1, 2, 3, 6, 7])
@pytest.mark.parametrize("probability", [0.001, 0.25, 0.5, 0.99, 0.9999, 1.0 - 1e-9])
def test_quantiles_are_those_of_scipy(dof, probability):
    assert chi2_quantile(dof, probability) == pytest.approx(chi2_distribution.ppf(probability, dof), rel=1e-8)


@pytest.mark.parametrize("probability", [0.0, 1.0, -1.0, float("nan")])
def test_quantile_refuses_what_is_no_probability(probability):
    with pytest.raises(UsageError, match="between 0 and 1"):
        chi2_quantile(3, probability)


def test_tls_weights_at_the_ends_of_their_range():
    gate, mu = 4.0, 0.5
    squared = np.array([0.0, gate * mu / (mu + 1.0), gate, gate * (mu + 1.0) / mu, 1e300])
    # in between sqrt(c2 mu (mu + 1) / s) - mu, at s = c2: sqrt(0.75) - 0.5
    expected = [1.0, 1.0, np.sqrt(0.75) - 0.5, 0.0, 0.0]
    np.testing.assert_allclose(tls_weights(squared, np.full(5, gate), mu), expected, atol=1e-12)


def test_tls_weights_end_at_the_gate():
    np.testing.assert_array_equal(tls_weights(np.array([0.0, 4.0, 4.1]), np.full(3, 4.0), np.inf), [1.0, 1.0, 0.0])


def test_gm_weights_are_one_for_large_mu_and_a_quarter_at_the_gate():
    squared, gate = np.array([0.0, 4.0, 9.0]), np.full(3, 4.0)
    np.testing.assert_allclose(gm_weights(squared, gate, 1e12), 1.0, rtol=1e-10)
    assert gm_weights(squared, gate, 1.0)[1] == pytest.approx(0.25)


def test_the_first_mu_leaves_nobody_out():
    squared, gate = np.array([1.0, 50.0]), np.full(2, 4.0)
    mu = first_mu_tls(squared, gate)
    assert mu == pytest.approx(1.0 / (2.0 * 12.5 - 1.0))
    assert tls_weights(squared, gate, mu).min() > 0.0
    assert first_mu_tls(np.array([1.0]), np.array([4.0])) == np.inf
    assert first_mu_gm(squared, gate) == pytest.approx(25.0)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("spatial", [False, True], ids=["plane", "space"])
@pytest.mark.parametrize("seed", [0, 1])
def test_exactly_the_false_closures_of_a_labelled_world_are_rejected(method, spatial, seed):
    w = world(seed, spatial=spatial)
    result = optimize(w.graph, robust=method)
    np.testing.assert_array_equal(result.rejection.rejected[0], w.false)
    clean = optimize(reordered(w.graph, np.flatnonzero(~w.false)))
    assert result.final_chi2 == pytest.approx(clean.final_chi2, rel=1e-7)
    assert result.rejection.inlier_chi2 == pytest.approx(clean.final_chi2, rel=1e-7)
    assert result.dof == result.rejection.inlier_dof == clean.dof
    assert result.plain_chi2 > 100.0 * clean.final_chi2  # the false ones, as they are


def test_geman_mcclure_rejects_the_false_closures_too():
    """Its first steps weigh all closures alike, and the map is bent before it can tell: it may lose true ones."""
    w = world(1)
    rejected = optimize(w.graph, robust="gnc-gm").rejection.rejected[0]
    assert rejected[w.false].all()
    assert (rejected & ~w.false).sum() <= 0.1 * (~w.false).sum()


@pytest.mark.parametrize("method", [*METHODS, "gnc-gm"])
def test_a_clean_world_loses_nothing(method):
    w = world(3, false=0)
    result = optimize(w.graph, robust=method)
    assert result.rejection.count == 0
    assert result.final_chi2 == pytest.approx(optimize(w.graph).final_chi2, rel=1e-9)


@pytest.mark.parametrize("method", ["gnc", "pcm+gnc"])
def test_the_outcome_does_not_depend_on_order_numbers_or_where_the_guess_lies(method):
    w = world(4, false=20)
    expected = optimize(w.graph, robust=method)
    order = np.random.default_rng(0).permutation(w.graph.edges)
    shuffled = optimize(reordered(w.graph, order), robust=method)
    np.testing.assert_array_equal(shuffled.rejection.rejected[0], expected.rejection.rejected[0][order])
    np.testing.assert_allclose(shuffled.graph.values["SE2"], expected.graph.values["SE2"], atol=1e-6)
    others = (renumbered(w.graph, 7, 100), moved(w.graph, np.array([30.0, -20.0, 2.0])))
    for other in others:
        result = optimize(other, robust=method)
        np.testing.assert_array_equal(result.rejection.rejected[0], expected.rejection.rejected[0])
        assert result.final_chi2 == pytest.approx(expected.final_chi2, rel=1e-7)


def test_the_noise_is_estimated():
    """Information a hundred times too small makes false closures look right; the noise that closures show does not."""
    w = world(5, false=20)
    loose = w.graph.factors[0].information / 100.0
    graph = replace(w.graph, factors=[replace(w.graph.factors[0], information=loose)])
    result = optimize(graph, robust="auto")
    np.testing.assert_array_equal(result.rejection.rejected[0], w.false)
    assert result.rejection.noise_scale == pytest.approx(0.1, rel=0.2)
    assert optimize(graph, robust="auto", noise_scale=0.1).rejection.noise_scale == pytest.approx(0.1)


def test_every_iteration_is_in_the_trace_and_seen():
    w = world(0)
    seen = []
    result = optimize(w.graph, robust="gnc", on_iteration=lambda start, chi2, record: seen.append(record))
    assert [r for r in seen if r is not None] == result.trace
    assert [r.iteration for r in result.trace] == list(range(1, len(result.trace) + 1))
    stages = [r.stage for r in result.trace]
    assert stages[0].startswith("gnc ")
    assert "set" in stages
    assert stages[-1] is None


def test_an_interrupted_run_has_a_result():
    w = world(0)
    result = optimize(w.graph, robust="gnc", interrupted=lambda: True)
    assert result.status.value == "interrupted"
    assert np.isfinite(result.final_chi2)


def test_robust_and_kernel_exclude_each_other():
    with pytest.raises(UsageError, match="two ways"):
        optimize(world(0).graph, robust="gnc", kernel="huber")


def test_a_graph_without_closures_is_optimized_as_it_is():
    w = world(0, laps=1, false=0)
    result = optimize(w.graph, robust="auto")
    assert result.rejection.closures == result.rejection.count == 0
    assert result.status.value == "converged"


def test_gtsam_keeps_the_same_closures_and_finds_the_same_poses():
    gtsam = pytest.importorskip("gtsam")
    if not hasattr(gtsam, "GncLMOptimizer"):
        pytest.skip("this gtsam has no GncLMOptimizer")
    w = world(6, laps=2, side=4, false=4)
    factors = w.graph.factors[0]
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for (i, j), z, omega in zip(factors.indices.tolist(), factors.measurements, factors.information, strict=True):
        noise = gtsam.noiseModel.Gaussian.Information(omega)
        graph.add(gtsam.BetweenFactorPose2(i, j, gtsam.Pose2(*z), noise))
    graph.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(*w.truth[0]), gtsam.noiseModel.Isotropic.Sigma(3, 1e-6)))
    for k, pose in enumerate(w.truth):
        values.insert(k, gtsam.Pose2(*pose))
    params = gtsam.GncLMParams()
    known = [k for k, (i, j) in enumerate(factors.indices.tolist()) if abs(i - j) == 1]
    params.setKnownInliers([*known, graph.size() - 1])
    optimizer = gtsam.GncLMOptimizer(graph, values, params)
    optimizer.setInlierCostThresholdsAtProbability(0.9999)
    estimate = optimizer.optimize()
    kept = np.asarray(optimizer.getWeights())[: len(factors)] > 0.5
    result = optimize(w.graph, robust="gnc", robust_probability=0.9999, noise_scale=1.0)
    np.testing.assert_array_equal(~result.rejection.rejected[0], kept)
    poses = np.array([[p.x(), p.y(), p.theta()] for p in map(estimate.atPose2, range(len(w.truth)))])
    # GTSAM's residual is a logarithm, g2o's is not: equal to first order in the noise
    np.testing.assert_allclose(result.graph.values["SE2"][:, :2], poses[:, :2], atol=5e-3)
