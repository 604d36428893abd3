"""chi2 of one edge of each tag, against g2o's own numbers where g2o knows the tag."""

import re
from pathlib import Path

import numpy as np
import pytest
from support import BUNDLED, EDGES, VARIABLES, VECTOR_EDGES, VECTOR_VARIABLES, vectors, write_file

import slamcli
from slamcli.formats.g2o import G2O
from slamcli.models import BAL_PROJECTION, FACTOR_KINDS, PROJECTION_KINDS


@pytest.mark.parametrize("edge", EDGES, ids=lambda edge: edge.split()[0])
def test_chi2_of_each_edge(tmp_path: Path, edge: str) -> None:
    graph = slamcli.read(str(write_file(tmp_path, f"{VARIABLES}{edge}\n")))
    assert graph.edges == 1
    assert graph.chi2() == pytest.approx(EDGES[edge], abs=6e-7, rel=0)


def test_the_vectors_hold_every_tag_and_every_kind(tmp_path: Path) -> None:
    graph = slamcli.read(str(write_file(tmp_path, vectors)))
    assert {factors.tag for factors in graph.factors} == {record.tag for record in G2O.edges}
    assert {factors.kind for factors in graph.factors} == {*FACTOR_KINDS, *PROJECTION_KINDS} - {BAL_PROJECTION}
    assert graph.report is not None
    assert not graph.report.skipped


def test_chi2_of_a_graph_is_the_sum_of_its_edges(tmp_path: Path) -> None:
    graph = slamcli.read(str(write_file(tmp_path, vectors)))
    assert graph.chi2() == pytest.approx(sum(EDGES.values()), abs=1e-5, rel=0)
    assert np.concatenate(graph.edge_chi2()).sum() == pytest.approx(graph.chi2(), rel=1e-14)


@pytest.mark.parametrize("name", ["manhattan_small.g2o", "sphere_small.g2o", "landmarks_small.g2o"])
def test_chi2_equals_g2opy_on_the_bundled_data_sets(name: str) -> None:
    assert slamcli.read(str(BUNDLED / name)).chi2() == pytest.approx(g2opy_chi2(BUNDLED / name), rel=1e-6)


def test_the_vectors_equal_g2opy(tmp_path: Path) -> None:
    lines = [*VECTOR_VARIABLES.splitlines(), *VECTOR_EDGES]
    text = "\n".join(map(with_unit_quaternion, lines)) + "\n"
    path = write_file(tmp_path, text)
    assert slamcli.read(str(path)).chi2() == pytest.approx(g2opy_chi2(path), rel=1e-12)


def with_unit_quaternion(line: str) -> str:
    """The record with its quaternion scaled to unit length, as slamcli and g2o master read it (g2opy does not)."""
    tag, *numbers = line.split()
    start = {"VERTEX_SE3:QUAT": 4, "EDGE_SE3:QUAT": 5, "EDGE_SE3_PRIOR": 5, "PARAMS_SE3OFFSET": 4}.get(tag)
    if start is not None:
        quaternion = np.array(numbers[start : start + 4], dtype=np.float64)
        numbers[start : start + 4] = map(repr, (quaternion / np.linalg.norm(quaternion)).tolist())
    return " ".join([tag, *numbers])


def g2opy_chi2(path: Path) -> float:
    g2o = pytest.importorskip("g2opy")
    optimizer = g2o.SparseOptimizer()
    optimizer.set_verbose(False)
    solver = g2o.BlockSolverX(g2o.LinearSolverEigenX())
    optimizer.set_algorithm(g2o.OptimizationAlgorithmGaussNewton(solver))
    assert optimizer.load(str(path))
    records = re.findall(r"^(?:EDGE|VERTEX)_\S+", path.read_text(), re.MULTILINE)
    assert len(optimizer.edges()) + len(optimizer.vertices()) == len(records)
    optimizer.initialize_optimization()
    optimizer.compute_active_errors()
    return float(optimizer.active_chi2())
