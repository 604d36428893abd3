"""The certificate matrix and what it proves, on graphs small enough for dense algebra and for numbers by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from certificate_graphs import SPACES, dense_connection, moved_rigidly, noisy, reduced, ring
from graphs import bundled, dense, exact_graph, variables
from numpy.testing import assert_allclose

import slamcli
from slamcli import models
from slamcli.graph import FactorGraph, Factors
from slamcli.solver.certificate import CertificateStatus, isotropic
from slamcli.solver.certificate.certify import certify
from slamcli.solver.certificate.connection import Connection, matrices, poses, state
from slamcli.solver.certificate.dual import CertificateMatrix, Multipliers, smallest_eigenpair
from slamcli.solver.result import Status

each_space = pytest.mark.parametrize("space", [2, 3], ids=["plane", "space"])


def by_definition(graph: FactorGraph) -> float:
    """SE-Sync's objective as it is written, with the precisions by explicit inverses."""
    total = 0.0
    for factors in graph.factors:
        kind = factors.kind.variables[0]
        d, x = kind.space, matrices(kind, graph.variables[kind.name].values)
        for (i, j), z, omega in zip(factors.indices, factors.measurements, factors.information, strict=True):
            edge = matrices(kind, z[None])[0]
            tau = d / np.trace(np.linalg.inv(omega[:d, :d]))
            kappa = omega[2, 2] if d == 2 else 3.0 / (2.0 * np.trace(np.linalg.inv(omega[3:, 3:])))
            rotation = x[j, :, :d] - x[i, :, :d] @ edge[:, :d]
            translation = x[j, :, d] - x[i, :, d] - x[i, :, :d] @ edge[:, d]
            total += kappa * np.square(rotation).sum() + tau * np.square(translation).sum()
    return total


@each_space
def test_transformed_chi2_is_the_objective(space: int) -> None:
    for seed in range(3):
        graph = noisy(space, seed=seed, noise=1.0)
        transformed = isotropic.transform(graph)
        assert transformed.chi2() == pytest.approx(by_definition(graph), rel=1e-12)
        connection = Connection(transformed)
        x = state(connection, graph.values)
        assert connection.cost(x) == pytest.approx(by_definition(graph), rel=1e-12)
        assert_allclose(poses(connection.kind, x)[:, :space], x[:, :, space])
        assert_allclose(matrices(connection.kind, poses(connection.kind, x)), x, atol=1e-12)


@each_space
def test_certificate_matrix_is_that_of_the_definition(space: int) -> None:
    graph = isotropic.transform(noisy(space))
    connection = Connection(graph)
    matrix, expected = CertificateMatrix(connection), dense_connection(connection)
    x = state(connection, graph.values)
    flat = x.transpose(1, 0, 2).reshape(space, -1)
    assert np.trace(flat @ expected @ flat.T) == pytest.approx(connection.cost(x), rel=1e-12)
    product = connection.product(x).transpose(1, 0, 2).reshape(space, -1)
    assert_allclose(product, flat @ expected, atol=1e-9 * np.abs(expected).max())
    pinned = connection.pins * (space + 1) + space
    expected[pinned, :] = expected[:, pinned] = 0.0
    found = dense(matrix.pattern, matrix.values)
    found[pinned, pinned] = 0.0
    assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())


@each_space
def test_critical_point(space: int) -> None:
    """X S = 0, the dual value is the cost, and Q - Lambda has the rows of the rotations as null vectors."""
    certificate = certify(noisy(space))
    assert certificate.graph is not None
    connection = Connection(certificate.graph)
    x = state(connection, certificate.graph.values)
    multipliers = Multipliers.of(connection, x)
    assert np.abs(multipliers.residual).max() < 1e-6 * certificate.scale
    assert multipliers.trace == pytest.approx(certificate.cost, rel=1e-8)
    spectrum = np.linalg.eigvalsh(reduced(connection, multipliers.blocks))
    assert_allclose(spectrum[:space], 0.0, atol=1e-8 * certificate.scale)
    assert certificate.certified
    assert certificate.next_eigenvalue == pytest.approx(spectrum[space], rel=1e-4)
    assert spectrum[space] > 1e-4 * certificate.scale


@each_space
def test_smallest_eigenvalue_of_an_uncertified_point(space: int) -> None:
    """At any point Lanczos finds the least eigenvalue of Q - Lambda, with its vector."""
    graph = isotropic.transform(noisy(space, noise=1.0))
    connection = Connection(graph)
    multipliers = Multipliers.of(connection, state(connection, graph.values))
    whole = reduced(connection, multipliers.blocks)
    spectrum = np.linalg.eigvalsh(whole)
    assert spectrum[0] < 0.0
    matrix = CertificateMatrix(connection)
    assert not matrix.factorize(multipliers.blocks, -0.9 * spectrum[0])
    assert matrix.factorize(multipliers.blocks, -1.5 * spectrum[0])
    found = smallest_eigenpair(matrix)
    assert found.value == pytest.approx(spectrum[0], rel=1e-5)
    vector = found.vector[:, :space].ravel()
    assert_allclose(whole @ vector, spectrum[0] * vector, atol=1e-2 * abs(spectrum[0]))
    assert np.linalg.norm(vector) == pytest.approx(1.0)


