"""Graphs with switches where poses, points and edges of two variables are expected: drawing, spoiling, comparing."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from support import BUNDLED

import slamcli
from slamcli.evaluation.landmarks import landmarks
from slamcli.graph import FactorGraph, is_loop_closure
from slamcli.graph.trajectory import of_graph
from slamcli.reporting.plots import scene
from slamcli.simulation.corruption import perturb
from slamcli.simulation.odometry_chain import is_observation, odometry_chain
from slamcli.solver.robust.switchable import with_switches

NAMES = ("manhattan_small.g2o", "sphere_small.g2o")


def pair(name: str) -> tuple[FactorGraph, FactorGraph]:
    """A bundled graph, and the same with every second edge switchable, loop closure or odometry."""
    graph = slamcli.read(str(BUNDLED / name))
    return graph, with_switches(graph, [np.arange(len(f)) % 2 == 1 for f in graph.factors], 1.0)


@pytest.mark.parametrize("name", NAMES)
def test_a_map_shows_the_edges_between_poses(name: str) -> None:
    plain, switched = (scene.estimate_of(of_graph(graph, "x"), "x") for graph in pair(name))
    order, other = (np.lexsort(e.edges.segments.reshape(len(e.edges.segments), -1).T) for e in (plain, switched))
    assert_array_equal(switched.edges.segments[other], plain.edges.segments[order])
    assert_array_equal(np.sort(switched.edges.role), np.sort(plain.edges.role))
    assert len(switched.landmarks) == 0


@pytest.mark.parametrize("name", NAMES)
def test_the_odometry_is_the_same(name: str) -> None:
    graph, switched = pair(name)
    plain, found = odometry_chain(graph), odometry_chain(switched)
    assert_array_equal(found.steps, plain.steps)
    assert found.driven.all()
    assert not any(is_observation(factors).any() for factors in switched.factors)
    counts = [sum(int(is_loop_closure(g, f).sum()) for f in g.factors) for g in (graph, switched)]
    assert counts[0] == counts[1]


@pytest.mark.parametrize("name", NAMES)
def test_switches_are_no_landmarks(name: str) -> None:
    _, switched = pair(name)
    assert len(landmarks(switched)[0]) == 0
    assert switched.landmarks == 0


def test_noise_on_the_guess_leaves_switches_alone() -> None:
    graph, switched = pair("manhattan_small.g2o")
    moved, plain = (perturb(g, 0.1, 0.1, np.random.default_rng(0)) for g in (switched, graph))
    assert_array_equal(moved["SWITCH"].values, switched.values["SWITCH"])
    assert_array_equal(moved["SE2"].values, plain["SE2"].values)
