"""How well two loop closures agree through the odometry: the squared Mahalanobis distance of the cycle of both.

Let X_t be the poses by dead reckoning and z the measurement of a closure from pose i to pose j (i before j in the order
of ids). In the world of dead reckoning the closure claims the transform L = X_i z X_j^-1, by which the odometry has
drifted between the two visits. Two closures a (i to j) and b (k to l) close a cycle, and its error is

    e = log(L_a L_b^-1)

To first order in the noise delta_t of X_t (left, in the world's frame) and those xi of the closures,

    e = (delta_i - delta_k) + L_a (delta_l - delta_j) + xi_a - xi_b

with L_a acting by its adjoint. delta_t is the sum of the steps' noise up to t, so with P_t its covariance, a prefix
sum, each difference has the covariance of the stretch between, |P_i - P_k| and |P_j - P_l|, and the two are correlated
by the stretch that they share. The distance e^T C^-1 e is chi-square distributed with as many degrees of freedom as a
pose has if both closures are right (J. Mangelson, D. Dominic, R. Eustice, R. Vasudevan, "Pairwise Consistent
Measurement Set Maximization for Robust Multi-Robot Map Merging", ICRA 2018, eq. 5-8; the covariance of the odometry by
prefix sums is ours). A single closure closes a cycle with the odometry alone: that of a with L_b = 1 at one pose of
the stretch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.geometry import se2, se3
from slamcli.graph.columns import BoolArray, IndexArray, Variables
from slamcli.models import SE2
from slamcli.models.base import Array
from slamcli.solver.robust.closures import Closures

#: Pairs whose matrices are made at once.
_BLOCK = 50_000
#: Information is raised by this share of its mean, so that an edge without information on an axis has a covariance.
_FLOOR = 1e-9


@dataclass(frozen=True, eq=False)
class Cycles:
    """Closures of one kind of pose with the odometry that they are held against.

    Attributes
    ----------
    which
        (c,) their numbers in the list of closures.
    first, second
        (c,) positions of the joined poses in the order of ids; first < second.
    claim, adjoint
        (c, size) L and its adjoint (c, d, d).
    noise
        (c, d, d) covariance of xi.
    prefix
        (n, d, d) P_t.
    segment
        (n,) number of the unbroken stretch of odometry that each pose belongs to.
    """

    which: IndexArray
    first: IndexArray
    second: IndexArray
    claim: Array
    adjoint: Array
    noise: Array
    prefix: Array
    segment: IndexArray

    def __len__(self) -> int:
        return len(self.which)

    @property
    def dimension(self) -> int:
        """Of the cycles' errors."""
        return int(self.noise.shape[-1])

    @classmethod
    def of(cls, closures: Closures) -> Cycles:
        """The closures between poses of the kind that most of them join."""
        graph = closures.graph
        poses = [column for column in graph.variables.values() if column.kind.is_pose]
        columns = [(rows, f) for _, rows, f in closures.columns]
        column = max(poses, key=lambda c: sum(len(f) for _, f in columns if f.kind.variables[0] is c.kind))
        group = se2 if column.kind is SE2 else se3
        steps, noise, driven = _odometry(closures, column)
        path = _dead_reckoning(column, steps)
        turned = group.adjoint(path[1:])
        prefix = np.zeros((len(path), *noise.shape[1:]))
        prefix[1:] = np.cumsum(turned @ noise @ turned.transpose(0, 2, 1), axis=0)
        ends, measured, own, which, start = [], [], [], [], 0
        for rows, factors in columns:
            if factors.kind.variables[0] is column.kind:
                z, covariance, rank = _forward(column, factors.measurements, factors.information, factors.indices)
                ends.append(rank)
                measured.append(z)
                own.append(covariance)
                which.append(start + np.arange(len(rows)))
            start += len(rows)
        rank = np.concatenate(ends)
        seen = column.kind.compose(path[rank[:, 0]], np.concatenate(measured))
        claim = column.kind.normalize(column.kind.compose(seen, column.kind.inverse(path[rank[:, 1]])))
        frame = group.adjoint(seen)
        return cls(
            which=np.concatenate(which),
            first=rank[:, 0],
            second=rank[:, 1],
            claim=claim,
            adjoint=group.adjoint(claim),
            noise=frame @ np.concatenate(own) @ frame.transpose(0, 2, 1),
            prefix=prefix,
            segment=np.concatenate([[0], np.cumsum(~driven)]).astype(np.intp),
        )

    def pairs(self, a: IndexArray, b: IndexArray) -> Array:
        """(p,) squared Mahalanobis distances of the cycles of closures a and b; 0 where no odometry joins them."""
        out = np.empty(len(a))
        for start in range(0, len(a), _BLOCK):
            rows = slice(start, start + _BLOCK)
            out[rows] = self._pairs(a[rows], b[rows])
        joined = (self.segment[self.first[a]] == self.segment[self.first[b]]) & (
            self.segment[self.second[a]] == self.segment[self.second[b]]
        )
        return np.where(joined, out, 0.0)

    def alone(self) -> Array:
        """(c,) squared Mahalanobis distances of the closures' cycles with the odometry; 0 where it is broken."""
        drift = self.prefix[self.second] - self.prefix[self.first]
        covariance = self.adjoint @ drift @ self.adjoint.transpose(0, 2, 1) + self.noise
        out = _squared(self._log(self.claim), covariance)
        return np.where(self.segment[self.first] == self.segment[self.second], out, 0.0)

    def steps_between(self, a: IndexArray, b: IndexArray) -> IndexArray:
        """(p,) steps of odometry in the cycles of closures a and b."""
        return np.abs(self.first[a] - self.first[b]) + np.abs(self.second[a] - self.second[b])

    def _log(self, x: Array) -> Array:
        return se2.log(x) if self.dimension == se2.DIM else se3.log(x)

    def _pairs(self, a: IndexArray, b: IndexArray) -> Array:
        kind = se2 if self.dimension == se2.DIM else se3
        error = self._log(kind.normalize(kind.compose(self.claim[a], kind.inverse(self.claim[b]))))
        i, j, k, m = self.first[a], self.second[a], self.first[b], self.second[b]
        low, high = np.minimum(i, k), np.maximum(i, k)
        low_2, high_2 = np.minimum(j, m), np.maximum(j, m)
        first, second = (low, high), (low_2, high_2)
        turns = (self.adjoint[a], self.adjoint[b])  # equal to first order if the closures agree
        return np.maximum(*(self._distance(error, a, b, first, second, turn) for turn in turns))

    def _distance(
        self,
        error: Array,
        a: IndexArray,
        b: IndexArray,
        first: tuple[IndexArray, IndexArray],
        second: tuple[IndexArray, IndexArray],
        turn: Array,
    ) -> Array:
        """Squared distances with the stretches between the first and between the second ends, these turned."""
        (low, high), (low_2, high_2) = first, second
        back = turn.transpose(0, 2, 1)
        covariance = turn @ (self.prefix[high_2] - self.prefix[low_2]) @ back
        covariance += self.prefix[high] - self.prefix[low] + self.noise[a] + self.noise[b]
        start, stop = np.maximum(low, low_2), np.minimum(high, high_2)
        shared = np.flatnonzero(stop > start)
        if len(shared):
            sign = np.sign(self.first[a] - self.first[b])[shared] * np.sign(self.second[b] - self.second[a])[shared]
            part = (self.prefix[stop[shared]] - self.prefix[start[shared]]) * sign[:, None, None] @ back[shared]
            covariance[shared] += part + part.transpose(0, 2, 1)
        return _squared(error, covariance)