@each_space
def test_nothing_is_below_the_lower_bound(space: int) -> None:
    graph = noisy(space, noise=0.15)
    certificate = certify(graph)
    assert certificate.certified and certificate.graph is not None
    assert 0.0 <= certificate.suboptimality <= 1e-5 * certificate.cost
    rng = np.random.default_rng(0)
    kind = SPACES[space][0]
    least = certificate.graph.values[kind.name]
    for size in (1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0) * 5:
        values = {kind.name: kind.retract(least, size * rng.standard_normal((len(least), kind.dimension)) / 3.0)}
        assert certificate.graph.chi2(values) >= certificate.lower_bound
    for init in ("file", "odometry", "spanning-tree"):
        other = slamcli.optimize(certificate.graph, init=init, method="lm")
        assert other.final_chi2 >= certificate.lower_bound


@each_space
def test_certificates_do_not_depend_on_the_frame(space: int) -> None:
    graph = noisy(space)
    first, second = certify(graph), certify(moved_rigidly(graph))
    other = certify(graph.with_fixed([7]))
    for certificate in (second, other):
        assert certificate.certified
        assert certificate.cost == pytest.approx(first.cost, rel=1e-9)
        assert certificate.next_eigenvalue == pytest.approx(first.next_eigenvalue, rel=1e-5)
        assert abs(certificate.smallest_eigenvalue or 0.0) < 1e-8 * first.scale


@each_space
def test_two_poses(space: int) -> None:
    """Q = kappa [[I, -Z], [-Z^T, I]]: eigenvalues 0 and 2 kappa, each d times; translations cost nothing."""
    kind, relative = SPACES[space]
    kappa, tau = 3.0, 5.0
    weights = np.diag([tau] * space + [kappa if space == 2 else 2.0 * kappa] * (kind.dimension - space))
    truth = kind.normalize(np.random.default_rng(1).standard_normal((2, kind.size)))
    measured = kind.compose(kind.inverse(truth[:1]), truth[1:])
    factors = Factors(relative, np.array([[0, 1]]), measured, weights[None], tag="EDGE")
    certificate = certify(FactorGraph({kind.name: variables(kind, [4, 9], truth)}, [factors]))
    assert certificate.certified
    assert certificate.cost == pytest.approx(0.0, abs=1e-25)
    assert certificate.smallest_eigenvalue == pytest.approx(0.0, abs=1e-10)
    assert certificate.next_eigenvalue == pytest.approx(2.0 * kappa, rel=1e-6)


def test_three_poses_around_a_triangle() -> None:
    """Headings measured to rise by 0.9 on a closed triangle: each edge is off by 0.3, cost 3 kappa 4 (1 - cos 0.3)."""
    graph = ring(3, kappa=2.0)
    (factors,) = graph.factors
    measured = factors.measurements.copy()
    measured[:, 2] = 0.3
    certificate = certify(replace(graph, factors=[replace(factors, measurements=measured)]))
    assert certificate.certified
    assert certificate.cost == pytest.approx(3 * 2.0 * 4.0 * (1.0 - np.cos(0.3)), rel=1e-9)
    # Q - Lambda = 2 kappa (cos a - cos(2 pi k / 3 + a)) for k = 0, 1, 2
    waves = [2.0 * 2.0 * (np.cos(0.3) - np.cos(2.0 * np.pi * k / 3.0 + 0.3)) for k in (1, 2)]
    assert certificate.next_eigenvalue == pytest.approx(min(waves), rel=1e-5)


@pytest.mark.parametrize("count", [9, 20, 50])
def test_wound_up_ring_is_not_certified(count: int) -> None:
    """Every edge is off by a = 2 pi / n: a local minimum; cost and eigenvalue are known."""
    kappa, angle = 2.5, 2.0 * np.pi / count
    graph = ring(count, turns=1, kappa=kappa)
    certificate = certify(graph, restarts=())
    assert certificate.status is CertificateStatus.NOT_CERTIFIED
    cost = 4.0 * kappa * count * (1.0 - np.cos(angle))
    assert certificate.cost == pytest.approx(cost, rel=1e-9)
    assert certificate.smallest_eigenvalue == pytest.approx(2.0 * kappa * (np.cos(angle) - 1.0), rel=1e-5)
    assert certificate.lower_bound == pytest.approx(0.0, abs=1e-2 * cost)
    (escape,) = certificate.escapes
    assert escape.rank == 2 and len(escape.movers) == 3 and escape.error < 1e-4 * abs(escape.eigenvalue)


