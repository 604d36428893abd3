"""Which variables are held, and why."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from graphs import bundled, differences, point_priors, points
from numpy.testing import assert_array_equal
from support import write_file

import slamcli
from slamcli.solver import gauge

POSES = "VERTEX_SE2 3 0 0 0\nVERTEX_SE2 1 1 0 0\nVERTEX_SE2 2 2 0 0\n"
CHAIN = "EDGE_SE2 3 1 1 0 0 1 0 0 1 0 1\nEDGE_SE2 1 2 1 0 0 1 0 0 1 0 1\n"
PRIOR = "EDGE_PRIOR_SE2 2 2 0 0 1 0 0 1 0 1\n"
OTHER = "VERTEX_SE2 8 0 5 0\nVERTEX_SE2 7 1 5 0\nEDGE_SE2 8 7 1 0 0 1 0 0 1 0 1\n"


@pytest.mark.parametrize(
    ("text", "fix", "held", "reason"),
    [
        (POSES + CHAIN, (), (1,), "lowest id held"),
        (POSES + "FIX 3\n" + CHAIN, (), (3,), "1 fixed by the file or by --fix"),
        (POSES + "FIX 3 2\n" + CHAIN, (), (3, 2), "2 fixed by the file or by --fix"),
        (POSES + CHAIN, (2,), (2,), "1 fixed by the file or by --fix"),
        (POSES + "FIX 3\n" + CHAIN, (2,), (3, 2), "2 fixed by the file or by --fix"),
        (POSES + CHAIN + PRIOR, (), (), "priors"),
        (POSES + CHAIN + PRIOR, (1,), (1,), "1 fixed by the file or by --fix"),
        (POSES + CHAIN + OTHER, (), (1, 7), "lowest id of 2 of 2 components held"),
        (POSES + "FIX 2\n" + CHAIN + OTHER, (), (2, 7), "lowest id of 1 of 2 components held"),
        (POSES + CHAIN + OTHER + PRIOR, (), (7,), "priors in 1 of 2 components"),
    ],
)
def test_choice(text: str, fix: tuple[int, ...], held: tuple[int, ...], reason: str, tmp_path: Path) -> None:
    graph = slamcli.read(str(write_file(tmp_path, text)))
    result = slamcli.optimize(graph, fix=fix)
    assert result.gauge.held == held
    assert reason in result.gauge.reason


def test_poses_come_before_landmarks(tmp_path: Path) -> None:
    text = "VERTEX_SE2 5 0 0 0\nVERTEX_XY 1 1 1\nEDGE_SE2_XY 5 1 1 1 1 0 1\n"
    graph = slamcli.read(str(write_file(tmp_path, text)))
    assert gauge.choose(graph)[0].held == (5,)


def test_a_component_of_points_holds_its_lowest_point() -> None:
    graph = points([(0.0, 0.0)] * 4, differences([(0, 1, 1.0, 0.0), (2, 3, 1.0, 0.0)]))
    chosen, held = gauge.choose(graph)
    assert chosen.held == (0, 2)
    assert_array_equal(held["XY"], [True, False, True, False])


def test_a_variable_without_edges_is_held() -> None:
    graph = points([(0.0, 0.0)] * 3, differences([(0, 1, 1.0, 0.0)]))
    assert gauge.choose(graph)[0].held == (0, 2)
    assert slamcli.optimize(graph).final_chi2 == pytest.approx(0.0, abs=1e-20)


def test_no_choice_is_made_where_a_prior_decides() -> None:
    graph = points([(0.0, 0.0)] * 2, differences([(0, 1, 1.0, 0.0)]), point_priors([(1, 5.0, 5.0)]))
    result = slamcli.optimize(graph)
    assert result.gauge.held == ()
    assert result.graph.values["XY"].tolist() == pytest.approx(np.array([[4.0, 5.0], [5.0, 5.0]]))


@pytest.mark.parametrize("name", ["manhattan_small.g2o", "sphere_small.g2o", "landmarks_small.g2o"])
def test_held_variables_do_not_move(name: str) -> None:
    graph = bundled(name)
    fix = [int(column.ids[k]) for column in graph.variables.values() for k in (0, 7)]
    result = slamcli.optimize(graph, fix=fix)
    for kind, column in graph.variables.items():
        same = (result.graph.values[kind] == column.values).all(axis=1)
        assert_array_equal(column.ids[same], np.intersect1d(column.ids, fix))


@pytest.mark.parametrize("name", ["manhattan_small.g2o", "sphere_small.g2o", "landmarks_small.g2o"])
def test_holding_more_costs_chi2(name: str) -> None:
    """A held variable is a constraint: the optimum cannot fall, and the degrees of freedom rise."""
    graph = bundled(name)
    free, tied = slamcli.optimize(graph), slamcli.optimize(graph, fix=[0, 30])
    assert tied.final_chi2 > free.final_chi2
    dimension = next(iter(c.kind.dimension for c in graph.variables.values() if c.kind.is_pose))
    assert tied.dof == free.dof + dimension


def test_components_are_solved_like_graphs_of_their_own() -> None:
    """Twice the same graph, with other ids: twice the chi2."""
    graph = bundled("square_toro.graph")
    column, factors = graph.variables["SE2"], graph.factors[0]
    count = len(column)
    doubled = replace(
        graph,
        variables={
            "SE2": replace(
                column,
                ids=np.concatenate([column.ids, column.ids + 1000]),
                values=np.concatenate([column.values] * 2),
                fixed=np.concatenate([column.fixed] * 2),
                known=np.concatenate([column.known] * 2),
                lines=np.concatenate([column.lines] * 2),
            )
        },
        factors=[factors, replace(factors, indices=factors.indices + count)],
    )
    one, two = slamcli.optimize(graph), slamcli.optimize(doubled)
    assert two.gauge.held == (0, 1000)
    assert two.final_chi2 == pytest.approx(2.0 * one.final_chi2, rel=1e-9)
    assert two.dof == 2 * one.dof
