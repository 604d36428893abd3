"""Scenes of bundle adjustment for tests: a ring of cameras around a cloud of points."""

import numpy as np

from slamcli import models
from slamcli.formats import scenes
from slamcli.geometry import so3
from slamcli.graph import FactorGraph
from slamcli.models.base import Array


def looking_at_origin(positions: Array) -> Array:
    """Quaternions (n, 4) of cameras that look along -z at the origin, with the world's z about up."""
    back = positions / np.linalg.norm(positions, axis=1, keepdims=True)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return so3.from_matrix(np.stack([right, np.cross(back, right), back], axis=2))


def ring(cameras: int = 6, points: int = 40, noise: float = 0.5, seed: int = 0, share: float = 0.8) -> FactorGraph:
    """A scene at its true values; each camera sees a share of the points, with pixel noise."""
    rng = np.random.default_rng(seed)
    angle = 2.0 * np.pi * np.arange(cameras) / cameras
    positions = np.stack([6.0 * np.cos(angle), 6.0 * np.sin(angle), rng.normal(scale=0.5, size=cameras)], axis=1)
    intrinsics = np.stack(
        [rng.uniform(480, 520, cameras), rng.normal(-0.1, 0.02, cameras), rng.normal(0.0, 0.01, cameras)], axis=1
    )
    values = np.concatenate([positions, looking_at_origin(positions), intrinsics], axis=1)
    cloud = rng.uniform(-1.5, 1.5, (points, 3))
    rows = np.argwhere(rng.random((cameras, points)) < share)
    x = values[rows[:, 0]], cloud[rows[:, 1]]
    assert (models.BAL_PROJECTION.depth(x) > 0.0).all()
    pixels = models.BAL_PROJECTION.residual(x, np.zeros((len(rows), 2)), None)
    scene = scenes.graph(
        scenes.Source("ring", "bal", b"", b"", 0, {}),
        camera_ids=np.arange(cameras),
        cameras=values,
        point_ids=cameras + np.arange(points),
        points=cloud,
        rows=rows,
        pixels=pixels + rng.normal(scale=noise, size=pixels.shape),
        lines=np.zeros(len(rows), dtype=np.intp),
    )
    scene.document = scene.report = None  # made in memory
    return scene


def perturbed(scene: FactorGraph, seed: int = 1, step: float = 0.02) -> FactorGraph:
    """The scene with all positions and orientations moved by about ``step``, focal lengths by 1 percent."""
    rng = np.random.default_rng(seed)
    values = dict(scene.values)
    delta = rng.normal(scale=step, size=(len(values["CAMERA"]), 9))
    delta[:, 6] *= 0.01 / step * 500.0
    delta[:, 7:] *= 0.1
    values["CAMERA"] = models.CAMERA.retract(values["CAMERA"], delta)
    values["XYZ"] = values["XYZ"] + rng.normal(scale=step, size=values["XYZ"].shape)
    return scene.with_values(values)
