"""Covariances against the dense inverse, by hand, and where there are none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from graphs import (
    BUNDLED_NAMES,
    bundled,
    dense,
    dense_assembly,
    differences,
    exact_graph,
    from_file,
    make_problem,
    mixed_graph,
    point_priors,
    points,
)
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from support import dataset

import slamcli
from slamcli import models
from slamcli.errors import InputError, NumericalError, UsageError
from slamcli.formats.reader import parse
from slamcli.graph import FactorGraph, Factors
from slamcli.solver.backends import NotPositiveDefiniteError
from slamcli.solver.covariance import CovarianceRecovery, CovarianceRequest, recover
from slamcli.solver.covariance.selected_inverse import selected_inverse
from slamcli.solver.covariance.supernodes import factorize
from slamcli.solver.options import OptimizeOptions

seeds = st.integers(0, 2**32 - 1)


def blocks(matrix: np.ndarray, size: int) -> np.ndarray:
    """The diagonal blocks (n, size, size)."""
    count = len(matrix) // size
    return matrix.reshape(count, size, count, size)[np.arange(count), :, np.arange(count)]


# -- selected inversion ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", BUNDLED_NAMES)
@pytest.mark.parametrize("ordering", ["amd", "natural"])
def test_entries_are_those_of_the_dense_inverse(name: str, ordering: str) -> None:
    graph = from_file(bundled(name)).graph
    problem = make_problem(graph, ordering=ordering)
    system = problem.linearize(graph.values)
    found = selected_inverse(problem.pattern, problem.permutation, system.hessian)
    whole = np.linalg.inv(dense(problem.pattern, system.hessian))
    wanted = whole[problem.pattern.scalar_rows, problem.pattern.scalar_columns]
    deviation = np.sqrt(np.diag(whole))
    scale = deviation[problem.pattern.scalar_rows] * deviation[problem.pattern.scalar_columns]
    assert np.abs((found - wanted) / scale).max() < 1e-9


@given(seeds)
def test_every_kind_of_variable_and_factor(seed: int) -> None:
    """Blocks of 1, 2, 3 and 6 rows side by side, any of them held; damped, so that nothing is singular."""
    graph, held = mixed_graph(seed)
    free = {
        name: column if held[name].all() else replace(column, fixed=held[name])
        for name, column in graph.variables.items()
    }
    problem = make_problem(replace(graph, variables=free))
    system = problem.linearize(graph.values)
    hessian = system.hessian.copy()
    hessian[problem.pattern.diagonal] += 1e-3 * problem.diagonal(system).max()
    found = selected_inverse(problem.pattern, problem.permutation, hessian)
    wanted = np.linalg.inv(dense(problem.pattern, hessian))
    assert_allclose(
        dense(problem.pattern, found)[dense(problem.pattern, np.ones_like(found)) != 0.0],
        wanted[dense(problem.pattern, np.ones_like(found)) != 0.0],
        rtol=1e-9,
        atol=1e-9 * wanted.max(),
    )


def test_supernodes_hold_the_factor() -> None:
    problem = make_problem(bundled("sphere_small.g2o"))
    system = problem.linearize(bundled("sphere_small.g2o").values)
    found = factorize(problem.pattern, problem.permutation, system.hessian)
    lower = np.zeros((problem.pattern.dimension,) * 2)
    panels = np.frombuffer(found.panels)
    for k, (start, width, height) in enumerate(zip(found.starts, found.widths, found.heights, strict=False)):
        rows = found.rows[found.row_starts[k] : found.row_starts[k + 1]]
        assert (rows[:width] == np.arange(start, start + width)).all()
        lower[rows, start : start + width] = panels[found.bases[k] : found.bases[k + 1]].reshape(width, height).T
        if width < height:  # what is below is within the parent
            parent = found.parents()[k]
            above = found.rows[found.row_starts[parent] : found.row_starts[parent + 1]]
            assert np.isin(rows[width:], above).all()
    wanted = dense(problem.pattern, system.hessian)[np.ix_(found.permutation, found.permutation)]
    assert_allclose(lower @ lower.T, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())


def test_a_matrix_that_is_not_positive_definite() -> None:
    problem = make_problem(bundled("manhattan_small.g2o"))
    system = problem.linearize(bundled("manhattan_small.g2o").values)
    with pytest.raises(NotPositiveDefiniteError):
        selected_inverse(problem.pattern, problem.permutation, -system.hessian)


# -- by hand -----------------------------------------------------------------------------------------------------------


def test_a_chain_of_points() -> None:
    """Variances add up along a chain that is held at its beginning; the joint covariance is that of a random walk."""
    graph = points([(0.0, 0.0)] * 4, differences([(0, 1, 0, 0), (1, 2, 0, 0), (2, 3, 0, 0)], weight=4.0))
    recovery = CovarianceRecovery(graph)
    assert_allclose(recovery.marginals()["XY"], np.arange(4)[:, None, None] * np.eye(2) / 4.0, atol=1e-15)
    joint = recovery.joint([("XY", 3), ("XY", 1)])
    assert_allclose(joint, np.kron(np.array([[0.75, 0.25], [0.25, 0.25]]), np.eye(2)), atol=1e-15)


def test_a_loop_of_points_halves_the_middle() -> None:
    """Two equally long ways to the far side of a loop are two measurements of it."""
    graph = points([(0.0, 0.0)] * 4, differences([(0, 1, 0, 0), (1, 2, 0, 0), (2, 3, 0, 0), (3, 0, 0, 0)]))
    assert_allclose(CovarianceRecovery(graph).marginals()["XY"][2], np.eye(2), atol=1e-15)


def test_a_prior_holds_nothing() -> None:
    """The covariances are those in the world: the prior's own at its point, and more elsewhere."""
    graph = points([(0.0, 0.0)] * 2, differences([(0, 1, 0, 0)], weight=10.0), point_priors([(0, 0, 0)], weight=2.0))
    recovery = CovarianceRecovery(graph)
    assert recovery.gauge.held == ()
    assert_allclose(recovery.marginals()["XY"], [0.5 * np.eye(2), 0.6 * np.eye(2)], atol=1e-15)


