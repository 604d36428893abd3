"""What sensors see of landmarks, and what a receiver says about positions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from slamcli import models
from slamcli.errors import UsageError
from slamcli.geometry import se2, se3, so2
from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.models import FactorKind, range_bearing
from slamcli.models.base import Array
from slamcli.simulation.noise import Noise
from slamcli.simulation.portable import portable
from slamcli.simulation.robots import covariance_of, numbers_of
from slamcli.simulation.scenario import Landmarks, Sensor
from slamcli.simulation.worlds import Path

_CHUNK = 20_000  # poses that look for landmarks at a time
_DRAWN_AT_ONCE = 500_000  # landmarks, of which those near the path are kept
_MOST_DRAWN = 1e9


@dataclass(frozen=True, eq=False)
class Readings:
    """All readings of one sensor.

    Attributes
    ----------
    kind
        The factor that a reading becomes.
    poses
        (m,) rows of the poses, ascending.
    landmarks
        (m,) rows of the landmarks they are taken for; empty for a sensor of positions.
    measurements
        (m, k) in metres and radians.
    information
        (d, d), one for all.
    false
        (m,) which of them come from nothing.
    """

    kind: FactorKind
    poses: IndexArray
    landmarks: IndexArray
    measurements: Array
    information: Array
    false: BoolArray


@dataclass(frozen=True)
class _Model:
    """A kind of sensor: its factor, its default noise, and its reading of a point (m, space) in the pose's frame."""

    kind: FactorKind
    noise: tuple[float, ...]
    read: Callable[[Array], list[Array]]


def _polar(local: Array) -> list[Array]:
    origin = portable(np.zeros((len(local), 3)))
    return [portable(part) for part in range_bearing.predict(origin, local)]


_MODELS: dict[str, _Model] = {
    "xy": _Model(models.POINT_OBSERVATION_2D, (0.1, 0.1), lambda local: [local[:, 0], local[:, 1]]),
    "range-bearing": _Model(models.RANGE_BEARING_2D, (0.1, 0.02), _polar),
    "bearing": _Model(models.BEARING_2D, (0.02,), lambda local: _polar(local)[1:]),
    "range": _Model(models.RANGE_2D, (0.1,), lambda local: _polar(local)[:1]),
    "point": _Model(models.POINT_OBSERVATION_3D, (0.1, 0.1, 0.1), lambda local: [local[:, k] for k in range(3)]),
}


def scatter(path: Path, options: Landmarks, reach: float, rng: np.random.Generator) -> Array:
    """Landmarks (k, space), uniform over what a sensor of some reach can see from the path.

    Raises
    ------
    UsageError
        If a density wants more points than can be drawn.
    """
    positions = np.asarray(path.positions)
    low, high = positions.min(axis=0) - reach, positions.max(axis=0) + reach
    volume = float(np.prod(high - low))
    wanted = options.count
    if not options.density * volume <= _MOST_DRAWN:
        raise UsageError(
            f"landmarks.density: {options.density * volume:.3g} points would lie in the box around the path",
            (f"  more than {_MOST_DRAWN:g} take too long; landmarks.count or a smaller world makes fewer",),
        )
    drawn = round(options.density * volume) if wanted is None else max(4 * wanted, 16)
    kept = np.empty((0, path.space))
    while True:
        parts = [kept]
        for begin in range(0, drawn, _DRAWN_AT_ONCE):
            count = min(_DRAWN_AT_ONCE, drawn - begin)
            points = low + (high - low) * rng.random((count, path.space))
            parts.append(points[_near(positions, points, reach)])
        kept = np.concatenate(parts)
        if wanted is None or len(kept) >= wanted:
            return portable(kept[:wanted])
        drawn = min(4 * drawn, 1_000_000)


def sense(path: Path, landmarks: Array, sensor: Sensor, name: str, rng: np.random.Generator) -> Readings:
    """All readings of one sensor along the path."""
    if sensor.kind == "gps":
        return _positions(path, sensor, name, rng)
    model = _MODELS[sensor.kind]
    noise = _noise(sensor, model.noise, model.kind.dimension, name)
    poses, seen, local = _in_view(path, landmarks, sensor)
    detected = rng.random(len(poses)) < sensor.detection
    poses, seen, local = poses[detected], seen[detected], portable(local[detected])
    reading = np.stack([np.asarray(part) for part in model.read(local)], axis=1)
    reading = reading.reshape(len(poses), model.kind.measurement_size)
    # h - z is the error of positions, z - h that of ranges and bearings: the noise is symmetric, so either will do
    reading += noise.draw(rng, len(poses))
    false = np.zeros(len(poses), dtype=bool)
    expected = sensor.false_alarms * len(range(0, len(path.poses), sensor.every))
    alarms = int(rng.poisson(expected)) if expected and len(poses) else 0
    if alarms:
        victims = np.sort(rng.integers(0, len(poses), alarms))
        nothing = model.read(_anywhere_in_view(path.space, sensor, alarms, rng))
        clutter = np.stack([np.asarray(part) for part in nothing], axis=1)
        poses, seen = np.concatenate([poses, poses[victims]]), np.concatenate([seen, seen[victims]])
        reading, false = np.concatenate([reading, clutter]), np.concatenate([false, np.ones(alarms, dtype=bool)])
        order = np.argsort(poses, kind="stable")
        poses, seen, reading, false = poses[order], seen[order], reading[order], false[order]
    return Readings(model.kind, poses, seen, _wrapped(model.kind, reading), noise.information, false)


