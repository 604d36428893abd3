"""Ids of 64 bits, in any order and with any gaps; vertices that only edges name; FIX."""

from itertools import pairwise
from pathlib import Path

import hypothesis.strategies as st
import pytest
from hypothesis import HealthCheck, given, settings
from support import write_file

import slamcli
from slamcli.formats import ParseError, render

EYE3 = "1 0 0 1 0 1"
X0 = 8646911284551352320  # GTSAM's symbol x0; doubles near it are 1024 apart
of_file = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])

signed = st.integers(-(2**63), 2**63 - 1)
unsigned = st.integers(0, 2**64 - 1)
symbols = st.integers(X0, X0 + 5)
id_lists = st.one_of(*(st.lists(i, min_size=2, max_size=6, unique=True) for i in (signed, unsigned, symbols)))


def chain(ids: list[int]) -> list[str]:
    return [f"EDGE_SE2 {a} {b} 1 0 0 {EYE3}" for a, b in pairwise(ids)]


@of_file
@given(id_lists, st.randoms())
def test_any_ids_in_any_order(tmp_path: Path, ids: list[int], random: object) -> None:
    """Vertices may come after their edges. Every id keeps its last bit, in the columns, in FIX and in the output."""
    lines = [f"VERTEX_SE2 {i} {k} 0 0" for k, i in enumerate(ids)] + chain(ids) + [f"FIX {ids[-1]}"]
    random.shuffle(lines)  # type: ignore[attr-defined]
    graph = slamcli.read(str(write_file(tmp_path, "\n".join(lines))))
    column = graph.variables["SE2"]
    assert sorted(column.ids.tolist()) == sorted(ids)
    assert [column.values[column.row_of(i), 0] for i in ids] == list(range(len(ids)))
    assert [column.fixed[column.row_of(i)] for i in ids] == [False] * (len(ids) - 1) + [True]
    pairs = sorted(graph.factors[0].variable_ids(graph.variables).tolist())
    assert pairs == sorted([a, b] for a, b in pairwise(ids))
    assert graph.chi2() == 0.0
    fresh = slamcli.FactorGraph(graph.variables, graph.factors)
    again = slamcli.read(str(write_file(tmp_path, render(fresh).data)))
    assert again.variables["SE2"].ids.tolist() == column.ids.tolist()
    assert again.variables["SE2"].fixed.tolist() == column.fixed.tolist()
    assert sorted(again.factors[0].variable_ids(again.variables).tolist()) == pairs


@of_file
@given(id_lists)
def test_edges_alone(tmp_path: Path, ids: list[int]) -> None:
    graph = slamcli.read(str(write_file(tmp_path, "\n".join(chain(ids)))))
    column = graph.variables["SE2"]
    assert column.ids.tolist() == sorted(ids)
    assert not column.known.any()
    assert not column.lines.any()
    assert graph.report is not None
    assert graph.report.created == {"SE2": sorted(ids)}


def test_neighbouring_symbols_are_not_confused(tmp_path: Path) -> None:
    lines = [
        f"VERTEX_SE2 {X0 + 1} 1 0 0",
        f"VERTEX_SE2 {X0} 0 0 0",
        f"FIX {X0 + 1}",
        f"EDGE_SE2 {X0} {X0 + 2} 1 0 0 {EYE3}",
    ]
    graph = slamcli.read(str(write_file(tmp_path, "\n".join(lines))))
    assert graph.variables["SE2"].ids.tolist() == [X0 + 1, X0, X0 + 2]
    assert graph.variables["SE2"].fixed.tolist() == [True, False, False]
    assert graph.variables["SE2"].known.tolist() == [True, True, False]
    held = graph.with_fixed([X0]).variables["SE2"].fixed
    assert held.tolist() == [True, True, False]


def test_a_partly_known_graph(tmp_path: Path) -> None:
    """Only what has no vertex record is without an estimate, by kind."""
    text = f"VERTEX_SE2 0 5 6 1\nEDGE_SE2 0 3 1 0 0 {EYE3}\nEDGE_SE2_XY 3 -1 1 1 1 0 1\n"
    graph = slamcli.read(str(write_file(tmp_path, text)))
    assert graph.variables["SE2"].ids.tolist() == [0, 3]
    assert graph.variables["SE2"].known.tolist() == [True, False]
    assert graph.variables["SE2"].values[0].tolist() == [5.0, 6.0, 1.0]
    assert graph.variables["XY"].ids.tolist() == [-1]
    assert graph.report is not None
    assert graph.report.created == {"SE2": [3], "XY": [-1]}


def test_a_whole_number_may_be_written_as_a_float(tmp_path: Path) -> None:
    graph = slamcli.read(str(write_file(tmp_path, "VERTEX_SE2 1.0 0 0 0\nVERTEX_SE2 2e1 0 0 0\nVERTEX_SE2 +3 0 0 0\n")))
    assert graph.variables["SE2"].ids.tolist() == [1, 20, 3]


def test_negative_ids_beside_ids_beyond_63_bits(tmp_path: Path) -> None:
    for lines in (
        ["VERTEX_SE2 -1 0 0 0", f"VERTEX_SE2 {2**63} 0 0 0"],
        ["VERTEX_SE2 -1 0 0 0", f"EDGE_SE2 0 {2**63} 1 0 0 {EYE3}"],
    ):
        with pytest.raises(ParseError, match="negative ids and ids of 2\\^63"):
            slamcli.read(str(write_file(tmp_path, "\n".join(lines))))


def test_a_pose_and_a_landmark_of_the_same_id_are_two_variables(tmp_path: Path) -> None:
    text = "VERTEX_SE2 1 0 0 0\nVERTEX_XY 1 3 4\nEDGE_SE2_XY 1 1 3 4 1 0 1\n"
    graph = slamcli.read(str(write_file(tmp_path, text)))
    assert (graph.poses, graph.landmarks, graph.chi2()) == (1, 1, 0.0)
    assert graph.report is not None
    assert any("g2o would refuse" in note for note in graph.report.notes)


def test_fix_may_name_several_vertices_of_all_kinds_and_come_first(tmp_path: Path) -> None:
    text = "FIX 2 0\n FIX 1 # the origin\nVERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 0 0 0\nVERTEX_XY 2 0 0\nVERTEX_XY 4 0 0\n"
    graph = slamcli.read(str(write_file(tmp_path, text)))
    assert graph.variables["SE2"].fixed.tolist() == [True, True]
    assert graph.variables["XY"].fixed.tolist() == [True, False]
    assert graph.report is not None
    assert graph.report.by_tag["FIX"] == 2
