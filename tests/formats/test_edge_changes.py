"""Edges that were added, changed or removed are written; every other byte stays."""

from dataclasses import replace
from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from numpy.testing import assert_array_equal
from support import BUNDLED, vectors, write_file

import slamcli
from slamcli import models
from slamcli.formats import render, writer
from slamcli.graph import FactorGraph, Factors

of_file = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=30)
bundled = pytest.mark.parametrize("path", sorted(BUNDLED.glob("*.g*")), ids=lambda path: path.name)
SMALL = (
    "# map\r\nVERTEX_SE2 0 0 0 0\r\nEDGE_SE2 0 1 1.0 0 0 1 0 0 1 0 1 # odometry\r\nUNKNOWN ,\r\nVERTEX_SE2 1 1 0 0\r\n"
)


def with_column(graph: FactorGraph, k: int, factors: Factors) -> FactorGraph:
    columns = list(graph.factors)
    columns[k] = factors
    return replace(graph, factors=columns)


def added(graph: FactorGraph, k: int, rows: list[int]) -> FactorGraph:
    """The graph with copies of some edges of a column as new edges."""
    whole, new = graph.factors[k], graph.factors[k].part(np.array(rows, dtype=np.intp))
    both = {
        name: np.concatenate([getattr(whole, name), getattr(new, name)])
        for name in ("indices", "measurements", "information")
    }
    lines = np.concatenate([whole.lines, np.zeros(len(rows), dtype=np.intp)])
    return with_column(graph, k, replace(whole, **both, lines=lines))  # type: ignore[arg-type]


def edges_of(graph: FactorGraph) -> list[tuple[str, list[list[int]], list[list[float]], list[object]]]:
    return [
        (f.tag, f.variable_ids(graph.variables).tolist(), f.measurements.tolist(), f.information.tolist())
        for f in graph.factors
    ]


@bundled
@of_file
@given(data=st.data())
def test_any_mixture_of_changes(tmp_path: Path, path: Path, data: st.DataObject) -> None:
    """Lines that are not touched are the same bytes; what is read back is the graph that was written."""
    graph = slamcli.read(str(path))
    k = data.draw(st.integers(0, len(graph.factors) - 1))
    column = graph.factors[k]
    rows = st.lists(st.integers(0, len(column) - 1), max_size=5, unique=True)
    new, changed, gone = data.draw(rows), data.draw(rows), data.draw(rows)
    edited = added(graph, k, new)
    information = edited.factors[k].information.copy()
    information[changed] *= 3.0
    keep = np.setdiff1d(np.arange(len(information)), gone)
    edited = with_column(edited, k, replace(edited.factors[k], information=information).part(keep))
    text = render(edited).data
    touched = {int(column.lines[row]) for row in [*changed, *gone]}
    before = path.read_bytes().splitlines(keepends=True)
    after = set(text.splitlines(keepends=True))
    assert all(line in after for number, line in enumerate(before, 1) if number not in touched)
    assert len(text.splitlines()) == len(before) + len(new) - len(gone)
    again = slamcli.read(str(write_file(tmp_path, text)))
    for one, two in zip(again.factors, edited.factors, strict=True):
        assert_array_equal(one.variable_ids(again.variables), two.variable_ids(edited.variables))
        # quaternions are normalized on reading, and toro states the information in another frame
        np.testing.assert_allclose(one.measurements, two.measurements, rtol=0, atol=1e-14)
        np.testing.assert_allclose(one.information, two.information, rtol=1e-14, atol=1e-11)