def _squared(error: Array, covariance: Array) -> Array:
    """e^T C^-1 e; infinite where C is singular in double precision."""
    try:
        solved = np.linalg.solve(covariance, error[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:
        solved = np.stack([np.linalg.pinv(c) @ e for c, e in zip(covariance, error, strict=True)])
    return np.abs(np.vecdot(error, solved))


def _mean_information(information: Array) -> Array:
    """Mean (m,) of the diagonal of information matrices (m, d, d)."""
    return np.trace(information, axis1=1, axis2=2) / information.shape[-1]


def _covariance(information: Array) -> Array:
    """Covariances (m, d, d) in the tangent space of exp: a quaternion's vector part is half a rotation vector."""
    d = information.shape[-1]
    mean = np.abs(_mean_information(information))
    least = _FLOOR * (float(mean.max(initial=0.0)) or 1.0)  # what has no information at all contradicts nothing
    floor = _FLOOR * np.maximum(mean, least)[:, None, None]
    scale = np.ones(d) if d == se2.DIM else np.repeat([1.0, 2.0], 3)
    return scale[:, None] * np.linalg.inv(information + floor * np.eye(d)) * scale


def _forward(
    column: Variables, measured: Array, information: Array, indices: IndexArray
) -> tuple[Array, Array, IndexArray]:
    """Relative poses with their covariances, all from the earlier to the later pose, and the poses' positions."""
    group = se2 if column.kind is SE2 else se3
    rank = column.rank[indices]
    covariance = _covariance(information)
    backward = rank[:, 0] > rank[:, 1]
    frame = group.adjoint(measured[backward])
    covariance[backward] = frame @ covariance[backward] @ frame.transpose(0, 2, 1)
    z = measured.copy()
    z[backward] = column.kind.inverse(measured[backward])
    return z, covariance, np.sort(rank, axis=1)


def _odometry(closures: Closures, column: Variables) -> tuple[Array, Array, BoolArray]:
    """Steps (n - 1, size) between poses that are neighbours in the order of ids, their covariances, where there are."""
    count, d = max(len(column) - 1, 0), column.kind.dimension
    steps, noise = np.tile(np.array(column.kind.identity), (count, 1)), np.zeros((count, d, d))
    driven = np.zeros(count, dtype=bool)
    for factors, mask in zip(closures.graph.factors, closures.masks, strict=True):
        if factors.kind.relative_pose and factors.kind.variables[0] is column.kind:
            mean = _mean_information(factors.information)
            says_something = mean > _FLOOR * mean.max(initial=0.0)  # prefix sums would drown in the noise of others
            rows = np.flatnonzero(~mask & (factors.indices[:, 0] != factors.indices[:, 1]) & says_something)
            z, covariance, rank = _forward(
                column, factors.measurements[rows], factors.information[rows], factors.indices[rows]
            )
            best = np.lexsort((*z.T, mean[rows]))  # of parallel ones the most informative, written last
            at = rank[best, 0]
            steps[at], noise[at], driven[at] = z[best], covariance[best], True
    return steps, noise, driven


def _dead_reckoning(column: Variables, steps: Array) -> Array:
    """Poses (n, size) from the origin on, by doubling: log2(n) batched compositions."""
    path = np.concatenate([np.array(column.kind.identity)[None], steps])
    stride = 1
    while stride < len(path):
        path[stride:] = column.kind.normalize(column.kind.compose(path[:-stride], path[stride:]))
        stride *= 2
    return path
