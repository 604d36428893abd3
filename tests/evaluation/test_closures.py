"""Loop closures against labels: counts worked by hand, however the labels name the edges."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import dataset, write_file

from slamcli.evaluation import EvaluateOptions, evaluate
from slamcli.evaluation.closures import closure_scores
from slamcli.formats import read
from slamcli.formats.labels import Labels, read_labels
from slamcli.graph import FactorGraph
from slamcli.graph.trajectory import of_graph

INFO = "1 0 0 1 0 1"
VERTICES = "".join(f"VERTEX_SE2 {k} {k} 0 0\n" for k in range(6))
ODOMETRY = [f"EDGE_SE2 {k} {k + 1} 1 0 0 {INFO}\n" for k in range(5)]
#: Ids, the measured x of each closure (the right one is the difference of the ids), and whether it is an outlier.
CLOSURES = [((0, 2), 2.0, False), ((0, 3), 9.0, True), ((1, 4), 8.0, False), ((5, 2), -3.1, True), ((0, 2), 2.5, False)]
#: chi2 is 0, 36, 25, 0.01 and 0.25; with a gate of 99 % (11.34) the second and third are rejected.
COUNTS = (2, 1, 1, 1)  # TP FP TN FN


def graph_of(tmp_path: Path, closures: list[int]) -> FactorGraph:
    lines = [f"EDGE_SE2 {CLOSURES[k][0][0]} {CLOSURES[k][0][1]} {CLOSURES[k][1]} 0 0 {INFO}\n" for k in closures]
    return read(str(write_file(tmp_path, VERTICES + "".join(ODOMETRY + lines))))


def labels_of(order: list[int], stated: bool = True) -> Labels:
    """Complete labels of the graph with all closures; the odometry comes first."""
    pairs = [(k, k + 1) for k in range(5)] + [CLOSURES[k][0] for k in order]
    outlier = [False] * 5 + [CLOSURES[k][2] for k in order]
    ids = np.array(pairs, dtype=np.int64)
    edge = np.arange(1, len(pairs) + 1) if stated else np.zeros(len(pairs), dtype=np.intp)
    return Labels(ids[:, 0], ids[:, 1], np.array(outlier), edge, True)


def counts(graph: FactorGraph, labels: Labels, gate: float = 0.99) -> tuple[int, int, int, int]:
    found = closure_scores(graph, labels, gate)
    return found.true_positive, found.false_positive, found.true_negative, found.false_negative


def test_counts_by_hand(tmp_path: Path) -> None:
    found = closure_scores(graph_of(tmp_path, [0, 1, 2, 3, 4]), labels_of([0, 1, 2, 3, 4]))
    assert (found.true_positive, found.false_positive, found.true_negative, found.false_negative) == COUNTS
    assert (found.precision, found.recall, found.f1) == (pytest.approx(2 / 3),) * 3
    assert (found.absent, found.unlabelled) == (0, 0)


def test_labels_by_pair_and_position_agree(tmp_path: Path) -> None:
    graph = graph_of(tmp_path, [0, 1, 2, 3, 4])
    assert counts(graph, labels_of([0, 1, 2, 3, 4], stated=False)) == COUNTS
    assert counts(graph, labels_of([3, 2, 1, 0, 4], stated=False)) == COUNTS
    # positions of another file: the ids do not fit, so the pairs count
    assert counts(graph, labels_of([3, 2, 1, 0, 4])) == COUNTS


def test_closures_that_were_left_out_are_rejected(tmp_path: Path) -> None:
    """As a robust solver writes its result: the third (a true one) and the fourth (a false one) are gone."""
    found = closure_scores(graph_of(tmp_path, [0, 1, 4]), labels_of([0, 1, 2, 3, 4]))
    assert (found.true_positive, found.false_positive, found.true_negative, found.false_negative) == (2, 0, 2, 1)
    assert found.absent == 2
    assert (found.precision, found.recall) == (1.0, pytest.approx(2 / 3))


def test_lists_of_outliers_only(tmp_path: Path) -> None:
    graph = graph_of(tmp_path, [0, 1, 2, 3, 4])
    path = write_file(tmp_path, "# false\n0 3\n2 5\n", "false.txt")
    assert counts(graph, read_labels(str(path))) == COUNTS
    shorter = closure_scores(graph_of(tmp_path, [0, 2]), read_labels(str(path)))
    assert (shorter.true_positive, shorter.true_negative, shorter.false_negative, shorter.absent) == (1, 2, 1, 2)


def test_closures_without_label_are_not_counted(tmp_path: Path) -> None:
    found = closure_scores(graph_of(tmp_path, [0, 1, 2, 3, 4]), labels_of([0, 1]))
    assert found.unlabelled == 3
    assert (found.true_positive, found.true_negative) == (1, 1)


def test_parallel_closures_go_by_their_order(tmp_path: Path) -> None:
    """Two edges between the same poses: the second one, off by half a metre, is the outlier."""
    labels = labels_of([0, 4], stated=False)
    outlier = labels.outlier.copy()
    outlier[-1] = True
    graph = graph_of(tmp_path, [0, 4])
    assert counts(graph, replace(labels, outlier=outlier), gate=0.01) == (1, 0, 1, 0)
    assert counts(graph, replace(labels, outlier=outlier[::-1].copy()), gate=0.01) == (1, 0, 0, 1)


def test_the_gate(tmp_path: Path) -> None:
    graph, labels = graph_of(tmp_path, [0, 1, 2, 3, 4]), labels_of([0, 1, 2, 3, 4])
    assert counts(graph, labels, gate=1.0 - 1e-12) == (3, 2, 0, 0)  # everything passes
    assert counts(graph, labels, gate=0.01) == (1, 1, 1, 2)  # chi2 below 0.115


def test_nothing_accepted_has_no_precision(tmp_path: Path) -> None:
    found = closure_scores(graph_of(tmp_path, [1]), labels_of([1]))
    assert (found.precision, found.recall, found.f1) == (None, None, None)
    none = closure_scores(graph_of(tmp_path, []), labels_of([]))
    assert (none.true_positive, none.true_negative, none.f1) == (0, 0, None)


@given(st.permutations([0, 1, 2, 3, 4]))
def test_the_order_of_edges_does_not_matter(tmp_path_factory: pytest.TempPathFactory, order: list[int]) -> None:
    """Unless two closures join the same poses: those are told apart by their order."""
    order = [k for k in order if k != 4]
    graph = graph_of(tmp_path_factory.mktemp("closures"), order)
    assert counts(graph, labels_of([0, 1, 2, 3])) == (1, 1, 1, 1)


def test_estimates_without_closures_say_so(tmp_path: Path) -> None:
    vertices = read(str(write_file(tmp_path, VERTICES)))
    evaluation = evaluate([of_graph(vertices, "truth.g2o")], labels=labels_of([0]))
    assert evaluation.estimates[0].closures is None
    assert evaluation.notes == ["truth.g2o: holds no edges, so no loop closures"]


@pytest.mark.datasets
def test_one_hundred_false_closures() -> None:
    """Odometry alone rejects all of them, with many true ones: 100 outliers among 2 054 closures."""
    graph = read(str(dataset("outliers/M3500_false100_random_seed1.g2o")))
    labels = read_labels(str(dataset("outliers/M3500_false100_random_seed1.labels.txt")))
    found = evaluate([of_graph(graph)], labels=labels, options=EvaluateOptions(gate=0.99)).estimates[0].closures
    assert found is not None
    assert found.true_negative + found.false_positive == 100
    assert found.true_positive + found.false_negative == 1954
    assert found.unlabelled == found.absent == 0