def _noise(sensor: Sensor, default: tuple[float, ...], dimension: int, name: str) -> Noise:
    given = numbers_of(list(default) if sensor.noise is None else sensor.noise, f"{name}.noise")
    return Noise(covariance_of(given, dimension, f"{name}.noise"), sensor.tails)


def _positions(path: Path, sensor: Sensor, name: str, rng: np.random.Generator) -> Readings:
    """Positions in the world's frame, as satellites tell them."""
    kind = models.POSITION_PRIOR_2D if path.space == 2 else models.POSITION_PRIOR_3D
    noise = _noise(sensor, (0.5,) * path.space, path.space, name)
    poses = np.arange(0, len(path.poses), sensor.every)
    poses = poses[rng.random(len(poses)) < sensor.detection]
    measured = np.asarray(path.positions)[poses] + noise.draw(rng, len(poses))
    none = np.empty(0, dtype=np.intp)
    return Readings(kind, poses, none, measured, noise.information, np.zeros(len(poses), dtype=bool))


def _in_view(path: Path, landmarks: Array, sensor: Sensor) -> tuple[IndexArray, IndexArray, Array]:
    """Rows of poses and of the landmarks in their view, and the landmarks in the poses' frames."""
    from scipy.spatial import cKDTree

    group = se2 if path.space == 2 else se3
    found: list[tuple[IndexArray, IndexArray, Array]] = []
    tree = cKDTree(np.asarray(landmarks)) if len(landmarks) else None
    looking = np.arange(0, len(path.poses), sensor.every)
    for rows in np.array_split(looking, max(len(looking) // _CHUNK, 1)):
        if tree is None:
            break
        here = cKDTree(np.asarray(path.positions)[rows])
        # a little more than the range: the exact test below must not depend on the tree's arithmetic
        near = here.sparse_distance_matrix(tree, sensor.range * (1.0 + 1e-9), output_type="ndarray")
        order = np.lexsort((near["j"], near["i"]))
        pose, landmark = rows[near["i"][order]], near["j"][order]
        local = portable(group.act(portable(group.inverse(path.poses[pose])), landmarks[landmark]))
        distance = np.sqrt(sum(np.square(local[:, k]) for k in range(path.space)))
        half = portable([0.5 * min(sensor.field_of_view, 2.0 * np.pi)])
        visible = np.asarray((distance <= sensor.range) & (local[:, 0] >= distance * np.cos(half)) & (distance > 1e-6))
        if sensor.field_of_view >= 2.0 * np.pi:
            visible = np.asarray((distance <= sensor.range) & (distance > 1e-6))
        found.append((pose[visible], landmark[visible], np.asarray(local)[visible]))
    if not found:
        none = np.empty(0, dtype=np.intp)
        return none, none, portable(np.empty((0, path.space)))
    poses, seen, local_points = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return poses, seen, portable(local_points)


def _near(positions: Array, points: Array, reach: float) -> BoolArray:
    """Which points some position can reach."""
    from scipy.spatial import cKDTree

    # a little more than the reach: the exact test below must not depend on the tree's arithmetic
    closest = cKDTree(positions).query(points, distance_upper_bound=reach * (1.0 + 1e-9))[1]
    found = np.flatnonzero(closest < len(positions))
    difference = portable(points[found]) - positions[closest[found]]
    near = np.zeros(len(points), dtype=bool)
    near[found] = sum(np.square(difference[:, k]) for k in range(points.shape[1])) <= reach * reach
    return near


def _anywhere_in_view(space: int, sensor: Sensor, count: int, rng: np.random.Generator) -> Array:
    """Points uniform in the view of a sensor, in its frame."""
    half = 0.5 * min(sensor.field_of_view, 2.0 * np.pi)
    # the largest of d uniform numbers is distributed as the distance in a ball of d dimensions
    distance = portable(sensor.range * rng.random((count, space)).max(axis=1))
    turn = portable(np.pi * (2.0 * rng.random(count) - 1.0))
    if space == 2:
        turn = turn * (half / np.pi)
        return portable(np.stack([distance * np.cos(turn), distance * np.sin(turn)], axis=1))
    # on a sphere, the height along the axis is uniform (Archimedes): 1 - cos from 0 to 2 sin^2(half / 2)
    sine = np.sin(portable([0.5 * half]))
    drop = rng.random(count) * (2.0 * sine * sine)
    aside = distance * np.sqrt(drop * (2.0 - drop))
    return portable(np.stack([distance * (1.0 - drop), aside * np.cos(turn), aside * np.sin(turn)], axis=1))


def _wrapped(kind: FactorKind, reading: Array) -> Array:
    """Bearings in [-pi, pi)."""
    out = reading.copy()
    for k, component in enumerate(kind.components):
        if component == "bearing":
            out[:, k] = so2.wrap(out[:, k])
    return out
