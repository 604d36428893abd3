"""False closures: how many, where, and that they contradict the truth but, where that is claimed, not each other."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import click
import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from support import BUNDLED, write_file

import slamcli
from slamcli import models
from slamcli.cli.inject import command
from slamcli.errors import InputError, UsageError
from slamcli.formats import render
from slamcli.geometry import se2
from slamcli.graph import FactorGraph, Factors, Variables
from slamcli.graph.topology import is_loop_closure
from slamcli.models.base import Array
from slamcli.simulation.injection import SCALES
from slamcli.simulation.odometry_chain import odometry_chain
from slamcli.simulation.outliers import AGREEMENT, GROUPED, POLICIES, FalseClosures, _noise, false_closures
from slamcli.simulation.reference import Reference, from_graph, from_truth
from slamcli.solver.optimize import optimize

WALKS = ("2-D", "3-D")
NAMES = ("manhattan_small.g2o", "sphere_small.g2o", "square_toro.graph")
policies = st.sampled_from(POLICIES)
seeds = st.integers(0, 2**32)
quick = settings(deadline=None, max_examples=12)


@cache
def known(name: str) -> tuple[FactorGraph, Reference]:
    """A graph and its reference: a bundled one, or a walk in the plane or in space."""
    graph = walk(int(name[0])) if name in WALKS else slamcli.read(str(BUNDLED / name))
    return graph, from_graph(graph)


def walk(space: int) -> FactorGraph:
    """Steps of 2 m with right-angled turns; one motif of 24 steps comes again and again."""
    rng = np.random.default_rng(space)
    kind = models.SE2 if space == 2 else models.SE3
    edge = models.RELATIVE_POSE_2D if space == 2 else models.RELATIVE_POSE_3D
    turns = rng.integers(0, 8, 30 * 16).reshape(16, 30)
    turns[:, :24] = turns[0, :24]
    half = np.sqrt(0.5)
    around = {0: (0.0, 0.0, half), 1: (0.0, 0.0, -half), 2: (0.0, half, 0.0), 3: (0.0, -half, 0.0)}
    steps = np.tile(np.array(kind.identity), (turns.size, 1))
    steps[:, 0] = 2.0
    for k, turn in enumerate(turns.ravel().tolist()):
        if space == 2 and turn < 4:
            steps[k, 2] = (-1.0) ** turn * 0.5 * np.pi
        elif turn < 4:
            steps[k, 3:] = (*around[turn], half)
    poses = [np.array([kind.identity])]
    for k in range(len(steps)):
        poses.append(kind.normalize(kind.compose(poses[-1], steps[k : k + 1])))
    values = np.concatenate(poses)
    n = len(values)
    chain = np.stack([np.arange(n - 1), np.arange(1, n)], axis=1)
    closures = np.stack([np.arange(0, n - 40, 7), np.arange(40, n, 7)], axis=1)
    pairs = np.concatenate([chain, closures])
    omega = np.diag([400.0] * space + [10_000.0] * (kind.dimension - space))
    measured = kind.compose(kind.inverse(values[pairs[:, 0]]), values[pairs[:, 1]])
    noise = rng.standard_normal((len(pairs), kind.dimension)) / np.sqrt(np.diag(omega))
    factors = Factors(edge, pairs, kind.retract(measured, noise), np.tile(omega, (len(pairs), 1, 1)))
    return FactorGraph({kind.name: column(kind, values)}, [factors])


def column(kind: models.VariableKind, values: Array) -> Variables:
    none = np.zeros(len(values), dtype=bool)
    return Variables(kind, np.arange(len(values)), values, none, ~none, np.zeros(len(values), dtype=np.intp))


def draw(name: str, count: int, policy: str, seed: int = 0, **options: object) -> FalseClosures:
    graph, reference = known(name)
    return false_closures(graph, count, policy, np.random.default_rng(seed), reference, **options)  # type: ignore[arg-type]


def numbers(graph: FactorGraph, drawn: FalseClosures) -> Array:
    """Numbers of the poses in the order of ids, the smaller one first."""
    return np.sort(odometry_chain(graph).number[drawn.factors.indices], axis=1)


def chain_graph(poses: Array, closures: Sequence[tuple[int, int]] = ()) -> FactorGraph:
    """Exact odometry along planar poses, and exact closures."""
    pairs = np.array([(k, k + 1) for k in range(len(poses) - 1)] + [*closures], dtype=np.intp).reshape(-1, 2)
    factors = Factors(
        kind=models.RELATIVE_POSE_2D,
        indices=pairs,
        measurements=se2.between(poses[pairs[:, 0]], poses[pairs[:, 1]]),
        information=np.tile(100.0 * np.eye(3), (len(pairs), 1, 1)),
    )
    return FactorGraph({"SE2": column(models.SE2, poses)}, [factors])


def line(count: int, step: float = 10.0) -> Array:
    return np.stack([step * np.arange(count), np.zeros(count), np.zeros(count)], axis=1)


def circle(count: int, laps: int, radius: float = 20.0) -> Array:
    turn = 2.0 * np.pi * np.arange(count * laps) / count
    return se2.normalize(np.stack([radius * np.sin(turn), -radius * np.cos(turn), turn], axis=1))


@pytest.mark.parametrize("name", WALKS)
@quick
@given(count=st.integers(1, 60), policy=policies, seed=seeds)
def test_every_policy_keeps_the_rules(name: str, count: int, policy: str, seed: int) -> None:
    graph, reference = known(name)
    drawn = draw(name, count, policy, seed)
    pairs = numbers(graph, drawn)
    assert len(drawn.factors) == len(drawn.run) == count
    assert (pairs[:, 1] - pairs[:, 0] >= 2).all()
    chain = odometry_chain(graph)
    there = {tuple(pair) for f in graph.factors for pair in np.sort(chain.number[f.indices], axis=1).tolist()}
    mine = [tuple(pair) for pair in pairs.tolist()]
    assert len(set(mine)) == count
    assert not there & set(mine)
    assert (drawn.factors.chi2(reference.values) > AGREEMENT[chain.factor_kind.dimension]).all()


@pytest.mark.parametrize("name", WALKS)
@pytest.mark.parametrize("policy", POLICIES)
def test_where_a_policy_puts_them(name: str, policy: str) -> None:
    graph, _ = known(name)
    drawn = draw(name, 100, policy, group_size=(5, 8))
    pairs = numbers(graph, drawn)
    apart = pairs[:, 1] - pairs[:, 0]
    if policy == "local":
        assert apart.max() <= 20
    if policy == "grouped":
        assert (apart <= 20).all()
    if policy in ("random", "random-grouped"):
        assert apart.max() > 100
    if policy == "aliased":
        assert apart.min() > 8  # stretches do not touch
    assert drawn.run.tolist() == sorted(drawn.run.tolist())
    sizes = np.bincount(drawn.run)
    if policy not in GROUPED:
        assert (sizes == 1).all()
        return
    assert ((sizes[:-1] >= 5) & (sizes[:-1] <= 8)).all()
    assert sizes[-1] <= 8
    inside = np.flatnonzero(np.diff(drawn.run) == 0)
    assert (pairs[inside + 1] == pairs[inside] + 1).all()


@pytest.mark.parametrize("policy", ["grouped", "random-grouped"])
def test_one_measurement_for_a_run(policy: str) -> None:
    drawn = draw("sphere_small.g2o", 60, policy)
    for run in range(drawn.run.max() + 1):
        assert len(np.unique(drawn.factors.measurements[drawn.run == run], axis=0)) == 1


@pytest.mark.parametrize(("name", "angles"), [("manhattan_small.g2o", 1), ("sphere_small.g2o", 3)])
def test_claims_are_vertigos(name: str, angles: int) -> None:
    """N(0, 0.3 m) and N(0, 10 deg); five standard errors of 600 draws."""
    graph, _ = known(name)
    kind = odometry_chain(graph).kind
    measured = draw(name, 600, "random").factors.measurements
    turn = measured[:, 2:3] if angles == 1 else 2.0 * measured[:, 3:6]
    for values, sigma in ((measured[:, : kind.space], 0.3), (turn, np.deg2rad(10.0))):
        assert values.std(axis=0) == pytest.approx(sigma, rel=5.0 / np.sqrt(2 * 600))
        assert values.mean(axis=0) == pytest.approx(0.0, abs=5.0 * sigma / np.sqrt(600))


@pytest.mark.parametrize("name", NAMES)
def test_nothing_tells_them_apart_by_their_information(name: str) -> None:
    """Each has the numbers of a true closure, in the notation of the file."""
    graph, _ = known(name)
    drawn = draw(name, 30, "random")
    whole = replace(graph, factors=[*graph.factors, drawn.factors])
    edges = [line.split() for line in render(whole).data.decode().splitlines() if line.startswith("EDGE")]
    size = drawn.factors.kind.dimension * (drawn.factors.kind.dimension + 1) // 2
    closures = np.concatenate([is_loop_closure(graph, f) for f in graph.factors])
    true = np.array([[float(x) for x in edge[-size:]] for edge, c in zip(edges, closures, strict=False) if c])
    false = np.array([[float(x) for x in edge[-size:]] for edge in edges[len(closures) :]])
    assert {edge[0] for edge in edges} == {edges[0][0]}
    nearest = np.abs(false[:, None] - true[None]).max(axis=2).min(axis=1)
    assert nearest.max() <= 1e-12 * np.abs(true).max()


def test_they_run_the_way_that_the_true_ones_run() -> None:
    graph, reference = known("manhattan_small.g2o")
    factors = graph.factors[0]
    closures = is_loop_closure(graph, factors)
    indices = np.where(closures[:, None], np.sort(factors.indices, axis=1)[:, ::-1], factors.indices)
    measurements = np.where(
        (closures & (factors.indices[:, 0] < factors.indices[:, 1]))[:, None],
        se2.inverse(factors.measurements),
        factors.measurements,
    )
    turned = replace(graph, factors=[replace(factors, indices=indices, measurements=measurements)])
    for policy in POLICIES:
        one = false_closures(graph, 20, policy, np.random.default_rng(1), reference).factors
        two = false_closures(turned, 20, policy, np.random.default_rng(1), reference).factors
        forward = odometry_chain(graph).number[one.indices]
        assert (forward[:, 0] < forward[:, 1]).all()
        np.testing.assert_array_equal(two.indices, one.indices[:, ::-1])
        np.testing.assert_allclose(se2.inverse(two.measurements), one.measurements, atol=1e-12)


@pytest.mark.parametrize("name", WALKS)
def test_aliased_closures_agree_with_each_other(name: str) -> None:
    """With stiff odometry a run's closures have the chi2 of their own noise, though each contradicts the truth."""
    graph, _ = known(name)
    chain = odometry_chain(graph)
    drawn = draw(name, 150, "aliased")
    chi2 = dof = 0.0
    for run in range(drawn.run.max() + 1):
        closures = drawn.factors.part(np.flatnonzero(drawn.run == run))
        ends = np.sort(chain.number[closures.indices], axis=1)
        stretches = [np.arange(ends[0, slot], ends[-1, slot] + 1) for slot in (0, 1)]
        steps = np.concatenate([stretch[:-1] for stretch in stretches])
        stiff = Factors(
            kind=closures.kind,
            indices=chain.rows[np.stack([steps, steps + 1], axis=1)],
            measurements=chain.steps[steps],
            information=np.tile(1e9 * np.eye(closures.kind.dimension), (len(steps), 1, 1)),
        )
        rows = chain.rows[np.concatenate(stretches)]
        new = np.full(len(chain), -1)
        new[rows] = np.arange(len(rows))
        small = column(chain.kind, graph.values[chain.kind.name][rows])
        both = [replace(f, indices=new[f.indices], lines=np.zeros(len(f), dtype=np.intp)) for f in (stiff, closures)]
        result = optimize(FactorGraph({chain.kind.name: small}, both), method="gn", init="spanning-tree")
        chi2 += result.final_chi2
        dof += closures.kind.dimension * (len(closures) - 1)
    assert chi2 / dof == pytest.approx(1.0, abs=5.0 * np.sqrt(2.0 / dof))


