"""Pairwise consistency: distances of cycles by hand and by Monte Carlo, largest sets against brute force."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from loop_worlds import moved, reordered, world

from slamcli.geometry import se2
from slamcli.graph import FactorGraph, Factors, Variables
from slamcli.models import RELATIVE_POSE_2D, SE2
from slamcli.solver.robust import pcm
from slamcli.solver.robust.cliques import consistent_set, greedy, largest
from slamcli.solver.robust.closures import Closures
from slamcli.solver.robust.consistency import Cycles


def _graph(steps, closures, information=1.0):
    """A chain of 2-D steps (n, 3), and closures (i, j, z)."""
    count = len(steps) + 1
    zeros = np.zeros(count, dtype=np.intp)
    column = Variables(SE2, np.arange(count), np.zeros((count, 3)), zeros > 0, zeros == 0, zeros)
    pairs = [(k, k + 1) for k in range(len(steps))] + [(i, j) for i, j, _ in closures]
    z = np.array([*steps, *(z for _, _, z in closures)], dtype=np.float64)
    omega = np.tile(np.eye(3) * information, (len(z), 1, 1))
    return FactorGraph({"SE2": column}, [Factors(RELATIVE_POSE_2D, np.array(pairs), z, omega)])


def test_two_closures_on_a_line_by_hand():
    """Along x, without turns: x noise adds up to 2 closures + 1 step there + 1 step back = 4 variances of 1."""
    steps = [(0.0, 0.0, 0.0)] * 9
    cycles = Cycles.of(Closures.of(_graph(steps, [(0, 8, (0.0, 0.0, 0.0)), (1, 9, (3.0, 0.0, 0.0))])))
    assert cycles.pairs(np.array([0]), np.array([1]))[0] == pytest.approx(9.0 / 4.0)


def test_a_closure_alone_by_hand():
    """Eight steps and the closure: nine variances of 1 along x."""
    cycles = Cycles.of(Closures.of(_graph([(0.0, 0.0, 0.0)] * 8, [(0, 8, (3.0, 0.0, 0.0))])))
    assert cycles.alone()[0] == pytest.approx(1.0)


def test_stretches_that_overlap_are_correlated():
    """Closures 0 to 4 and 2 to 6 share the steps 2 to 4, whose noise cancels: 2 + 2 + 2 variances less 2 times 2."""
    steps = [(0.0, 0.0, 0.0)] * 7
    first, second = (0, 4, (0.0, 0.0, 0.0)), (2, 6, (2.0, 0.0, 0.0))
    cycles = Cycles.of(Closures.of(_graph(steps, [first, second])))
    apart = cycles.pairs(np.array([0]), np.array([1]))[0]
    # delta_0 - delta_2 = -(s0 + s1), delta_6 - delta_4 = s4 + s5: disjoint, 4 steps and 2 closures
    assert apart == pytest.approx(4.0 / 6.0)
    far = Cycles.of(Closures.of(_graph(steps, [(0, 3, (0.0, 0.0, 0.0)), (5, 7, (2.0, 0.0, 0.0))])))
    # -(s0 ... s4) + (s3 ... s6): s3 and s4 cancel, which leaves 5 steps and 2 closures
    assert far.pairs(np.array([0]), np.array([1]))[0] == pytest.approx(4.0 / 7.0)


def _line(false):
    """A chain along x with four true closures and, if wanted, a false one."""
    true = [(i, i + 5, (5.0, 0.0, 0.0)) for i in range(4)]
    return _graph([(1.0, 0.0, 0.0)] * 9, true + [(0, 9, (0.0, 0.0, 0.0))] * false, information=100.0)


@pytest.mark.parametrize("silent", [[9, 10], range(9, 13), [2]], ids=["some closures", "all closures", "a step"])
def test_edges_without_information_contradict_nothing(silent):
    graph = _line(false=silent == [2])
    graph.factors[0].information[silent] = 0.0
    found = pcm.consistent(Closures.of(graph), 0.9999)
    assert found.keep[:4].all()
    assert np.isfinite(found.scale)


def test_of_parallel_steps_the_most_informative_counts():
    graph = _line(false=True)
    edges = graph.factors[0]
    wrong = replace(edges.part(np.array([3])), information=np.eye(3)[None], measurements=np.array([[7.0, 0.0, 0.0]]))
    both = Factors(
        edges.kind,
        *(np.concatenate([getattr(f, name) for f in (edges, wrong)]) for name in ("indices", "measurements")),
        np.concatenate([edges.information, wrong.information]),
    )
    order = np.roll(np.arange(len(both)), 1)
    found = [Cycles.of(Closures.of(replace(graph, factors=[both.part(rows)]))) for rows in (slice(None), order)]
    alone = [np.sort(cycles.alone()) for cycles in found]
    np.testing.assert_allclose(alone[0], alone[1], atol=1e-12)
    np.testing.assert_allclose(alone[0], np.sort(Cycles.of(Closures.of(graph)).alone()), atol=1e-12)


def test_the_distance_is_chi_square_distributed():
    rng = np.random.default_rng(0)
    sigma, steps = 0.01, np.array([(1.0, 0.0, 0.1)] * 30)
    truth = se2.chain(np.zeros(3), steps)
    closures = np.array([(2, 20), (6, 28)])
    wanted = se2.compose(se2.inverse(truth[closures[:, 0]]), truth[closures[:, 1]])
    found = []
    for _ in range(400):
        noisy = se2.retract(steps, sigma * rng.normal(size=steps.shape))
        z = se2.retract(wanted, sigma * rng.normal(size=(2, 3)))
        graph = _graph(noisy, [(i, j, m) for (i, j), m in zip(closures, z, strict=True)], 1.0 / sigma**2)
        found.append(Cycles.of(Closures.of(graph)).pairs(np.array([0]), np.array([1]))[0])
    assert np.mean(found) == pytest.approx(3.0, abs=0.4)  # standard deviation of the mean: sqrt(6 / 400) = 0.12
    assert np.var(found) == pytest.approx(6.0, rel=0.35)


@pytest.mark.parametrize("spatial", [False, True])
def test_distances_do_not_depend_on_the_direction_of_edges(spatial):
    w = world(1, spatial=spatial, false=5)
    factors = w.graph.factors[0]
    kind, group = next(iter(w.graph.variables.values())).kind, Cycles.of(Closures.of(w.graph))
    adjoint = pytest.importorskip("slamcli.geometry.se3" if spatial else "slamcli.geometry.se2").adjoint
    frame = adjoint(factors.measurements)
    scale = np.repeat([1.0, 2.0], 3) if spatial else np.ones(3)
    covariance = scale[:, None] * np.linalg.inv(factors.information) * scale
    turned = frame @ covariance @ frame.transpose(0, 2, 1)
    information = np.linalg.inv(turned / scale[:, None] / scale)
    back = replace(
        factors,
        indices=factors.indices[:, ::-1],
        measurements=kind.inverse(factors.measurements),
        information=0.5 * (information + information.transpose(0, 2, 1)),
    )
    other = Cycles.of(Closures.of(replace(w.graph, factors=[back])))
    a, b = (np.array(rows) for rows in zip(*combinations(range(12), 2), strict=True))
    np.testing.assert_allclose(other.pairs(a, b), group.pairs(a, b), rtol=1e-6)
    np.testing.assert_allclose(other.alone(), group.alone(), rtol=1e-6)


def test_where_odometry_is_broken_nothing_contradicts():
    graph = _graph([(0.0, 0.0, 0.0)] * 9, [(0, 8, (0.0, 0.0, 0.0)), (1, 9, (99.0, 0.0, 0.0))])
    cut = replace(graph, factors=[graph.factors[0].part(np.setdiff1d(np.arange(11), [0]))])
    cycles = Cycles.of(Closures.of(cut))
    assert cycles.pairs(np.array([0]), np.array([1]))[0] == 0.0


def _brute_force(count, pairs):
    for size in range(count, -1, -1):
        for chosen in combinations(range(count), size):
            if not any(a in chosen and b in chosen for a, b in pairs):
                return size
    return 0


@pytest.mark.parametrize("seed", range(12))
def test_the_largest_set_is_that_of_brute_force(seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 10))
    pairs = [pair for pair in combinations(range(count), 2) if rng.random() < rng.choice([0.2, 0.5, 0.8])]
    first, second = np.array(pairs, dtype=np.intp).reshape(-1, 2).T
    expected = _brute_force(count, pairs)
    for found in (largest(count, first, second), consistent_set(count, first, second)):
        assert found.sum() == expected
        assert not (found[first] & found[second]).any()


def test_the_greedy_set_is_consistent_and_cannot_grow():
    rng = np.random.default_rng(1)
    first, second = rng.integers(0, 200, (2, 1500))
    first, second = first[first != second], second[first != second]
    keep = greedy(200, first, second)
    assert not (keep[first] & keep[second]).any()
    conflicts = np.zeros(200, dtype=bool)
    conflicts[first[keep[second]]] = conflicts[second[keep[first]]] = True
    assert (keep | conflicts).all()


def test_a_run_of_false_closures_that_agree_with_each_other_is_outnumbered():
    w = world(2, laps=4, false=0)
    factors = w.graph.factors[0]
    run = np.stack([np.arange(3, 6), np.arange(20, 23)], axis=1)  # along two sides, as if they were one
    claims = np.tile([0.0, 0.0, 0.0], (3, 1))
    joined = replace(
        factors,
        indices=np.concatenate([factors.indices, run]),
        measurements=np.concatenate([factors.measurements, claims]),
        information=np.concatenate([factors.information, factors.information[:3]]),
        lines=np.zeros(len(factors) + 3, dtype=np.intp),
    )
    chosen = pcm.consistent(Closures.of(replace(w.graph, factors=[joined])), 0.9999)
    np.testing.assert_array_equal(chosen.keep, np.arange(len(chosen.keep)) < len(chosen.keep) - 3)


def test_the_set_does_not_depend_on_order_or_guess():
    w = world(3, false=15)
    expected = pcm.consistent(Closures.of(w.graph), 0.9999)
    order = np.random.default_rng(1).permutation(w.graph.edges)
    shuffled = reordered(w.graph, order)
    mask = Closures.of(w.graph).masks[0]
    kept = np.zeros(w.graph.edges, dtype=bool)
    kept[mask] = expected.keep
    np.testing.assert_array_equal(pcm.consistent(Closures.of(shuffled), 0.9999).keep, kept[order][mask[order]])
    away = moved(w.graph, np.array([5.0, 5.0, 1.0]))
    np.testing.assert_array_equal(pcm.consistent(Closures.of(away), 0.9999).keep, expected.keep)
