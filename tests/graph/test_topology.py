"""Components, degrees, loop closures, parallel and self edges, by hand and against a union-find."""

from pathlib import Path

import hypothesis.strategies as st
import numpy as np
from hypothesis import given
from support import write_file

import slamcli
from slamcli.graph import FactorGraph, analyze
from slamcli.graph.topology import connected_components, node_pairs


def graph_of(tmp_path: Path, vertices: str, edges: list[tuple[int, int]], extra: str = "") -> FactorGraph:
    """Planar poses with the given ids, and edges between them."""
    lines = [f"VERTEX_SE2 {i} 0 0 0" for i in vertices.split()]
    lines += [f"EDGE_SE2 {i} {j} 1 0 0 1 0 0 1 0 1" for i, j in edges]
    return slamcli.read(str(write_file(tmp_path, "\n".join(lines) + "\n" + extra)))


def test_a_chain_and_a_loop(tmp_path: Path) -> None:
    topology = analyze(graph_of(tmp_path, "0 1 2 3", [(0, 1), (1, 2), (2, 3), (3, 0)]))
    assert topology.component_count == 1
    assert topology.degrees.tolist() == [2, 2, 2, 2]
    assert [mask.tolist() for mask in topology.loop_closures] == [[False, False, False, True]]
    assert topology.loop_closure_count == 1
    assert (topology.parallel_edges, topology.self_edges) == (0, 0)


def test_neighbours_across_a_gap_in_the_ids_are_odometry(tmp_path: Path) -> None:
    """Neighbours are those in the order of ids, whatever the distance of the ids and the order of the file."""
    graph = graph_of(tmp_path, "900 0 10 11", [(0, 10), (11, 10), (900, 11), (10, 900), (0, 11)])
    assert analyze(graph).loop_closures[0].tolist() == [False, False, False, True, True]


def test_parallel_and_self_edges(tmp_path: Path) -> None:
    """A pair repeats in either direction and by any kind of edge; a self edge is no degree and no loop closure."""
    landmark = "VERTEX_XY 9 1 1\nEDGE_SE2_XY 0 9 1 1 1 0 1\nEDGE_BEARING_SE2_XY 0 9 0.5 1\n"
    topology = analyze(graph_of(tmp_path, "0 1 2", [(0, 1), (1, 0), (0, 1), (2, 2)], landmark))
    assert topology.parallel_edges == 3
    assert topology.self_edges == 1
    assert topology.degrees.tolist() == [5, 3, 0, 2]
    assert topology.loop_closure_count == 0
    assert topology.component_count == 2


def test_observations_and_priors_join_nothing_to_the_odometry_chain(tmp_path: Path) -> None:
    """An observation is no loop closure, however far the ids; a prior is no degree."""
    extra = "VERTEX_XY 500 1 1\nEDGE_SE2_XY 0 500 1 1 1 0 1\nEDGE_PRIOR_SE2 1 0 0 0 1 0 0 1 0 1\n"
    graph = graph_of(tmp_path, "0 1", [], extra)
    topology = analyze(graph)
    assert topology.loop_closure_count == 0
    assert topology.degrees.tolist() == [1, 0, 1]
    assert topology.components.tolist() == [0, 1, 0]
    assert node_pairs(graph).tolist() == [[0, 2]]


def test_the_chain_of_the_planar_poses_is_not_that_of_the_spatial_ones(tmp_path: Path) -> None:
    information = " ".join(["1" if i == j else "0" for i in range(6) for j in range(i, 6)])
    text = "".join(f"VERTEX_SE3:QUAT {i} 0 0 0 0 0 0 1\n" for i in (2, 5))
    text += f"EDGE_SE3:QUAT 2 5 1 0 0 0 0 0 1 {information}\n"
    graph = graph_of(tmp_path, "1 3 4", [(1, 3), (1, 4)], text)
    topology = analyze(graph)
    assert {f.tag: m.tolist() for f, m in zip(graph.factors, topology.loop_closures, strict=True)} == {
        "EDGE_SE2": [False, True],
        "EDGE_SE3:QUAT": [False],
    }
    assert topology.component_count == 2


def test_no_edges(tmp_path: Path) -> None:
    topology = analyze(graph_of(tmp_path, "4 2 7", []))
    assert topology.component_count == 3
    assert topology.degrees.tolist() == [0, 0, 0]
    assert (topology.parallel_edges, topology.self_edges, topology.loop_closure_count) == (0, 0, 0)


def union_find(nodes: int, pairs: list[tuple[int, int]]) -> list[int]:
    """Component numbers in the order of the first nodes, by the textbook's method."""
    parent = list(range(nodes))

    def root(node: int) -> int:
        while parent[node] != node:
            node = parent[node]
        return node

    for a, b in pairs:
        parent[max(root(a), root(b))] = min(root(a), root(b))
    numbers: dict[int, int] = {}
    return [numbers.setdefault(root(node), len(numbers)) for node in range(nodes)]


@given(
    st.integers(1, 40).flatmap(
        lambda n: st.tuples(st.just(n), st.lists(st.tuples(st.integers(0, n - 1), st.integers(0, n - 1)), max_size=60))
    )
)
def test_components_are_those_of_a_union_find(graph: tuple[int, list[tuple[int, int]]]) -> None:
    nodes, pairs = graph
    found = connected_components(nodes, np.array(pairs, dtype=np.intp).reshape(-1, 2))
    assert found.tolist() == union_find(nodes, pairs)


@given(st.permutations(range(60)))
def test_a_path_through_the_nodes_in_any_order_is_one_component(order: list[int]) -> None:
    pairs = np.stack([order[:-1], order[1:]], axis=1)
    assert not connected_components(60, pairs).any()
    assert connected_components(60, pairs[:-1]).max() == 1