def test_aliased_stretches_are_alike_and_coincide_in_the_middle() -> None:
    drawn = draw("2-D", 150, "aliased")
    middle = [np.flatnonzero(drawn.run == run) for run in range(drawn.run.max())]  # without the last one, that is cut
    z = drawn.factors.measurements[[rows[len(rows) // 2] for rows in middle]]
    assert np.abs(z[:, :2]).max() < 5 * np.hypot(0.3, 0.05)
    assert z[:, 2].std() < 0.02  # the closures' own noise; that of the odometry up to there would be 0.04
    assert np.abs(drawn.factors.measurements[:, 2]).max() < np.deg2rad(60 + 5)


def test_revisits_are_no_aliasing() -> None:
    """On a circle all stretches are alike; that pose k + 40 is where pose k was is true, and never labelled false."""
    poses = circle(40, 3)
    graph = chain_graph(poses, [(0, 40)])
    drawn = false_closures(graph, 300, "aliased", np.random.default_rng(0), from_graph(graph))
    apart = np.diff(numbers(graph, drawn), axis=1)[:, 0]
    assert len(apart) == 300
    assert not (apart % 40 == 0).any()


def test_the_truth_decides_where_the_graph_does_not_know() -> None:
    """The same circle, with a guess that is a straight line and no closures."""
    poses = circle(40, 3)
    graph = chain_graph(poses)
    truth = from_truth(graph, chain_graph(poses))
    wrong = Reference({"SE2": line(120)}, {"SE2": np.ones(120, dtype=bool)}, "a line")
    for reference, revisits in ((truth, False), (wrong, True)):
        drawn = false_closures(graph, 600, "random", np.random.default_rng(0), reference)
        agrees = drawn.factors.chi2({"SE2": poses}) <= AGREEMENT[3]
        assert agrees.any() == revisits
    some = replace(truth, known={"SE2": np.arange(120) < 60})
    drawn = false_closures(graph, 300, "random", np.random.default_rng(0), some)
    assert drawn.factors.indices.max() < 60


def test_poses_are_matched_with_the_truth_by_id() -> None:
    graph = chain_graph(line(6))
    poses = graph.variables["SE2"]
    shuffled = replace(poses, ids=poses.ids[::-1].copy(), values=poses.values[::-1].copy())
    truth = FactorGraph(
        {
            "SE2": replace(
                shuffled, **{n: getattr(shuffled, n)[2:] for n in ("ids", "values", "fixed", "known", "lines")}
            )
        },
        [],
    )
    reference = from_truth(graph, truth)
    assert reference.known["SE2"].tolist() == [True] * 4 + [False] * 2
    np.testing.assert_array_equal(reference.values["SE2"][:4], poses.values[:4])
    with pytest.raises(InputError, match="none of the poses"):
        from_truth(graph, FactorGraph({"SE2": replace(poses, ids=poses.ids + 100)}, []))


def test_the_reference_of_a_graph() -> None:
    graph = chain_graph(circle(40, 2), [(0, 40)])
    assert from_graph(graph).source == "values of the graph"
    rng = np.random.default_rng(0)
    bad = graph.with_values({"SE2": graph.values["SE2"] + rng.normal(0.0, 0.5, (80, 3))})
    reference = from_graph(bad)
    assert (reference.source, reference.doubtful) == ("optimum of the graph", False)
    relative = se2.between(reference.values["SE2"][:1], reference.values["SE2"])
    np.testing.assert_allclose(relative, se2.between(graph.values["SE2"][:1], graph.values["SE2"]), atol=1e-6)
    factors = graph.factors[0]
    lie = replace(factors, measurements=factors.measurements + 3.0)
    assert from_graph(replace(graph, factors=[factors, lie])).doubtful


@pytest.mark.parametrize("policy", ["random", "local"])
def test_every_possible_pair_is_found(policy: str) -> None:
    """Five poses in a row: 1-3, 1-4, 1-5, 2-4, 2-5 and 3-5, of which one has an edge."""
    graph = chain_graph(line(5), [(1, 3)])
    reference = from_graph(graph)
    drawn = false_closures(graph, 5, policy, np.random.default_rng(3), reference)
    assert sorted(map(tuple, numbers(graph, drawn).tolist())) == [(0, 2), (0, 3), (0, 4), (1, 4), (2, 4)]
    with pytest.raises(UsageError, match="only 5 of 6 false closures of the policy"):
        false_closures(graph, 6, policy, np.random.default_rng(3), reference)


@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("poses", [1, 2, 3])
def test_graphs_that_are_too_small(policy: str, poses: int) -> None:
    graph = (
        chain_graph(line(poses))
        if poses > 1
        else replace(chain_graph(line(2)), variables=chain_graph(line(1)).variables)
    )
    if poses == 1:
        graph = replace(graph, factors=[replace(graph.factors[0], indices=np.zeros((1, 2), dtype=np.intp))])
    with pytest.raises(UsageError, match=r"only . of 5"):
        false_closures(graph, 5, policy, np.random.default_rng(0), from_graph(graph))


def test_runs_do_not_overlap() -> None:
    """In a graph so small that most of the runs that are drawn do."""
    graph = chain_graph(line(12))
    drawn = false_closures(graph, 30, "random-grouped", np.random.default_rng(0), from_graph(graph), group_size=(2, 3))
    assert len(np.unique(numbers(graph, drawn), axis=0)) == 30


def test_none_are_none() -> None:
    for policy in POLICIES:
        drawn = draw("manhattan_small.g2o", 0, policy)
        assert (len(drawn.factors), len(drawn.run)) == (0, 0)


def test_a_graph_without_relative_poses(tmp_path: Path) -> None:
    graph = slamcli.read(
        str(write_file(tmp_path, "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 0 0 0\nEDGE_PRIOR_SE2 0 0 0 0 1 0 0 1 0 1\n"))
    )
    with pytest.raises(InputError, match="no relative poses"):
        false_closures(graph, 1, "random", np.random.default_rng(0), from_graph(graph))
    points = slamcli.read(str(write_file(tmp_path, "VERTEX_XY 0 0 0\n")))
    with pytest.raises(InputError, match="no poses"):
        false_closures(points, 1, "random", np.random.default_rng(0), from_graph(points))


def test_information_of_ones_own() -> None:
    graph, reference = known("sphere_small.g2o")
    mine = np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]) * 100.0
    drawn = false_closures(graph, 7, "random", np.random.default_rng(0), reference, information=mine)
    assert (drawn.factors.information == mine).all()


@pytest.mark.parametrize("policy", POLICIES)
def test_plain_least_squares_fails_with_them(policy: str) -> None:
    """Else there would be nothing to be robust against."""
    graph, reference = known("2-D")
    clean = optimize(graph, max_iterations=30)
    factors = false_closures(graph, 50, policy, np.random.default_rng(0), reference).factors
    spoiled = optimize(replace(graph, factors=[*graph.factors, factors]), max_iterations=30)
    assert spoiled.final_chi2 / spoiled.dof > 5.0 * clean.final_chi2 / clean.dof


@given(st.integers(0, 2**32), st.integers(1, 6), st.integers(0, 2))
def test_noise_has_the_inverse_information_as_its_covariance(seed: int, dimension: int, absent: int) -> None:
    """M M^T = Omega^-1 for the linear map M that makes noise of standard normal numbers."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((dimension, dimension))
    omega = root @ root.T + 0.1 * np.eye(dimension)
    map_ = _noise(np.tile(omega, (dimension, 1, 1)), np.eye(dimension)).T
    np.testing.assert_allclose(map_ @ map_.T @ omega, np.eye(dimension), atol=1e-8)
    gone = min(absent, dimension - 1)
    omega[:gone], omega[:, :gone] = 0.0, 0.0
    map_ = _noise(np.tile(omega, (dimension, 1, 1)), np.eye(dimension)).T
    np.testing.assert_allclose(map_ @ map_.T, np.linalg.pinv(omega, rcond=1e-9, hermitian=True), atol=1e-8)


def test_the_command_offers_what_there_is() -> None:
    """Written out there, since its help must not load numpy."""
    choices = {p.name: list(p.type.choices) for p in command.params if isinstance(p.type, click.Choice)}
    assert choices["policy"] == list(POLICIES)
    assert choices["scale"] == list(SCALES)
