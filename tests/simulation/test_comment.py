"""The comment that says what a file was simulated from hides nothing from other readers."""

from pathlib import Path

import pytest

from slamcli.cli.main import main
from slamcli.formats import read

SIMULATE = "simulate {world} --poses 30 --set closures.count=8 --seed 1 -q -o {path}"


def simulated(world: str, path: Path) -> Path:
    assert main(SIMULATE.format(world=world, path=path).split()) == 0
    return path


def lines_of(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8").splitlines()


def test_the_comment_is_the_last_line(tmp_path: Path) -> None:
    lines = lines_of(simulated("manhattan", tmp_path / "made.g2o"))
    assert [line for line in lines if line.startswith("#")] == lines[-1:]
    assert "manhattan" in lines[-1]


def test_records_that_are_added_come_before_it(tmp_path: Path) -> None:
    """Also those of a command that edits the text."""
    source, spoiled = simulated("manhattan", tmp_path / "made.g2o"), tmp_path / "spoiled.g2o"
    assert main(["inject", str(source), "--false-closures", "3", "--seed", "1", "-q", "-o", str(spoiled)]) == 0
    before, after = lines_of(source), lines_of(spoiled)
    assert after[: len(before) - 1] == before[:-1]
    assert after[-1] == before[-1]
    assert len(after) == len(before) + 3
    assert read(str(spoiled)).edges == read(str(source)).edges + 3


@pytest.mark.parametrize(("world", "spatial"), [("manhattan", False), ("sphere", True)])
def test_gtsam_reads_all_edges(world: str, spatial: bool, tmp_path: Path) -> None:
    gtsam = pytest.importorskip("gtsam")
    path = simulated(world, tmp_path / "made.g2o")
    factors, values = gtsam.readG2o(str(path), spatial)
    graph = read(str(path))
    assert (factors.size(), values.size()) == (graph.edges, graph.poses)


def test_gtsam_reads_all_edges_of_an_injected_graph(tmp_path: Path) -> None:
    gtsam = pytest.importorskip("gtsam")
    source, spoiled = simulated("manhattan", tmp_path / "made.g2o"), tmp_path / "spoiled.g2o"
    assert main(["inject", str(source), "--false-closures", "3", "--seed", "1", "-q", "-o", str(spoiled)]) == 0
    factors, _ = gtsam.readG2o(str(spoiled), False)
    assert factors.size() == read(str(spoiled)).edges


def test_g2o_reads_all_edges(tmp_path: Path) -> None:
    g2o = pytest.importorskip("g2opy")
    path = simulated("manhattan", tmp_path / "made.g2o")
    optimizer = g2o.SparseOptimizer()
    assert optimizer.load(str(path))
    graph = read(str(path))
    assert (len(optimizer.edges()), len(optimizer.vertices())) == (graph.edges, graph.poses)
