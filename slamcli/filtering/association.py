"""Which landmark is each reading of: chi-square gates, nearest neighbours, joint compatibility.

A reading i and a landmark j are *individually compatible* if the Mahalanobis distance of their innovation is inside
the gate. ``nearest`` pairs every reading with at most one landmark and every landmark with at most one reading so that
the sum of the distances, with the gate as the price of no pair, is least. ``joint_compatibility`` demands that all
pairs together are inside the gate of all their numbers, which sees that errors of one pose are common to all readings
(Neira and Tardos, "Data association in stochastic mapping using the joint compatibility test", 2001).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from slamcli.filtering.readings import Reading, Stream, linearize_readings
from slamcli.filtering.state import POSE, Block, State
from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.models.base import Array

#: Beyond this many standard deviations, taken generously, pairs are not looked at. It covers every gate up to
#: a probability of 1 - 1e-9 and the difference between polar and Cartesian errors.
_REACH = 10.0


@cache
def gate(degrees_of_freedom: int, probability: float) -> float:
    """Value below which a chi-square variable is with this probability."""
    from scipy.special import gammaincinv

    return 2.0 * float(gammaincinv(0.5 * degrees_of_freedom, probability))


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of a reading and a landmark near enough to be looked at, by reading and then by landmark.

    Attributes
    ----------
    readings, landmarks
        (p,) numbers of the reading in the step, and of the landmark among the ones given.
    innovation
        (p, 2) z - h.
    jacobian
        (p, 2, 5) by the pose (steps along the axes of the world) and by the landmark.
    distance
        (p,) squared Mahalanobis distances.
    covariance
        (2 p, 2 p) of all innovations together, noise included where reading and reading are the same.
    """

    readings: IndexArray
    landmarks: IndexArray
    innovation: Array
    jacobian: Array
    distance: Array
    covariance: Array

    def __len__(self) -> int:
        return len(self.readings)

    def inside(self, bound: float) -> Pairs:
        """The pairs of a distance up to ``bound``."""
        rows = np.flatnonzero(self.distance <= bound)
        numbers = (2 * rows[:, None] + np.arange(2)).ravel()
        covariance = self.covariance[np.ix_(numbers, numbers)]
        return Pairs(
            self.readings[rows],
            self.landmarks[rows],
            self.innovation[rows],
            self.jacobian[rows],
            self.distance[rows],
            covariance,
        )


def compare(
    state: State, streams: Sequence[Stream], readings: list[Reading], landmarks: list[Block], bound: float
) -> Pairs:
    """All pairs of readings and landmarks with a distance up to ``bound``.

    Parameters
    ----------
    readings
        Of one step, each of two numbers.
    landmarks
        In the state.
    bound
        Largest squared Mahalanobis distance.
    """
    starts = np.array([block.start for block in landmarks], dtype=np.intp)
    own, cross = state.landmark_covariances(starts)
    pose = state.pose_covariance()
    near = _near(state, streams, readings, starts, own, pose)
    first, second = np.nonzero(near)
    count = len(first)
    innovation, jacobian, noise = np.empty((count, 2)), np.empty((count, 2, 5)), np.empty((count, 2, 2))
    points = state.mean[starts[:, None] + np.arange(2)]
    stream_of, row_of = (np.array([reading[k] for reading in readings], dtype=np.intp) for k in range(2))
    for number in {reading.stream for reading in readings}:
        chosen = np.flatnonzero(stream_of[first] == number)
        rows = row_of[first[chosen]]
        poses = np.broadcast_to(state.mean[:POSE], (len(chosen), POSE))
        nu, by_pose, by_point = linearize_readings(
            streams[number].sensor, poses, points[second[chosen]], streams[number].measurements[rows]
        )
        innovation[chosen], jacobian[chosen, :, :POSE], jacobian[chosen, :, POSE:] = nu, by_pose, by_point
        noise[chosen] = streams[number].noise[rows]
    h, g = jacobian[:, :, :POSE], jacobian[:, :, POSE:]
    mixed = g @ cross[second] @ h.transpose(0, 2, 1)
    covariance = h @ pose @ h.transpose(0, 2, 1) + mixed + mixed.transpose(0, 2, 1) + noise
    covariance += g @ own[second] @ g.transpose(0, 2, 1)
    distance = np.full(count, np.inf)
    finite = np.isfinite(covariance).all(axis=(1, 2)) & np.isfinite(innovation).all(axis=1)
    distance[finite] = _squared(innovation[finite], covariance[finite])
    kept = np.flatnonzero(distance <= bound)
    joint = _joint(state, starts, second[kept], jacobian[kept], noise[kept])
    return Pairs(first[kept], second[kept], innovation[kept], jacobian[kept], distance[kept], joint)


