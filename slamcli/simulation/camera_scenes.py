"""Scenes of bundle adjustment: cameras in a ring around a cloud of points, or in flight above a field of them.

The cameras are BAL's, each with focal length and distortion of its own as unknowns. A camera sees a point in front of
it that is within its image, with a probability; its pixels have normal noise. What is written to start from is the
truth with normal noise on places, orientations and focal lengths.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli import models
from slamcli.errors import UsageError
from slamcli.formats import scenes
from slamcli.geometry import so3
from slamcli.graph import FactorGraph
from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array

#: The worlds of cameras.
CAMERA_WORLDS = ("camera-ring", "camera-flight")
_LEAST_VIEWS = 2
_DEEPEST = 1e6
#: Pairs of a camera and a point that are looked at together.
_PAIRS = 1_000_000


@dataclass(frozen=True)
class CameraScene:
    """What to simulate.

    Attributes
    ----------
    world
        ``camera-ring`` or ``camera-flight``.
    seed
        Of all random numbers.
    cameras, points
        How many.
    radius
        Of the ring; of a flight, the height above ground. Metres, as all lengths.
    spacing
        Between the cameras of a flight.
    extent
        Half the edge of the cube of points in the ring; half the width of the field under a flight.
    focal, k1, k2
        Mean focal length in pixels and mean distortion; cameras differ by 1 percent and by 0.01.
    image
        Half the width of the image in pixels; points beyond are not seen.
    probability
        That a camera sees a point that it could see.
    noise
        Standard deviation of each coordinate of a pixel.
    position, rotation, focal_error
        Standard deviations of the start: of each coordinate of cameras and points, in radians about each axis, and as
        a share of the focal length.
    """

    world: str = CAMERA_WORLDS[0]
    seed: int = 0
    cameras: int = 20
    points: int = 500
    radius: float = 10.0
    spacing: float = 2.0
    extent: float = 3.0
    focal: float = 500.0
    k1: float = -0.05
    k2: float = 0.01
    image: float = 320.0
    probability: float = 0.8
    noise: float = 0.5
    position: float = 0.05
    rotation: float = 0.01
    focal_error: float = 0.01

    def __post_init__(self) -> None:
        if self.world not in CAMERA_WORLDS:
            raise UsageError(f"world {self.world!r} has no cameras", (f"  one of: {', '.join(CAMERA_WORLDS)}",))
        for name in ("cameras", "points"):
            if getattr(self, name) < 1:
                raise UsageError(f"{name} must be at least 1, got {getattr(self, name)}")
        for name in ("radius", "spacing", "extent", "focal", "image"):
            if not 0.0 < getattr(self, name) < _DEEPEST:
                raise UsageError(f"{name} must be positive and below {_DEEPEST:g}, got {getattr(self, name)}")
        for name in ("noise", "position", "rotation", "focal_error"):
            if not 0.0 <= getattr(self, name) < _DEEPEST:
                raise UsageError(f"{name} must be a number from 0, got {getattr(self, name)}")
        if not 0.0 < self.probability <= 1.0:
            raise UsageError(f"probability must be above 0 and at most 1, got {self.probability}")
        if not self.seed >= 0:
            raise UsageError(f"seed must not be negative, got {self.seed}")


@dataclass(frozen=True, eq=False)
class SimulatedScene:
    """What was simulated: the graph to optimize, the same at the true values, and how many points too few see."""

    scene: CameraScene
    graph: FactorGraph
    truth: FactorGraph
    dropped: int


def simulate_cameras(scene: CameraScene) -> SimulatedScene:
    """Simulate a scene; the same seed gives the same scene.

    Raises
    ------
    UsageError
        If no point is seen twice.
    """
    world, views, noise, start = (np.random.default_rng([scene.seed, k]) for k in range(4))
    cameras, points = _cameras(scene, world), _points(scene, world)
    rows, pixels = _seen(scene, cameras, points, views)
    enough = np.bincount(rows[:, 1], minlength=scene.points) >= _LEAST_VIEWS
    if not enough.any():
        raise UsageError("no point is seen by two cameras", ("  more cameras, a larger image or another radius help",))
    kept = enough[rows[:, 1]]
    rows, pixels, points = rows[kept], pixels[kept], points[enough]
    rows[:, 1] = (np.cumsum(enough) - 1)[rows[:, 1]]
    pixels += noise.normal(0.0, scene.noise, pixels.shape) if scene.noise else 0.0
    truth = scenes.graph(
        scenes.Source(scene.world, "bal", b"", b"", 0, {"observations": len(rows)}),
        camera_ids=np.arange(scene.cameras),
        cameras=cameras,
        point_ids=scene.cameras + np.arange(len(points)),
        points=points,
        rows=rows,
        pixels=pixels,
        lines=np.zeros(len(rows), dtype=np.intp),
    )
    truth.document = truth.report = None  # made in memory
    return SimulatedScene(scene, truth.with_values(_start(scene, truth, start)), truth, int((~enough).sum()))


def _seen(scene: CameraScene, cameras: Array, points: Array, rng: np.random.Generator) -> tuple[IndexArray, Array]:
    """Which camera sees which point, (m, 2), and at which pixels, (m, 2): some cameras at a time, to save memory."""
    all_rows, all_pixels = [], []
    step = max(1, _PAIRS // scene.points)
    for first in range(0, scene.cameras, step):
        some = cameras[first : first + step]
        rows = np.argwhere(rng.random((len(some), scene.points)) < scene.probability)
        x = some[rows[:, 0]], points[rows[:, 1]]
        with np.errstate(all="ignore"):
            pixels = models.BAL_PROJECTION.residual(x, np.zeros((len(rows), 2)), None)
            seen = (models.BAL_PROJECTION.depth(x) > 0.0) & (np.abs(pixels) <= scene.image).all(axis=1)
        all_rows.append(rows[seen] + [first, 0])
        all_pixels.append(pixels[seen])
    return np.concatenate(all_rows), np.concatenate(all_pixels)


def _cameras(scene: CameraScene, rng: np.random.Generator) -> Array:
    """True values (n, 10)."""
    count = scene.cameras
    if scene.world == "camera-ring":
        angle = 2.0 * np.pi * np.arange(count) / count
        height = rng.normal(0.0, 0.1 * scene.radius, count)
        places = np.stack([scene.radius * np.cos(angle), scene.radius * np.sin(angle), height], axis=1)
        back, up = places, np.array([0.0, 0.0, 1.0])
    else:
        along = scene.spacing * np.arange(count)
        across, height = rng.normal(0.0, 0.05 * scene.radius, (2, count))
        places = np.stack([along, across, scene.radius + height], axis=1)
        back, up = np.array([0.0, 0.0, 1.0]) + rng.normal(0.0, 0.05, (count, 3)), np.array([1.0, 0.0, 0.0])
    back = back / np.linalg.norm(back, axis=1, keepdims=True)
    right = np.cross(up, back)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    turn = so3.from_matrix(np.stack([right, np.cross(back, right), back], axis=2))
    intrinsics = np.stack(
        [
            scene.focal * (1.0 + rng.normal(0.0, 0.01, count)),
            scene.k1 + rng.normal(0.0, 0.01, count),
            scene.k2 + rng.normal(0.0, 0.01, count),
        ],
        axis=1,
    )
    return np.concatenate([places, turn, intrinsics], axis=1)


def _points(scene: CameraScene, rng: np.random.Generator) -> Array:
    """True places (p, 3)."""
    cube = rng.uniform(-1.0, 1.0, (scene.points, 3))
    if scene.world == "camera-ring":
        return scene.extent * cube
    length = 0.5 * scene.spacing * (scene.cameras - 1)
    relief = 0.1 * scene.radius
    return cube * [length + scene.extent, scene.extent, relief] + [length, 0.0, 0.0]


def _start(scene: CameraScene, truth: FactorGraph, rng: np.random.Generator) -> dict[str, Array]:
    """The values to start from."""
    cameras, points = truth.values[models.CAMERA.name], truth.values["XYZ"]
    delta = np.zeros((len(cameras), models.CAMERA.dimension))
    delta[:, :3] = rng.normal(0.0, scene.position, (len(cameras), 3))
    delta[:, 3:6] = 0.5 * rng.normal(0.0, scene.rotation, (len(cameras), 3))  # half a rotation vector
    delta[:, 6] = cameras[:, 7] * rng.normal(0.0, scene.focal_error, len(cameras))
    moved = points + rng.normal(0.0, scene.position, points.shape)
    return {models.CAMERA.name: models.CAMERA.retract(cameras, delta), "XYZ": moved}
