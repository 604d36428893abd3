"""Planar worlds. Every function takes the number of poses, a generator, and parameters of its own; metres."""

from __future__ import annotations

import math

import numpy as np

from slamcli.geometry import se2
from slamcli.models.base import Array
from slamcli.simulation.portable import portable
from slamcli.simulation.worlds.path import Path, lattice, rounds


def square(poses: int, rng: np.random.Generator, *, spacing: float = 1.0, laps: int = 1) -> Path:
    """Laps round a square; the last pose is where the first one was (if poses - 1 is a multiple of 4 laps)."""
    side = max((poses - 1) // (4 * laps), 1)
    turns = np.zeros(poses - 1, dtype=np.intp)
    turns[side - 1 :: side] = 1
    return Path(lattice(turns, spacing))


def circle(poses: int, rng: np.random.Generator, *, spacing: float = 1.0, laps: int = 1) -> Path:
    """Laps round a circle, counterclockwise; the last pose is where the first one was."""
    angle = portable(np.arange(poses) * (2.0 * math.pi * laps / max(poses - 1, 1)))
    radius = spacing * max(poses - 1, 1) / (2.0 * math.pi * laps)
    return Path(_round(angle, radius, 1.0))


def figure_eight(poses: int, rng: np.random.Generator, *, spacing: float = 1.0, laps: int = 1) -> Path:
    """Laps of two circles that touch at the start, the left one counterclockwise, then the right one clockwise."""
    per_lap = max(poses - 1, 1) / laps
    phase = np.arange(poses) * (2.0 / per_lap)  # circles driven
    right = np.floor(phase) % 2 == 1
    radius = spacing * per_lap / (4.0 * math.pi)
    angle = portable((phase - np.floor(phase)) * (2.0 * math.pi))
    left = _round(angle, radius, 1.0)
    return Path(portable(np.where(right[:, None], _round(angle, radius, -1.0), left)))


def corridor(poses: int, rng: np.random.Generator, *, spacing: float = 1.0, rooms: int = 8, depth: int = 4) -> Path:
    """A corridor with ``rooms`` equal rooms of ``depth`` steps on each side: into every room, out again, and round.

    All rooms look alike: what perceptual aliasing is made of.
    """
    pitch = 4  # steps from door to door
    corners: list[tuple[int, int]] = []
    for door in range(1, pitch * rooms, pitch):
        corners += [(door, 0), (door, -depth), (door + 2, -depth), (door + 2, 0)]
    corners += [(pitch * rooms, 0), (pitch * rooms, 1)]
    for door in range(pitch * rooms - 1, 0, -pitch):
        corners += [(door, 1), (door, 1 + depth), (door - 2, 1 + depth), (door - 2, 1)]
    return Path(lattice(rounds([*corners, (0, 1), (0, 0)], poses - 1), spacing))


def manhattan(
    poses: int,
    rng: np.random.Generator,
    *,
    spacing: float = 1.0,
    block: int = 1,
    turning: float = 0.4,
    half: float | None = None,
) -> Path:
    """A random walk on square streets of ``block`` steps between crossings.

    At a crossing the robot turns left or right with probability ``turning``; where it would leave the square of
    ``half`` metres from the start, it turns away from the border. By default the square has as many lattice points
    as there are poses, so that places are met again about as often however long the walk is.
    """
    limit = math.ceil(0.5 * math.sqrt(poses) / block) if half is None else int(half / (spacing * block))
    limit = max(limit, 1)
    crossings = poses // block + 1
    chance = rng.random(crossings)
    wanted = np.where(chance < 0.5 * turning, 1, np.where(chance < turning, -1, 0)).tolist()
    aside = (2 * rng.integers(0, 2, crossings) - 1).tolist()
    turns = np.zeros(poses - 1, dtype=np.intp)
    turns[block - 1 :: block] = _walk(wanted, aside, limit)[: len(turns[block - 1 :: block])]
    return Path(lattice(turns, spacing))


def city(
    poses: int,
    rng: np.random.Generator,
    *,
    spacing: float = 1.0,
    block: int = 10,
    turning: float = 0.5,
    half: float | None = None,
) -> Path:
    """Streets ten steps long between the crossings, else as ``manhattan``."""
    side = 0.5 * math.sqrt(poses * block / 2.0) * spacing  # about two visits to every place
    return manhattan(poses, rng, spacing=spacing, block=block, turning=turning, half=side if half is None else half)


def garage(poses: int, rng: np.random.Generator, *, spacing: float = 1.0, aisles: int = 8, length: int = 30) -> Path:
    """One level of a parking garage: up and down its parallel aisles, home along the wall, and again."""
    pitch = 6  # steps from aisle to aisle
    top = pitch * (aisles - 1)
    corners: list[tuple[int, int]] = []
    for k in range(aisles):
        end = length if k % 2 == 0 else 0
        corners += [(end, pitch * k), (end, pitch * (k + 1))] if k < aisles - 1 else [(end, top)]
    wall = length + 2 if aisles % 2 else -2
    return Path(lattice(rounds([*corners, (wall, top), (wall, -2), (0, -2), (0, 0)], poses - 1), spacing))


def _round(angle: Array, radius: float, side: float) -> Array:
    """Poses (n, 3) on a circle that touches the x axis at the origin, to its left (side 1) or right (side -1)."""
    x, y = radius * np.sin(angle), radius * side * (1.0 - np.cos(angle))
    return se2.normalize(portable(np.stack([x, y, side * angle], axis=1)))


def _walk(wanted: list[int], aside: list[int], limit: int) -> list[int]:
    """Quarter turns at the crossings of a walk that stays within ``limit`` crossings of the start."""
    x, y, heading = 1, 0, 0
    east, north = (1, 0, -1, 0), (0, 1, 0, -1)
    turns = []
    for turn, other in zip(wanted, aside, strict=True):
        choices = (turn, other, -other, 2)
        for choice in choices:
            new = (heading + choice) % 4
            if abs(x + east[new]) <= limit and abs(y + north[new]) <= limit:
                break
        turns.append(choice)
        heading = new
        x, y = x + east[new], y + north[new]
    return turns
