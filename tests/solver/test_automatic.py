"""The default method: watched, accelerated, with a fallback."""

from dataclasses import replace

import numpy as np
import pytest
from graphs import BUNDLED_NAMES, bundled, from_file, points
from support import dataset

import slamcli
from slamcli.graph import FactorGraph, Factors, Variables
from slamcli.models import RELATIVE_POSE_2D, SE2
from slamcli.models.base import Array
from slamcli.solver.linear_system import LinearSystem
from slamcli.solver.policies import automatic
from slamcli.solver.policies.acceleration import Acceleration
from slamcli.solver.policies.automatic import Automatic
from slamcli.solver.result import Status


@pytest.mark.parametrize("name", BUNDLED_NAMES)
def test_is_gauss_newton_where_that_does_well(name: str) -> None:
    graph = bundled(name)
    wanted, found = from_file(graph), from_file(graph, method="auto")
    for ours, plain in zip(found.trace, wanted.trace, strict=False):
        if ours.step != "gauss-newton":
            break
        assert ours.chi2 == plain.chi2
    assert found.status is Status.CONVERGED
    assert found.final_chi2 == pytest.approx(wanted.final_chi2, rel=1e-8)


def test_the_gain_ratio_of_a_linear_problem_is_one() -> None:
    from graphs import differences, point_priors

    graph = points([(9.0, 9.0), (3.0, 4.0)], point_priors([(0, 0.0, 0.0)]), differences([(0, 1, 1.0, 2.0)]))
    result = from_file(graph, method="auto")
    assert result.trace[0].gain_ratio == pytest.approx(1.0, rel=1e-9)
    assert result.final_chi2 == pytest.approx(0.0, abs=1e-18)


class Scripted:
    """A problem in one variable whose chi2 after each step is given; steps are always one long."""

    def __init__(self, chi2: list[float]) -> None:
        self.chi2 = iter(chi2)

    def solve(self, system: LinearSystem, damping: Array | None = None) -> Array:
        return np.array([1.0])

    def solve_again(self, system: LinearSystem) -> Array:
        return np.array([1.0])

    def retract(self, values: dict[str, Array], delta: Array) -> dict[str, Array]:
        return values

    def linearize(self, values: dict[str, Array]) -> LinearSystem:
        return at(next(self.chi2))


def at(chi2: float) -> LinearSystem:
    return LinearSystem({}, chi2, np.ones(1), np.array([-1.0]))


def test_after_its_patience_it_goes_on_from_the_best_state(monkeypatch: pytest.MonkeyPatch) -> None:
    """chi2 falls to 5 once, then only climbs: the tenth such step is taken back, and dogleg begins at 5."""
    seen: list[float] = []

    class Fallback:
        def step(self, problem: object, now: LinearSystem) -> object:
            seen.append(now.chi2)
            return None

    monkeypatch.setattr(automatic, "Dogleg", Fallback)
    problem, policy, now = Scripted([9.0, 5.0, *(2.0**k for k in range(3, 40))]), Automatic(), at(8.0)
    for _ in range(2 + automatic.PATIENCE - 1):
        now = policy.step(problem, now).system  # type: ignore[arg-type]
    assert now.chi2 == 2.0**11 and not seen
    policy.step(problem, now)  # type: ignore[arg-type]
    assert seen == [5.0]


def test_a_step_that_is_not_finite_is_taken_back(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[float] = []

    class Fallback:
        def step(self, problem: object, now: LinearSystem) -> object:
            seen.append(now.chi2)
            return None

    monkeypatch.setattr(automatic, "Dogleg", Fallback)
    problem, policy = Scripted([7.0, 9.0, np.nan]), Automatic()
    now = policy.step(problem, at(8.0)).system  # type: ignore[arg-type]
    now = policy.step(problem, now).system  # type: ignore[arg-type]
    policy.step(problem, now)  # type: ignore[arg-type]
    assert seen == [7.0]


def test_acceleration_solves_a_linear_iteration_exactly() -> None:
    """x -> A x + b in n dimensions: after n + 1 states the next is the fixed point."""
    rng = np.random.default_rng(2)
    n = 4
    hessian = np.diag(rng.uniform(1.0, 3.0, n))
    curvature = hessian @ np.diag([0.1, 0.3, 0.7, 1.8])  # of the true cost: steps fall short and overshoot
    x, acceleration = rng.standard_normal(n), Acceleration()
    for _ in range(n):
        gradient = curvature @ x
        step = -np.linalg.solve(hessian, gradient)
        acceleration.moved(step, step, gradient)
        x = x + step
    gradient = curvature @ x
    x = x + acceleration.extrapolated(-np.linalg.solve(hessian, gradient), gradient)
    assert np.abs(x).max() < 1e-9


def test_the_last_step_reuses_a_factor() -> None:
    result = from_file(bundled("sphere_small.g2o"), method="auto", tolerance=1e-14)
    assert "simplified-newton" in {record.step for record in result.trace}
    wanted = from_file(bundled("sphere_small.g2o"), tolerance=1e-14)
    assert result.final_chi2 == pytest.approx(wanted.final_chi2, rel=1e-12)


@pytest.mark.datasets
@pytest.mark.parametrize(
    ("path", "best", "plain"),
    [("pose3d/KITTI_00_vo_copslam.g2o", 6.26633076, 100), ("pose3d/pose3example_gtsam.txt", 17781.787, 30)],
)
def test_slow_tails_are_accelerated(path: str, best: float, plain: int) -> None:
    graph = slamcli.read(str(dataset(path)))
    found = slamcli.optimize(graph, init="chordal")
    assert found.status is Status.CONVERGED
    assert found.final_chi2 == pytest.approx(best, rel=1e-6)
    assert found.iterations <= 0.5 * plain
    assert slamcli.optimize(graph, init="chordal", method="gn", max_iterations=plain).status is Status.NOT_CONVERGED


def test_falls_back_where_gauss_newton_never_comes_down() -> None:
    """Angles started far off, with a start that plain Gauss-Newton does not survive or that it leaves upwards."""
    rng = np.random.default_rng(1)
    graph = bundled("manhattan_small.g2o")
    values = graph.values["SE2"].copy()
    values[1:, 2] += rng.uniform(-2.5, 2.5, len(values) - 1)
    graph = replace(graph.with_values({"SE2": values}))
    result = from_file(graph, method="auto", max_iterations=300)
    assert result.status is Status.CONVERGED
    assert result.final_chi2 < result.initial_chi2


@pytest.mark.parametrize("method", ["auto", "gn", "lm", "dogleg"])
def test_a_chain_without_closures_converges_although_chi2_is_rounding(method: str) -> None:
    """Its chi2 is zero but for rounding, of which no decrease is a small share."""
    steps, rng = 3000, np.random.default_rng(0)
    z = np.column_stack([np.ones(steps), np.zeros(steps), 0.1 * rng.standard_normal(steps)])
    pairs = np.column_stack([np.arange(steps), np.arange(1, steps + 1)])
    zeros = np.zeros(steps + 1, dtype=np.intp)
    poses = Variables(SE2, np.arange(steps + 1), np.zeros((steps + 1, 3)), zeros > 0, zeros > 0, zeros)
    edges = Factors(RELATIVE_POSE_2D, pairs, z, np.tile(100.0 * np.eye(3), (steps, 1, 1)))
    result = slamcli.optimize(FactorGraph({"SE2": poses}, [edges]), method=method, init="chordal")
    assert result.status is Status.CONVERGED
    assert len(result.trace) <= 3
    assert result.final_chi2 < 1e-12
