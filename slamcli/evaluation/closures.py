"""Loop closures: which ones an estimate accepts, against labels that say which ones are false.

A closure is accepted if its chi2 at the estimate is below the gate, the quantile of the chi-square distribution with
as many degrees of freedom as its residual has; or if labels that came with the estimate call it an inlier. A closure
that the labels know and the estimate's graph no longer holds was rejected. "Positive" means accepted, so precision is
the share of true closures among the accepted ones and recall the share of accepted ones among the true closures.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.evaluation.consistency import chi2_quantile
from slamcli.formats.labels import Labels, edge_positions, outlier_masks
from slamcli.graph import FactorGraph, is_loop_closure
from slamcli.graph.columns import BoolArray, IdArray, IndexArray

#: Probability with which the gate lets a correct closure pass.
GATE = 0.99


@dataclass(frozen=True)
class ClosureScores:
    """How an estimate's choice of loop closures compares with labels.

    Attributes
    ----------
    true_positive, false_positive
        Accepted closures that the labels call inliers, outliers.
    true_negative, false_negative
        Rejected closures that the labels call outliers, inliers.
    absent
        How many of the rejected ones the estimate's graph does not hold.
    unlabelled
        Closures of the estimate that the labels do not name; they are not counted above.
    precision, recall, f1
        None where the quotient has no denominator.
    gate
        Probability that defines the largest accepted chi2.
    """

    true_positive: int
    false_positive: int
    true_negative: int
    false_negative: int
    absent: int
    unlabelled: int
    precision: float | None
    recall: float | None
    f1: float | None
    gate: float


@dataclass(frozen=True, eq=False)
class _Closures:
    """The loop closures of a graph: ids (c, 2) as in the file, positions among its edges, and which are accepted."""

    ids: IdArray
    position: IndexArray
    accepted: BoolArray


def closure_scores(
    graph: FactorGraph, labels: Labels, gate: float = GATE, estimated: Labels | None = None
) -> ClosureScores:
    """Compare the closures that an estimate accepts with labels.

    Labels that state the positions of as many edges as the graph has are matched by position if their ids agree;
    otherwise by pair of ids, in either direction, parallel edges in their order. Labels that list the outliers only
    call every other closure of the graph an inlier.

    Parameters
    ----------
    graph
        The estimate, at its own values.
    labels
        See ``formats.labels``.
    gate
        Probability between 0 and 1.
    estimated
        Labels that say which closures the estimate rejects; None: the gate says it.

    Raises
    ------
    InputError
        If the estimated labels belong to another graph.
    """
    closures = _closures(graph, gate, estimated)
    match, is_closure = _match(graph, closures, labels)
    found = match >= 0
    outlier = np.zeros(len(match), dtype=bool)
    outlier[found] = labels.outlier[match[found]]
    known = found | (not labels.complete)
    absent = is_closure.copy()
    absent[match[found]] = False
    accepted = closures.accepted
    tp = int(np.count_nonzero(known & accepted & ~outlier))
    fp = int(np.count_nonzero(known & accepted & outlier))
    tn = int(np.count_nonzero(known & ~accepted & outlier)) + int(np.count_nonzero(absent & labels.outlier))
    fn = int(np.count_nonzero(known & ~accepted & ~outlier)) + int(np.count_nonzero(absent & ~labels.outlier))
    precision = tp / (tp + fp) if tp + fp else None
    recall = tp / (tp + fn) if tp + fn else None
    f1 = 2 * tp / (2 * tp + fp + fn) if tp + fp + fn else None
    unlabelled = int(np.count_nonzero(~known))
    return ClosureScores(tp, fp, tn, fn, int(np.count_nonzero(absent)), unlabelled, precision, recall, f1, gate)


def _closures(graph: FactorGraph, gate: float, estimated: Labels | None) -> _Closures:
    ids, positions, accepted = [], [], []
    none = [None] * len(graph.factors)
    rejected = none if estimated is None else outlier_masks(estimated, graph, "the estimated labels")
    for factors, position, out in zip(graph.factors, edge_positions(graph), rejected, strict=True):
        mask = is_loop_closure(graph, factors)
        if mask.any():
            limit = chi2_quantile(factors.kind.dimension, gate)
            ids.append(factors.variable_ids(graph.variables)[mask][:, :2])
            positions.append(position[mask])
            accepted.append(factors.chi2(graph.values)[mask] <= limit if out is None else ~out[mask])
    if not ids:
        return _Closures(np.empty((0, 2), dtype=np.int64), np.empty(0, dtype=np.intp), np.empty(0, dtype=bool))
    return _Closures(np.concatenate(ids), np.concatenate(positions), np.concatenate(accepted))


def _match(graph: FactorGraph, closures: _Closures, labels: Labels) -> tuple[IndexArray, BoolArray]:
    """Row of the labels for each closure (-1: none), and which rows of the labels are about loop closures."""
    by_position = _by_position(graph, closures, labels)
    is_closure = _closure_rows(graph, labels)
    if by_position is not None:
        is_closure[by_position] = True
        return by_position, is_closure
    rows = np.flatnonzero(is_closure)
    wanted: dict[tuple[int, int], list[int]] = {}
    pairs = np.sort(np.stack([labels.first, labels.second], axis=1), axis=1)
    order = rows[np.argsort(labels.edge[rows], kind="stable")]
    for row, (a, b) in zip(order[::-1].tolist(), pairs[order[::-1]].tolist(), strict=True):
        wanted.setdefault((a, b), []).append(row)
    match = np.full(len(closures.ids), -1, dtype=np.intp)
    own = np.argsort(closures.position, kind="stable")
    for k, (a, b) in zip(own.tolist(), np.sort(closures.ids[own], axis=1).tolist(), strict=True):
        candidates = wanted.get((a, b))
        if candidates:
            match[k] = candidates.pop()
    return match, is_closure


def _by_position(graph: FactorGraph, closures: _Closures, labels: Labels) -> IndexArray | None:
    """Match by the position of the edge records, None if the labels belong to a file with other edges."""
    if len(labels) != graph.edges or not np.array_equal(np.sort(labels.edge), np.arange(1, graph.edges + 1)):
        return None
    row_of_edge = np.argsort(labels.edge)
    match = row_of_edge[closures.position - 1]
    named = np.stack([labels.first[match], labels.second[match]], axis=1)
    same = (np.sort(named, axis=1) == np.sort(closures.ids, axis=1)).all()
    return match if same else None


def _closure_rows(graph: FactorGraph, labels: Labels) -> BoolArray:
    """Which labels are about two poses of the graph that are not neighbours in the order of ids."""
    out = np.zeros(len(labels), dtype=bool)
    for column in graph.variables.values():
        if column.kind.is_pose and len(column):
            first = column.rows_of(labels.first.astype(column.ids.dtype))
            second = column.rows_of(labels.second.astype(column.ids.dtype))
            both = (first >= 0) & (second >= 0)
            out |= both & (np.abs(column.rank[first] - column.rank[second]) > 1)
    return out
