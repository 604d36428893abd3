"""What is not changed is not touched; what is written reads back as the same doubles."""

from pathlib import Path

import hypothesis.extra.numpy as nps
import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from numpy.testing import assert_array_equal
from support import BUNDLED, STANDARD, vectors, write_file

import slamcli
from slamcli import models
from slamcli.errors import InputError, NumericalError
from slamcli.formats import render
from slamcli.formats.writer import format_records
from slamcli.graph import FactorGraph, Variables
from slamcli.models.base import Array

of_file = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
doubles = st.floats(allow_nan=False, allow_infinity=False)  # subnormal and huge ones and -0.0 among them
bundled = pytest.mark.parametrize("path", sorted(BUNDLED.glob("*.g*")), ids=lambda path: path.name)
LARGEST = 4_000_000  # bytes of a standard data set that is read here


def standard() -> list[Path]:
    """All standard data sets in text, none where they are not."""
    return [] if STANDARD is None else sorted(p for p in STANDARD.glob("*/*") if 0 < p.stat().st_size < LARGEST)


def bits(values: Array) -> list[int]:
    """The doubles bit by bit, so that -0.0 is not 0.0."""
    return np.ascontiguousarray(values).view(np.uint64).ravel().tolist()


def moved(graph: FactorGraph, rows: dict[str, list[int]]) -> FactorGraph:
    """The graph with some variables elsewhere, by kind."""
    values = {name: column.values.copy() for name, column in graph.variables.items()}
    for name, which in rows.items():
        values[name][which, :2] += 0.1
    return graph.with_values(values)


@bundled
def test_bundled_data_sets_are_rendered_byte_by_byte(path: Path) -> None:
    graph = slamcli.read(str(path))
    assert render(graph).data == path.read_bytes()
    assert render(graph.with_values({n: v.copy() for n, v in graph.values.items()})).data == path.read_bytes()


@pytest.mark.datasets
@pytest.mark.skipif(STANDARD is None, reason="SLAMCLI_DATASETS does not name the folder of the standard data sets")
def test_standard_data_sets_are_rendered_byte_by_byte() -> None:
    """Whatever can be read; the files of other formats are refused."""
    readable = 0
    for path in standard():
        try:
            graph = slamcli.read(str(path), lenient=True)
        except InputError:
            continue
        rendered = render(graph)
        assert rendered.data == path.read_bytes(), path
        assert rendered.losses == [], path
        readable += 1
    assert readable > 50


