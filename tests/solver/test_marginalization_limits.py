"""What marginalization refuses, and what it says of what it did."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from support import BUNDLED, write_file

from slamcli.cli.main import main
from slamcli.errors import InputError, NumericalError, UsageError
from slamcli.formats import read
from slamcli.graph import FactorGraph
from slamcli.reporting.marginalization import marginalize_summary, marginalize_warnings
from slamcli.solver.marginalization import (
    Reduction,
    compare,
    comparison,
    marginalize,
    reduction,
    removed_by,
    require_same_optimum,
)
from slamcli.solver.optimize import optimize


def reduce(graph: FactorGraph, keep: str | None = None, remove: str | None = None, **options: object) -> Reduction:
    return marginalize(graph, removed_by(graph, keep, remove)[0], **options)  # type: ignore[arg-type]


def test_rules(tmp_path: Path) -> None:
    graph = read(str(BUNDLED / "landmarks_small.g2o"))
    fixed = graph.with_fixed([3])
    removed, saved = removed_by(fixed, "every:10", None)
    assert saved == 1 and not removed["SE2"][graph.variables["SE2"].row_of(3)]
    assert int((~removed["SE2"]).sum()) == 11 and not removed["XY"].any()
    removed, saved = removed_by(fixed, None, "2-4")
    assert saved == 0 and int(removed["SE2"].sum()) == 3
    removed, _ = removed_by(graph, None, "every:10")
    assert int(removed["SE2"].sum()) == 10 and not removed["XY"].any()


@pytest.mark.parametrize(
    ("keep", "remove", "says"),
    [
        (None, None, "--keep RULE or --remove RULE"),
        ("0", "1", "--keep RULE or --remove RULE"),
        ("every:1", None, "whole number N of 2 or more"),
        ("every:x", None, "whole number"),
        ("5-2", None, "no range"),
        ("999999", None, "no variable has the id 999999"),
        ("0,x", None, "'x' is no id"),
        ("0-999", None, "removes nothing"),
        (None, "0-999", "removes everything"),
    ],
)
def test_rules_that_cannot_be_followed(keep: str | None, remove: str | None, says: str) -> None:
    graph = read(str(BUNDLED / "landmarks_small.g2o"))
    with pytest.raises(UsageError, match=says):
        removed_by(graph, keep, remove)


def test_what_no_factor_can_say_is_refused(tmp_path: Path) -> None:
    """A pose that sees three landmarks, and a kept pose elsewhere in the component that does not join them."""
    lines = ["VERTEX_SE2 0 0 0 0", "VERTEX_SE2 1 9 0 0", *(f"VERTEX_XY 1{k} {k} 1" for k in range(4))]
    lines += [f"EDGE_SE2_XY 0 1{k} {k} 1 1 0 1" for k in range(3)]
    lines += [f"EDGE_SE2_XY 1 1{k} {k - 9} 1 1 0 1" for k in range(2, 4)]
    graph = read(str(write_file(tmp_path, "".join(f"{line}\n" for line in lines))))
    with pytest.raises(InputError, match="joins 3 landmarks in a frame"):
        reduce(graph, remove="0")


def test_large_marginals_are_refused_with_a_way_out() -> None:
    with pytest.raises(UsageError, match="in 780 pairs") as caught:
        reduce(read(str(BUNDLED / "manhattan_small.g2o")), "every:10", largest_blanket=20)
    assert "--sparsify chow-liu" in caught.value.details[0]


def test_marginals_that_cannot_be_computed_are_named(tmp_path: Path) -> None:
    """No edge but the observations says anything: what is left has no frame."""
    lines = [f"VERTEX_SE2 {k} {k} 0 0" for k in range(4)] + ["VERTEX_XY 8 3 1", "VERTEX_XY 9 -1 1"]
    lines += [f"EDGE_SE2 {k} {k + 1} 1 0 0 0 0 0 0 0 0" for k in range(3)]
    lines += [f"EDGE_SE2_XY {k} {p} {x - k} 1 100 0 100" for k, p, x in ((1, 8, 3), (2, 8, 3), (0, 9, -1), (3, 9, -1))]
    graph = read(str(write_file(tmp_path, "".join(f"{line}\n" for line in lines))))
    with pytest.raises(NumericalError, match="marginal of 3 variables that cannot be computed") as caught:
        reduce(graph, remove="1")
    assert "SE2 0, SE2 2, XY 8" in caught.value.details[0]


def test_no_estimate_is_refused(tmp_path: Path) -> None:
    graph = read(str(write_file(tmp_path, "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\nEDGE_SE2 1 2 1 0 0 1 0 0 1 0 1\n")))
    with pytest.raises(InputError, match="3 variables have no estimate"):
        reduce(graph, remove="1")


def test_what_hangs_on_nothing_kept_goes_without_a_trace(tmp_path: Path) -> None:
    """The end of a chain says nothing of its start; another component neither."""
    lines = [f"VERTEX_SE2 {k} {k} 0 0" for k in range(5)]
    lines += [f"EDGE_SE2 {k} {k + 1} 1 0 0 1 0 0 1 0 1" for k in (0, 1, 3)]
    graph = read(str(write_file(tmp_path, "".join(f"{line}\n" for line in lines))))
    reduction = reduce(graph, "0,1")
    assert reduction.recovered_edges == 0 and reduction.graph.edges == 1
    assert reduction.detached == 2


def test_a_variable_that_joins_too_many_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The centre of a star: its marginal is dense, whatever is made of it."""
    monkeypatch.setattr(reduction, "LARGEST_ALONE", 5)
    lines = [f"VERTEX_SE2 {k} {k} 0 0" for k in range(9)]
    lines += [f"EDGE_SE2 0 {k} {k} 0 0 1 0 0 1 0 1" for k in range(1, 9)]
    graph = read(str(write_file(tmp_path, "".join(f"{line}\n" for line in lines))))
    with pytest.raises(UsageError, match="removing SE2 0 makes 8 variables depend on each other"):
        reduce(graph, remove="0", sparsification="chow-liu", largest_blanket=2)
    assert reduce(graph, remove="0", sparsification="chow-liu", largest_blanket=8).recovered_edges == 7


