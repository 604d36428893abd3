"""When a run ends and what it gives as its reason."""

from collections.abc import Callable
from dataclasses import replace

import hypothesis.strategies as st
import numpy as np
import pytest
from graphs import bundled, differences, from_file, point_priors, points
from hypothesis import given

from slamcli.errors import InputError, UsageError
from slamcli.graph import FactorGraph
from slamcli.solver.linear_system import LinearSystem
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.policies.steps import Step
from slamcli.solver.problem import FullStep
from slamcli.solver.result import IterationRecord, Result, Status
from slamcli.solver.termination import Termination

Check = Callable[[Result], bool]
AT_REST = points([(0.0, 0.0), (1.0, 0.0)], differences([(0, 1, 1.0, 0.0)]))


def run(name: str = "manhattan_small.g2o", **options: object) -> Result:
    return from_file(bundled(name), **options)


@pytest.mark.parametrize("method", ["gn", "lm", "dogleg"])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-9])
def test_tolerance(method: str, tolerance: float) -> None:
    """What is left to gain is of the order of the tolerance, and less work is done for a larger one."""
    result = run(method=method, tolerance=tolerance)
    exact = run(method=method, tolerance=1e-13)
    assert result.status is Status.CONVERGED
    assert f"below {tolerance:.0e}" in result.reason
    assert result.iterations <= exact.iterations
    assert 0.0 <= result.final_chi2 - exact.final_chi2 <= 10.0 * tolerance * exact.final_chi2 + 1e-9


@pytest.mark.parametrize("method", ["gn", "lm", "dogleg"])
def test_no_tolerance_ends_at_rounding(method: str) -> None:
    result = run(method=method, tolerance=0.0, max_iterations=200)
    assert result.status is Status.CONVERGED
    assert any(word in result.reason for word in ("rounding", "no variable moved", "none promises to"))


@pytest.mark.parametrize("budget", [1, 2, 3])
def test_budget_of_iterations(budget: int) -> None:
    result = run(max_iterations=budget)
    assert (result.status, result.iterations) == (Status.NOT_CONVERGED, budget)
    assert result.reason == f"iteration limit {budget} reached"
    assert result.final_chi2 < result.initial_chi2


def test_no_iterations_at_all() -> None:
    result = run(max_iterations=0)
    assert (result.status, result.iterations) == (Status.NOT_CONVERGED, 0)
    assert result.reason == "no iterations allowed"
    assert result.final_chi2 == result.initial_chi2 == bundled("manhattan_small.g2o").chi2()


def test_time_limit() -> None:
    result = run(time_limit=1e-9)
    assert (result.status, result.iterations) == (Status.NOT_CONVERGED, 1)
    assert result.reason == "time limit of 1e-09 s used up"


def test_convergence_beats_the_budget() -> None:
    """A run that converges in its last iteration has converged."""
    wanted = run()
    result = run(max_iterations=wanted.iterations, time_limit=1000.0)
    assert (result.status, result.iterations) == (Status.CONVERGED, wanted.iterations)


@pytest.mark.parametrize("method", ["gn", "lm", "dogleg"])
def test_perfect_graph(method: str) -> None:
    result = from_file(AT_REST, method=method)
    assert (result.status, result.iterations) == (Status.CONVERGED, 0)
    assert result.reason == "the gradient is zero at the start"
    assert result.final_chi2 == 0.0


@pytest.mark.parametrize("method", ["gn", "lm", "dogleg"])
def test_chi2_of_zero_is_reached(method: str) -> None:
    """Relative tests must bear a chi2 of exactly zero."""
    graph = points([(0.0, 0.0), (9.0, 3.0)], differences([(0, 1, 1.0, 0.0)]))
    result = from_file(graph, method=method)
    assert result.status is Status.CONVERGED
    assert result.final_chi2 == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("method", ["gn", "lm", "dogleg"])
def test_all_variables_held(method: str) -> None:
    graph = points([(0.0, 0.0), (9.0, 3.0)], differences([(0, 1, 1.0, 0.0)]), point_priors([(1, 8.0, 3.0)]))
    result = from_file(graph, method=method, fix=[0, 1])
    assert (result.status, result.iterations) == (Status.CONVERGED, 0)
    assert result.reason == "all variables are held: nothing to optimize"
    assert result.final_chi2 == result.initial_chi2 == 74.0
    assert result.dof == 4


def test_interruption_after_the_iteration() -> None:
    seen: list[IterationRecord] = []

    def watch(start: str, chi2: float, record: IterationRecord | None) -> None:
        if record is not None:
            seen.append(record)

    result = from_file(bundled("manhattan_small.g2o"), on_iteration=watch, interrupted=lambda: len(seen) >= 2)
    assert result.status is Status.INTERRUPTED
    assert result.exit_code == 130
    assert result.iterations == 2
    assert result.final_chi2 == seen[-1].chi2
    assert result.graph.chi2() == pytest.approx(result.final_chi2)


def test_watcher_sees_the_start_and_every_record() -> None:
    seen: list[tuple[float, IterationRecord | None]] = []
    result = from_file(
        bundled("square_toro.graph"), on_iteration=lambda start, chi2, record: seen.append((chi2, record))
    )
    assert seen[0] == (result.initial_chi2, None)
    assert [record for _, record in seen[1:]] == result.trace
    assert [chi2 for chi2, _ in seen[1:]] == [record.chi2 for record in result.trace]


