"""Dead reckoning, filter and smoother on the same data with the same models and noise."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from slamcli.batch.closing import Closing, closing, closing_step
from slamcli.batch.smoother import Smoothed, smooth
from slamcli.errors import InputError
from slamcli.evaluation.alignment import Alignment
from slamcli.evaluation.consistency import chi2_quantile
from slamcli.evaluation.evaluate import evaluate
from slamcli.evaluation.filter_run import matching_interval, true_trajectory
from slamcli.evaluation.landmarks import LandmarkErrors, landmark_errors
from slamcli.evaluation.result import EstimateResult, EvaluateOptions
from slamcli.filtering.chain import integrated, integrated_covariance
from slamcli.filtering.controls import displacements
from slamcli.filtering.estimate import estimated_graph
from slamcli.filtering.options import EkfOptions
from slamcli.filtering.result import EkfResult
from slamcli.filtering.run import run
from slamcli.filtering.smoother_graph import first_seen, start_covariance
from slamcli.formats.covariances import Covariances
from slamcli.graph import FactorGraph, Variables
from slamcli.graph.columns import BoolArray, IndexArray, finite_rows
from slamcli.graph.sensor_log import SensorLog
from slamcli.graph.trajectory import Trajectory
from slamcli.models import SE2, XY
from slamcli.models.base import Array

ALIGNMENTS = ("none", "origin", "se")
NAMES = ("dead reckoning", "filter", "smoother")
#: The first pose may be this far off the truth, in metres and degrees, before the output says that the frames differ.
_OFF = (0.1, 1.0)


@dataclass(frozen=True, eq=False)
class Method:
    """One of the three.

    Attributes
    ----------
    name
        One of ``NAMES``.
    poses
        (t, 3).
    covariances
        (s, 3, 3) of the sampled poses, in their frames.
    landmarks
        (k, 2), NaN where it has no estimate of one.
    landmark_covariances
        (k, 2, 2), None if it has none.
    seconds
        Without the evaluation; the smoother's without its covariances.
    memory
        Bytes: of the filter's covariance, 8 for each entry of the matrix; of the smoother's factor L, 8 for each
        nonzero. None for dead reckoning, which keeps one pose.
    against_truth
        None without true trajectory.
    landmark_errors
        After the alignment of the poses, without one where only the landmarks' truth is known; None without that.
    """

    name: str
    poses: Array
    covariances: Array
    landmarks: Array
    landmark_covariances: Array | None
    seconds: float
    memory: int | None
    against_truth: EstimateResult | None = None
    landmark_errors: LandmarkErrors | None = None


@dataclass(frozen=True)
class Agreement:
    """How far the filter is from the smoother's optimum.

    Attributes
    ----------
    last_pose
        Metres between their last poses.
    path
        Root mean square of the metres between their poses; the filter's are those at their steps.
    landmarks
        The same of the landmarks, None without any.
    inside
        Share of the smoother's landmarks within the 95 % region that the filter states; None without landmarks.
    """

    last_pose: float
    path: float
    landmarks: float | None
    inside: float | None


@dataclass(frozen=True, eq=False)
class Comparison:
    """All that was measured.

    Attributes
    ----------
    log
        The data.
    options
        Of filter and smoother alike.
    align
        How estimates are moved before they are compared with the truth, one of ``ALIGNMENTS``.
    methods
        Dead reckoning, filter, smoother.
    sampled
        (s,) steps of the poses with covariances: those that are variables of the smoother.
    run, smoothed
        Filter and smoother.
    covariance_seconds
        Time of the smoother's covariances.
    agreement
        Of filter and smoother.
    closure
        The corrections of a loop closure; None if there is none.
    truth
        With its landmarks in its graph, None if not known.
    notes
        What was left out or assumed, one sentence each.
    """

    log: SensorLog
    options: EkfOptions
    align: str
    methods: tuple[Method, Method, Method]
    sampled: IndexArray
    run: EkfResult
    smoothed: Smoothed
    covariance_seconds: float
    agreement: Agreement
    closure: Closing | None
    truth: Trajectory | None
    notes: list[str] = field(default_factory=list)


def compare(
    log: SensorLog,
    options: EkfOptions,
    *,
    align: str = "none",
    closure: str | int = "last",
    tick: Callable[[], None] = lambda: None,
) -> Comparison:
    """Run all three and measure them.

    Parameters
    ----------
    log, options
        Data, and the noise of whatever the data do not state.
    align
        One of ``ALIGNMENTS``; NEES goes with the first two.
    closure
        Which loop closure to take apart, see ``closing.closing_step``.
    tick
        Called after each of four parts.

    Raises
    ------
    InputError
        If the filter has no landmark; and as the filter and the evaluation.
    UsageError, NumericalError
        As the filter, the evaluation and the optimizer.
    """
    result = run(log, options)
    tick()
    if len(result.landmarks) == 0:
        counts = ", ".join(f"{name} {number}" for name, number in result.counts.items() if number)
        raise InputError(
            f"{log.source}: no reading was taken for a landmark: filter and smoother are dead reckoning",
            (f"  readings: {counts or 'none'}",),
        )
    smoothed = smooth(log, options, result)
    tick()
    sampled = smoothed.built.kept
    begin = time.perf_counter()
    covariances, landmark_covariances = smoothed.covariances(sampled)
    covariance_seconds = time.perf_counter() - begin
    tick()
    sparsity = smoothed.result.sparsity
    methods = (
        _dead_reckoning(log, options, smoothed, sampled),
        Method(
            NAMES[1],
            result.poses,
            result.covariances[sampled],
            result.landmarks.positions,
            result.landmarks.covariances,
            result.seconds,
            result.covariance_bytes,
        ),
        Method(
            NAMES[2],
            smoothed.poses,
            covariances,
            smoothed.landmarks,
            landmark_covariances,
            smoothed.seconds,
            8 * sparsity.nnz_factor if sparsity is not None and sparsity.nnz_factor is not None else None,
        ),
    )
    step = closing_step(log, options, result, closure)
    closed = None if step is None else closing(log, options, result, step)
    tick()
    notes = [*log.notes, *_notes(log, smoothed)]
    if closed is None:
        notes.append("no landmark is seen again after a long absence: there is no loop closure to take apart")
    truth = true_trajectory(log)
    if truth is not None:
        if log.positions_only and align != "se":
            align = "se"
            notes.append("the truth has positions in a frame of its own, and no headings: aligned by se, no NEES")
        found = [_against(method, log, result, truth, align, sampled, notes) for method in methods]
        methods = (found[0], found[1], found[2])
        _say_frames(methods[0], align, notes)
    elif log.true_landmarks is not None:
        notes.append("the truth of the path is not known: no ATE, no NEES; landmarks are compared as they are")
        one, two, three = (_landmarks_against(method, log, result) for method in methods)
        methods = (one, two, three)
    else:
        notes.append("there is no truth: no ATE, no landmark errors, no NEES")
    return Comparison(
        log,
        options,
        align,
        methods,
        sampled,
        result,
        smoothed,
        covariance_seconds,
        _agreement(result, smoothed),
        closed,
        truth,
        list(dict.fromkeys(notes)),
    )


def _dead_reckoning(log: SensorLog, options: EkfOptions, smoothed: Smoothed, sampled: IndexArray) -> Method:
    """The integrated odometry, and each landmark where the first reading that places it puts it."""
    begin = time.perf_counter()
    displacement, covariance = displacements(log, options)
    poses = integrated(np.asarray(log.start, dtype=np.float64), displacement)
    covariances = integrated_covariance(poses, start_covariance(log, options), covariance)
    seconds = time.perf_counter() - begin
    unknown = np.full(smoothed.landmarks.shape, np.nan)
    landmarks = first_seen(smoothed.built.graph.factors, poses[smoothed.built.kept], unknown)
    return Method(NAMES[0], poses, covariances[sampled], landmarks, None, seconds, None)


def _against(
    method: Method,
    log: SensorLog,
    result: EkfResult,
    truth: Trajectory,
    align: str,
    sampled: IndexArray,
    notes: list[str],
) -> Method:
    """The method with its scores."""
    estimate = Trajectory(SE2, method.poses, log.ids, log.times, method.name, _map_of(method, result))
    covariances = None
    if truth.kind is SE2 and align != "se":
        if _without_headings(truth):
            notes.append("the truth has no headings: no NEES")
        else:
            covariances = Covariances(log.ids[sampled], method.covariances)
    options = EvaluateOptions(align=align, max_time_difference=matching_interval(truth))
    found = evaluate([estimate], truth, options=options, covariances=covariances)
    scores = found.estimates[0]
    return replace(method, against_truth=scores, landmark_errors=scores.landmarks)


def _without_headings(truth: Trajectory) -> bool:
    """Whether the headings of a path that turns are all the same: they stand for nothing."""
    step = np.diff(truth.positions, axis=0)
    way = np.arctan2(step[:, 1], step[:, 0])[step.any(axis=1)]
    return len(way) > 1 and not np.ptp(truth.poses[:, 2]) and bool(np.ptp(way) > 1e-6)


def _landmarks_against(method: Method, log: SensorLog, result: EkfResult) -> Method:
    """The method with the errors of its landmarks alone."""
    assert log.true_landmarks is not None
    ids, positions = log.true_landmarks
    known = np.ones(len(ids), dtype=bool)
    column = Variables(XY, ids, positions, ~known, known, np.zeros(len(ids), dtype=np.intp))
    truth = FactorGraph({XY.name: column}, [])
    still = Alignment("none", np.eye(3), np.zeros(3))
    return replace(method, landmark_errors=landmark_errors(_map_of(method, result), truth, still))


def _map_of(method: Method, result: EkfResult) -> FactorGraph:
    """The landmarks that the method has, without poses."""
    known = finite_rows(method.landmarks)
    if not known.any():
        return FactorGraph({}, [])
    column = estimated_graph(result).variables[XY.name]
    chosen = replace(
        column,
        ids=column.ids[known],
        values=method.landmarks[known],
        fixed=column.fixed[known],
        known=column.known[known],
        lines=column.lines[known],
    )
    return FactorGraph({XY.name: chosen}, [])


def _agreement(result: EkfResult, smoothed: Smoothed) -> Agreement:
    apart = np.square(result.poses[:, :2] - smoothed.poses[:, :2]).sum(axis=1)
    landmarks = inside = None
    if len(smoothed.landmarks):
        difference = smoothed.landmarks - result.landmarks.positions
        landmarks = float(np.sqrt(np.square(difference).sum(axis=1).mean()))
        inside = float(np.mean(_inside(difference, result.landmarks.covariances)))
    return Agreement(float(np.sqrt(apart[-1])), float(np.sqrt(apart.mean())), landmarks, inside)


def _inside(difference: Array, covariances: Array) -> BoolArray:
    distance = np.vecdot(difference, np.linalg.solve(covariances, difference[:, :, None])[:, :, 0])
    return np.asarray(distance <= chi2_quantile(2, 0.95))


def _notes(log: SensorLog, smoothed: Smoothed) -> list[str]:
    built, steps = smoothed.built, len(log)
    notes = []
    if len(built.kept) < steps:
        notes.append(
            f"the smoother has the poses of {len(built.kept)} of {steps} steps: most without readings are composed, "
            "with their covariances, and filled in afterwards"
        )
    if built.softened:
        notes.append(
            f"the odometry of {built.softened} steps has singular noise, which the smoother cannot invert: it takes "
            f"deviations of {built.softening:.1g} m and rad more"
        )
    if built.deleted:
        notes.append(f"{built.deleted} readings of landmarks that the filter deleted are not in the smoother")
    if len(built.kept) < steps:
        notes.append(f"covariances and NEES are those of these {len(built.kept)} poses")
    if smoothed.method != "gn":
        notes.append("Gauss-Newton did not converge from the filter's estimates: the smoother is Levenberg-Marquardt")
    return notes


def _say_frames(method: Method, align: str, notes: list[str]) -> None:
    """A truth in another frame makes every error large."""
    found = method.against_truth
    if align != "none" or found is None or found.table is None:
        return
    distance, angle = float(found.table.errors.translation[0]), float(found.table.errors.rotation[0])
    if distance > _OFF[0] or angle > _OFF[1]:
        notes.append(
            f"the first pose is {distance:.3g} m and {angle:.3g} deg off the truth: where the frames differ, "
            "--align origin or se moves the estimates"
        )
