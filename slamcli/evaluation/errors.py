"""Absolute and relative pose errors and their statistics, in evo's definitions.

With the poses Q of the truth and P of the estimate (aligned), both elements of SE(3), the error is

* absolute (ATE; evo calls it APE):  E_i = Q_i^-1 P_i
* relative (RPE):                    E_ij = (Q_i^-1 Q_j)^-1 (P_i^-1 P_j)

of which three numbers are reported: the length of the translation (m), the angle of the rotation (deg), and for the
full transformation the Frobenius norm of E - I, which is sqrt(|t|^2 + 8 |v|^2), v being the vector part of the unit
quaternion of E.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.errors import UsageError
from slamcli.geometry import se3
from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array

DELTA_UNITS = ("frames", "m", "deg", "rad")
#: Part of delta by which the distance of a pair may differ from it, with ``all_pairs``.
RELATIVE_TOLERANCE = 0.1


@dataclass(frozen=True)
class Statistics:
    """Statistics of a list of errors: sse is the sum of squares, rmse the root of its mean, std that of n."""

    rmse: float
    mean: float
    median: float
    std: float
    min: float
    max: float
    sse: float
    count: int


@dataclass(frozen=True, eq=False)
class PoseErrors:
    """Three errors of each pose or pair of poses.

    Attributes
    ----------
    translation
        (k,) metres.
    rotation
        (k,) degrees, at least 0.
    full
        (k,) Frobenius norm of E - I.
    """

    translation: Array
    rotation: Array
    full: Array

    def __len__(self) -> int:
        return len(self.translation)

    def statistics(self) -> dict[str, Statistics]:
        """Statistics of each; there must be at least one error."""
        return {name: statistics(getattr(self, name)) for name in ("translation", "rotation", "full")}


def statistics(errors: Array) -> Statistics:
    """Statistics of at least one error."""
    squares = np.square(errors)
    return Statistics(
        rmse=float(np.sqrt(squares.mean())),
        mean=float(errors.mean()),
        median=float(np.median(errors)),
        std=float(errors.std()),
        min=float(errors.min()),
        max=float(errors.max()),
        sse=float(squares.sum()),
        count=len(errors),
    )


def absolute_errors(estimate: Array, truth: Array) -> PoseErrors:
    """Errors of poses (k, 7) that belong together."""
    return _errors(se3.between(truth, estimate))


def relative_errors(estimate: Array, truth: Array, pairs: IndexArray) -> PoseErrors:
    """Errors of the motions between the pairs (k, 2) of rows of poses (n, 7)."""
    first, second = pairs[:, 0], pairs[:, 1]
    true_motion = se3.between(truth[first], truth[second])
    return _errors(se3.between(true_motion, se3.between(estimate[first], estimate[second])))


def _errors(error: Array) -> PoseErrors:
    square = np.square(error[:, :3]).sum(axis=1)
    vector = np.square(error[:, 3:6]).sum(axis=1)
    angle = 2.0 * np.arctan2(np.sqrt(vector), np.abs(error[:, 6]))
    return PoseErrors(np.sqrt(square), np.degrees(angle), np.sqrt(square + 8.0 * vector))


def path_distance(positions: Array) -> Array:
    """(n,) metres travelled up to each of the positions (n, m)."""
    steps = np.sqrt(np.square(np.diff(positions, axis=0)).sum(axis=1))
    return np.concatenate([[0.0], np.cumsum(steps)])


def relative_pairs(poses: Array, delta: float, unit: str, all_pairs: bool = False) -> IndexArray:
    """Pairs of poses that are ``delta`` apart, as evo chooses them.

    Parameters
    ----------
    poses
        (n, 7) poses of the estimate, in the order in which they were driven.
    delta
        How far apart, in ``unit``.
    unit
        ``"frames"``, ``"m"`` along the path, ``"deg"`` or ``"rad"`` of accumulated rotation.
    all_pairs
        Every pose starts a pair, whose end is the pose next to ``delta`` away, if it is so within a tenth. Otherwise
        a pair begins where the one before it ended, at the first pose that is at least ``delta`` away.

    Returns
    -------
    (k, 2) rows
        Maybe none.

    Raises
    ------
    UsageError
        If delta is not positive, not a whole number of frames, or all pairs are asked for by angle.
    """
    if unit not in DELTA_UNITS:
        raise UsageError(f"unknown unit of delta {unit!r}", (f"  one of: {', '.join(DELTA_UNITS)}",))
    if not 0.0 < delta < np.inf:
        raise UsageError(f"delta must be positive, got {delta:g}")
    if unit == "frames":
        if delta != int(delta):
            raise UsageError(f"delta must be a whole number of frames, got {delta:g}")
        first = np.arange(0, max(len(poses) - int(delta), 0), 1 if all_pairs else int(delta))
        return np.stack([first, first + int(delta)], axis=1)
    if unit == "m":
        distance = path_distance(poses[:, :3])
        return _all_at_distance(distance, delta) if all_pairs else _consecutive(np.diff(distance), delta)
    if all_pairs:
        raise UsageError("all pairs are chosen by frames or by metres, not by angles")
    turn = se3.between(poses[:-1], poses[1:])[:, 3:]
    angle = 2.0 * np.arctan2(np.sqrt(np.square(turn[:, :3]).sum(axis=1)), np.abs(turn[:, 3]))
    return _consecutive(angle, np.radians(delta) if unit == "deg" else delta)


def _consecutive(steps: Array, delta: float) -> IndexArray:
    """Ends of stretches over which the steps add up to delta at least, one behind the other."""
    ends, total = [0], 0.0
    for k, step in enumerate(steps.tolist(), start=1):  # a sum that starts anew: sequential by nature, 50 ns a step
        total += step
        if total >= delta:
            ends.append(k)
            total = 0.0
    rows = np.array(ends, dtype=np.intp)
    return np.stack([rows[:-1], rows[1:]], axis=1)


def _all_at_distance(distance: Array, delta: float) -> IndexArray:
    """For each pose the later one whose distance from it is nearest to delta; the first of several."""
    first = np.arange(len(distance) - 1)
    guess = np.searchsorted(distance, distance[:-1] + delta)
    # rounding may put the best one beside the guess, and standing still repeats distances: take the first of those
    candidates = np.clip(guess[:, None] + np.arange(-2, 2), first[:, None] + 1, len(distance) - 1)
    candidates = np.maximum(np.searchsorted(distance, distance[candidates]), first[:, None] + 1)
    off = np.abs((distance[candidates] - distance[first, None]) - delta)
    best = np.argmin(off, axis=1)
    keep = off[first, best] <= RELATIVE_TOLERANCE * delta
    return np.stack([first, candidates[first, best]], axis=1)[keep]