def test_a_graph_without_edges_is_no_problem() -> None:
    with pytest.raises(InputError, match="no edge"):
        from_file(FactorGraph(AT_REST.variables, []))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "newton"}, "method 'newton' does not exist"),
        ({"init": "random"}, "init 'random' does not exist"),
        ({"ordering": "mmd"}, "ordering 'mmd' does not exist"),
        ({"linear_solver": "eigen"}, "linear_solver 'eigen' does not exist"),
        ({"scaling": "nielsen"}, "scaling 'nielsen' does not exist"),
        ({"tolerance": -1e-9}, "tolerance must be"),
        ({"tolerance": float("nan")}, "tolerance must be"),
        ({"max_iterations": -1}, "max_iterations must"),
        ({"time_limit": 0.0}, "time_limit must"),
        ({"fix": [2]}, "no variable has the id 2"),
    ],
)
def test_options_that_do_not_exist(options: dict[str, object], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        from_file(AT_REST, **options)


def promises(decrease: float) -> Callable[[], FullStep]:
    return lambda: FullStep(decrease, largest=1.0, singular=False)


def step(chi2: float, kind: str = "gauss-newton") -> Step:
    """An accepted step to a chi2, with a gradient and a length that say nothing."""
    system = LinearSystem({}, chi2, np.ones(1), np.ones(1))
    return Step(system=system, norm=1.0, largest=1.0, damping=None, trials=1, accepted=True, kind=kind)


@given(st.floats(0.01, 0.9), st.floats(1e-3, 1e3), st.sampled_from([1e-4, 1e-6, 1e-9]))
def test_extrapolation_of_a_linear_sequence(ratio: float, gap: float, tolerance: float) -> None:
    """Where chi2 = 1 + gap ratio^k, what is left at the end is at most the tolerance (or r / (1 - r) of it)."""
    termination = Termination(OptimizeOptions(tolerance=tolerance, max_iterations=10**6), 1.0 + gap)
    chi2 = 1.0 + gap
    for k in range(1, 10**4):
        after = 1.0 + gap * ratio**k
        verdict = termination.after(step(after), chi2 - after, k, 0.0, promises(0.0))
        chi2 = after
        if verdict is not None:
            break
    assert verdict is not None and verdict.status is Status.CONVERGED
    assert chi2 - 1.0 <= tolerance * chi2 * max(1.0, ratio / (1.0 - ratio)) * 1.01


def test_a_short_damped_step_must_be_confirmed() -> None:
    """The change is below the tolerance, but the full step promises much more: go on."""
    termination = Termination(OptimizeOptions(tolerance=1e-6), 100.0)
    assert termination.after(step(99.99999, "damped"), 1e-6, 1, 0.0, promises(50.0)) is None
    verdict = termination.after(step(99.99999, "damped"), 1e-6, 2, 0.0, promises(1e-9))
    assert verdict is not None and verdict.status is Status.CONVERGED


def test_a_rejected_step_with_much_to_gain_is_no_convergence() -> None:
    system = LinearSystem({}, 100.0, np.ones(1), np.ones(1))
    rejected = Step(system=system, norm=1.0, largest=1.0, damping=1.0, trials=10, accepted=False, kind="damped")
    verdict = Termination(OptimizeOptions(), 100.0).after(rejected, 0.0, 1, 0.0, promises(50.0))
    assert verdict is not None
    assert (verdict.status, verdict.reason) == (Status.NOT_CONVERGED, "no step lowers chi2 after 10 trials")
    verdict = Termination(OptimizeOptions(), 100.0).after(rejected, 0.0, 1, 0.0, promises(0.0))
    assert verdict is not None and verdict.status is Status.CONVERGED


def test_a_rising_chi2_is_no_convergence_by_extrapolation() -> None:
    termination = Termination(OptimizeOptions(tolerance=1e-9), 100.0)
    assert termination.after(step(10.0), 90.0, 1, 0.0, promises(0.0)) is None
    assert termination.after(step(10.0001), -1e-4, 2, 0.0, promises(0.0)) is None


def test_nothing_is_extrapolated_far_from_the_minimum() -> None:
    """Decreases by half, then by a fiftieth of that: a good guess near a minimum, none where chi2 still falls fast."""
    termination = Termination(OptimizeOptions(tolerance=1e-3), 100.0)
    assert termination.after(step(50.0), 50.0, 1, 0.0, promises(0.0)) is None
    assert termination.after(step(49.0), 1.0, 2, 0.0, promises(0.0)) is None


def test_no_promise_counts_where_chi2_is_gone() -> None:
    """A chi2 of rounding cannot fall by more than itself, whatever a nearly singular H promises."""
    system = LinearSystem({}, 1e-31, np.ones(1), np.ones(1))
    rejected = Step(system=system, norm=1.0, largest=1.0, damping=1.0, trials=10, accepted=False, kind="damped")
    verdict = Termination(OptimizeOptions(), 1.0).after(rejected, 0.0, 1, 0.0, promises(1e-15))
    assert verdict is not None and verdict.status is Status.CONVERGED


def test_a_tiny_full_step_confirms_where_chi2_is_rounding() -> None:
    rejected = replace(step(1e-24, "damped"), accepted=False)
    stuck = Termination(OptimizeOptions(), 1e-24).after(rejected, 0.0, 1, 0.0, lambda: FullStep(1e-24, 1e-13, False))
    assert stuck is not None and stuck.status is Status.CONVERGED


def test_a_singular_hessian_confirms_only_with_nothing_left_to_gain() -> None:
    short = step(18.0, "damped")
    assert Termination(OptimizeOptions(), 18.0).after(short, 1e-15, 1, 0.0, lambda: FullStep(17.0, 3.0, True)) is None
    verdict = Termination(OptimizeOptions(), 18.0).after(short, 1e-15, 1, 0.0, lambda: FullStep(1e-12, 3.0, True))
    assert verdict is not None and "H is singular" in verdict.reason
