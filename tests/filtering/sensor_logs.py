"""Sensor logs made in memory, and the batch solution that a filter has to reach on them."""

from __future__ import annotations

from typing import Any

import numpy as np

from slamcli.filtering.result import EkfResult
from slamcli.filtering.state import local_covariance
from slamcli.geometry import se2
from slamcli.graph.sensor_log import Observations, SensorLog
from slamcli.graph.trajectory import of_graph
from slamcli.models import RELATIVE_POSE_2D, FactorKind
from slamcli.models.base import Array
from slamcli.simulation.settings import scenario_of
from slamcli.simulation.simulate import simulate

ODOMETRY = np.diag([400.0, 900.0, 10_000.0])
WEIGHTS = {"range": 100.0, "bearing": 2500.0, "x": 100.0, "y": 400.0}


def world_covariance(covariance: Array, heading: Array) -> Array:
    """The reverse of ``local_covariance``."""
    return local_covariance(covariance, -np.asarray(heading))


def simulated(**settings: Any) -> SensorLog:
    """The log of a simulated world, with its truth; clutter has the id -1."""
    simulation = simulate(scenario_of(settings, "test"))
    poses, points = simulation.truth.variables["SE2"].values, simulation.truth.variables["XY"]
    count = len(poses)
    observations = [
        Observations(
            reading.kind,
            reading.poses,
            np.where(reading.false, -1, count + reading.landmarks),
            reading.measurements,
            np.tile(reading.information, (len(reading.poses), 1, 1)),
        )
        for reading in simulation.readings
    ]
    return SensorLog(
        times=np.arange(count, dtype=np.float64),
        ids=np.arange(count),
        model="body",
        controls=simulation.odometry.measurements,
        information=simulation.odometry.information,
        observations=observations,
        start=poses[0],
        true_trajectory=of_graph(simulation.truth),
        true_landmarks=(points.ids, points.values),
    )


def exact(kind: FactorKind, poses: Array, landmarks: Array) -> SensorLog:
    """A log without noise, from given poses (t, 3), in which every pose reads every landmark (k, 2)."""
    steps = np.repeat(np.arange(len(poses)), len(landmarks))
    ids = np.tile(np.arange(len(landmarks)), len(poses))
    nothing = np.zeros((len(steps), kind.measurement_size))
    sign = -1.0 if kind.name == "point_observation_2d" else 1.0
    measured = kind.normalize(-sign * kind.residual((poses[steps], landmarks[ids]), nothing, None))
    weight = np.diag([WEIGHTS[component] for component in kind.components])
    return SensorLog(
        times=np.arange(len(poses), dtype=np.float64),
        ids=np.arange(len(poses)),
        model="body",
        controls=se2.between(poses[:-1], poses[1:]),
        information=np.tile(ODOMETRY, (len(poses) - 1, 1, 1)),
        observations=[Observations(kind, steps, ids, measured, np.tile(weight, (len(steps), 1, 1)))],
        start=poses[0],
    )


def batch_covariance(log: SensorLog, poses: Array, landmarks: Array, start: Array) -> Array:
    """Covariance of the last pose (local steps) and all landmarks, from the information of everything, at the truth.

    ``start`` is the covariance (3, 3) of the first pose, local steps.
    """
    count = len(poses)
    size = 3 * count + 2 * len(landmarks)
    hessian = np.zeros((size, size))
    hessian[:3, :3] = np.linalg.inv(start)
    terms = [(RELATIVE_POSE_2D, k, k + 1, log.controls[k], log.information[k]) for k in range(count - 1)]  # type: ignore[index]
    for entry in log.observations:
        for row, (step, landmark) in enumerate(zip(entry.steps, entry.landmarks, strict=True)):
            terms.append((entry.kind, int(step), -1 - int(landmark), entry.measurements[row], entry.information[row]))  # type: ignore[arg-type, index]
    for kind, first, second, measured, weight in terms:
        other = poses[second] if second >= 0 else landmarks[-1 - second]
        place = 3 * second if second >= 0 else 3 * count + 2 * (-1 - second)
        _, (a, b) = kind.linearize((poses[first][None], other[None]), measured[None], None)
        jacobian = np.zeros((kind.dimension, size))
        jacobian[:, 3 * first : 3 * first + 3] = a[0]
        jacobian[:, place : place + len(other)] = b[0]
        hessian += jacobian.T @ weight @ jacobian
    return np.linalg.inv(hessian)[3 * count - 3 :, 3 * count - 3 :]


def in_world(covariance: Array, heading: float) -> Array:
    """The covariance of ``batch_covariance`` with steps of the pose along the axes of the world."""
    out = covariance.copy()
    cosine, sine = np.cos(heading), np.sin(heading)
    rotation = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    out[:3] = rotation @ out[:3]
    out[:, :3] = out[:, :3] @ rotation.T
    return out


def pose_nees(result: EkfResult, log: SensorLog) -> Array:
    """Normalized estimation error squared of every pose but the first."""
    assert log.true_trajectory is not None
    error = se2.between(result.poses, log.true_trajectory.poses)[1:]
    solved = np.linalg.solve(result.covariances[1:], error[:, :, None])[:, :, 0]
    return np.asarray((error * solved).sum(axis=1))


def by_id(result: EkfResult, values: Array) -> Array:
    """Rows of the landmarks in the order of their ids."""
    return values[np.argsort(result.landmarks.ids)]


__all__ = ["batch_covariance", "by_id", "exact", "in_world", "pose_nees", "simulated", "world_covariance"]
