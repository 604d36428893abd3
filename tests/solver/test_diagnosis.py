"""What a numerical failure says: the edge, the variable, the part of the graph."""

from pathlib import Path

import numpy as np
import pytest
from graphs import from_file
from support import write_file

import slamcli
from slamcli.solver import policies
from slamcli.solver.backends import NotPositiveDefiniteError
from slamcli.solver.linear_system import LinearSystem
from slamcli.solver.policies.steps import Step
from slamcli.solver.problem import Problem
from slamcli.solver.result import Result, Status

INFO = "1 0 0 1 0 1"
TWO_POSES = f"VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nEDGE_SE2 0 1 1 0 0 {INFO}\n"


def failed(tmp_path: Path, text: str, **options: str) -> Result:
    graph = slamcli.read(str(write_file(tmp_path, text)))
    with np.errstate(all="ignore"):
        result = slamcli.optimize(graph, **options)  # type: ignore[arg-type]
    assert result.status is Status.FAILED
    assert result.exit_code == 5
    for kind, values in graph.values.items():
        assert np.array_equal(result.graph.values[kind], values)  # nothing has moved
    return result


def test_pose_without_orientation_is_named(tmp_path: Path) -> None:
    text = TWO_POSES.replace("EDGE_SE2", "FIX 0\nEDGE_SE2").replace(INFO, "1 0 0 1 0 0")
    result = failed(tmp_path, text.replace("EDGE_SE2 0 1 1 0", "EDGE_SE2 0 1 1.5 0"))
    assert "not positive definite" in result.reason
    movers = [line for line in result.diagnosis if line.startswith("  ")]
    assert "SE2 1, mostly theta" in movers[0]
    assert any("--method lm" in line for line in result.diagnosis)


def test_position_prior_leaves_the_gauge_free(tmp_path: Path) -> None:
    """Nothing says where the pose looks."""
    result = failed(tmp_path, "VERTEX_SE2 4 0 0 0\nEDGE_PRIOR_SE2_XY 4 0.1 0 10 0 10\n")
    gauge = [line for line in result.diagnosis if line.startswith("gauge freedom")]
    assert len(gauge) == 1
    assert "the component of 4 (1 variables)" in gauge[0]
    assert "2 prior dimensions, fewer than 3" in gauge[0]
    assert any("SE2 4, mostly theta" in line for line in result.diagnosis)


def test_spatial_position_prior_leaves_the_gauge_free(tmp_path: Path) -> None:
    text = (
        "PARAMS_SE3OFFSET 0 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 4 0 0 0 0 0 0 1\n"
        "EDGE_SE3_XYZ_PRIOR 4 0 0.1 0 0 1 0 0 1 0 1\n"
    )
    result = failed(tmp_path, text)
    assert any("3 prior dimensions, fewer than 6" in line for line in result.diagnosis)


def test_indefinite_information_is_named_with_its_line(tmp_path: Path) -> None:
    text = TWO_POSES + "VERTEX_SE2 2 2 0 0\nEDGE_SE2 1 2 1 0 0 4 0 0 -3 0 1\nEDGE_SE2 0 2 2 0 0 1 2 0 1 0 1\n"
    result = failed(tmp_path, text)
    assert result.reason == "2 information matrices are indefinite: chi2 is unbounded below"
    assert result.diagnosis[0] == "2 of 3 EDGE_SE2, the worst:"
    assert result.diagnosis[1] == "  EDGE_SE2 1 2 (line 5): eigenvalues from -3 to 4"
    assert result.diagnosis[2] == "  EDGE_SE2 0 2 (line 6): eigenvalues from -1 to 3"
    assert result.iterations == 0


def test_semidefinite_information_is_allowed(tmp_path: Path) -> None:
    """A weight of zero says nothing about a dimension, which others may determine."""
    text = TWO_POSES + "EDGE_SE2 0 1 1.2 0 0 1 0 0 0 0 0\n"
    result = from_file(slamcli.read(str(write_file(tmp_path, text))))
    assert result.status is Status.CONVERGED
    assert result.graph.values["SE2"][1, 0] == pytest.approx(1.1)


def test_bearing_to_a_landmark_at_the_pose_is_named(tmp_path: Path) -> None:
    text = TWO_POSES + "VERTEX_XY 7 0 0\nEDGE_BEARING_SE2_XY 1 7 1.6 10\nEDGE_BEARING_SE2_XY 0 7 0.8 10\n"
    result = failed(tmp_path, text, init="file")
    assert "not finite" in result.reason
    assert [line for line in result.diagnosis if "line" in line] == [
        "  EDGE_BEARING_SE2_XY 0 7 (line 6): residual or Jacobian is not finite"
    ]


@pytest.mark.parametrize("method", ["gn", "lm", "dogleg"])
def test_overflow_is_a_divergence(method: str, tmp_path: Path) -> None:
    """The residual is finite, its square is not."""
    result = failed(tmp_path, TWO_POSES.replace("VERTEX_SE2 1 1", "VERTEX_SE2 1 1e200"), method=method, init="file")
    assert result.reason == "chi2 or its derivatives are not finite"
    assert any("diverged" in line for line in result.diagnosis)


def test_edges_of_graphs_without_a_file_are_named_by_their_kind() -> None:
    from graphs import differences, points

    graph = points([(0.0, 0.0), (1.0, 0.0)], differences([(0, 1, 1.0, 0.0)], weight=-1.0))
    result = from_file(graph)
    assert result.status is Status.FAILED
    assert result.diagnosis[1] == "  point_difference_2d 0 1: eigenvalues from -1 to -1"


class Runaway:
    """Takes one long step in a wrong direction, and then finds H singular."""

    def step(self, problem: Problem, now: LinearSystem) -> Step:
        if now.chi2 > 1e3:
            raise NotPositiveDefiniteError
        system = problem.linearize(problem.retract(now.values, np.full_like(now.gradient, 50.0)))
        return Step(system, 50.0, 50.0, None, 1, accepted=True, kind="gauss-newton")


def test_a_diverging_run_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(policies, "make", lambda options: Runaway())
    text = "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nEDGE_SE2 0 1 1.1 0 0 1 0 0 1 0 1\n"
    result = from_file(slamcli.read(str(write_file(tmp_path, text))))
    assert result.status is Status.FAILED
    assert "the run was diverging" in result.diagnosis[0]