@bundled
def test_only_the_lines_of_changed_vertices_change(path: Path) -> None:
    graph = slamcli.read(str(path))
    rows = {name: [0, len(column) // 2, len(column) - 1] for name, column in graph.variables.items()}
    lines = {int(graph.variables[name].lines[k]) for name, which in rows.items() for k in which}
    before, after = path.read_bytes().split(b"\n"), render(moved(graph, rows)).data.split(b"\n")
    assert len(before) == len(after)
    assert {k + 1 for k in range(len(before)) if before[k] != after[k]} == lines
    for k in lines:
        assert before[k - 1].split()[:2] == after[k - 1].split()[:2]  # tag and id


@bundled
def test_a_changed_graph_reads_back_bit_by_bit_and_is_stable(tmp_path: Path, path: Path) -> None:
    graph = slamcli.read(str(path))
    changed = moved(graph, {name: list(range(len(column))) for name, column in graph.variables.items()})
    data = render(changed).data
    again = slamcli.read(str(write_file(tmp_path, data)))
    for name, column in changed.variables.items():
        if name == "SE3":  # a unit quaternion is normalized again on reading, and toro's angles are another chart
            np.testing.assert_allclose(again.variables[name].values, column.values, rtol=0, atol=1e-15)
        else:
            assert bits(again.variables[name].values) == bits(column.values)
        assert again.variables[name].ids.tolist() == column.ids.tolist()
    assert render(again).data == data


def test_layout_and_comments_around_a_changed_record_stay(tmp_path: Path) -> None:
    text = "\ufeff# map\r\n  VERTEX_SE2\t0 0 0 0 # start\r\nUNKNOWN  1 ,x\r\nVERTEX_SE2 1  1.50 0 0\r\n\r\nFIX 0\r\n"
    text += "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1e0  #  odometry"
    graph = slamcli.read(str(write_file(tmp_path, text)))
    assert render(graph).data == text.encode()
    changed = render(moved(graph, {"SE2": [0]})).data.decode()
    assert changed == text.replace("VERTEX_SE2\t0 0 0 0 #", "VERTEX_SE2 0 0.1 0.1 0 #")


def test_records_at_the_ends_of_a_file_without_comments(tmp_path: Path) -> None:
    graph = slamcli.read(str(write_file(tmp_path, "VERTEX_XY 4 1 1\nVERTEX_XY 6 1 1")))
    changed = graph.with_values({"XY": np.full((2, 2), -0.5)})
    assert render(changed).data == b"VERTEX_XY 4 -0.5 -0.5\nVERTEX_XY 6 -0.5 -0.5"


@of_file
@given(nps.arrays(np.float64, st.tuples(st.integers(1, 5), st.just(3)), elements=doubles))
def test_points_survive_writing_bit_by_bit(tmp_path: Path, values: Array) -> None:
    ids = np.arange(len(values)) * 7 - 3
    none = np.zeros(len(values), dtype=bool)
    column = Variables(models.XYZ, ids, values, none, ~none, np.zeros(len(values), dtype=np.intp))
    data = render(FactorGraph({"XYZ": column}, [])).data
    again = slamcli.read(str(write_file(tmp_path, data)))
    assert bits(again.variables["XYZ"].values) == bits(values)
    assert again.variables["XYZ"].ids.tolist() == ids.tolist()
    assert render(again).data == data


@of_file
@given(nps.arrays(np.float64, (2, 2), elements=doubles), nps.arrays(np.float64, 3, elements=doubles))
def test_measurements_and_information_survive_writing_bit_by_bit(tmp_path: Path, z: Array, omega: Array) -> None:
    text = "".join(f"VERTEX_XY {k} 0 0\n" for k in range(2))
    text += "".join(f"EDGE_POINTXY 0 1 {' '.join(map(repr, [*row.tolist(), *omega.tolist()]))}\n" for row in z)
    graph = slamcli.read(str(write_file(tmp_path, text)))
    fresh = render(FactorGraph(graph.variables, graph.factors)).data
    again = slamcli.read(str(write_file(tmp_path, fresh)))
    assert bits(again.factors[0].measurements) == bits(graph.factors[0].measurements) == bits(z)
    assert bits(again.factors[0].information) == bits(graph.factors[0].information)
    assert bits(again.factors[0].information[1][np.triu_indices(2)]) == bits(omega)


def test_a_graph_of_all_kinds_from_nothing(tmp_path: Path) -> None:
    """Parameters, FIX and every kind of edge are written for a graph that has no document."""
    graph = slamcli.read(str(write_file(tmp_path, vectors + "FIX 0 20 10 31\n")))
    data = render(FactorGraph(graph.variables, graph.factors, graph.parameters)).data
    again = slamcli.read(str(write_file(tmp_path, data)))
    assert again.chi2() == pytest.approx(graph.chi2(), rel=1e-14)
    assert again.report is not None
    assert again.report.skipped == {}
    for name, column in graph.variables.items():
        assert_array_equal(again.variables[name].fixed, column.fixed)
    for one, two in zip(again.factors, graph.factors, strict=True):
        assert_array_equal(one.variable_ids(again.variables), two.variable_ids(graph.variables))
        assert_array_equal(one.information, two.information)


@given(
    st.lists(st.tuples(st.integers(-(2**63), 2**63 - 1), doubles, doubles), min_size=1, max_size=5),
)
def test_records_hold_exact_numbers(rows: list[tuple[int, float, float]]) -> None:
    ids = np.array([row[:1] for row in rows], dtype=np.int64)
    numbers = np.array([row[1:] for row in rows])
    texts = format_records(ids, numbers)
    assert [int(text.split()[0]) for text in texts] == ids[:, 0].tolist()
    assert bits(np.array([[float(x) for x in text.split()[1:]] for text in texts])) == bits(numbers)
    assert not any(number.endswith(".0") for text in texts for number in text.split())


@pytest.mark.parametrize(
    ("head", "tail"),
    [
        ("", "\n"),
        ("# poses are missing\n\n", "\n"),
        ("UNKNOWN 1\r\n", "\r\n"),
        ("\ufeff", "\r\n"),
        ("\ufeff", ""),
        ("", ""),
    ],
)
def test_new_vertices_come_before_the_first_edge(tmp_path: Path, head: str, tail: str) -> None:
    end = "\r\n" if "\r\n" in head + tail else "\n"
    edges = ["EDGE_SE2 0 5 1 0 0 1 0 0 1 0 1", "EDGE_SE2_XY 5 9 1 1 1 0 1"]
    text = head + end.join(edges) + tail
    graph = slamcli.read(str(write_file(tmp_path, text)))
    assert render(graph).data == text.encode()  # no estimates, nothing to write
    estimated = graph.with_values({"SE2": np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.5]]), "XY": np.array([[1.0, 2.5]])})
    new = ["VERTEX_SE2 0 0 0 0", "VERTEX_SE2 5 1 0 0.5", "VERTEX_XY 9 1 2.5"]
    data = render(estimated).data
    assert data.decode() == head + end.join(new + edges) + tail
    again = slamcli.read(str(write_file(tmp_path, data)))
    assert again.report is not None
    assert again.report.created == {}
    assert again.chi2() == estimated.chi2()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_nothing_is_written_of_a_graph_that_is_not_finite(tmp_path: Path, bad: float) -> None:
    graph = slamcli.read(str(write_file(tmp_path, "VERTEX_XY 4 1 1\nVERTEX_XY 6 1 1\n")))
    broken = graph.with_values({"XY": np.array([[1.0, 1.0], [bad, 1.0]])})
    with pytest.raises(NumericalError, match="vertex 6 is not finite"):
        slamcli.write(broken, str(tmp_path / "out.g2o"))
    assert not (tmp_path / "out.g2o").exists()
