"""Spatial worlds. Every function takes the number of poses, a generator, and parameters of its own; metres."""

from __future__ import annotations

import math

import numpy as np

from slamcli.geometry import so3
from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array
from slamcli.simulation.portable import portable
from slamcli.simulation.worlds.path import Path, lagged, lattice, rotation


def sphere(poses: int, rng: np.random.Generator, *, per_ring: int = 0, radius: float = 0.0) -> Path:
    """A spiral of rings from the south pole of a sphere to the north pole; neighbours are one ring apart.

    By default as many rings as poses on a ring, and a radius for steps of about 1 m at the equator.
    """
    per_ring = per_ring or max(round(math.sqrt(poses)), 3)
    radius = radius or per_ring / (2.0 * math.pi)
    longitude = portable(np.arange(poses) * (2.0 * math.pi / per_ring))
    latitude = math.pi * (np.arange(poses) / max(poses - 1, 1) - 0.5)
    attitude = so3.compose(rotation(2, longitude), rotation(1, -latitude))
    outward = np.tile([radius, 0.0, 0.0], (poses, 1))
    # x forward along the ring, z outward: the frame that points outward turned about its own axes
    forward = np.array([0.5, 0.5, 0.5, 0.5])  # x to y, y to z, z to x
    return Path(_stacked(so3.act(portable(attitude), outward), _turned(attitude, forward)), lagged(poses, per_ring))


def torus(poses: int, rng: np.random.Generator, *, per_ring: int = 0, major: float = 0.0, minor: float = 0.0) -> Path:
    """Windings round the tube of a torus; neighbours are one winding apart, and the last winding meets the first.

    By default twice as many windings as poses on each, steps of about 1 m and a hole as wide as the tube.
    """
    windings = max(round(poses / (per_ring or max(math.sqrt(poses / 2.0), 3.0))), 1)
    minor = minor or poses / windings / (2.0 * math.pi)
    along = portable(np.arange(poses) * (2.0 * math.pi / poses))
    around = portable(np.arange(poses) * (2.0 * math.pi * windings / poses))
    frame = portable(so3.compose(rotation(2, along), rotation(1, -around)))  # x out of the tube
    centre = so3.act(rotation(2, along), np.tile([major or 3.0 * minor, 0.0, 0.0], (poses, 1)))
    positions = portable(centre) + so3.act(frame, np.tile([minor, 0.0, 0.0], (poses, 1)))
    lag = round(poses / windings)
    last = np.arange(max(poses - lag, lag), poses)
    forward = np.array([0.0, -math.sqrt(0.5), 0.0, math.sqrt(0.5)])  # x to z: ahead is round the tube
    pairs = np.concatenate([lagged(poses, lag), np.stack([last - (poses - lag), last], axis=1)])
    return Path(_stacked(positions, _turned(frame, forward)), pairs)


def grid(poses: int, rng: np.random.Generator, *, spacing: float = 1.0, side: int = 0) -> Path:
    """Through all points of a cubic lattice, ``side`` points an edge, level by level; neighbours are one step apart."""
    side = side or max(math.ceil(round(poses ** (1.0 / 3.0), 9)), 2)
    number = np.arange(poses)
    level, rest = number // (side * side), number % (side * side)
    rest = np.where(level % 2 == 1, side * side - 1 - rest, rest)
    row, column = rest // side, rest % side
    column = np.where(row % 2 == 1, side - 1 - column, column)
    cell = np.stack([column, row, level], axis=1)
    positions = portable(cell * spacing)
    ahead = np.diff(cell, axis=0, append=cell[-1:])
    heading = portable(np.arctan2(portable(ahead[:, 1]), portable(ahead[:, 0])))
    index = np.full(cell.max(axis=0) + 2, -1)
    index[column, row, level] = number
    pairs = []
    for shift in ((1, 0, 0), (0, 1, 0), (0, 0, 1)):
        other = index[column + shift[0], row + shift[1], level + shift[2]]
        pairs.append(np.sort(np.stack([number, other], axis=1)[other >= 0], axis=1))
    found = np.concatenate(pairs)
    found = found[found[:, 1] - found[:, 0] > 1]
    return Path(_stacked(positions, rotation(2, heading)), found[np.lexsort((found[:, 0], found[:, 1]))])


