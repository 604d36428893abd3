"""Landmark errors: distances between the landmarks of two graphs that have the same id."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.evaluation.alignment import Alignment
from slamcli.evaluation.association import match_ids
from slamcli.evaluation.errors import Statistics, statistics
from slamcli.graph import FactorGraph
from slamcli.graph.columns import IdArray
from slamcli.models.base import Array


@dataclass(frozen=True)
class LandmarkErrors:
    """Errors of the landmarks.

    Attributes
    ----------
    matched
        Landmarks that both graphs have.
    unmatched_estimate, unmatched_truth
        Landmarks that only one of them has.
    error
        Statistics of the distances in metres, None if nothing matched.
    """

    matched: int
    unmatched_estimate: int
    unmatched_truth: int
    error: Statistics | None


def landmark_errors(
    estimate: FactorGraph | None, truth: FactorGraph | None, alignment: Alignment
) -> LandmarkErrors | None:
    """Errors of the landmarks after the alignment of the poses; None where one of the two has no landmarks."""
    if estimate is None or truth is None:
        return None
    ids, points = landmarks(estimate)
    true_ids, true_points = landmarks(truth)
    if len(ids) == 0 or len(true_ids) == 0:
        return None
    rows, true_rows = match_ids(ids, true_ids)
    error = None
    if len(rows):
        difference = alignment.points(points[rows]) - true_points[true_rows]
        error = statistics(np.sqrt(np.square(difference).sum(axis=1)))
    return LandmarkErrors(len(rows), len(ids) - len(rows), len(true_ids) - len(rows), error)


def landmarks(graph: FactorGraph) -> tuple[IdArray, Array]:
    """Ids (n,) and positions (n, 3) of the points that have a value, planar ones in z = 0."""
    ids: list[IdArray] = []
    points: list[Array] = []
    for column in graph.variables.values():
        if column.kind.is_point:
            lifted = np.zeros((int(column.known.sum()), 3))
            lifted[:, : column.kind.space] = column.values[column.known, : column.kind.space]
            ids.append(column.ids[column.known])
            points.append(lifted)
    if not ids:
        return np.empty(0, dtype=np.int64), np.empty((0, 3))
    return np.concatenate(ids), np.concatenate(points)
