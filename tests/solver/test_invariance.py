"""What must not change the optimum: the frame, the ids, the order of lines, the held pose, the scale of the weights."""

from dataclasses import replace

import numpy as np
import pytest
from graphs import BUNDLED_NAMES, bundled, reordered
from numpy.testing import assert_allclose

import slamcli
from slamcli import models
from slamcli.geometry import se2, se3
from slamcli.graph import FactorGraph
from slamcli.graph.columns import Values

each_graph = pytest.mark.parametrize("name", BUNDLED_NAMES)

MOVE_2D = np.array([[3.0, -4.0, 2.5]])
MOVE_3D = se3.normalize(np.array([[3.0, -4.0, 5.0, 0.3, -0.5, 0.2, 0.7]]))


def moved(graph: FactorGraph, values: Values) -> Values:
    """All variables moved by one rigid motion of the world."""
    out = {}
    for name, column in graph.variables.items():
        kind, count = column.kind, len(column)
        if kind is models.SE2:
            out[name] = kind.compose(np.tile(MOVE_2D, (count, 1)), values[name])
        elif kind is models.SE3:
            out[name] = kind.compose(np.tile(MOVE_3D, (count, 1)), values[name])
        else:
            move, act = (MOVE_2D, se2.act) if kind.space == 2 else (MOVE_3D, se3.act)
            out[name] = act(np.tile(move, (count, 1)), values[name])
    return out


def distances(graph: FactorGraph, values: Values) -> np.ndarray:
    """Distances of all variables from the first: what no rigid motion changes."""
    positions = np.concatenate([values[name][:, : c.kind.space] for name, c in graph.variables.items()])
    return np.linalg.norm(positions - positions[0], axis=1)


@each_graph
def test_rigid_motion_of_the_start(name: str) -> None:
    graph = bundled(name)
    wanted = slamcli.optimize(graph)
    result = slamcli.optimize(graph.with_values(moved(graph, graph.values)))
    assert result.initial_chi2 == pytest.approx(wanted.initial_chi2, rel=1e-9)
    assert result.final_chi2 == pytest.approx(wanted.final_chi2, rel=1e-9)
    # the lowest pose is held where it was moved to: the whole solution moves with it
    target = moved(graph, wanted.graph.values)
    for kind, column in graph.variables.items():
        space = column.kind.space
        found = result.graph.values[kind][:, :space]
        assert_allclose(found, target[kind][:, :space], rtol=0, atol=1e-6)


@each_graph
def test_renumbered_ids(name: str) -> None:
    """Any distinct ids in any order, with gaps; another variable then has the lowest."""
    graph = bundled(name)
    rng = np.random.default_rng(4)
    total = sum(len(column) for column in graph.variables.values())
    ids = rng.choice(10**6, total, replace=False)
    columns, start = {}, 0
    for kind, column in graph.variables.items():
        columns[kind] = replace(column, ids=ids[start : start + len(column)])
        start += len(column)
    wanted = slamcli.optimize(graph, tolerance=1e-12)
    result = slamcli.optimize(FactorGraph(columns, graph.factors), tolerance=1e-12)
    assert result.gauge.held != wanted.gauge.held
    assert result.final_chi2 == pytest.approx(wanted.final_chi2, rel=1e-9)
    found = distances(graph, result.graph.values)
    assert_allclose(found, distances(graph, wanted.graph.values), rtol=0, atol=1e-5)


@each_graph
def test_order_of_vertices_and_edges(name: str) -> None:
    graph = bundled(name)
    rng = np.random.default_rng(5)
    columns, place = {}, {}
    for kind, column in reversed(graph.variables.items()):
        order = rng.permutation(len(column))
        place[kind] = np.argsort(order)
        columns[kind] = replace(
            column,
            ids=column.ids[order],
            values=column.values[order],
            fixed=column.fixed[order],
            known=column.known[order],
            lines=column.lines[order],
        )
    factors = []
    for old in reversed(graph.factors):
        slots = [place[kind.name][old.indices[:, s]] for s, kind in enumerate(old.kind.variables)]
        factors.append(reordered(replace(old, indices=np.stack(slots, axis=1)), rng.permutation(len(old))))
    wanted = slamcli.optimize(graph)
    result = slamcli.optimize(FactorGraph(columns, factors))
    assert result.gauge.held == wanted.gauge.held
    assert [record.chi2 for record in result.trace] == pytest.approx([record.chi2 for record in wanted.trace], rel=1e-7)
    for kind, rows in place.items():
        space = graph.variables[kind].kind.space
        found = result.graph.values[kind][rows][:, :space]
        assert_allclose(found, wanted.graph.values[kind][:, :space], rtol=0, atol=1e-6)


@each_graph
@pytest.mark.parametrize("held", [17, 39])
def test_another_held_pose(name: str, held: int) -> None:
    graph = bundled(name)
    wanted = slamcli.optimize(graph, tolerance=1e-12)
    result = slamcli.optimize(graph, fix=[held], tolerance=1e-12)
    assert result.gauge.held == (held,)
    assert result.final_chi2 == pytest.approx(wanted.final_chi2, rel=1e-9)
    found = distances(graph, result.graph.values)
    assert_allclose(found, distances(graph, wanted.graph.values), rtol=0, atol=1e-5)


@each_graph
@pytest.mark.parametrize("method", ["gn", "dogleg"])
def test_scale_of_all_weights(name: str, method: str) -> None:
    """chi2 scales with the information, the solution stays."""
    graph = bundled(name)
    factors = [replace(f, information=100.0 * f.information) for f in graph.factors]
    wanted = slamcli.optimize(graph, method=method)
    result = slamcli.optimize(replace(graph, factors=factors), method=method)
    assert result.final_chi2 == pytest.approx(100.0 * wanted.final_chi2, rel=1e-9)
    assert result.iterations == wanted.iterations


@each_graph
def test_edges_twice_with_half_the_weight(name: str) -> None:
    """Parallel edges are a sum like any other."""
    graph = bundled(name)
    halved = [replace(f, information=0.5 * f.information) for f in graph.factors]
    wanted = slamcli.optimize(graph)
    result = slamcli.optimize(replace(graph, factors=halved + halved))
    assert result.final_chi2 == pytest.approx(wanted.final_chi2, rel=1e-9)
    assert result.dof == wanted.dof + sum(len(f) * f.kind.dimension for f in graph.factors)


@each_graph
def test_the_optimum_is_where_it_stays(name: str) -> None:
    """Optimized again from its own result, nothing moves."""
    once = slamcli.optimize(bundled(name), tolerance=1e-12)
    again = slamcli.optimize(once.graph)
    assert again.initial_chi2 == once.final_chi2
    assert again.final_chi2 == pytest.approx(once.final_chi2, rel=1e-9)
    assert again.iterations <= 2


@each_graph
def test_the_given_graph_is_not_changed(name: str) -> None:
    graph = bundled(name)
    before = {kind: values.copy() for kind, values in graph.values.items()}
    result = slamcli.optimize(graph)
    for kind, values in before.items():
        assert_allclose(graph.values[kind], values, rtol=0, atol=0)
        assert not np.array_equal(result.graph.values[kind], values)
