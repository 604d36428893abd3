"""Loop closures: which earlier poses are recognized, and what is measured then."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.errors import UsageError
from slamcli.geometry import so2, so3
from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.models.base import Array
from slamcli.simulation.noise import Noise
from slamcli.simulation.places import meetings
from slamcli.simulation.portable import portable
from slamcli.simulation.robots import relative_covariance, relative_poses, spoiled
from slamcli.simulation.scenario import Closures
from slamcli.simulation.worlds import Path

_MOST_FALSE = 10_000_000


@dataclass(frozen=True, eq=False)
class LoopClosures:
    """Measured relative poses between poses that are not consecutive.

    Attributes
    ----------
    pairs
        (m, 2) rows (earlier, later), by the later pose.
    measurements
        (m, size) relative poses.
    information
        (d, d), one for all.
    false
        (m,) which of them are not true.
    """

    pairs: IndexArray
    measurements: Array
    information: Array
    false: BoolArray


def close_loops(path: Path, options: Closures, robot_noise: object, rng: np.random.Generator) -> LoopClosures:
    """Loop closures along a path.

    Raises
    ------
    UsageError
        If more are wanted than there are, or more false ones than fit into memory.
    """
    noise_of = robot_noise if options.noise is None else options.noise
    noise = Noise(relative_covariance(noise_of, path.space, "closures.noise"), options.tails)
    pairs = _recognized(path, options, rng)
    exact = relative_poses(path.poses, pairs[:, 0], pairs[:, 1])
    measured = spoiled(exact, noise.draw(rng, len(pairs))) if len(pairs) else exact
    false = np.zeros(len(pairs), dtype=bool)
    wrong = round(options.false * len(pairs))
    if wrong > _MOST_FALSE:
        raise UsageError(f"closures.false: {options.false:g} of {len(pairs)} true closures are more than {_MOST_FALSE}")
    if wrong:
        others = _random_pairs(len(path.poses), wrong, options.gap, rng)
        nowhere = _near_each_other(path.space, wrong, rng)
        pairs, false = np.concatenate([pairs, others]), np.concatenate([false, np.ones(wrong, dtype=bool)])
        measured = portable(np.concatenate([np.asarray(measured), np.asarray(nowhere)]))
    order = np.lexsort((pairs[:, 0], pairs[:, 1]))
    return LoopClosures(pairs[order], np.asarray(measured)[order], noise.information, false[order])


def _recognized(path: Path, options: Closures, rng: np.random.Generator) -> IndexArray:
    """Pairs of poses that a front end recognizes."""
    if options.by == "none":
        return np.empty((0, 2), dtype=np.intp)
    if options.by == "topology" and path.neighbours is None:
        raise UsageError("closures.by: this world has no topology of its own", ("  use closures.by=place",))
    if options.by != "place" and path.neighbours is not None:
        pairs = path.neighbours
        pairs = pairs[(pairs[:, 1] - pairs[:, 0] >= min(options.gap, 2))]
    else:
        reach = 1.5 * float(np.median(path.steps())) if options.reach is None else options.reach
        pairs = meetings(path.positions, max(reach, 1e-6), int(options.gap), int(options.per_pose), rng)
    pairs = pairs[_same_view(path.poses, pairs, options.field_of_view)]
    if options.count is None:
        return pairs[rng.random(len(pairs)) < options.probability]
    if options.count > len(pairs):
        raise UsageError(
            f"closures.count: {options.count} wanted, but only {len(pairs)} pairs of poses meet",
            ("  a larger closures.reach or per_pose, a smaller gap, or a smaller world makes more",),
        )
    return pairs[np.sort(rng.permutation(len(pairs))[: options.count])]


def _same_view(poses: Array, pairs: IndexArray, field_of_view: float) -> BoolArray:
    """Which pairs look the same way, to half the field of view (about any axis in space)."""
    if field_of_view >= 2.0 * np.pi:
        return np.ones(len(pairs), dtype=bool)
    limit = portable([0.5 * field_of_view])
    if poses.shape[1] == 3:
        return np.asarray(np.abs(so2.wrap(poses[pairs[:, 1], 2] - poses[pairs[:, 0], 2])) <= limit)
    turn = so3.between(poses[pairs[:, 0], 3:], poses[pairs[:, 1], 3:])
    return np.asarray(np.abs(turn[:, 3]) >= np.asarray(np.cos(0.5 * limit)))


def _random_pairs(poses: int, count: int, gap: int, rng: np.random.Generator) -> IndexArray:
    """Pairs of poses anywhere, at least a gap apart in time."""
    gap = min(int(gap), poses - 1)
    earlier = rng.integers(0, poses - gap, count)
    later = earlier + gap + np.floor(rng.random(count) * (poses - gap - earlier)).astype(np.intp)
    return np.stack([earlier, later], axis=1)


def _near_each_other(space: int, count: int, rng: np.random.Generator) -> Array:
    """Relative poses as a place recognition reports them: 0.3 m and 10 degrees about none (Suenderhauf, Vertigo)."""
    noise = Noise(relative_covariance((0.3, np.deg2rad(10.0)), space, ""))
    identity = np.zeros((count, 3 if space == 2 else 7))
    if space == 3:
        identity[:, 6] = 1.0
    return spoiled(portable(identity), noise.draw(rng, count))