@bundled
def test_rebuilt_columns_with_the_same_numbers_change_nothing(path: Path) -> None:
    graph = slamcli.read(str(path))
    copies = [f.part(np.arange(len(f))) for f in graph.factors]
    assert render(replace(graph, factors=copies)).data == path.read_bytes()
    halves = [f.part(s) for f in graph.factors for s in (slice(0, len(f) // 2), slice(len(f) // 2, None))]
    assert render(replace(graph, factors=halves)).data == path.read_bytes()


def test_untouched_factors_are_not_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    """Writing an optimized graph must not take longer for its edges."""
    graph = slamcli.read(str(BUNDLED / "manhattan_small.g2o"))
    monkeypatch.setattr(writer, "_differ", None)
    monkeypatch.setattr(writer, "_edge_records", None)
    moved = graph.with_values({name: values + 0.25 for name, values in graph.values.items()})
    assert render(moved).data != render(graph).data


@pytest.mark.parametrize("tail", ["\r\n", ""])
def test_new_edges_come_at_the_end(tmp_path: Path, tail: str) -> None:
    text = SMALL.removesuffix("\r\n") + tail
    graph = slamcli.read(str(write_file(tmp_path, text)))
    assert render(added(graph, 0, [0])).data.decode() == SMALL + "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\r\n"


def test_changed_and_removed_edges(tmp_path: Path) -> None:
    graph = slamcli.read(str(write_file(tmp_path, SMALL)))
    column = graph.factors[0]
    doubled = with_column(graph, 0, replace(column, information=2.0 * column.information))
    assert render(doubled).data.decode() == SMALL.replace("1.0 0 0 1 0 0 1 0 1 #", "1 0 0 2 0 0 2 0 2 #")
    turned = with_column(graph, 0, replace(column, indices=column.indices[:, ::-1]))
    assert "EDGE_SE2 1 0 1 0 0 1 0 0 1 0 1 # odometry\r\n" in render(turned).data.decode()
    without = SMALL.replace("EDGE_SE2 0 1 1.0 0 0 1 0 0 1 0 1 # odometry\r\n", "")
    assert render(replace(graph, factors=[])).data.decode() == without
    assert render(with_column(graph, 0, column.part(slice(0, 0)))).data.decode() == without


def test_new_vertices_and_new_edges_of_a_file_without_edges(tmp_path: Path) -> None:
    graph = slamcli.read(str(write_file(tmp_path, "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0")))
    column = graph.variables["SE2"]
    more = column.followed_by(replace(column, ids=column.ids + 2, lines=0 * column.lines))
    edge = Factors(models.RELATIVE_POSE_2D, np.array([[1, 2]]), np.array([[1.0, 0.0, 0.0]]), np.eye(3)[None])
    text = render(replace(graph, variables={"SE2": more}, factors=[edge])).data.decode()
    vertices = ["VERTEX_SE2 0 0 0 0", "VERTEX_SE2 1 1 0 0", "VERTEX_SE2 2 0 0 0", "VERTEX_SE2 3 1 0 0"]
    assert text.splitlines() == [*vertices, "EDGE_SE2 1 2 1 0 0 1 0 0 1 0 1"]


@pytest.mark.parametrize(("name", "other"), [("manhattan_small.g2o", "toro"), ("square_toro.graph", "g2o")])
def test_the_other_dialect_has_the_same_edges(tmp_path: Path, name: str, other: str) -> None:
    graph = slamcli.read(str(BUNDLED / name))
    column = graph.factors[0]
    information = column.information.copy()
    information[3] *= 2.0
    edited = added(with_column(graph, 0, replace(column, information=information).part(slice(1, None))), 0, [5, 7])
    again = slamcli.read(str(write_file(tmp_path, render(edited, other).data)))
    assert_array_equal(again.factors[0].indices, edited.factors[0].indices)
    np.testing.assert_allclose(again.factors[0].information, edited.factors[0].information, rtol=1e-13, atol=1e-10)
    assert render(edited, other).data.count(b"\n") == render(graph, other).data.count(b"\n") + 1


def test_an_edge_keeps_its_own_tag(tmp_path: Path) -> None:
    """TORO has two tags for one kind of edge."""
    text = "VERTEX2 0 0 0 0\nVERTEX2 1 1 0 0\nEDGE 0 1 1 0 0 1 0 1 1 0 0\nEDGE2 0 1 1 0 0 1 0 1 1 0 0\n"
    graph = slamcli.read(str(write_file(tmp_path, text)))
    tags = [factors.tag for factors in graph.factors]
    doubled = [replace(factors, information=2.0 * factors.information) for factors in graph.factors]
    assert render(replace(graph, factors=doubled)).data.decode() == text.replace("1 0 1 1 0 0\n", "2 0 2 2 0 0\n")
    more = render(added(graph, tags.index("EDGE"), [0])).data.decode()
    assert more == text + "EDGE 0 1 1 0 0 1 0 1 1 0 0\n"


def test_all_kinds_can_be_added_and_changed(tmp_path: Path) -> None:
    graph = slamcli.read(str(write_file(tmp_path, vectors)))
    double = [replace(f, information=2.0 * f.information) for f in graph.factors]
    again = slamcli.read(str(write_file(tmp_path, render(replace(graph, factors=double)).data)))
    assert again.chi2() == pytest.approx(2.0 * graph.chi2(), rel=1e-12)
    new = [replace(f, lines=0 * f.lines) for f in graph.factors]
    again = slamcli.read(str(write_file(tmp_path, render(replace(graph, factors=graph.factors + new)).data)))
    assert again.chi2() == pytest.approx(2.0 * graph.chi2(), rel=1e-12)
    assert again.edges == 2 * graph.edges


def test_what_the_dialect_of_the_file_lacks_is_said() -> None:
    graph = slamcli.read(str(BUNDLED / "square_toro.graph"))
    prior = Factors(models.POSE_PRIOR_2D, np.array([[0]]), np.zeros((1, 3)), np.eye(3)[None])
    rendered = render(replace(graph, factors=[*graph.factors, prior]))
    assert rendered.losses == ["1 pose_prior_2d edges: toro has no such edge"]


def test_lines_must_be_those_of_the_source() -> None:
    graph = slamcli.read(str(BUNDLED / "square_toro.graph"))
    for lines in (graph.factors[0].lines + 100_000, np.full_like(graph.factors[0].lines, graph.factors[0].lines[0])):
        with pytest.raises(ValueError, match="lines"):
            render(with_column(graph, 0, replace(graph.factors[0], lines=lines)))