def _near(
    state: State, streams: Sequence[Stream], readings: list[Reading], starts: IndexArray, own: Array, pose: Array
) -> BoolArray:
    """(readings, landmarks) which pairs are near enough in metres to be worth the rest."""
    points = state.mean[starts[:, None] + np.arange(2)]
    places, spread = np.empty((len(readings), 2)), np.empty(len(readings))
    here = state.mean[:POSE]
    for k, (number, row) in enumerate(readings):
        stream = streams[number]
        placed = stream.sensor.kind.place(here[None], stream.measurements[row : row + 1], None)
        assert placed is not None
        places[k] = placed[0]
        square = float(stream.distance[row]) ** 2
        across = 1.0 if stream.sensor.name == "xy" else square  # a bearing's error in metres
        spread[k] = pose[0, 0] + pose[1, 1] + square * pose[2, 2]
        spread[k] += stream.noise[row, 0, 0] + across * stream.noise[row, 1, 1]
    gaps = places[:, None, :] - points[None, :, :]
    variance = spread[:, None] + np.trace(own, axis1=1, axis2=2)[None, :]
    return np.square(gaps).sum(axis=2) <= _REACH * _REACH * variance


def _squared(innovation: Array, covariance: Array) -> Array:
    """(p,) squared Mahalanobis distances; infinite where the covariance is not positive definite."""
    a, b, c = covariance[:, 0, 0], covariance[:, 1, 0], covariance[:, 1, 1]
    determinant = a * c - b * b
    x, y = innovation[:, 0], innovation[:, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (c * x * x - 2.0 * b * x * y + a * y * y) / determinant
    return np.where((determinant > 0.0) & (a > 0.0), distance, np.inf)


def _joint(state: State, starts: IndexArray, landmarks: IndexArray, jacobian: Array, noise: Array) -> Array:
    """(2 p, 2 p) covariance of all innovations."""
    count = len(landmarks)
    used, place = np.unique(landmarks, return_inverse=True)
    index = np.concatenate([np.arange(POSE), (starts[used][:, None] + np.arange(2)).ravel()])
    stacked = np.zeros((count, 2, len(index)))
    stacked[:, :, :POSE] = jacobian[:, :, :POSE]
    columns = POSE + 2 * place[:, None] + np.arange(2)
    for k in range(2):
        stacked[np.arange(count)[:, None], k, columns] = jacobian[:, k, POSE:]
    h = stacked.reshape(2 * count, len(index))
    covariance = h @ state.block(index) @ h.T
    for k in range(count):
        covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] += noise[k]
    return covariance


def nearest(pairs: Pairs, bound: float) -> dict[int, int]:
    """Landmark of each reading that gets one: least sum of distances, nothing twice.

    ``bound`` is the gate, and the price of a reading without a landmark.
    """
    from scipy.optimize import linear_sum_assignment

    inside = pairs.distance <= bound
    readings, landmarks = pairs.readings[inside], pairs.landmarks[inside]
    if len(readings) == 0:
        return {}
    rows, row = np.unique(readings, return_inverse=True)
    columns, column = np.unique(landmarks, return_inverse=True)
    cost = np.full((len(rows), len(columns) + len(rows)), bound)  # one way out for every reading
    cost[:, : len(columns)] = 2.0 * bound * len(rows) + 1.0
    cost[row, column] = pairs.distance[inside]
    chosen = zip(*linear_sum_assignment(cost), strict=True)
    return {int(rows[i]): int(columns[j]) for i, j in chosen if j < len(columns)}


@dataclass(frozen=True)
class Hypothesis:
    """A joint hypothesis.

    Attributes
    ----------
    landmarks
        Landmark of each reading that has one.
    distance
        Joint squared Mahalanobis distance.
    nodes
        Nodes of the search tree that were visited.
    complete
        Whether the search came to its end.
    """

    landmarks: dict[int, int]
    distance: float
    nodes: int
    complete: bool


