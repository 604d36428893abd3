"""The automatic start: what it takes, when it doubts, what it says, and what must not matter."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from chordal_graphs import spoiled
from graphs import bundled, exact_graph, from_file, reordered, variables
from numpy.testing import assert_allclose, assert_array_equal
from support import dataset

import slamcli
from slamcli import models
from slamcli.geometry import so2
from slamcli.graph import FactorGraph, Factors
from slamcli.solver import gauge, multistart
from slamcli.solver.initialization import initialize, rotations
from slamcli.solver.result import Result, Status

SETS = ("manhattan_small.g2o", "sphere_small.g2o", "landmarks_small.g2o", "square_toro.graph")


def start(graph: FactorGraph) -> Result:
    return slamcli.optimize(graph, max_iterations=0)


def unequal(graph: FactorGraph) -> FactorGraph:
    """The graph with weights that differ from edge to edge, and make chi2 per degree of freedom large."""
    rng = np.random.default_rng(5)
    factors = [
        replace(f, information=f.information * 10.0 ** rng.uniform(1.0, 3.0, (len(f), 1, 1))) for f in graph.factors
    ]
    return replace(graph, factors=factors)


def ring(count: int, turns: int) -> FactorGraph:
    """A closed ring of poses that each turn by 2 pi / count, with a guess that winds around more often: a minimum, too.

    With all residual in the angles, 2 pi (turns - 1) / count each, chi2 is stationary there.
    """
    pose = np.zeros((count, 3))
    edges = np.stack([np.arange(count), (np.arange(count) + 1) % count], axis=1)
    step = np.tile([0.0, 0.0, 2.0 * np.pi / count], (count, 1))
    pose[:, 2] = so2.wrap(np.arange(count) * 2.0 * np.pi * turns / count)
    factors = Factors(models.RELATIVE_POSE_2D, edges, step, np.tile(np.eye(3) * 1e3, (count, 1, 1)))
    return FactorGraph({"SE2": variables(models.SE2, range(count), pose)}, [factors])


def runs(result: Result) -> dict[str, float]:
    """Where the runs ended."""
    return {s.name: s.final_chi2 for s in result.starts if s.final_chi2 is not None}


@pytest.mark.parametrize("name", SETS)
def test_the_optimum_is_kept(name: str) -> None:
    best = slamcli.optimize(bundled(name)).graph
    result = start(best)
    assert result.start == "values of the file"
    for kind, values in best.values.items():
        assert_array_equal(result.graph.values[kind], values)


@pytest.mark.parametrize("name", SETS)
def test_a_useless_guess_is_dropped(name: str) -> None:
    graph = spoiled(bundled(name))
    result = slamcli.optimize(graph)
    assert result.start == "chordal relaxation" and result.doubt is None
    assert result.final_chi2 == pytest.approx(slamcli.optimize(bundled(name)).final_chi2, rel=1e-8)


def test_the_starts_are_ranked_by_their_chi2() -> None:
    graph = bundled("manhattan_small.g2o")
    held = gauge.choose(graph)[1]
    result = start(graph)
    for record in result.starts:
        wanted = graph.chi2(initialize(graph, record.name, held)[0])
        assert record.initial_chi2 == pytest.approx(wanted, rel=1e-12)
    assert result.initial_chi2 == min(record.initial_chi2 for record in result.starts)
    assert {record.name for record in result.starts} == {"file", "chordal"}


def test_values_with_a_small_chi2_are_taken_without_a_look_at_others() -> None:
    graph = bundled("manhattan_small.g2o")
    graph = replace(graph, factors=[replace(f, information=f.information * 1e-6) for f in graph.factors])
    assert [record.name for record in start(graph).starts] == ["file"]


def test_a_graph_without_values_starts_from_a_relaxation() -> None:
    graph = bundled("manhattan_small.g2o")
    column = graph.variables["SE2"]
    result = start(replace(graph, variables={"SE2": replace(column, known=np.zeros(len(column), dtype=bool))}))
    assert result.start == "chordal relaxation" and [record.name for record in result.starts] == ["chordal"]


def test_of_starts_that_are_both_exact_the_file_counts() -> None:
    """Without a loop there is no degree of freedom and nothing but rounding to compare."""
    graph = exact_graph(models.SE3, models.RELATIVE_POSE_3D, 20, 4, extra=0)
    assert graph.degrees_of_freedom(gauge.choose(graph)[1]) == 0
    assert start(graph).start == "values of the file"


@pytest.mark.filterwarnings("ignore:overflow")
def test_values_that_overflow_are_dropped() -> None:
    graph = bundled("manhattan_small.g2o")
    values = graph.values["SE2"] * [1e200, 1e200, 1.0]
    values[0] = 0.0
    result = slamcli.optimize(graph.with_values({"SE2": values}))
    assert result.start == "chordal relaxation"
    assert result.final_chi2 == pytest.approx(877.048408928, rel=1e-8)


def test_points_alone_and_held_variables() -> None:
    points = {"XY": variables(models.XY, [1, 2], np.array([[0.0, 0.0], [5.0, 5.0]]))}
    edge = Factors(models.POINT_DIFFERENCE_2D, np.array([[0, 1]]), np.array([[1.0, 2.0]]), np.eye(2)[None])
    graph = FactorGraph(points, [edge])
    assert start(graph).start == "values of the file"
    assert slamcli.optimize(graph.with_fixed([1, 2])).status is Status.CONVERGED


def test_a_ring_that_winds_twice_is_left() -> None:
    """Its values are a local minimum of 4 pi^2 1e3 / count; the relaxation finds the exact ring."""
    local = ring(12, 2)
    assert from_file(local).final_chi2 == pytest.approx(4e3 * np.pi**2 / 12, rel=1e-9)
    assert slamcli.optimize(local).final_chi2 == pytest.approx(0.0, abs=1e-12)


def test_values_of_the_file_at_a_minimum_are_checked_by_another_run() -> None:
    """Where chi2 per degree of freedom does not speak for them; both end at the same minimum, and the file counts."""
    result = slamcli.optimize(slamcli.optimize(bundled("manhattan_small.g2o")).graph)
    assert result.start == "values of the file"
    assert "chi2 per degree of freedom" in str(result.doubt)
    assert runs(result)["chordal"] == pytest.approx(runs(result)["file"], rel=1e-8)


def test_a_structural_defect_is_not_searched_around() -> None:
    graph = bundled("manhattan_small.g2o")
    weights = replace(graph.factors[0], information=graph.factors[0].information * np.array([1.0, 1.0, 0.0])[:, None])
    weights = replace(weights, information=weights.information * np.array([1.0, 1.0, 0.0]))
    result = slamcli.optimize(replace(graph, factors=[weights]))
    assert result.status is Status.FAILED and result.doubt is None


@pytest.mark.parametrize("name", SETS)
@pytest.mark.parametrize("bad", [False, True])
def test_order_of_edges_does_not_count(name: str, bad: bool) -> None:
    graph = unequal(bundled(name))
    graph = spoiled(graph) if bad else graph
    rng = np.random.default_rng(3)
    shuffled = [reordered(f, rng.permutation(len(f))) for f in reversed(graph.factors)]
    wanted, found = slamcli.optimize(graph), slamcli.optimize(replace(graph, factors=shuffled))
    assert found.start == wanted.start
    assert found.initial_chi2 == pytest.approx(wanted.initial_chi2, rel=1e-9)
    assert found.final_chi2 == pytest.approx(wanted.final_chi2, rel=1e-8)


# --- doubts ----------------------------------------------------------------------------------------------------------


class Ended:
    """An attempt that has taken these values of chi2."""

    def __init__(self, *chi2: float, failed: bool = False, gain: float = 1.0) -> None:
        self.initial, *rest = chi2
        self.trace = [SimpleNamespace(chi2=value, gain_ratio=gain) for value in rest]
        self.chi2, self.lowest = chi2[-1], chi2[-1]
        self.converged, self.failed, self.singular = not failed, failed, False


@pytest.mark.parametrize(
    ("attempt", "word"),
    [
        (Ended(9.0, 5.0, 4.0), None),
        (Ended(9.0, 20.0, 30.0, 15.0, 12.0, 4.0), None),  # four steps above 9
        (Ended(9.0, 20.0, 30.0, 15.0, 12.0, 10.0, 4.0), "above its lowest value for 5 steps"),
        (Ended(9.0, 5.0, failed=True), "did not converge"),
        (Ended(9e3, 5e3, gain=0.1), "too large for the stated noise"),
        (Ended(9e3, 5e3, gain=0.9), None),
        (Ended(9e3, 80.0, gain=0.1), None),
    ],
)
def test_what_leaves_a_doubt(attempt: Ended, word: str | None) -> None:
    reason = multistart.doubt(attempt, 100, from_file=False)  # type: ignore[arg-type]
    assert reason is None if word is None else word in str(reason)


def test_values_of_the_file_need_a_small_chi2() -> None:
    assert multistart.doubt(Ended(30.0, 24.0), 100, from_file=True) is None  # type: ignore[arg-type]
    assert multistart.doubt(Ended(30.0, 26.0), 100, from_file=True) is not None  # type: ignore[arg-type]


def test_the_lowest_counts_and_of_equals_the_first() -> None:
    first, second, third = Ended(9.0, 5.0), Ended(9.0, 5.0 - 1e-9), Ended(9.0, 4.0, failed=True)
    assert multistart.best([first, second, third]) is first  # type: ignore[list-item]
    assert multistart.best([first, Ended(9.0, 4.9)]) is not first  # type: ignore[list-item]


# --- anchors ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["manhattan_small.g2o", "sphere_small.g2o"])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.99])
def test_an_anchor_is_what_holding_that_pose_gives(name: str, share: float) -> None:
    """One solve with the factor of another gauge, against the relaxation with the pose itself held."""
    graph = bundled(name)
    (column,) = graph.variables.values()
    row = int(np.argsort(column.rank)[int(share * len(column))])
    held = gauge.choose(graph)[1][column.kind.name]
    found = rotations.Relaxation(graph, column, held).anchored(share)
    there = np.zeros(len(column), dtype=bool)
    there[row] = True
    relaxation = rotations.Relaxation(graph, column, there)
    wanted = relaxation._projected(relaxation._solved)
    assert_allclose(found.transpose(0, 2, 1) @ found[:1], wanted.transpose(0, 2, 1) @ wanted[:1], atol=1e-9)
    assert_array_equal(found[held], rotations.rotation_matrices(column.kind, column.values[held]))


@pytest.mark.parametrize("name", ["manhattan_small.g2o", "sphere_small.g2o"])
def test_the_relaxation_does_not_depend_on_the_held_pose(name: str) -> None:
    graph = bundled(name)
    wanted = graph.chi2(initialize(graph, "chordal", gauge.choose(graph)[1])[0])
    for fixed in (5, 100, 199):
        other = graph.with_fixed([fixed])
        found = graph.chi2(initialize(other, "chordal", gauge.choose(other)[1])[0])
        assert found == pytest.approx(wanted, rel=1e-9)


def test_more_anchors_are_no_worse() -> None:
    graph = bundled("manhattan_small.g2o")
    held = gauge.choose(graph)[1]
    one, many = (graph.chi2(initialize(graph, name, held)[0]) for name in ("chordal", "chordal-anchors"))
    assert many <= one * (1.0 + 1e-3)


# --- standard sets ---------------------------------------------------------------------------------------------------


@pytest.mark.datasets
def test_leaves_the_local_minimum_of_mit() -> None:
    local = from_file(slamcli.read(str(dataset("pose2d/MIT_carlone.g2o")))).graph
    assert local.chi2() == pytest.approx(770.663502, rel=1e-8)
    assert slamcli.optimize(local).final_chi2 == pytest.approx(41.1632688, rel=1e-6)


@pytest.mark.datasets
def test_the_lowest_minimum_of_m3500c() -> None:
    """From the relaxation that holds pose 0 Gauss-Newton ends at 4071.18, and the peers' lowest is 4011.15."""
    result = slamcli.optimize(slamcli.read(str(dataset("pose2d/M3500c.g2o"))))
    assert result.doubt is None
    assert result.final_chi2 == pytest.approx(2554.73239, rel=1e-6)