def test_large_graphs_are_told_the_shift_without_a_divergence(monkeypatch: pytest.MonkeyPatch) -> None:
    graph = optimize(read(str(BUNDLED / "landmarks_small.g2o")), tolerance=1e-14).graph
    reduced = reduce(graph, "poses-only", sparsification="chow-liu")
    whole = compare(graph, reduced)
    monkeypatch.setattr(comparison, "LARGEST", 10)
    part = compare(graph, reduced)
    assert whole is not None and part is not None
    assert part == replace(whole, divergence=None, sigma_ratio=None)
    assert 0.0 < part.shift_sigmas < 1.0 < part.shift_sigmas / part.shift
    assert "KLD        not computed" in "\n".join(
        marginalize_summary(graph, reduced, part, None, {"total": 1.0, "marginalize": 1.0})
    )


def test_a_graph_with_another_optimum_is_not_written() -> None:
    graph = optimize(read(str(BUNDLED / "landmarks_small.g2o")), tolerance=1e-14).graph
    reduced = reduce(graph, "every:10", sparsification="chow-liu")
    found = compare(graph, reduced)
    assert found is not None
    require_same_optimum(graph, found)
    assert marginalize_warnings(graph, reduced, found, 0) == []
    moved = replace(found, shift=2.0, shift_sigmas=1.0)
    require_same_optimum(graph, moved)
    assert "kept positions move by up to 2 m" in marginalize_warnings(graph, reduced, moved, 0)[0]
    with pytest.raises(NumericalError, match="nothing is written"):
        require_same_optimum(graph, replace(moved, shift_sigmas=3.1))
    require_same_optimum(graph, replace(moved, shift_sigmas=9.0, predicted_decrease=1.0))  # no optimum to keep


def test_all_of_a_kind_is_held(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (
        "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nVERTEX_XY 5 1 1\nFIX 0 1\n"
        "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\nEDGE_SE2_XY 0 5 1 1 1 0 1\n"
    )
    path = write_file(tmp_path, text)
    assert main(["marginalize", str(path), "--remove", "0"]) == 0
    assert "each of 2 dimensions" in capsys.readouterr().out


def test_the_input_is_not_overwritten(tmp_path: Path) -> None:
    path = write_file(tmp_path, (BUNDLED / "manhattan_small.g2o").read_bytes())
    assert main(["marginalize", str(path), "--remove", "5", "-o", str(path)]) == 2
    assert path.read_bytes() == (BUNDLED / "manhattan_small.g2o").read_bytes()