def test_odometry_turns_uncertain_headings_into_uncertain_places() -> None:
    """Two steps of 1 m: the deviation 0.1 rad of the first turn is 0.1 m across at the end of the second step."""
    information = np.diag([1e6, 1e6, 100.0])
    chain = Factors(
        models.RELATIVE_POSE_2D,
        np.array([[0, 1], [1, 2]]),
        np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]),
        np.tile(information, (2, 1, 1)),
    )
    base = exact_graph(models.SE2, models.RELATIVE_POSE_2D, 3, 0)
    column = replace(base.variables["SE2"], values=np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]))
    found = CovarianceRecovery(FactorGraph({"SE2": column}, [chain])).marginals()["SE2"]
    assert_allclose(found[1], np.diag([1e-6, 1e-6, 0.01]), atol=1e-15)
    assert_allclose(found[2], [[2e-6, 0, 0], [0, 2e-6 + 0.01, 0.01], [0, 0.01, 0.02]], atol=1e-12)


# -- against the dense inverse, and each other -------------------------------------------------------------------------


@pytest.mark.parametrize("name", BUNDLED_NAMES)
def test_joint_blocks_are_those_of_the_dense_inverse(name: str) -> None:
    """Of pairs that no edge joins as well, of different kinds, of what is held."""
    graph = bundled(name)
    recovery = CovarianceRecovery(graph)
    inverse, places = (
        np.linalg.inv(dense(recovery.problem.pattern, recovery.problem.linearize(graph.values).hessian)),
        {},
    )
    start = 0
    for kind, column in graph.variables.items():
        for row in range(len(column)):
            size = 0 if recovery.held[kind][row] else column.kind.dimension
            places[kind, row] = np.arange(start, start + size)
            start += size
    rng = np.random.default_rng(0)
    members = [list(places)[k] for k in rng.choice(len(places), 5, replace=False)]
    place = np.concatenate([places[m] for m in members])
    deviation = np.sqrt(np.diag(inverse)[place])
    difference = recovery.joint(members) - inverse[np.ix_(place, place)]
    assert np.abs(difference / np.outer(deviation, deviation)).max() < 1e-9
    held = next(member for member, place in places.items() if not len(place))
    both = recovery.joint([held, members[0]])
    size = graph.variables[held[0]].kind.dimension
    assert not both[:size].any()
    assert_allclose(both[size:, size:], recovery.joint(members[:1]), rtol=1e-12)


