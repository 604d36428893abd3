"""Factors that are linearized sorted by their camera, against the general way."""

from dataclasses import replace

import numpy as np
import pytest
from bundle_scenes import perturbed, ring
from numpy.testing import assert_allclose

from slamcli.graph import FactorGraph
from slamcli.solver import gauge, grouped_batches
from slamcli.solver.linear_system import Linearizer, LinearSystem
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.robust import kernels
from slamcli.solver.stopwatch import Stopwatch


def flipped(graph: FactorGraph) -> FactorGraph:
    """The same with the points' column before the cameras', so that blocks are stored the other way round."""
    return replace(graph, variables=dict(reversed(graph.variables.items())))


def held_in_part(graph: FactorGraph) -> FactorGraph:
    return graph.with_fixed([1, 7, 8, 20])


def weighted(graph: FactorGraph) -> FactorGraph:
    weights = np.random.default_rng(0).uniform(0.0, 3.0, graph.edges)
    return replace(graph, factors=[replace(graph.factors[0], information=weights[:, None, None] * np.eye(2))])


def twice(graph: FactorGraph) -> FactorGraph:
    """Every observation twice, the second time elsewhere."""
    one = graph.factors[0]
    two = replace(
        one,
        indices=np.tile(one.indices, (2, 1)),
        measurements=np.concatenate([one.measurements, one.measurements + 1.0]),
        information=np.tile(np.eye(2), (2 * len(one), 1, 1)),
        lines=np.zeros(2 * len(one), dtype=np.intp),
    )
    return replace(graph, factors=[two])


VARIANTS = {f.__name__: f for f in (lambda graph: graph, flipped, held_in_part, weighted, twice)}


def systems(graph: FactorGraph, kernel: str, monkeypatch: pytest.MonkeyPatch) -> list[tuple[LinearSystem, float]]:
    options = OptimizeOptions(kernel=kernel, kernel_on="all")
    _, held = gauge.choose(graph)
    out = []
    for pays in (1, 10**9):
        monkeypatch.setattr(grouped_batches, "_PAYS", pays)
        assert grouped_batches.suits(graph.factors[0]) == (pays == 1)
        linearizer = Linearizer(graph, held, Stopwatch(), kernels.losses(graph, options))
        out.append((linearizer.linearize(graph.values), linearizer.chi2(graph.values)))
    return out


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("kernel", ["none", "huber"])
@pytest.mark.parametrize("batch", [64, 4096])
def test_the_linear_system_is_the_same(variant: str, kernel: str, batch: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(grouped_batches, "_BATCH", batch)
    graph = VARIANTS[variant](perturbed(ring(cameras=4, points=60)))
    (one, chi2), (two, other) = systems(graph, kernel, monkeypatch)
    assert chi2 == pytest.approx(other, rel=1e-12)
    assert one.chi2 == pytest.approx(two.chi2, rel=1e-12)
    assert_allclose(one.hessian, two.hessian, rtol=0, atol=1e-12 * np.abs(two.hessian).max())
    assert_allclose(one.gradient, two.gradient, rtol=0, atol=1e-12 * np.abs(two.gradient).max())


def test_factors_with_full_information_are_not_grouped() -> None:
    factors = perturbed(ring(cameras=2, points=80)).factors[0]
    assert grouped_batches.suits(factors)
    full = np.tile(np.array([[2.0, 0.5], [0.5, 1.0]]), (len(factors), 1, 1))
    assert not grouped_batches.suits(replace(factors, information=full))
