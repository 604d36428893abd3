"""The state of the filter: pose, landmarks and kept poses, with one covariance that is changed in place.

The covariance P is the lower triangle of the leading corner of one array in column order: 8 bytes for every entry of
the matrix, no second copy. The pose comes first, so that its cross-covariances with everything else are the first
three columns, each in one piece: a prediction runs over them and over nothing else.

Errors of poses are steps of (x, y, theta) along the axes of the world (see ``docs/ekf.md`` for the reason);
``local_covariance`` gives them in the frame of the pose, as ``VariableKind.retract`` and the rest of slamcli have them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from slamcli.filtering.blas import subtract_square, subtract_symmetric_product
from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array

POSE = 3
_TAU = 2.0 * math.pi


class Block:
    """Numbers of the state that belong together: a pose (3) or a landmark (2).

    Attributes
    ----------
    start, size
        Where they are in the state. -1: outside of the local area that is kept up to date
        (``filtering.compressed``); ``State.require`` brings them in.
    """

    __slots__ = ("size", "start")

    def __init__(self, start: int, size: int) -> None:
        self.start = start
        self.size = size


class State:
    """Estimate and covariance.

    Attributes
    ----------
    size
        Dimension n of the state.
    mean
        (capacity,) estimates, the first n in use: the pose (x, y, theta), then the blocks.
    first
        (capacity,) the same as they were predicted or initialized: where first-estimates Jacobians are taken.
    blocks
        What follows the pose, in order.
    robot
        The block of the pose.
    """

    def __init__(self, pose: Array, covariance: Array, capacity: int = 64) -> None:
        capacity = max(capacity, POSE)
        self.size = POSE
        self.mean, self.first = np.zeros(capacity), np.zeros(capacity)
        self.mean[:POSE] = self.first[:POSE] = pose
        self._matrix = np.zeros((capacity, capacity), order="F")
        self._matrix[:POSE, :POSE] = covariance
        self.robot = Block(0, POSE)
        self.blocks: list[Block] = []

    @property
    def capacity(self) -> int:
        """Dimension up to which the state grows without new memory."""
        return len(self.mean)

    @property
    def dimension(self) -> int:
        """Dimension of the whole state, also where ``size`` is that of a local area."""
        return self.size

    @property
    def nbytes(self) -> int:
        """Bytes of the covariance in use, 8 for each entry of the (n, n) matrix."""
        return 8 * self.size * self.size

    @property
    def reserved_bytes(self) -> int:
        """Bytes of the array that holds it; pages that were never written are not in memory."""
        return self._matrix.nbytes

    @property
    def lower(self) -> Array:
        """(n, n) view of the covariance, of which only the lower triangle means anything."""
        return self._matrix[: self.size, : self.size]

    def covariance(self) -> Array:
        """(n, n) copy, both triangles."""
        triangle = np.tril(self.lower)
        return triangle + np.tril(triangle, -1).T

    def pose_covariance(self) -> Array:
        """(3, 3) of steps along the axes of the world."""
        corner = self._matrix[:POSE, :POSE].copy()
        corner[0, 1], corner[0, 2], corner[1, 2] = corner[1, 0], corner[2, 0], corner[2, 1]
        return corner

    def variances(self) -> Array:
        """(n,) diagonal of the covariance, a view."""
        return self._matrix.diagonal()[: self.size]

    def columns(self, index: IndexArray) -> Array:
        """(n, m) columns of the covariance, both triangles, in column order."""
        n, matrix = self.size, self._matrix
        out = np.empty((n, len(index)), order="F")
        for k, j in enumerate(index.tolist()):
            out[j:, k] = matrix[j:n, j]
            if j:
                out[:j, k] = matrix[j, :j]
        return out

    def block(self, index: IndexArray) -> Array:
        """(m, m) of the covariance, both triangles."""
        high, low = np.maximum.outer(index, index), np.minimum.outer(index, index)
        return self._matrix[high, low]

    def landmark_covariances(self, starts: IndexArray) -> tuple[Array, Array]:
        """Covariances (k, 2, 2) of landmarks, and (k, 2, 3) of each with the pose."""
        rows = starts[:, None] + np.arange(2)
        own = np.empty((len(starts), 2, 2))
        own[:, 0, 0], own[:, 1, 1] = self._matrix[starts, starts], self._matrix[starts + 1, starts + 1]
        own[:, 0, 1] = own[:, 1, 0] = self._matrix[starts + 1, starts]
        return own, self._matrix[rows[:, :, None], np.arange(POSE)]

    def move(self, pose: tuple[float, float, float], shift: tuple[float, float], noise: Array) -> None:
        """Prediction: P <- F P F^T + Q with F = I but for the derivative of the position by the heading.

        Parameters
        ----------
        pose
            The predicted pose.
        shift
            Derivatives of its x and y by the heading before.
        noise
            (3, 3) Q, steps along the axes of the world.
        """
        turned = self._matrix[POSE : self.size, 2]
        self._matrix[POSE : self.size, 0] += shift[0] * turned
        self._matrix[POSE : self.size, 1] += shift[1] * turned
        transition = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]], [0.0, 0.0, 1.0]])
        self._matrix[:POSE, :POSE] = transition @ self.pose_covariance() @ transition.T + noise
        self.mean[:POSE] = self.first[:POSE] = pose

    def correct(self, factor: Array, whitened: Array, index: IndexArray, lower: Array, jacobian: Array) -> None:
        """Update: mean += V y and P -= V V^T.

        Parameters
        ----------
        factor
            (n, d) V = P H^T L^-T, in column order.
        whitened
            (d,) y = L^-1 times the innovation.
        index, lower, jacobian
            (m,) entries of the state that H touches, (d, d) L of S = L L^T, and (d, m) H there; a local area of the
            map (``filtering.compressed``) carries them to the rest.
        """
        self._shift(factor, whitened)
        subtract_square(self.lower, factor)

    def correct_joseph(self, gain: Array, cross: Array, innovation_covariance: Array, innovation: Array) -> None:
        """Update in Joseph's form, P -= K W^T + W K^T - K S K^T with W = P H^T, right for any gain K.

        That is (I - K H) P (I - K H)^T + K Q K^T, multiplied out.
        """
        self._shift(gain, innovation)
        half = cross - 0.5 * (gain @ innovation_covariance)
        subtract_symmetric_product(self.lower, gain, np.asfortranarray(half))

    def _shift(self, factor: Array, weights: Array) -> None:
        self.mean[: self.size] += factor @ weights
        self.mean[2] = wrap(float(self.mean[2]))

    def append(self, values: Array, index: IndexArray, jacobian: Array, noise: Array) -> Block:
        """New entries that are a function of old ones: x_new = g(x[index], e).

        Parameters
        ----------
        values
            (b,) the new entries.
        index, jacobian
            (m,) old entries, and (b, m) derivatives of g by them.
        noise
            (b, b) covariance of what e adds.
        """
        count, n = len(values), self.size
        self.reserve(n + count)
        rows = jacobian @ self.columns(index).T
        self._matrix[n : n + count, :n] = rows
        self._matrix[n : n + count, n : n + count] = rows[:, index] @ jacobian.T + noise
        self.mean[n : n + count] = self.first[n : n + count] = values
        self.size = n + count
        block = Block(n, count)
        self.blocks.append(block)
        return block

    def overwrite(self, index: IndexArray, columns: Array) -> None:
        """Put columns (n, m) of the covariance, and the rows they mirror, in the place of the old ones."""
        n, matrix = self.size, self._matrix
        for k, j in enumerate(index.tolist()):
            matrix[j:n, j] = columns[j:, k]
            matrix[j, :j] = columns[:j, k]

    def remove(self, blocks: Iterable[Block]) -> None:
        """Forget blocks: the rest of the covariance stays as it is and moves up, in place."""
        gone = set(blocks)
        if not gone:
            return
        kept = np.ones(self.size, dtype=bool)
        for block in gone:
            kept[block.start : block.start + block.size] = False
        rows = np.flatnonzero(kept)
        first = int(np.flatnonzero(~kept)[0])
        for new, old in enumerate(rows.tolist()):
            begin = max(new, first)
            self._matrix[begin : len(rows), new] = self._matrix[rows[begin:], old]
        self.mean[: len(rows)], self.first[: len(rows)] = self.mean[rows], self.first[rows]
        self.size = len(rows)
        self.blocks = [block for block in self.blocks if block not in gone]
        place = np.cumsum(kept) - 1
        for block in self.blocks:
            block.start = int(place[block.start])

    def reserve(self, size: int) -> None:
        """Make room for this many dimensions: at least twice the capacity, once it is not enough."""
        if size <= self.capacity:
            return
        capacity = max(size, 2 * self.capacity)
        n, matrix = self.size, np.zeros((capacity, capacity), order="F")
        for j in range(n):
            matrix[j:n, j] = self._matrix[j:n, j]
        self._matrix = matrix
        self.mean, self.first = np.resize(self.mean, capacity), np.resize(self.first, capacity)

    def require(self, blocks: Iterable[Block]) -> None:
        """Have these blocks up to date; all are."""

    def require_around(self, radius: float) -> None:
        """Have all landmarks within a radius in metres of the robot up to date; all are."""

    def complete(self) -> State:
        """The state of everything, up to date."""
        return self

    def place_of(self, block: Block) -> int:
        """Where a block is in ``complete()``."""
        return block.start

    def map_trace(self) -> float:
        """Sum of the variances of all but the pose."""
        return float(self.variances()[POSE:].sum())


def wrap(angle: float) -> float:
    """An angle in [-pi, pi)."""
    wrapped = math.remainder(angle, _TAU)
    return -math.pi if wrapped >= math.pi else wrapped


def local_covariance(covariance: Array, heading: Array) -> Array:
    """Covariances (..., 3, 3) of world steps at headings (...) as those of steps in the frame of the pose."""
    rotation = np.zeros((*np.shape(heading), 3, 3))
    cosine, sine = np.cos(heading), np.sin(heading)
    rotation[..., 0, 0] = rotation[..., 1, 1] = cosine
    rotation[..., 0, 1], rotation[..., 1, 0], rotation[..., 2, 2] = sine, -sine, 1.0
    return rotation @ covariance @ np.swapaxes(rotation, -1, -2)