@pytest.mark.parametrize("name", BUNDLED_NAMES)
def test_marginals_and_cross_covariances_are_blocks_of_joint_ones(name: str) -> None:
    graph = bundled(name)
    recovery = CovarianceRecovery(graph)
    found = recover(recovery, CovarianceRequest(cross=True))
    marginals = recovery.marginals()
    for cross in found.cross:
        rows = [graph.variables[k.name].rows_of(cross.ids[:, s]) for s, k in enumerate(cross.kinds)]
        for m in (0, len(cross.ids) // 2, len(cross.ids) - 1):
            members = [(kind.name, int(row[m])) for kind, row in zip(cross.kinds, rows, strict=True)]
            joint = recovery.joint(members)
            size = cross.kinds[0].dimension
            scale = 1e-9 * np.abs(joint).max()
            assert_allclose(cross.covariance[m], joint[:size, size:], rtol=0, atol=scale)
            assert_allclose(marginals[members[0][0]][members[0][1]], joint[:size, :size], rtol=0, atol=scale)
    joined = {tuple(sorted(pair)) for f in graph.factors for pair in f.variable_ids(graph.variables).tolist()}
    assert {tuple(sorted(pair)) for cross in found.cross for pair in cross.ids.tolist()} == joined


def test_the_problem_of_a_run_is_used_again() -> None:
    result = from_file(bundled("manhattan_small.g2o"))
    again = CovarianceRecovery(result.graph, result.options, result.problem)
    assert again.problem is result.problem
    assert_allclose(again.marginals()["SE2"], CovarianceRecovery(result.graph).marginals()["SE2"], rtol=1e-12)
    assert again.predicted_decrease == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("linear_solver", ["cholmod", "superlu"])
def test_a_sparse_graph_and_another_linear_solver(linear_solver: str) -> None:
    """CHOLMOD itself would not take supernodes for a graph that is almost a chain."""
    graph = exact_graph(models.SE2, models.RELATIVE_POSE_2D, 30, 3, extra=1)
    recovery = CovarianceRecovery(graph, OptimizeOptions(linear_solver=linear_solver))
    hessian, _, _ = dense_assembly(graph, recovery.held, graph.values)
    assert_allclose(recovery.marginals()["SE2"][1:], blocks(np.linalg.inv(hessian), 3), rtol=1e-8, atol=1e-12)
    assert_allclose(recovery.joint([("SE2", 9)]), recovery.marginals()["SE2"][9], rtol=1e-8, atol=1e-12)


# -- what cannot be done -----------------------------------------------------------------------------------------------


def test_everything_is_held() -> None:
    graph = points([(0.0, 0.0)] * 2, differences([(0, 1, 0, 0)])).with_fixed([0, 1])
    found = recover(CovarianceRecovery(graph), CovarianceRequest(joint=(0, 1), cross=True))
    assert not found.marginals[0].covariance.any() and not found.joint.covariance.any()
    assert found.at_optimum and not found.cross[0].covariance.any()


def test_a_singular_graph_is_diagnosed() -> None:
    """A landmark that a single bearing sees: its distance is not determined."""
    text = "VERTEX_SE2 0 0 0 0\nVERTEX_XY 77 5 5\nEDGE_BEARING_SE2_XY 0 77 0.8 10\n"
    graph = parse("test.g2o", text.encode(), text.encode())
    for call in (lambda r: r.marginals(), lambda r: r.joint([("XY", 0)]), lambda r: r.predicted_decrease):
        with pytest.raises(NumericalError, match="not positive definite") as caught:
            call(CovarianceRecovery(graph))
        assert any("XY 77" in line for line in caught.value.details)


@pytest.mark.parametrize("seed", range(40))
def test_rounding_does_not_hide_a_singular_graph(seed: int) -> None:
    """A graph that may turn about its one known point: rounding makes its last pivot zero, or next to it."""
    rng = np.random.default_rng(seed)
    lines = [f"VERTEX_SE2 {k} {x} {y} {a}" for k, (x, y, a) in enumerate(rng.normal(size=(6, 3)) * 3.0)]
    lines += [f"VERTEX_XY 9 {rng.normal()} {rng.normal()}"]
    for i, j in ((0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (0, 5)):
        scale = np.exp(rng.normal(size=3))
        lines.append(f"EDGE_SE2 {i} {j} 1 0 0.1 {scale[0]} 0.1 0.05 {scale[1] + 1} 0.02 {scale[2] + 1}")
    lines += ["EDGE_SE2_XY 2 9 1 1 7.1 0.3 5.2", "EDGE_SE2_XY 3 9 1 2 3.1 0.1 2.2", "EDGE_PRIOR_XY 9 0 0 10 0 10"]
    text = "".join(f"{line}\n" for line in lines).encode()
    with pytest.raises(NumericalError, match="not positive definite"):
        CovarianceRecovery(parse("test.g2o", text, text)).marginals()


def test_a_long_chain_is_uncertain_but_not_singular() -> None:
    """The end is 10^11 times as uncertain as with its neighbours held; its variance is known in closed form."""
    count = 20_000
    text = "".join(f"VERTEX_SE2 {k} {k} 0 0\n" for k in range(count))
    text += "".join(f"EDGE_SE2 {k} {k + 1} 1 0 0 400 0 0 400 0 10000\n" for k in range(count - 1))
    last = CovarianceRecovery(parse("test.g2o", text.encode(), text.encode())).marginals()["SE2"][-1]
    steps = count - 1
    sideways = steps / 400 + sum(k * k for k in range(steps)) / 10_000
    assert_allclose(np.diag(last), [steps / 400, sideways, steps / 10_000], rtol=1e-6)


def test_no_scale_without_a_residual() -> None:
    graph = points([(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)], differences([(0, 1, 1, 0), (1, 2, 1, 0), (0, 2, 2, 0)]))
    with pytest.raises(NumericalError, match="chi2 is 0"):
        recover(CovarianceRecovery(graph), CovarianceRequest(scale="posterior"))


def test_no_information_at_all() -> None:
    graph = points([(0.0, 0.0)] * 2, differences([(0, 1, 0, 0)], weight=0.0))
    with pytest.raises(NumericalError, match="not positive definite"):
        recover(CovarianceRecovery(graph), CovarianceRequest())


def test_what_is_refused() -> None:
    graph = bundled("manhattan_small.g2o")
    with pytest.raises(InputError, match="no edge"):
        CovarianceRecovery(FactorGraph(graph.variables, []))
    unknown = replace(graph.variables["SE2"], known=np.arange(400) != 7)
    with pytest.raises(InputError, match="1 variable has no estimate, the first SE2 7"):
        CovarianceRecovery(FactorGraph({"SE2": unknown}, graph.factors))
    negative = replace(graph.factors[0], information=-graph.factors[0].information)
    with pytest.raises(NumericalError, match="indefinite"):
        CovarianceRecovery(FactorGraph(graph.variables, [negative]))
    recovery = CovarianceRecovery(graph)
    for request, message in (
        (CovarianceRequest(ids=(5, 1000)), "no variable has the id 1000"),
        (CovarianceRequest(joint=(1, -1)), "no variable has the id -1"),
        (CovarianceRequest(joint=(1, 1)), "twice"),
        (CovarianceRequest(relative=((1, 1),)), "two different"),
        (CovarianceRequest(of="landmarks"), "no landmarks"),
    ):
        with pytest.raises(UsageError, match=message):
            recover(recovery, request)


def test_not_a_number_is_diagnosed() -> None:
    graph = bundled("manhattan_small.g2o")
    values = graph.values["SE2"].copy()
    values[3, 0] = np.inf
    with pytest.raises(NumericalError, match="not finite"):
        CovarianceRecovery(graph.with_values({"SE2": values})).marginals()


# -- scale and optimum -------------------------------------------------------------------------------------------------


def test_the_posterior_scale_makes_the_scale_of_the_information_irrelevant() -> None:
    """A thousand times the information is a thousand times chi2."""
    graph = from_file(bundled("manhattan_small.g2o")).graph
    louder = replace(graph, factors=[replace(f, information=1e3 * f.information) for f in graph.factors])
    request = CovarianceRequest(scale="posterior")
    found = [recover(CovarianceRecovery(g), request) for g in (graph, louder)]
    assert found[0].factor == pytest.approx(found[0].chi2 / found[0].dof)
    assert_allclose(found[0].marginals[0].covariance, found[1].marginals[0].covariance, rtol=1e-9, atol=1e-15)
    exact = points([(0.0, 0.0)] * 2, differences([(0, 1, 0, 0)]))
    with pytest.raises(NumericalError, match="0 degrees of freedom"):
        recover(CovarianceRecovery(exact), request)


def test_the_predicted_decrease_says_how_far_the_optimum_is() -> None:
    graph = bundled("manhattan_small.g2o")
    before = recover(CovarianceRecovery(graph), CovarianceRequest())
    after = recover(CovarianceRecovery(from_file(graph).graph), CovarianceRequest())
    assert not before.at_optimum and after.at_optimum
    # of a linear problem it is the decrease itself: two edges 0 -> 1 that say 0 and 2, from the point 0 away
    linear = points([(0.0, 0.0), (0.0, 0.0)], differences([(0, 1, 0, 0), (0, 1, 2, 0)], weight=3.0))
    found = recover(CovarianceRecovery(linear), CovarianceRequest())
    assert (found.chi2, found.predicted_decrease) == pytest.approx((12.0, 6.0))


@pytest.mark.datasets
def test_city10000_against_columns_of_the_inverse() -> None:
    graph = slamcli.read(str(dataset("pose2d/city10000.g2o")))
    recovery = CovarianceRecovery(graph)
    marginals = recovery.marginals()["SE2"]
    assert np.linalg.eigvalsh(marginals[1:]).min() > 0.0
    for row in (1, 5000, 9999):
        joint = recovery.joint([("SE2", row)])
        assert np.abs(marginals[row] - joint).max() < 1e-9 * np.abs(joint).max()
