"""Dead reckoning over many steps: poses, their covariance, several steps as one, and the poses in between again.

Errors of a step are small motions in the frame of the later pose. An error e there is the error Ad(Y^-1 X) e of a later
pose Y, for it moves everything behind it as one piece; X and Y are dead-reckoned. So the covariance of a stretch is

    C = sum_k A_k Q_k A_k^T     with A_k = Ad(X_end^-1 X_k)

to first order in the errors, as in a filter. J. Sola, J. Deray, D. Atchuthan, "A micro Lie theory for state estimation
in robotics", 2018, section IV.
"""

from __future__ import annotations

import numpy as np

from slamcli.geometry import se2
from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array

#: Singular values below this part of the largest are taken for zero.
_SINGULAR = 1e-12


def integrated(start: Array, displacement: Array) -> Array:
    """Poses (t, 3) of a robot that makes the displacements (t - 1, 3), each seen from the pose before."""
    return se2.normalize(se2.chain(start, displacement))


def integrated_covariance(poses: Array, start: Array, covariance: Array) -> Array:
    """Covariances (t, 3, 3) of dead-reckoned poses, each in its own frame.

    Parameters
    ----------
    poses
        (t, 3), see ``integrated``.
    start
        (3, 3) of the first pose, in its frame.
    covariance
        (t - 1, 3, 3) of the displacements, in the frame of the later pose.
    """
    to_start = se2.adjoint(se2.between(poses[:1], poses))
    common = np.cumsum(np.concatenate([start[None], _turned(to_start[1:], covariance)]), axis=0)
    return _turned(se2.adjoint(se2.between(poses, poses[:1])), common)


def composed(displacement: Array, covariance: Array, kept: IndexArray) -> tuple[Array, Array]:
    """Displacements (k - 1, 3) between the kept steps, and their covariances (k - 1, 3, 3).

    Parameters
    ----------
    displacement, covariance
        (t - 1, 3) and (t - 1, 3, 3).
    kept
        (k,) steps, ascending; the first is 0 and the last t - 1.
    """
    if len(kept) == len(displacement) + 1:
        return displacement, covariance
    path = integrated(np.zeros(3), displacement)
    _, end = _stretches(kept)
    carried = _turned(se2.adjoint(se2.between(path[end], path[1:])), covariance)
    return se2.between(path[kept[:-1]], path[kept[1:]]), np.add.reduceat(carried, kept[:-1], axis=0)


def filled(poses: Array, displacement: Array, covariance: Array, kept: IndexArray) -> Array:
    """All poses (t, 3), from those of the kept steps (k, 3): the others where they are most likely.

    A pose in a stretch is dead-reckoned from its beginning and takes its part of what is missing at the end: with S_k
    the sum of the covariances up to step k in the frame of the end, the part S_k C^-1 of it.
    """
    if len(kept) == len(displacement) + 1:
        return poses
    path = integrated(np.zeros(3), displacement)
    begin, end = _stretches(kept)
    number = np.searchsorted(kept, end) - 1
    there = path[1:]
    carried = _turned(se2.adjoint(se2.between(path[end], there)), covariance)
    total = np.add.reduceat(carried, kept[:-1], axis=0)
    sums = np.cumsum(carried, axis=0)
    before = np.concatenate([np.zeros((1, 3, 3)), sums])[begin]
    reckoned = se2.compose(poses[number], se2.between(path[begin], there))
    missing = se2.local(reckoned[kept[1:] - 1], poses[1:])
    weight = np.matvec(np.linalg.pinv(total, rcond=_SINGULAR, hermitian=True), missing)
    at_end = np.matvec(sums - before, weight[number])
    out = np.empty((len(path), 3))
    out[1:] = se2.retract(reckoned, np.matvec(se2.adjoint(se2.between(there, path[end])), at_end))
    out[kept] = poses
    return out


def _turned(adjoint: Array, covariance: Array) -> Array:
    return adjoint @ covariance @ adjoint.swapaxes(-1, -2)


def _stretches(kept: IndexArray) -> tuple[IndexArray, IndexArray]:
    """Kept steps before and after each displacement, (t - 1,) each."""
    number = np.repeat(np.arange(len(kept) - 1), np.diff(kept))
    return kept[number], kept[number + 1]
