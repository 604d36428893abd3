"""The factor graph as it is drawn: roles, elimination, online SLAM."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from support import BUNDLED, write_file

from slamcli.formats import read
from slamcli.graph.bipartite import (
    bipartite,
    eliminate,
    eliminate_all,
    least_degree,
    neighbourhood,
    online,
    spring_layout,
)

INFO = "1 0 0 1 0 1"
#: Three poses in a row, a prior, a closure, two landmarks.
SMALL = (
    "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nVERTEX_SE2 2 2 0 0\nVERTEX_XY 7 1 1\nVERTEX_XY 8 2 1\nFIX 2\n"
    f"EDGE_PRIOR_SE2 0 0 0 0 {INFO}\nEDGE_SE2 0 1 1 0 0 {INFO}\nEDGE_SE2 1 2 1 0 0 {INFO}\n"
    f"EDGE_SE2 0 2 2 0 0 {INFO}\n"
    "EDGE_SE2_XY 0 7 1 1 1 0 1\nEDGE_SE2_XY 1 7 0 1 1 0 1\nEDGE_SE2_XY 2 8 0 1 1 0 1\n"
)


def test_roles_and_labels(tmp_path: Path) -> None:
    graph, cut = bipartite(read(str(write_file(tmp_path, SMALL))))
    assert cut == 0
    assert [v.label for v in graph.variables.values()] == ["x0", "x1", "x2", "l7", "l8"]
    assert [v.fixed for v in graph.variables.values()] == [False, False, True, False, False]
    assert sorted(factor.role for factor in graph.factors) == sorted(
        ["prior", "odometry", "odometry", "loop closure", "observation", "observation", "observation"]
    )
    assert graph.positions[3] == (1.0, 1.0)


def test_one_step(tmp_path: Path) -> None:
    """x0 is joined to x1, x2 and l7: of their three pairs, x2 and l7 are not joined yet."""
    graph, _ = bipartite(read(str(write_file(tmp_path, SMALL))))
    step = eliminate(graph, 0)
    assert [v.label for v in step.separator] == ["x1", "x2", "l7"]
    assert [(a.label, b.label) for a, b in step.fill_in] == [("x2", "l7")]
    assert len(step.absorbed) == 4
    assert (len(step.graph.variables), len(step.graph.factors)) == (4, 4)
    assert step.graph.factors[-1].variables == (1, 2, 3)


def test_online_slam_has_the_last_pose_and_the_map(tmp_path: Path) -> None:
    graph, _ = bipartite(read(str(write_file(tmp_path, SMALL))))
    filtered = online(graph)
    assert [v.label for v in filtered.variables.values()] == ["x2", "l7", "l8"]
    assert [(f.role, f.variables) for f in filtered.factors] == [("observation", (2, 4)), ("marginal", (2, 3))]


def test_least_degree_fills_no_more_than_the_order_of_time() -> None:
    source = read(str(BUNDLED / "landmarks_small.g2o"))
    chosen = {name: np.arange(len(column)) < 12 for name, column in source.variables.items()}
    graph, cut = bipartite(source, chosen)
    assert cut > 0
    natural = sum(len(step.fill_in) for step in eliminate_all(graph, list(graph.variables)))
    order = least_degree(graph)
    assert sorted(order) == sorted(graph.variables)
    assert sum(len(step.fill_in) for step in eliminate_all(graph, order)) < natural


def test_fill_in_is_that_of_the_symbolic_factorization() -> None:
    """Pairs of the graph and fill-in together are the blocks of L below its diagonal."""
    source = read(str(BUNDLED / "manhattan_small.g2o"))
    chosen = {"SE2": np.arange(400) < 40}
    graph, _ = bipartite(source, chosen)
    fill = sum(len(step.fill_in) for step in eliminate_all(graph, list(graph.variables)))
    pattern = np.eye(40)
    for a, b in graph.pairs():
        pattern[a, b] = pattern[b, a] = 0.01  # diagonally dominant: nothing cancels
    lower = np.linalg.cholesky(pattern)
    assert len(graph.pairs()) + fill == np.count_nonzero(np.abs(np.tril(lower, -1)) > 0.0)


def test_neighbourhoods_grow_along_factors(tmp_path: Path) -> None:
    source = read(str(write_file(tmp_path, SMALL)))
    chosen = {"SE2": np.array([False, False, False]), "XY": np.array([False, True])}
    assert neighbourhood(source, chosen, 1)["SE2"].tolist() == [False, False, True]
    grown = neighbourhood(source, chosen, 2)
    assert grown["SE2"].all() and grown["XY"].tolist() == [False, True]


def test_springs_keep_variables_apart() -> None:
    source = read(str(BUNDLED / "manhattan_small.g2o"))
    graph, _ = bipartite(source, {"SE2": np.arange(400) < 30})
    places = np.array(list(spring_layout(graph).values()))
    apart = np.sqrt(np.square(places[:, None] - places[None]).sum(axis=2)) + 9.0 * np.eye(30)
    assert np.isfinite(places).all()
    assert apart.min() > 0.2
    np.testing.assert_allclose(places, list(spring_layout(graph).values()))


def test_switches_are_variables_without_a_place(tmp_path: Path) -> None:
    text = SMALL + f"VERTEX_SWITCH 9 1\nEDGE_SWITCH_PRIOR 9 1 1\nEDGE_SE2_SWITCHABLE 0 2 9 2 0 0 {INFO}\n"
    graph, _ = bipartite(read(str(write_file(tmp_path, text))))
    switch = next(v for v in graph.variables.values() if v.kind == "SWITCH")
    assert switch.label == "s9" and switch.key not in graph.positions
    assert [f.role for f in graph.factors if switch.key in f.variables] == ["loop closure", "prior"]