def joint_compatibility(pairs: Pairs, probability: float, node_limit: int) -> Hypothesis:
    """The jointly compatible hypothesis with the most pairs, among those the one of least joint distance.

    Depth first over the readings, nearest landmark first. A branch ends where even a landmark for every reading left
    would not beat the best hypothesis: the joint distance never falls as pairs are added.

    Parameters
    ----------
    pairs
        The individually compatible ones.
    probability
        Of the gate of the joint distance.
    node_limit
        Nodes to visit before the best so far is taken.
    """
    return _Search(pairs, probability, node_limit).run()


class _Search:
    """Branch and bound; the Cholesky factor of a hypothesis grows by two rows with each pair."""

    def __init__(self, pairs: Pairs, probability: float, node_limit: int) -> None:
        self.pairs, self.probability, self.node_limit = pairs, probability, node_limit
        order: dict[int, list[int]] = {}
        for pair in np.argsort(pairs.distance, kind="stable").tolist():
            order.setdefault(int(pairs.readings[pair]), []).append(pair)
        # readings that are hard to mistake come first: they say where the pose is
        self.levels = sorted(order.values(), key=lambda options: (len(options), pairs.distance[options[0]]))
        depth = 2 * len(self.levels)
        self.factor, self.whitened = np.zeros((depth, depth)), np.zeros(depth)
        self.best: list[int] = []
        self.least = 0.0
        self.nodes = 0

    def run(self) -> Hypothesis:
        self._descend(0, [], 0.0)
        found = {int(self.pairs.readings[pair]): int(self.pairs.landmarks[pair]) for pair in self.best}
        return Hypothesis(found, self.least, self.nodes, self.nodes < self.node_limit)

    def _descend(self, level: int, chosen: list[int], distance: float) -> None:
        if self.nodes >= self.node_limit:
            return
        self.nodes += 1
        if len(chosen) > len(self.best) or (len(chosen) == len(self.best) and distance < self.least):
            self.best, self.least = list(chosen), distance
        if level == len(self.levels):
            return
        taken = {int(self.pairs.landmarks[pair]) for pair in chosen}
        for pair in self.levels[level]:
            if int(self.pairs.landmarks[pair]) in taken or not self._promising(level, len(chosen), distance):
                continue
            joint = self._extended(chosen, pair, distance)
            if joint <= gate(2 * len(chosen) + 2, self.probability):
                self._descend(level + 1, [*chosen, pair], joint)
        if self._promising(level + 1, len(chosen), distance):
            self._descend(level + 1, chosen, distance)

    def _promising(self, level: int, count: int, distance: float) -> bool:
        most = count + len(self.levels) - level
        return most > len(self.best) or (most == len(self.best) and distance < self.least)

    def _extended(self, chosen: list[int], pair: int, distance: float) -> float:
        """Joint distance with one more pair; its rows of the factor are written below those of the chosen ones."""
        size = 2 * len(chosen)
        numbers = [number for other in chosen for number in (2 * other, 2 * other + 1)]
        own = slice(2 * pair, 2 * pair + 2)
        corner, nu = self.pairs.covariance[own, own], self.pairs.innovation[pair]
        rows: Array = np.empty((2, 0))
        if size:
            cross = np.linalg.solve(self.factor[:size, :size], self.pairs.covariance[numbers, own])
            rows = np.asarray(cross.T, dtype=np.float64)
            corner = corner - rows @ rows.T
            nu = nu - rows @ self.whitened[:size]
        a, b, c = float(corner[0, 0]), float(corner[1, 0]), float(corner[1, 1])
        if not a > 0.0 or not c - b * b / a > 0.0:
            return np.inf
        first = a**0.5
        below = b / first
        last = (c - below * below) ** 0.5
        y = float(nu[0]) / first
        z = (float(nu[1]) - below * y) / last
        self.factor[size : size + 2, :size] = rows
        self.factor[size : size + 2, size : size + 2] = [[first, 0.0], [below, last]]
        self.whitened[size : size + 2] = y, z
        return distance + y * y + z * z