@pytest.mark.parametrize("restart", ["chordal", "staircase"])
@pytest.mark.parametrize("turns", [1, 2])
def test_wound_up_ring_is_left(restart: str, turns: int) -> None:
    graph = ring(24, turns=turns, noise=0.02)
    stuck = certify(graph, restarts=())
    found = certify(graph, restarts=(restart,))
    assert not stuck.certified and stuck.escapes
    assert found.certified and found.escapes[0].cost == pytest.approx(stuck.cost)
    assert found.cost < 1e-2 * stuck.cost
    assert found.polished_cost == pytest.approx(stuck.cost)
    best = certify(graph.with_values(slamcli.optimize(graph, init="chordal").graph.values))
    assert best.certified and not best.escapes
    assert found.cost == pytest.approx(best.cost, rel=1e-8)
    assert stuck.lower_bound <= best.cost
    held = graph.variables["SE2"].values[0]
    assert found.graph is not None
    assert_allclose(found.graph.variables["SE2"].values[0], held, atol=1e-12)  # the gauge is kept


def test_staircase_in_space() -> None:
    """Poses around a ring in space, wound up about one axis."""
    planar = ring(16, turns=1)
    heading = planar.variables["SE2"].values[:, 2]
    values = np.zeros((16, 7))
    values[:, 5], values[:, 6] = np.sin(heading / 2), np.cos(heading / 2)
    measured = np.tile([0.0, 0, 0, 0, 0, 0, 1], (16, 1))
    weights = np.tile(np.eye(6), (16, 1, 1))
    factors = Factors(models.RELATIVE_POSE_3D, planar.factors[0].indices, measured, weights, tag="EDGE")
    graph = FactorGraph({"SE3": variables(models.SE3, range(16), values)}, [factors])
    # in space that is a saddle, at which the gradient vanishes
    stuck = certify(graph, restarts=())
    assert not stuck.certified
    found = certify(graph, restarts=("staircase",))
    assert found.certified
    assert found.cost == pytest.approx(0.0, abs=1e-12)


def test_components_are_certified_together() -> None:
    first, second = noisy(2, seed=1), noisy(2, seed=2)
    shifted = replace(second.factors[0], indices=second.factors[0].indices + 12)
    values = np.concatenate([first.variables["SE2"].values, second.variables["SE2"].values])
    both = FactorGraph({"SE2": variables(models.SE2, range(24), values)}, [first.factors[0], shifted])
    one, two, whole = certify(first), certify(second), certify(both)
    assert whole.certified
    assert whole.cost == pytest.approx(one.cost + two.cost, rel=1e-9)
    assert whole.next_eigenvalue == pytest.approx(min(one.next_eigenvalue or 0, two.next_eigenvalue or 0), rel=1e-5)


def test_isolated_poses_and_edges_to_themselves() -> None:
    """A pose without edges, an edge from a pose to itself (a constant) and a noise-free graph are no obstacle."""
    graph = exact_graph(*SPACES[2], 10, 4)
    column = graph.variables["SE2"].followed_by(variables(models.SE2, [77], np.array([1.0, 2.0, 3.0])))
    (factors,) = graph.factors
    own = replace(factors.part(slice(0, 1)), indices=np.array([[3, 3]]))
    certificate = certify(FactorGraph({"SE2": column}, [factors, own]))
    constant = isotropic.transform(FactorGraph({"SE2": column}, [own])).chi2()
    assert certificate.certified and constant > 0.1
    assert certificate.cost == pytest.approx(constant, rel=1e-9)
    assert certificate.suboptimality < 1e-6 * constant + 1e-9


def test_bound_too_loose_is_no_certificate() -> None:
    """One edge a trillion times stiffer than the others: rounding beside it hides what the others say."""
    graph = ring(12, turns=1)
    (factors,) = graph.factors
    weights = factors.information.copy()
    weights[0] *= 1e13
    certificate = certify(replace(graph, factors=[replace(factors, information=weights)]), restarts=())
    assert not certificate.certified


@pytest.mark.parametrize("name", ["manhattan_small.g2o", "sphere_small.g2o"])
def test_bundled_sets_are_certified(name: str) -> None:
    graph = bundled(name)
    result = slamcli.optimize(isotropic.transform(graph), init="chordal")
    certificate = certify(graph.with_values(result.graph.values), minimized=result, restarts=())
    assert result.status is Status.CONVERGED and certificate.certified
    assert certificate.cost == pytest.approx(result.final_chi2, rel=1e-8)
    assert certificate.relative_suboptimality < 2e-6
    assert certificate.relative_eta < 1e-8


def test_inapplicable() -> None:
    landmarks = certify(bundled("landmarks_small.g2o"))
    assert landmarks.status is CertificateStatus.INAPPLICABLE
    assert "EDGE_SE2_XY" in landmarks.reason
    fixed = certify(ring(5).with_fixed([0, 1]))
    assert fixed.status is CertificateStatus.INAPPLICABLE and "fixed" in fixed.reason
    graph = ring(5)
    (factors,) = graph.factors
    spoiled = factors.information.copy()
    spoiled[2] = np.diag([1.0, 1.0, -1.0])
    refused = certify(replace(graph, factors=[replace(factors, information=spoiled)]))
    assert refused.status is CertificateStatus.INAPPLICABLE and "EDGE_SE2 2 3" in refused.reason