def helix(poses: int, rng: np.random.Generator, *, per_turn: int = 0, rise: float = 3.0) -> Path:
    """Up the ramp of a parking garage and down again; neighbours are one turn apart, or at one place of the ramp."""
    per_turn = per_turn or max(round(math.sqrt(poses)), 4)
    radius = per_turn / (2.0 * math.pi)
    top = (poses - 1) // 2
    number = np.arange(poses)
    climbed = np.minimum(number, 2 * top - number)
    angle = portable(climbed * (2.0 * math.pi / per_turn))
    positions = np.stack([radius * np.sin(angle), radius * (1.0 - np.cos(angle)), climbed * (rise / per_turn)], axis=1)
    down = np.where(number > top, math.pi, 0.0)
    slope = math.atan2(rise, float(per_turn))
    pitch = rotation(1, np.where(number > top, slope, -slope))
    attitude = so3.compose(portable(so3.compose(rotation(2, angle), rotation(2, down))), pitch)
    met = np.stack([2 * top - number, number], axis=1)[(number > top + 1) & (number <= 2 * top)]
    pairs = np.concatenate([lagged(top + 1, per_turn), met])
    return Path(_stacked(portable(positions), attitude), pairs[np.lexsort((pairs[:, 0], pairs[:, 1]))])


def lawnmower(
    poses: int, rng: np.random.Generator, *, spacing: float = 1.0, line: int = 0, swath: int = 4, height: float = 20.0
) -> Path:
    """A drone that mows a field in parallel lines of ``line`` steps, ``swath`` steps apart, over rolling ground.

    It rises and sinks by a tenth of its height along a line, nose along the path; neighbours fly abreast.
    """
    line = line or max(round(math.sqrt(poses * swath)), swath + 1)
    turns = np.zeros(poses - 1, dtype=np.intp)
    lap = [*([0] * (line - 1)), 1, *([0] * (swath - 1)), 1, *([0] * (line - 1)), -1, *([0] * (swath - 1)), -1]
    turns[:] = np.resize(np.array(lap), poses - 1)
    flat = lattice(turns, spacing)
    phase = portable(np.asarray(flat[:, 0]) * (2.0 * math.pi / (line * spacing)))
    altitude = height * (1.0 + 0.1 * np.sin(phase))
    # slope of the ground along the path: only the lines along x climb
    slope = 0.1 * height * (2.0 * math.pi / (line * spacing)) * np.cos(phase) * np.cos(flat[:, 2])
    pitch = -np.arctan2(slope, portable(np.ones(poses)))
    attitude = so3.compose(rotation(2, flat[:, 2]), rotation(1, pitch))
    positions = portable(np.stack([flat[:, 0], flat[:, 1], altitude], axis=1))
    return Path(_stacked(positions, attitude), _abreast(poses, line, swath))


def _abreast(poses: int, line: int, swath: int) -> IndexArray:
    """Pairs of poses on neighbouring lines at the same point along them."""
    period = line + swath
    number = np.arange(poses)
    lane, along = number // period, number % period
    mirrored = (lane - 1) * period + (line - along)
    here = (along <= line) & (lane > 0) & (number - mirrored > 1)
    return np.stack([mirrored, number], axis=1)[here]


def _turned(attitude: Array, by: Array) -> Array:
    """Attitudes (n, 4) followed by one turn (4,) in the body frame."""
    return portable(so3.normalize(portable(so3.compose(portable(attitude), portable(np.tile(by, (len(attitude), 1)))))))


def _stacked(positions: Array, attitude: Array) -> Array:
    """Poses (n, 7) of positions and unit quaternions with w >= 0."""
    unit = np.asarray(so3.normalize(portable(attitude)))
    unit = np.where(unit[:, 3:] < 0.0, -unit, unit)
    return portable(np.concatenate([np.asarray(positions), unit], axis=1))
