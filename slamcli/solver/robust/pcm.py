"""Pairwise consistency maximization: the largest set of loop closures that agree with each other through the odometry.

Two closures contradict each other where the squared Mahalanobis distance of their cycle (see ``consistency``) is above
the gate; the method keeps a largest set without contradictions (Mangelson, Dominic, Eustice, Vasudevan, ICRA 2018).
Three things are done differently here:

* The noise scale is estimated. The information matrices of most data sets say several times the noise that their
  edges have (M3500: 6.5 times), and with such a noise the odometry can explain any two closures. Cycles of closures
  that are close to each other tell what the noise is: the distance of two right ones is chi-square distributed, times
  the square of the scale. Longer cycles are judged by cycles of their own length, since odometry may drift by more than
  its steps show. The scale is 1 at most: where many closures are false, they would pass for noise.
* Not all pairs are compared, but each closure with its nearest ones, which say most, and with some at a stride, in
  rounds: what is left after one is compared with its nearest ones among what is left. Memory and time are linear.
* A closure must also agree with the odometry between its own poses.

A pair that is not compared, or that no odometry joins, contradicts nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.models.base import Array
from slamcli.solver.robust.cliques import consistent_set
from slamcli.solver.robust.closures import Closures
from slamcli.solver.robust.consistency import Cycles
from slamcli.solver.robust.quantile import chi2_quantile

#: Nearest closures that each is compared with (false ones of one run are up to 20 or so), and others at a stride.
_NEAREST, _STRIDED = 64, 64
_ROUNDS = 8
#: A closure is supported if one within so many steps of odometry agrees with it.
_NEAR = 40
#: Cycles are judged by others of their length, in steps: up to the first of these, up to the second, ...
_LENGTHS = (20, 100, 500)
#: Quantile of the distances of neighbours that the noise is judged by: low where half of them may be false.
_QUANTILE, _QUANTILE_LATER = 0.25, 0.5
#: The stated noise counts as much as the cycles of so many closures.
_STATED = 10.0


@dataclass(frozen=True, eq=False)
class ConsistentSet:
    """What pairwise consistency makes of closures.

    Attributes
    ----------
    keep
        (c,) which closures are in the set.
    supported
        (c,) which of them agree with another one of the set nearby.
    scale
        Noise over the stated noise, a ratio of standard deviations.
    compared
        Number of pairs that were compared, with repetitions between rounds.
    """

    keep: BoolArray
    supported: BoolArray
    scale: float
    compared: int


def consistent(closures: Closures, probability: float, scale: float | None = None) -> ConsistentSet:
    """The largest consistent set that can be found.

    Parameters
    ----------
    closures
        Of a graph. Those between poses of another kind than most are all kept.
    probability
        With which a pair of right closures passes the gate.
    scale
        Noise over the stated noise; None: estimated from the closures.
    """
    total = len(closures)
    if total == 0:
        return ConsistentSet(np.ones(0, dtype=bool), np.ones(0, dtype=bool), scale or 1.0, 0)
    search = _Search(Cycles.of(closures), probability, scale)
    found, supported = search.run()
    keep, near = np.ones(total, dtype=bool), np.ones(total, dtype=bool)
    keep[search.cycles.which] = found
    near[search.cycles.which] = supported
    return ConsistentSet(keep, keep & near, float(np.sqrt(search.variance)), search.compared)


class _Search:
    """Rounds of comparisons over the closures in the order of their poses, whatever that of the file."""

    def __init__(self, cycles: Cycles, probability: float, scale: float | None) -> None:
        self.cycles = cycles
        self.order = np.lexsort((*cycles.claim.T, cycles.second, cycles.first))
        self.quantile = chi2_quantile(cycles.dimension, probability)
        self.fixed = scale is not None
        self.variance = 1.0 if scale is None else scale**2
        self.by_length = np.full(len(_LENGTHS) + 1, self.variance)
        self.compared = 0

    def run(self) -> tuple[BoolArray, BoolArray]:
        alone = self.cycles.alone()
        left = self.order
        for number in range(_ROUNDS):
            a, b = self._sample(left, left)
            distance = self._distances(a, b)
            if not self.fixed:
                self._estimate(a, b, distance, _QUANTILE_LATER if number else _QUANTILE)
            agrees = alone <= self._gate(self.cycles.second - self.cycles.first)
            fits = agrees[left]
            position = np.full(len(self.cycles), -1)
            position[left] = np.arange(len(left))
            torn = self._torn(a, b, distance) & fits[position[a]] & fits[position[b]]
            chosen = consistent_set(len(left), position[a[torn]], position[b[torn]]) & fits
            left = left[chosen]
            if chosen.all() or len(left) == 0:
                break
        left = self._taken_back(left, agrees)
        keep, supported = np.zeros((2, len(self.cycles)), dtype=bool)
        keep[left] = True
        if len(left) > 1:
            a, b = self._sample(left, left)
            near = (self.cycles.steps_between(a, b) <= _NEAR) & ~self._torn(a, b)
            supported[a[near]] = supported[b[near]] = True
        return keep, supported

    def _taken_back(self, left: IndexArray, fits: BoolArray) -> IndexArray:
        """The set with those that contradict none of their nearest ones in it, nor each other."""
        out = np.ones(len(self.cycles), dtype=bool)
        out[left] = False
        rest = self.order[(out & fits)[self.order]]
        if len(rest) == 0 or len(left) == 0:
            return left
        a, b = self._sample(rest, left)
        torn = np.zeros(len(self.cycles), dtype=bool)
        torn[a[self._torn(a, b)]] = True
        back = rest[~torn[rest]]
        if len(back) > 1:
            a, b = self._sample(back, back)
            bad = self._torn(a, b)
            position = np.full(len(self.cycles), -1)
            position[back] = np.arange(len(back))
            back = back[consistent_set(len(back), position[a[bad]], position[b[bad]])]
        return np.concatenate([left, back])

    def _gate(self, steps: IndexArray) -> Array:
        """Largest distances of cycles with so many steps of odometry."""
        return self.quantile * self.by_length[np.searchsorted(_LENGTHS, steps)]

    def _torn(self, a: IndexArray, b: IndexArray, distance: Array | None = None) -> BoolArray:
        """Which pairs contradict each other."""
        found = self._distances(a, b) if distance is None else distance
        return np.asarray(found > self._gate(self.cycles.steps_between(a, b)))

    def _distances(self, a: IndexArray, b: IndexArray) -> Array:
        self.compared += len(a)
        with np.errstate(all="ignore"):
            return np.nan_to_num(self.cycles.pairs(a, b), nan=np.inf)

    def _sample(self, some: IndexArray, others: IndexArray) -> tuple[IndexArray, IndexArray]:
        """Pairs, each once, of closures with their nearest others and with others at a stride."""
        from scipy.spatial import cKDTree  # lazily: takes longer to load than a small graph to solve

        ends = np.stack([self.cycles.first, self.cycles.second], axis=1).astype(np.float64)
        count = min(_NEAREST + 1, len(others))
        nearest = cKDTree(ends[others]).query(ends[some], k=count, p=1)[1].reshape(len(some), count)
        b = others[nearest]
        if len(others) > count:
            place = np.searchsorted(ends[others, 0], ends[some, 0])[:, None]
            stride = (np.arange(1, _STRIDED + 1) * len(others)) // (_STRIDED + 1)
            b = np.concatenate([b, others[(place + stride) % len(others)]], axis=1)
        a = np.repeat(some, b.shape[1])
        low, high = np.minimum(a, b.ravel()), np.maximum(a, b.ravel())
        keys = np.unique((low * len(self.cycles) + high)[low != high])
        first, second = np.divmod(keys, len(self.cycles))
        if some is others:
            return first, second
        inside = np.zeros(len(self.cycles), dtype=bool)
        inside[some] = True
        return np.where(inside[first], first, second), np.where(inside[first], second, first)

    def _estimate(self, a: IndexArray, b: IndexArray, distance: Array, share: float) -> None:
        """Judge the noise by each closure's cycle with its nearest other one, and by the longer cycles."""
        self.variance = min(self._nearest(a, b, distance, share), 1.0)
        length = np.searchsorted(_LENGTHS, self.cycles.steps_between(a, b))
        highest = self.variance
        for k in range(len(self.by_length)):
            some = distance[(length == k) & (distance > 0.0)]
            if len(some):
                found = float(np.quantile(some, share)) / chi2_quantile(self.cycles.dimension, share)
                highest = max(highest, min(found, 1.0))
            self.by_length[k] = highest

    def _nearest(self, a: IndexArray, b: IndexArray, distance: Array, share: float) -> float:
        """Variance of the noise over the stated one, from each closure's cycle with its nearest other one."""
        steps = self.cycles.steps_between(a, b)
        use = np.flatnonzero((steps > 0) & (distance > 0.0) & np.isfinite(distance))
        if len(use) == 0:
            return 1.0
        ends = np.concatenate([a[use], b[use]])
        order = np.lexsort((np.tile(distance[use], 2), np.tile(steps[use], 2), ends))
        nearest = order[np.unique(ends[order], return_index=True)[1]] % len(use)
        found = float(np.quantile(distance[use][nearest], share)) / chi2_quantile(self.cycles.dimension, share)
        return float(found ** (len(nearest) / (len(nearest) + _STATED)))
