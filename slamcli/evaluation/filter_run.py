"""How good and how honest a run of the filter is: NIS, and with the truth NEES, ATE and landmark errors."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from slamcli.errors import NumericalError
from slamcli.evaluation.alignment import Alignment
from slamcli.evaluation.consistency import chi2_band
from slamcli.evaluation.evaluate import evaluate
from slamcli.evaluation.landmarks import LandmarkErrors, landmark_errors
from slamcli.evaluation.result import EstimateResult, EvaluateOptions
from slamcli.filtering.estimate import estimated_graph, estimated_trajectory
from slamcli.filtering.result import EkfResult
from slamcli.formats.covariances import Covariances
from slamcli.graph import FactorGraph, Variables
from slamcli.graph.columns import IdArray
from slamcli.graph.sensor_log import SensorLog
from slamcli.graph.trajectory import Trajectory
from slamcli.models import SE2, XY
from slamcli.models.base import Array

#: Probability of the bands.
CONFIDENCE = 0.95


@dataclass(frozen=True, eq=False)
class FilterScores:
    """Scores of a run.

    Attributes
    ----------
    nis_mean
        NIS of all updates over their degrees of freedom; 1 is expected. None without updates.
    nis_band
        In which it lies with a probability of 95 %.
    nis_inside
        Share of the updates whose own NIS is within its 95 % band.
    against_truth
        ATE, landmark errors and NEES without any alignment; None without a truth in the frame of the log.
    aligned
        ATE and landmark errors after the rigid motion that fits the positions best: the shape of path and map alone.
        None without a truth, or where the positions do not determine that motion.
    landmarks
        Landmark errors as they are, where the truth of the landmarks is known and that of the path is not; else None.
    """

    nis_mean: float | None
    nis_band: tuple[float, float] | None
    nis_inside: float | None
    against_truth: EstimateResult | None
    aligned: EstimateResult | None
    landmarks: LandmarkErrors | None = None


def judge(result: EkfResult, log: SensorLog) -> FilterScores:
    """Scores of a run of the filter on a log.

    Raises
    ------
    InputError
        If the log has a truth of which no pose belongs to one of the log's.
    """
    mean, band, inside = _nis(result)
    truth = true_trajectory(log)
    if truth is None:
        return FilterScores(mean, band, inside, None, None, _landmarks_alone(result, log))
    estimate = estimated_trajectory(result, log.source)
    within = matching_interval(truth)
    fitted: EstimateResult | None = None
    with suppress(NumericalError):  # all positions in one point, or on one line in space
        found = evaluate([estimate], truth, options=EvaluateOptions(align="se", max_time_difference=within))
        fitted = found.estimates[0]
    if log.positions_only:
        return FilterScores(mean, band, inside, None, fitted)
    plain = evaluate(
        [estimate],
        truth,
        options=EvaluateOptions(align="none", max_time_difference=within),
        covariances=Covariances(result.ids, result.covariances) if truth.kind is SE2 else None,
    )
    return FilterScores(mean, band, inside, plain.estimates[0], fitted)


def true_trajectory(log: SensorLog) -> Trajectory | None:
    """The truth of a log, its landmarks in the graph of the trajectory."""
    truth = log.true_trajectory
    if truth is None or log.true_landmarks is None or truth.graph is not None:
        return truth
    return Trajectory(truth.kind, truth.poses, truth.ids, truth.stamps, truth.source, _map(*log.true_landmarks))


def _map(ids: IdArray, positions: Array) -> FactorGraph:
    """A graph of landmarks alone."""
    count = len(ids)
    flags = {"fixed": np.zeros(count, dtype=bool), "known": np.ones(count, dtype=bool)}
    column = Variables(kind=XY, ids=ids, values=positions, lines=np.zeros(count, dtype=np.intp), **flags)
    return FactorGraph({XY.name: column}, [])


def _landmarks_alone(result: EkfResult, log: SensorLog) -> LandmarkErrors | None:
    """Errors of the landmarks without those of the path."""
    if log.true_landmarks is None:
        return None
    still = Alignment("none", np.eye(3), np.zeros(3))
    return landmark_errors(estimated_graph(result), _map(*log.true_landmarks), still)


def _nis(result: EkfResult) -> tuple[float | None, tuple[float, float] | None, float | None]:
    updates = result.updates
    freedom = int(updates.degrees_of_freedom.sum())
    if freedom == 0:
        return None, None, None
    low, high = chi2_band(freedom, CONFIDENCE)
    within = 0
    for size in np.unique(updates.degrees_of_freedom).tolist():
        below, above = chi2_band(size, CONFIDENCE)
        nis = updates.nis[updates.degrees_of_freedom == size]
        within += int(np.count_nonzero((nis >= below) & (nis <= above)))
    return float(updates.nis.sum()) / freedom, (low / freedom, high / freedom), within / len(updates)


def matching_interval(truth: Trajectory) -> float:
    """How far apart in time poses may be that belong together: half the truth's interval, at least evo's 0.01 s."""
    if truth.stamps is None or len(truth) < 2:
        return 0.01
    return max(0.01, 0.5 * float(np.median(np.diff(truth.stamps))))
