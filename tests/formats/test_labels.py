"""Labels survive writing and reading, belong to one file, and say where they are wrong."""

from dataclasses import replace
from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from support import dataset, write_file

import slamcli
from slamcli.errors import InputError
from slamcli.formats import render
from slamcli.formats.labels import Labels, edge_positions, labels_of, outlier_masks, read_labels, write_labels
from slamcli.graph import FactorGraph

GRAPH = """\
# edges of two kinds, in no order
EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1
VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1 0 0
VERTEX_SE2 2 2 0 0
EDGE_SE2_XY 0 10 1 1 1 0 1
VERTEX_XY 10 1 1
UNKNOWN 1 2
EDGE_PRIOR_SE2 2 2 0 0 1 0 0 1 0 1
EDGE_SE2 2 0 -2 0 0 1 0 0 1 0 1
EDGE_SE2_XY 1 10 0 1 1 0 1
"""
IN_ORDER = ["EDGE_SE2 0 1", "EDGE_SE2_XY 0 10", "EDGE_PRIOR_SE2 2", "EDGE_SE2 2 0", "EDGE_SE2_XY 1 10"]
HEADER = "edge,tag,from,to,label\n"


def read_text(tmp_path: Path, text: str) -> Labels:
    return read_labels(str(write_file(tmp_path, text, "labels.csv")))


def names(graph: FactorGraph) -> list[str]:
    """Tag and ids of the edges by position."""
    found = {}
    for factors, positions in zip(graph.factors, edge_positions(graph), strict=True):
        for position, ids in zip(positions.tolist(), factors.variable_ids(graph.variables).tolist(), strict=True):
            found[position] = " ".join([factors.tag, *map(str, ids)])
    assert sorted(found) == list(range(1, len(found) + 1))
    return [found[k] for k in sorted(found)]


def test_positions_follow_the_lines_of_the_file(tmp_path: Path) -> None:
    assert names(slamcli.read(str(write_file(tmp_path, GRAPH)))) == IN_ORDER


def test_positions_of_a_graph_made_in_memory_are_those_of_its_file(tmp_path: Path) -> None:
    graph = slamcli.read(str(write_file(tmp_path, GRAPH)))
    memory = FactorGraph(graph.variables, graph.factors)
    again = slamcli.read(str(write_file(tmp_path, render(memory).data)))
    assert names(memory) == names(again) != IN_ORDER
    bare = FactorGraph(graph.variables, [replace(f, lines=np.empty(0, dtype=np.intp)) for f in graph.factors])
    assert names(bare) == names(memory)


def test_positions_of_nothing() -> None:
    assert edge_positions(FactorGraph({}, [])) == []
    labels, tags = labels_of(FactorGraph({}, []), [])
    assert (len(labels), tags) == (0, [])
    assert outlier_masks(labels, FactorGraph({}, [])) == []


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.booleans(), min_size=5, max_size=5))
def test_labels_of_a_graph_come_back(tmp_path: Path, marked: list[bool]) -> None:
    graph = slamcli.read(str(write_file(tmp_path, GRAPH)))
    masks = [np.array(marked)[positions - 1] for positions in edge_positions(graph)]
    labels, tags = labels_of(graph, masks)
    path = tmp_path / "labels.csv"
    write_labels(str(path), labels, tags)
    rows = path.read_text().splitlines()
    assert rows[0] + "\n" == HEADER
    for k, (row, edge, outlier) in enumerate(zip(rows[1:], IN_ORDER, marked, strict=True), 1):
        tag, first, *second = edge.split()
        assert row == f"{k},{tag},{first},{(second or [first])[0]},{'outlier' if outlier else 'inlier'}"
    again = read_labels(str(path))
    assert again.complete
    for one, two in zip(outlier_masks(again, graph), masks, strict=True):
        np.testing.assert_array_equal(one, two)


