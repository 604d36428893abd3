"""What people read: every number of a summary is that of the result."""

from pathlib import Path

import pytest
from support import BUNDLED, write_file

import slamcli
from slamcli.graph import analyze
from slamcli.graph.describe import WorstEdge, describe, worst_edges
from slamcli.reporting import optimization, summaries, text
from slamcli.solver.certificate import CertifiedRun
from slamcli.solver.result import Result

TIME = {"load": 0.0125, "setup": 0.1, "iterate": 0.2, "write": 1.5, "total": 2.0}


def summary(graph: slamcli.FactorGraph, result: Result, colour: bool = False) -> str:
    run = CertifiedRun("g2o", result, result.graph)
    return "\n".join(optimization.optimize_summary(graph, analyze(graph), run, [], TIME, 42.4, "out.g2o", colour))


def test_summary_of_an_optimization() -> None:
    graph = slamcli.read(str(BUNDLED / "landmarks_small.g2o"))
    result = slamcli.optimize(graph)
    out = summary(graph, result)
    assert "2-D, 100 poses, 35 landmarks, 407 edges (0 loop closures), 1 component" in out
    assert f"{result.initial_chi2:.6f} -> {result.final_chi2:.6f} in {result.iterations} iterations" in out
    assert f"{result.final_chi2 / 450:.6g} (450 degrees of freedom)" in out
    assert f"converged: {result.reason}" in out
    assert "lowest id held: 0" in out
    sparsity = result.sparsity
    assert sparsity is not None
    assert f"{sparsity.dimension} x {sparsity.dimension}, {sparsity.nnz_hessian} nonzeros" in out
    assert f"{sparsity.nnz_factor} nonzeros, fill-in {sparsity.fill_in:.2f}, 68.7 kflop, ordering amd" in out
    assert "2.00 s: load 12.5 ms, setup 100.0 ms, iterate 200.0 ms, write 1.50 s" in out
    assert "written   out.g2o" in out
    assert "42 MB at the peak" in out
    assert "\x1b" not in out


def test_colour_follows_the_status() -> None:
    graph = slamcli.read(str(BUNDLED / "square_toro.graph"))
    done, short = slamcli.optimize(graph), slamcli.optimize(graph, max_iterations=1)
    assert "\x1b[32mconverged\x1b[0m" in summary(graph, done, colour=True)
    assert "\x1b[33mnot converged\x1b[0m" in summary(graph, short, colour=True)
    assert "in 1 iteration\n" in summary(graph, short)


def test_held_ids_are_cut_short() -> None:
    graph = slamcli.read(str(BUNDLED / "square_toro.graph"))
    out = summary(graph, slamcli.optimize(graph, fix=range(12)))
    assert ": 0, 1, 2, 3, 4, 5, 6, 7, ...\n" in out


def test_skipped_records_are_counted(tmp_path: Path) -> None:
    content = "FOO 1\nFOO 2\nBAR x\nVERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 bad\n"
    content += "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\nEDGE_SE2 0 2 1 0 0 1 0 0 1 0 1\n"
    graph = slamcli.read(str(write_file(tmp_path, content)), lenient=True)
    out = summary(graph, slamcli.optimize(graph))
    row = next(line for line in out.splitlines() if line.startswith("skipped"))
    assert all(part in row for part in ("FOO 2", "BAR 1", "1 malformed"))
    warnings = "\n".join(summaries.reading_warnings(graph.report))
    assert "2 FOO records skipped" in warnings
    assert "graph.g2o:6:" in warnings
    assert "edges name: 1 SE2" in warnings
    assert summaries.reading_warnings(None) == []


def test_description() -> None:
    graph = slamcli.read(str(BUNDLED / "landmarks_small.g2o"))
    assert graph.document is not None
    out = "\n".join(summaries.info_summary(graph, describe(graph)))
    assert graph.document.sha256 in out
    assert f"{graph.chi2():.6f} at these values" in out
    assert "370 unknowns, 817 residuals" in out
    rows = {line.split()[0]: line.split() for line in out.splitlines() if line}
    assert rows["EDGE_BEARING_SE2_XY"][1] == "96"
    assert rows["XY"][1:5] == ["35", "100", "to", "134"]


def test_description_of_a_graph_without_estimates(tmp_path: Path) -> None:
    graph = slamcli.read(str(write_file(tmp_path, "EDGE_SE2 0 5 1 0 0 1 0 0 1 0 1\n")))
    out = "\n".join(summaries.info_summary(graph, describe(graph)))
    assert "unknown: not every variable has an estimate" in out
    assert "with gaps" in out


def test_worst_edges_are_listed_with_their_lines() -> None:
    graph = slamcli.read(str(BUNDLED / "square_toro.graph"))
    edges = worst_edges(graph, 3)
    lines = summaries.worst_table(edges)
    assert "3 edges with the largest chi2" in lines[1]
    for edge, line in zip(edges, lines[3:], strict=True):
        assert line.split()[:5] == [f"{edge.chi2:.6g}", str(edge.line), "EDGE2", *map(str, edge.ids)]
    assert summaries.worst_table([]) == []
    assert "the 1 edge " in summaries.worst_table([WorstEdge("T", (1, 2), 0, 1.0, (0.5,))])[1]


@pytest.mark.parametrize(
    ("value", "wanted"),
    [(0.0, "0.0 ms"), (0.01234, "12.3 ms"), (0.9994, "999.4 ms"), (1.0, "1.00 s"), (75.129, "75.13 s")],
)
def test_durations(value: float, wanted: str) -> None:
    assert text.seconds(value) == wanted


@pytest.mark.parametrize(
    ("value", "wanted"),
    [
        (0, "0 flop"),
        (19, "19 flop"),
        (999, "999 flop"),
        (1234, "1.23 kflop"),
        (1.53e6, "1.53 Mflop"),
        (2.5e9, "2.5 Gflop"),
        (7.77e12, "7.77 Tflop"),
    ],
)
def test_counts(value: float, wanted: str) -> None:
    assert text.count(value, "flop") == wanted


def test_tables_are_aligned() -> None:
    rows = [("a", "1", "x"), ("long", "22", "y")]
    assert text.table(rows, "<><") == ["a      1  x", "long  22  y"]
    assert text.table([("a", ""), ("b", "")], "<<") == ["a", "b"]  # no blanks at line ends


def test_plural_and_colour() -> None:
    assert [text.plural(n, "edge") for n in (0, 1, 2)] == ["0 edges", "1 edge", "2 edges"]
    assert text.coloured("x", "red", on=False) == "x"
    assert text.coloured("x", "red", on=True) == "\x1b[31mx\x1b[0m"
