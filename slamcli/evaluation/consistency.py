"""Consistency: whether the errors of an estimate are as large as its covariances say (NEES).

Y. Bar-Shalom, X.-R. Li, T. Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, section 5.4.
The error of pose i is the tangent step e_i that takes the estimate to the truth, x_true = retract(x_i, e_i), in the
frame in which the covariance P_i is given; NEES_i = e_i^T P_i^-1 e_i is chi-square distributed with d degrees of
freedom if the estimate is consistent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.errors import InputError
from slamcli.evaluation.association import Association, match_ids
from slamcli.formats.covariances import Covariances
from slamcli.geometry import se2, se3
from slamcli.graph.trajectory import Trajectory
from slamcli.models import SE2
from slamcli.models.base import Array

#: A covariance whose smallest eigenvalue is below this part of its largest is singular: the pose is held.
_SINGULAR = 1e-14
CONFIDENCE = 0.95


@dataclass(frozen=True, eq=False)
class Consistency:
    """NEES of the poses that have a partner and a covariance.

    Attributes
    ----------
    values
        (k,) NEES of each associated pose, NaN where it has none.
    count
        How many are not NaN.
    without_covariance, singular
        Associated poses without covariance, and with a singular one (that of a held pose is zero).
    dimension
        d, degrees of freedom of one pose.
    mean
        Mean NEES (ANEES), expected to be d; None if ``count`` is 0.
    band
        Where the mean of ``count`` independent poses lies with probability ``confidence``.
    pose_band
        Where the NEES of one pose lies with that probability.
    inside
        Share of the poses inside ``pose_band``; None if ``count`` is 0.
    confidence
        0.95 unless stated otherwise.
    """

    values: Array
    count: int
    without_covariance: int
    singular: int
    dimension: int
    mean: float | None
    band: tuple[float, float] | None
    pose_band: tuple[float, float]
    inside: float | None
    confidence: float = CONFIDENCE


def chi2_quantile(dof: float, probability: float) -> float:
    """The value below which a chi-square variable of ``dof`` degrees of freedom lies with a probability."""
    from scipy.special import gammaincinv  # lazily: takes longer than most evaluations

    return float(2.0 * gammaincinv(0.5 * dof, probability))


def chi2_band(dof: float, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """The two-sided interval of a chi-square variable: as much probability below it as above."""
    tail = 0.5 * (1.0 - confidence)
    return chi2_quantile(dof, tail), chi2_quantile(dof, 1.0 - tail)


def nees(
    estimate: Trajectory,
    truth: Trajectory,
    pairs: Association,
    covariances: Covariances,
    aligned: Array,
    confidence: float = CONFIDENCE,
) -> Consistency:
    """NEES of an estimate.

    Parameters
    ----------
    estimate, truth
        Two trajectories of the same kind; the estimate has ids.
    pairs
        Which poses belong together.
    covariances
        Of the estimate's poses, by id.
    aligned
        (k, 7) the estimate's associated poses in the frame of the truth. A rigid motion of all poses does not change
        covariances in their own frames.
    confidence
        Probability of the bands.

    Raises
    ------
    InputError
        If the kinds or dimensions do not go together, or no covariance has the id of an associated pose.
    """
    kind = estimate.kind
    if kind is not truth.kind:
        raise InputError(
            f"NEES compares poses of one kind: {estimate.source} is {kind.name}, the truth {truth.kind.name}"
        )
    dimension = covariances.covariance.shape[1]
    if dimension != kind.dimension:
        raise InputError(
            f"the covariances are {dimension} x {dimension}, "
            f"the poses of {estimate.source} have {kind.dimension} dimensions"
        )
    if estimate.ids is None:
        raise InputError(f"{estimate.source} has no ids to find the covariances of its poses by")
    rows, theirs = match_ids(estimate.ids[pairs.estimate], covariances.ids)
    if len(rows) == 0:
        raise InputError(f"no covariance has the id of a pose that {estimate.source} and the truth have in common")
    error = _tangent(kind is SE2, aligned[rows], truth.lifted()[pairs.truth[rows]])
    covariance = covariances.covariance[theirs]
    eigenvalues = np.linalg.eigvalsh(covariance)
    regular = eigenvalues[:, 0] > _SINGULAR * np.maximum(eigenvalues[:, -1], 0.0)
    if (eigenvalues[:, 0] < -1e-9 * np.abs(eigenvalues).max(axis=1)).any():
        bad = int(np.flatnonzero(eigenvalues[:, 0] < -1e-9 * np.abs(eigenvalues).max(axis=1))[0])
        raise InputError(f"the covariance of pose {covariances.ids[theirs[bad]]} has a negative eigenvalue")
    values = np.full(len(pairs), np.nan)
    solved = np.linalg.solve(covariance[regular], error[regular, :, None])[:, :, 0]
    values[rows[regular]] = (error[regular] * solved).sum(axis=1)
    return _summary(values, len(pairs) - len(rows), int((~regular).sum()), dimension, confidence)


def _summary(values: Array, missing: int, singular: int, dimension: int, confidence: float) -> Consistency:
    known = values[np.isfinite(values)]
    count = len(known)
    pose_band = chi2_band(dimension, confidence)
    mean = band = inside = None
    if count:
        low, high = chi2_band(dimension * count, confidence)
        mean, band = float(known.mean()), (low / count, high / count)
        inside = float(((known >= pose_band[0]) & (known <= pose_band[1])).mean())
    return Consistency(values, count, missing, singular, dimension, mean, band, pose_band, inside, confidence)


def _tangent(planar: bool, estimate: Array, truth: Array) -> Array:
    """Steps from the estimate to the truth in the estimate's frame, (k, d), from poses (k, 7)."""
    if not planar:
        return se3.local(estimate, truth)
    flat = [np.column_stack([p[:, 0], p[:, 1], 2.0 * np.arctan2(p[:, 5], p[:, 6])]) for p in (estimate, truth)]
    return se2.local(flat[0], flat[1])
