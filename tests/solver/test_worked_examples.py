"""Examples that can be worked by hand, and a linear problem that numpy solves."""

from pathlib import Path

import numpy as np
import pytest
from graphs import dense, differences, make_problem, point_priors, points
from numpy.testing import assert_allclose
from support import write_file

import slamcli
from slamcli.graph import FactorGraph
from slamcli.solver.result import Status

# The lesson: poses on a line, odometry 1 and 1, a closure of 1.6, a prior at 0, all weights 1, guess (0, 1, 2).
LINE = points(
    [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)],
    point_priors([(0, 0.0, 0.0)]),
    differences([(0, 1, 1.0, 0.0), (1, 2, 1.0, 0.0), (0, 2, 1.6, 0.0)]),
)
POSES = """\
VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1 0 0
VERTEX_SE2 2 2 0 0
EDGE_PRIOR_SE2 0 0 0 0 1 0 0 1 0 1
EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1
EDGE_SE2 1 2 1 0 0 1 0 0 1 0 1
EDGE_SE2 0 2 1.6 0 0 1 0 0 1 0 1
"""


def test_three_points_on_a_line() -> None:
    """H by hand: the Laplacian of the triangle, plus the prior."""
    problem = make_problem(LINE)
    system = problem.linearize(LINE.values)
    assert system.chi2 == pytest.approx(0.16)
    along_x = dense(problem.pattern, system.hessian)[::2, ::2]
    assert_allclose(along_x, [[3.0, -1.0, -1.0], [-1.0, 2.0, -1.0], [-1.0, -1.0, 2.0]])
    assert_allclose(system.gradient[::2], [-0.4, 0.0, 0.4])
    step = problem.solve(system)
    assert_allclose(step[::2], [0.0, -2.0 / 15.0, -4.0 / 15.0], atol=1e-12)
    # chi2 falls by 2/15 * 0.4 * 2 = 0.1067, as the quadratic model says
    assert problem.model_decrease(system, step) == pytest.approx(0.16 - 0.16 / 3.0)
    assert problem.full_step(system).decrease == pytest.approx(0.16 - 0.16 / 3.0)


@pytest.mark.parametrize("method", ["gn", "dogleg"])
def test_one_step_spreads_the_closure(method: str) -> None:
    result = slamcli.optimize(LINE, method=method, max_iterations=1)
    assert_allclose(result.graph.values["XY"], [[0.0, 0.0], [13.0 / 15.0, 0.0], [26.0 / 15.0, 0.0]], atol=1e-12)
    assert result.initial_chi2 == pytest.approx(0.16)
    assert result.trace[0].chi2 == pytest.approx(0.16 / 3.0)  # 0.0533
    assert result.trace[0].chi2_change == pytest.approx(-0.16 * 2.0 / 3.0)
    assert result.trace[0].step_norm == pytest.approx(np.hypot(2.0 / 15.0, 4.0 / 15.0))


@pytest.mark.parametrize("linear_solver", ["cholmod", "superlu"])
def test_three_poses_from_a_file(linear_solver: str, tmp_path: Path) -> None:
    """The same with planar poses; nothing turns, so that the problem stays linear."""
    graph = slamcli.read(str(write_file(tmp_path, POSES)))
    result = slamcli.optimize(graph, linear_solver=linear_solver)
    assert result.status is Status.CONVERGED
    wanted = [[0.0, 0.0, 0.0], [13.0 / 15.0, 0.0, 0.0], [26.0 / 15.0, 0.0, 0.0]]
    assert_allclose(result.graph.values["SE2"], wanted, atol=1e-12)
    assert result.trace[0].chi2 == pytest.approx(0.16 / 3.0)
    assert result.dof == 3 * 4 - 3 * 3


def test_two_measurements_are_averaged_by_their_weights() -> None:
    """1 m with weight 1 and 2 m with weight 3 give 1.75 m; chi2 is 1 * 0.75^2 + 3 * 0.25^2."""
    graph = points(
        [(0.0, 0.0), (5.0, 5.0)],
        differences([(0, 1, 1.0, 0.0)], weight=1.0),
        differences([(0, 1, 2.0, 0.0)], weight=3.0),
    )
    result = slamcli.optimize(graph)
    assert_allclose(result.graph.values["XY"][1], [1.75, 0.0], atol=1e-12)
    assert result.final_chi2 == pytest.approx(0.75)
    assert result.dof == 2


def test_square_that_does_not_close() -> None:
    """A loop of n equal edges takes an equal share of the gap on each: chi2 = gap^2 / n."""
    gap, n = 0.6, 4
    steps = [(0, 1, 1.0, 0.0), (1, 2, 0.0, 1.0), (2, 3, -1.0, 0.0), (3, 0, gap, -1.0)]
    result = slamcli.optimize(points([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)], differences(steps)))
    assert result.final_chi2 == pytest.approx(gap**2 / n)
    wanted = [[0.0, 0.0], [1.0 - gap / n, 0.0], [1.0 - 2 * gap / n, 1.0], [-3 * gap / n, 1.0]]
    assert_allclose(result.graph.values["XY"], wanted, atol=1e-12)


def linear_problem(seed: int, count: int = 12) -> tuple[FactorGraph, np.ndarray, float]:
    """A random graph of points, and numpy's solution and chi2 of it."""
    rng = np.random.default_rng(seed)
    edges = [(i, i + 1, *rng.standard_normal(2)) for i in range(count - 1)]
    edges += [(int(a), int(b), *rng.standard_normal(2)) for a, b in rng.integers(0, count, (2 * count, 2)) if a != b]
    priors = [(0, 1.0, 2.0), (count - 1, -1.0, 3.0)]
    weight = 2.5
    graph = points([tuple(p) for p in 50.0 * rng.standard_normal((count, 2))], differences(edges, weight))
    graph.factors.append(point_priors(priors))
    rows = np.zeros((len(edges) + 2, count))
    rhs = np.zeros((len(edges) + 2, 2))
    for k, (i, j, dx, dy) in enumerate(edges):
        rows[k, j] += np.sqrt(weight)
        rows[k, i] -= np.sqrt(weight)
        rhs[k] = np.sqrt(weight) * np.array([dx, dy])
    for k, (i, x, y) in enumerate(priors, start=len(edges)):
        rows[k, i] = 1.0
        rhs[k] = x, y
    solution, rest, *_ = np.linalg.lstsq(rows, rhs, rcond=None)
    return graph, solution, float(rest.sum())


@pytest.mark.parametrize("seed", range(4))
def test_a_linear_problem_takes_one_step(seed: int) -> None:
    graph, solution, chi2 = linear_problem(seed)
    result = slamcli.optimize(graph)
    assert result.trace[0].chi2 == pytest.approx(chi2, rel=1e-9)
    assert result.iterations <= 2  # the second shows that nothing is left to gain
    assert result.status is Status.CONVERGED
    assert_allclose(result.graph.values["XY"], solution, atol=1e-9)


@pytest.mark.parametrize("method", ["lm", "dogleg"])
def test_the_other_methods_reach_the_same_solution(method: str) -> None:
    graph, solution, chi2 = linear_problem(1)
    result = slamcli.optimize(graph, method=method, tolerance=1e-14)
    assert result.final_chi2 == pytest.approx(chi2, rel=1e-9)
    assert_allclose(result.graph.values["XY"], solution, atol=1e-5)
