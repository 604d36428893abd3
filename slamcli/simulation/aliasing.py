"""Perceptual aliasing: places that look alike because the path through them has the same shape."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from slamcli.geometry import so2, so3
from slamcli.graph.columns import IndexArray
from slamcli.models import SE2
from slamcli.models.base import Array
from slamcli.simulation.odometry_chain import OdometryChain

#: Two stretches of path are alike when their points differ by no more than this share of the path (root mean square),
ALIKE = 0.05
#: and their headings by no more than this, in radians.
ALIKE_TURN = np.deg2rad(30.0)

_POINTS = 5  # of a stretch, by which similar ones are looked up
_ANCHORS = 20_000  # stretches that others are looked up for: at least so many, and each at least once
_CHUNK = 256


def alike_places(
    chain: OdometryChain, least: int, most: int, rng: np.random.Generator
) -> Iterator[tuple[IndexArray, IndexArray]]:
    """Pairs of stretches whose shapes are alike, in random order.

    Shapes are compared in the frame of the stretch's first pose, by dead reckoning: the guess plays no part.
    Stretches that overlap or touch, and those along which the robot hardly moves, are left out.

    Parameters
    ----------
    chain
        The poses.
    least, most
        Steps that stretches are alike for: at least so many, and the most that are asked for.
    rng
        Which pairs come up when.

    Yields
    ------
    firsts : (c, 2)
        Numbers of the first poses of both stretches, the smaller one first. Pairs may come up again.
    steps : (c,)
        How long the stretches stay alike, least to most.
    """
    from scipy.spatial import cKDTree

    starts = chain.windows(least)
    if len(starts) < 2:
        return
    shapes, lengths = _shapes(chain, starts, least)
    moving = (lengths > 0.5 * np.median(lengths)) & (lengths > 0.0)
    starts, shapes, lengths = starts[moving], shapes[moving], lengths[moving]
    if len(starts) < 2:
        return
    tree = cKDTree(shapes)
    # the distance of two shapes is the root of a sum over their points
    reach = ALIKE * np.sqrt(shapes.shape[1] // chain.kind.space) * lengths
    neighbours = min(len(starts), 8 * least)
    for _ in range(-(-_ANCHORS // len(starts))):
        order = rng.permutation(len(starts))
        for begin in range(0, len(order), _CHUNK):
            chunk = order[begin : begin + _CHUNK]
            distance, other = tree.query(shapes[chunk], k=neighbours, distance_upper_bound=float(reach[chunk].max()))
            lottery = rng.random(distance.shape)
            other = np.minimum(other, len(starts) - 1)  # where there is no neighbour, the distance is infinite
            apart = np.abs(starts[other] - starts[chunk][:, None]) > most
            lottery[~(apart & (distance <= reach[chunk][:, None]))] = -1.0
            drawn = np.argmax(lottery, axis=1)
            rows = np.flatnonzero(lottery[np.arange(len(chunk)), drawn] >= 0.0)
            pairs = np.sort(np.stack([starts[chunk[rows]], starts[other[rows, drawn[rows]]]], axis=1), axis=1)
            steps = _alike_for(chain, pairs, most)
            yield pairs[steps >= least], steps[steps >= least]


def _shapes(chain: OdometryChain, starts: IndexArray, length: int) -> tuple[Array, Array]:
    """Positions at some points of each stretch, (c, points * space), and lengths of the paths (c,) in metres."""
    kind = chain.kind
    at = set(np.linspace(0, length, _POINTS + 1).round().astype(int).tolist()[1:])
    pose = np.tile(np.array(kind.identity), (len(starts), 1))
    points, driven = [], np.zeros(len(starts))
    for k in range(length):
        step = chain.steps[starts + k]
        driven += np.sqrt(np.square(step[:, : kind.space]).sum(axis=1))
        pose = kind.compose(pose, step)
        if k + 1 in at:
            points.append(pose[:, : kind.space].copy())
    return np.concatenate(points, axis=1), driven


def _alike_for(chain: OdometryChain, pairs: IndexArray, most: int) -> IndexArray:
    """For how many steps, up to ``most``, both stretches of each pair are driven and alike."""
    space = chain.kind.space
    paths = [chain.path(pairs[:, slot], most) for slot in (0, 1)]
    driven = [np.sqrt(np.square(np.diff(path[:, :, :space], axis=1)).sum(axis=2)).cumsum(axis=1) for path in paths]
    apart = np.square(paths[0] - paths[1])[:, 1:, :space].sum(axis=2)
    number = np.arange(1, most + 1)
    alike = np.sqrt(apart.cumsum(axis=1) / number) <= ALIKE * np.minimum(*driven)
    alike &= _angle(chain, *paths)[:, 1:] <= ALIKE_TURN
    for slot in (0, 1):
        step = pairs[:, slot, None] + number - 1
        alike &= (step < len(chain.driven)) & chain.driven[np.minimum(step, len(chain.driven) - 1)]
    return np.where(alike.all(axis=1), most, np.argmin(alike, axis=1))


def _angle(chain: OdometryChain, first: Array, second: Array) -> Array:
    """Angle between the orientations of poses, in radians."""
    rotation = chain.kind.compose(chain.kind.inverse(first), second)[..., chain.kind.space :]
    if chain.kind is SE2:
        return np.abs(so2.wrap(rotation[..., 0]))
    return np.asarray(2.0 * np.arctan2(so3.norm(rotation), np.abs(rotation[..., 3])))
