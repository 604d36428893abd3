"""What a robust run says about the closures that it rejected."""

import numpy as np
import pytest
from loop_worlds import world

from slamcli.formats import read, write
from slamcli.formats.labels import labels_of, outlier_masks, read_labels, write_labels
from slamcli.solver.optimize import optimize
from slamcli.solver.robust.rejection import of_kernel, rejected_edges, without_rejected


def test_rejected_edges_are_listed_by_chi2():
    w = world(0)
    result = optimize(w.graph, robust="gnc")
    edges = rejected_edges(result.graph, result.rejection)
    assert len(edges) == result.rejection.count == w.false.sum()
    assert [e.chi2 for e in edges] == sorted((e.chi2 for e in edges), reverse=True)
    assert {e.ids for e in edges} == {tuple(pair) for pair in w.graph.factors[0].indices[w.false].tolist()}
    assert all(e.weight == 0.0 for e in edges)


def test_the_graph_without_them_keeps_the_other_bytes(tmp_path):
    w = world(0)
    source, kept, labels = tmp_path / "source.g2o", tmp_path / "kept.g2o", tmp_path / "labels.csv"
    write(w.graph, str(source), comments=["a comment"])
    graph = read(str(source))
    result = optimize(graph, robust="gnc")
    write(without_rejected(result.graph, result.rejection), str(kept))
    before = [line for line in source.read_text().splitlines() if not line.startswith("VERTEX")]
    after = [line for line in kept.read_text().splitlines() if not line.startswith("VERTEX")]
    gone = {edge.line for edge in rejected_edges(result.graph, result.rejection)}
    vertices = len(source.read_text().splitlines()) - len(before)
    assert after == [line for k, line in enumerate(before) if k + vertices + 1 not in gone]
    assert read(str(kept)).chi2() == pytest.approx(result.final_chi2, rel=1e-9)
    write_labels(str(labels), *labels_of(result.graph, result.rejection.rejected))
    np.testing.assert_array_equal(outlier_masks(read_labels(str(labels)), graph)[0], w.false)


def test_a_kernel_rejects_what_is_beyond_the_gate():
    w = world(0)
    result = optimize(w.graph, kernel="dcs", kernel_width=5.0)
    found = of_kernel(result.graph, result.options, result.dof)
    assert found.rejected[0][w.false].all()
    assert (found.rejected[0] & ~w.false).sum() <= 2  # bent by what is left of the false ones
    assert found.method == "dcs"
    assert (found.weight[0][w.false] < 0.1).all()
    assert found.inlier_dof == result.dof - 3 * found.count


def test_switches_reject_what_they_switch_off():
    w = world(0)
    result = optimize(w.graph, robust="switchable")
    rejected = result.rejection.rejected[0]
    assert rejected[w.false].all()
    assert result.graph.variables.keys() == w.graph.variables.keys()
    np.testing.assert_array_equal(rejected, result.rejection.weight[0] < 0.5**2)
