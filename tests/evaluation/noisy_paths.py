"""What the tests of the evaluation share: noisy paths in the plane and in space."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamcli.geometry import se2, se3
from slamcli.graph.trajectory import Trajectory
from slamcli.models import SE2, SE3
from slamcli.models.base import Array


def planar(count: int = 200, seed: int = 0, noise: float = 0.0) -> Trajectory:
    """A winding path of steps of about half a metre, with noise on every pose (metres, radians)."""
    rng = np.random.default_rng(seed)
    poses = np.zeros((count, 3))
    steps = np.column_stack([rng.uniform(0.2, 0.8, count), np.zeros(count), rng.normal(0.0, 0.3, count)])
    for k in range(1, count):
        poses[k] = se2.compose(poses[k - 1], steps[k])
    noisy = se2.retract(poses, noise * np.random.default_rng(seed + 1).normal(size=(count, 3)))
    return Trajectory(SE2, noisy, ids=np.arange(count), stamps=100.0 + 0.1 * np.arange(count), source="planar")


def spatial(count: int = 200, seed: int = 0, noise: float = 0.0) -> Trajectory:
    """The same in space."""
    rng = np.random.default_rng(seed)
    poses = np.tile(SE3.identity, (count, 1)).astype(float)
    steps = np.column_stack([rng.uniform(0.2, 0.8, count), np.zeros((count, 2)), rng.normal(0.0, 0.1, (count, 3))])
    for k in range(1, count):
        poses[k] = se3.retract(poses[k - 1], steps[k])
    noisy = se3.retract(poses, noise * np.random.default_rng(seed + 1).normal(size=(count, 6)))
    return Trajectory(SE3, noisy, ids=np.arange(count), stamps=100.0 + 0.1 * np.arange(count), source="spatial")


def moved(trajectory: Trajectory, motion: Array, scale: float = 1.0) -> Trajectory:
    """A trajectory whose positions are scaled and whose poses are then moved as a whole."""
    poses = trajectory.poses.copy()
    poses[:, : trajectory.kind.space] *= scale
    return replace(trajectory, poses=trajectory.kind.compose(np.tile(motion, (len(poses), 1)), poses))
