"""The course of an evaluation: associate, align, compare; once for each estimate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slamcli.errors import InputError, UsageError
from slamcli.evaluation.alignment import align
from slamcli.evaluation.association import associate
from slamcli.evaluation.closures import ClosureScores, closure_scores
from slamcli.evaluation.consistency import nees
from slamcli.evaluation.drift import gap
from slamcli.evaluation.errors import absolute_errors, path_distance, relative_errors, relative_pairs
from slamcli.evaluation.landmarks import landmark_errors
from slamcli.evaluation.result import EstimateResult, EvaluateOptions, Evaluation, PoseTable, RelativeErrors
from slamcli.formats.covariances import Covariances
from slamcli.formats.labels import Labels
from slamcli.graph.trajectory import Trajectory
from slamcli.models import SE2
from slamcli.models.base import Array

#: Metres from the origin; the squares of such distances and their sums are numbers still.
_FARTHEST = 1e100


def evaluate(
    estimates: Sequence[Trajectory],
    truth: Trajectory | None = None,
    *,
    options: EvaluateOptions | None = None,
    labels: Labels | None = None,
    estimated_labels: Labels | None = None,
    covariances: Covariances | None = None,
) -> Evaluation:
    """Compare estimates with the truth.

    Parameters
    ----------
    estimates
        At least one, each with at least one pose.
    truth
        The true poses; without them only the end of the path and the loop closures are judged.
    options
        How; the defaults if not given.
    labels
        Which edges are outliers, for the estimates that are graphs.
    estimated_labels
        Which edges the estimates reject; None: the gate of the options says it.
    covariances
        Of the poses of the first estimate.

    Raises
    ------
    InputError
        If no pose of an estimate has a partner, if labels or covariances do not fit, or if a position is too far away.
    NumericalError
        If the positions do not determine the alignment.
    UsageError
        If an option does not exist, or covariances come with an alignment that fits positions.
    """
    chosen = options or EvaluateOptions()
    if covariances is not None and chosen.align not in ("none", "origin"):
        raise UsageError(
            f"NEES does not go with --align {chosen.align}: fitted to the truth, errors are smaller than they are",
            ("  --align none, or --align origin where the first pose is held",),
        )
    notes: list[str] = []
    results = [
        _result(estimate, truth, chosen, (labels, estimated_labels), covariances if k == 0 else None, notes)
        for k, estimate in enumerate(estimates)
    ]
    return Evaluation(chosen, truth, results, notes)


def _result(
    estimate: Trajectory,
    truth: Trajectory | None,
    options: EvaluateOptions,
    labels: tuple[Labels | None, Labels | None],
    covariances: Covariances | None,
    notes: list[str],
) -> EstimateResult:
    closures = _closures(estimate, *labels, options.gate, notes)
    if truth is None:
        return EstimateResult(
            estimate.source, len(estimate), estimate.length, estimate.kind.name, gap(estimate), closures=closures
        )
    for trajectory in (estimate, truth):
        _check_extent(trajectory)
    pairs = associate(estimate, truth, options.associate, options.max_time_difference)
    shorter = min(len(estimate), len(truth))
    if 2 * len(pairs) < shorter:
        more = "; --max-time-difference S allows more" if pairs.method == "time" else ""
        notes.append(f"{estimate.source}: only {len(pairs)} of {shorter} poses have a partner by {pairs.method}{more}")
    if pairs.reused:
        notes.append(f"{estimate.source}: {pairs.reused} pairs share a pose with another: stamps as dense as the limit")
    poses, true_poses = estimate.lifted()[pairs.estimate], truth.lifted()[pairs.truth]
    planar = estimate.kind is SE2 and truth.kind is SE2
    alignment = align(poses, true_poses, options.align, planar)
    aligned = alignment.poses(poses)
    errors = absolute_errors(aligned, true_poses)
    found = landmark_errors(estimate.graph, truth.graph, alignment)
    if found is not None and found.error is None:
        notes.append(
            f"{estimate.source}: none of its {found.unmatched_estimate} landmarks has the id of one of the truth"
        )
    table = PoseTable(
        ids=None if estimate.ids is None else estimate.ids[pairs.estimate],
        stamps=None if estimate.stamps is None else estimate.stamps[pairs.estimate],
        distance=path_distance(truth.lifted()[:, :3])[pairs.truth],
        positions=aligned[:, :3],
        errors=errors,
    )
    return EstimateResult(
        name=estimate.source,
        poses=len(estimate),
        length=estimate.length,
        kind=estimate.kind.name,
        gap=gap(estimate, truth, pairs),
        association=pairs,
        alignment=alignment,
        absolute=errors.statistics(),
        relative=[_relative(aligned, true_poses, delta, options, estimate.source, notes) for delta in options.deltas],
        table=table,
        landmarks=found,
        consistency=None if covariances is None else nees(estimate, truth, pairs, covariances, aligned),
        closures=closures,
    )


def _check_extent(trajectory: Trajectory) -> None:
    """Squares of distances have to be numbers."""
    farthest = float(np.abs(trajectory.positions).max(initial=0.0))
    if farthest > _FARTHEST:
        raise InputError(
            f"{trajectory.source}: a position is {farthest:.3g} m from the origin, too far to be compared",
            ("  did the optimization that wrote it diverge?",),
        )


def _relative(
    aligned: Array, truth: Array, delta: float, options: EvaluateOptions, name: str, notes: list[str]
) -> RelativeErrors:
    pairs = relative_pairs(aligned, delta, options.delta_unit, options.all_pairs)
    statistics = None
    if len(pairs):
        statistics = relative_errors(aligned, truth, pairs).statistics()
    else:
        notes.append(f"{name}: no two of {len(aligned)} poses are {delta:g} {options.delta_unit} apart: no RPE")
    return RelativeErrors(delta, options.delta_unit, options.all_pairs, len(pairs), statistics)


def _closures(
    estimate: Trajectory, labels: Labels | None, estimated: Labels | None, gate: float, notes: list[str]
) -> ClosureScores | None:
    graph = estimate.graph
    if labels is None:
        return None
    if graph is None or not graph.factors:
        notes.append(f"{estimate.source}: holds no edges, so no loop closures")
        return None
    if not all(np.all(column.known) for column in graph.variables.values()):
        notes.append(f"{estimate.source}: not every variable has a value, so its loop closures have no chi2")
        return None
    return closure_scores(graph, labels, gate, estimated)
