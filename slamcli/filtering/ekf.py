"""Prediction, update and initialization of EKF-SLAM, on a ``State``.

    prediction       x_r <- x_r + u,   P <- F P F^T + G Q G^T              first three columns only, O(n)
    update           S = H P H^T + Q,  P <- P - (P H^T) S^-1 (P H^T)^T     O(n^2) for each number read
    initialization   x_new = g(x, z),  cov(x_new, x) = G P                 O(n)

(Thrun, Burgard, Fox, "Probabilistic Robotics", 2005, table 10.1; Smith, Self, Cheeseman, "Estimating uncertain spatial
relationships in robotics", 1990.) With S = L L^T and V = P H^T L^-T the update subtracts V V^T from one triangle:
the result is symmetric because there is only one triangle, and nothing is inverted.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from slamcli.errors import NumericalError
from slamcli.filtering.blas import divide_by_transpose
from slamcli.filtering.readings import Linearization
from slamcli.filtering.state import POSE, Block, State, wrap
from slamcli.models.base import Array


class Update(NamedTuple):
    """What an update found.

    Attributes
    ----------
    nis
        Squared Mahalanobis distance of all innovations together.
    degrees_of_freedom
        Their number.
    covariance
        (d, d) S.
    """

    nis: float
    degrees_of_freedom: int
    covariance: Array


def predict(state: State, displacement: Array, noise: Array, first: bool = False) -> None:
    """Move the robot.

    Parameters
    ----------
    displacement
        (3,) the new pose seen from the old one.
    noise
        (3, 3) covariance of its error in the frame of the new pose.
    first
        First-estimates Jacobians: the way from the last *predicted* pose takes the place of the way from the last
        updated one (Huang, Mourikis, Roumeliotis, "Observability-based rules for designing consistent EKF SLAM
        estimators", IJRR 2010, section 4.1).
    """
    x, y, theta = state.mean[:POSE].tolist()
    u, v, turn = displacement.tolist()
    cosine, sine = math.cos(theta), math.sin(theta)
    pose = (x + cosine * u - sine * v, y + sine * u + cosine * v, wrap(theta + turn))
    origin = state.first if first else state.mean
    shift = (float(origin[1]) - pose[1], pose[0] - float(origin[0]))
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    rotation = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    state.move(pose, shift, rotation @ noise @ rotation.T)


def update(state: State, stacked: Linearization, joseph: bool = False) -> Update:
    """Correct the state by all readings of a step at once.

    Raises
    ------
    NumericalError
        If the covariance of the innovation is not positive definite.
    """
    index, jacobian = stacked.entries, stacked.jacobian
    n, d = state.size, len(stacked.innovation)
    whole = np.empty((n + 1, d), order="F")  # P H^T, and below it the innovation: both are divided by L^T
    cross = whole[:n]
    np.matmul(state.columns(index), jacobian.T, out=cross)
    whole[n] = stacked.innovation
    covariance = jacobian @ cross[index] + stacked.noise
    covariance = 0.5 * (covariance + covariance.T)
    lower = cholesky(covariance)
    if joseph:
        gain = np.linalg.solve(covariance, cross.T).T
        whitened = np.linalg.solve(lower, stacked.innovation)
        state.correct_joseph(np.asfortranarray(gain), cross, covariance, stacked.innovation)
    else:
        divide_by_transpose(whole, np.asfortranarray(lower))
        whitened = whole[n].copy()
        state.correct(cross, whitened, index, lower, jacobian)
    return Update(float(whitened @ whitened), d, covariance)


def cholesky(covariance: Array) -> Array:
    """L (d, d) of S = L L^T.

    Raises
    ------
    NumericalError
        If there is none.
    """
    try:
        lower = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
    except np.linalg.LinAlgError:
        lower = np.full(covariance.shape, np.nan)
    if not np.isfinite(lower).all():
        raise NumericalError(
            "the covariance of an innovation is not positive definite",
            (
                "  the covariance of the state has lost its meaning, or the noise of a sensor is zero",
                "  check the noise of odometry and sensors",
            ),
        )
    return lower


def initialize(state: State, point: Array, stacked: Linearization) -> Block:
    """Put a landmark into the state that two numbers place: h(x, point) = z.

    By the implicit function theorem, with H = (Hx, Hl) and the error e of the reading,

        d point = Hl^-1 (e - Hx dx)

    Parameters
    ----------
    point
        (2,) the solution.
    stacked
        The readings (d = 2), linearized there, of a landmark in the last two columns, which is not yet in the state.
    """
    by_point = np.linalg.inv(stacked.jacobian[:, -2:])
    jacobian = -by_point @ stacked.jacobian[:, :-2]
    return state.append(point, stacked.entries[:-2], jacobian, by_point @ stacked.noise @ by_point.T)


def keep_pose(state: State) -> Block:
    """A copy of the pose that stays in the state as it moves on (stochastic cloning)."""
    return state.append(state.mean[:POSE].copy(), np.arange(POSE), np.eye(POSE), np.zeros((POSE, POSE)))