def test_ids_of_64_bits(tmp_path: Path) -> None:
    labels = read_text(tmp_path, f"{HEADER}1,EDGE_SE2,{2**63},{2**64 - 1},outlier\n")
    assert (int(labels.first[0]), int(labels.second[0])) == (2**63, 2**64 - 1)
    with pytest.raises(InputError, match="64 bits"):
        read_text(tmp_path, f"{HEADER}1,EDGE_SE2,-1,{2**63},outlier\n")


def test_a_table_without_positions_in_another_order_of_columns(tmp_path: Path) -> None:
    graph = slamcli.read(str(write_file(tmp_path, GRAPH)))
    labels = read_text(tmp_path, "label, to, from\r\noutlier, 0, 2\r\ninlier, 10, 1\r\n")
    assert labels.complete
    assert [mask.tolist() for mask in outlier_masks(labels, graph)] == [[False, True], [False, False], [False]]


def test_a_plain_list_names_the_outliers_only(tmp_path: Path) -> None:
    graph = slamcli.read(str(write_file(tmp_path, GRAPH)))
    labels = read_text(tmp_path, "# from to\n\n0 2 # either direction\n")
    assert not labels.complete
    assert labels.edge.tolist() == [0]
    assert [mask.tolist() for mask in outlier_masks(labels, graph)] == [[False, True], [False, False], [False]]
    assert len(read_text(tmp_path, "# none\n")) == 0


@pytest.mark.parametrize(
    ("text", "where", "what"),
    [
        (HEADER + "1,EDGE_SE2,0,1,outlier\n2,EDGE_SE2,1,x,inlier\n", ":3:14:", "whole number, found 'x'"),
        (HEADER + "1,EDGE_SE2,0,1,false\n", ":2:16:", "inlier or outlier, found 'false'"),
        (HEADER + "1,EDGE_SE2,0,1\n", ":2:1:", "expected 5 columns, found 4"),
        (HEADER + "0,EDGE_SE2,0,1,inlier\n", ":2:1:", "positions count from 1, found 0"),
        (HEADER + "1,E,0,1,inlier\n1,E,0,1,inlier\n", ":3:1:", "edge 1 is named twice"),
        ("edge,from,to,lable\n", ":1:14:", "found 'lable'"),
        ("from,from,label\n", ":1:6:", "found 'from'"),
        ("edge,from,label\n", ":1:1:", "the header lacks 'to'"),
        ("1 2\n3\n", ":2:1:", "found 1 words"),
        ("1 2 3\n", ":1:1:", "found 3 words"),
        ("1 b\n", ":1:3:", "whole number, found 'b'"),
    ],
)
def test_errors_name_line_and_column(tmp_path: Path, text: str, where: str, what: str) -> None:
    with pytest.raises(InputError) as caught:
        read_text(tmp_path, text)
    assert f"labels.csv{where}" in caught.value.message
    assert what in caught.value.message


@pytest.mark.parametrize("row", ["1,EDGE_SE2,0,2,inlier", "6,EDGE_SE2,0,1,inlier", "4,EDGE_SE2,0,2,outlier"])
def test_labels_of_another_graph_are_refused(tmp_path: Path, row: str) -> None:
    graph = slamcli.read(str(write_file(tmp_path, GRAPH)))
    with pytest.raises(InputError, match="the graph does not have"):
        outlier_masks(read_text(tmp_path, HEADER + row + "\n"), graph)
    with pytest.raises(InputError, match="the graph does not have"):
        outlier_masks(read_text(tmp_path, "1 2\n"), graph)
    with pytest.raises(InputError, match="the graph does not have"):
        outlier_masks(read_text(tmp_path, HEADER + row + "\n"), FactorGraph({}, []))


def test_the_list_of_the_standard_data_set() -> None:
    """Its 100 false closures are the last 100 edges."""
    graph = slamcli.read(str(dataset("outliers/M3500_false100_random_seed1.g2o")))
    labels = read_labels(str(dataset("outliers/M3500_false100_random_seed1.labels.txt")))
    (mask,) = outlier_masks(labels, graph)
    assert np.flatnonzero(mask).tolist() == list(range(5453, 5553))
