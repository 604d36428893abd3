"""Graduated non-convexity: weights that go from those of a convex cost to those of a robust one.

With s = e^T Omega e of a loop closure, c2 the gate above which it is an outlier, and mu the control parameter, the
weight that the surrogate cost gives it is

    truncated least squares, mu from near 0 to infinity:
        1 for s <= mu/(mu + 1) c2,   0 for s >= (mu + 1)/mu c2,   else sqrt(c2 mu (mu + 1) / s) - mu
    Geman-McClure, mu from large to 1:
        (mu c2 / (s + mu c2))^2

(H. Yang, P. Antonante, V. Tzoumas, L. Carlone, "Graduated Non-Convexity for Robust Spatial Perception: From Non-Minimal
Solvers to Global Outlier Rejection", RA-L 2020, eq. 10-15 and their start values of mu). All other factors are known
inliers of weight 1. Each mu gets one Gauss-Newton step; pattern, elimination order and symbolic factorization are made
once, and weights that are 0 stay in the pattern.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from slamcli.errors import NumericalError
from slamcli.graph import FactorGraph
from slamcli.graph.columns import BoolArray, Values
from slamcli.models.base import Array, norm
from slamcli.solver.backends import NotPositiveDefiniteError
from slamcli.solver.gauge import Held
from slamcli.solver.linear_system import LinearSystem
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.problem import SHIFTS, Problem
from slamcli.solver.result import IterationRecord
from slamcli.solver.robust.closures import Closures
from slamcli.solver.robust.loss import Weights
from slamcli.solver.stopwatch import Stopwatch

FACTOR = 1.4  # between values of mu, as in the paper
#: Where every weight is this near to 0 or 1, the annealing is over; so it is beyond this mu.
_DECIDED, _LARGEST = 1e-2, 1e6
#: Steps with a weight for every closure of 0 or 1 until the set must stand; from then on closures only leave it.
_FREE, _SETTLING = 12, 40
#: The set stands where the last step changed chi2 by less than this share of it.
_STILL = 1e-6


def tls_weights(squared: Array, gate: Array, mu: Array | float) -> Array:
    """Weights (c,) of the truncated least squares' surrogate; those of the cost itself for mu = infinity."""
    mu = np.broadcast_to(np.asarray(mu, dtype=np.float64), np.shape(squared))
    final = np.isinf(mu)
    soft = np.where(final, 1.0, mu)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        between = np.sqrt(gate / squared) * np.sqrt(soft * (soft + 1.0)) - soft
    between = np.where(squared > 0.0, np.nan_to_num(between, nan=0.0, posinf=1.0), 1.0)
    return np.where(final, (squared <= gate).astype(np.float64), np.clip(between, 0.0, 1.0))


def gm_weights(squared: Array, gate: Array, mu: float) -> Array:
    """Weights (c,) of the Geman-McClure surrogate."""
    return np.asarray(np.square(1.0 / (1.0 + squared / (mu * gate))))


def first_mu_tls(squared: Array, gate: Array) -> float:
    """Where mu starts for truncated least squares: the largest s has a weight above 0; infinity if all are inliers."""
    ratio = 2.0 * float(np.max(squared / gate, initial=0.0))
    return 1.0 / (ratio - 1.0) if ratio > 1.0 else math.inf


def first_mu_gm(squared: Array, gate: Array) -> float:
    """Where mu starts for Geman-McClure: 2 max s / c2."""
    return max(1.0, 2.0 * float(np.max(squared / gate, initial=0.0)))


@dataclass
class Budget:
    """What the iterations of a whole run share.

    Attributes
    ----------
    record
        Takes each iteration.
    stop
        Asked after each iteration whether to stop.
    count
        Iterations so far.
    """

    record: Callable[[IterationRecord], None]
    stop: Callable[[], bool]
    count: int = 0


class Annealing:
    """A graph with some of its closures under weights, and the state that the iterations have come to.

    Parameters
    ----------
    graph
        The graph with the closures that count at all.
    closures
        Those.
    held, options, stopwatch
        See ``Problem``.
    values
        Where it starts.
    budget
        See there.
    """

    def __init__(
        self,
        closures: Closures,
        held: Held,
        options: OptimizeOptions,
        stopwatch: Stopwatch,
        values: Values,
        budget: Budget,
    ) -> None:
        self.closures = closures
        self.graph: FactorGraph = closures.graph
        self.weight = np.ones(len(closures))
        self._losses = [Weights(weight) for weight in closures.spread(self.weight)]
        self.problem = Problem(self.graph, held, options, stopwatch, self._losses)
        self.values = values
        self.squared = closures.chi2(values)
        self._budget = budget
        self._free = sum(int((~held[n]).sum()) * c.kind.dimension for n, c in self.graph.variables.items())
        self._change = math.inf

    def anneal(self, gate: Array, *, gm: bool = False, trusted: BoolArray | None = None) -> None:
        """Steps while mu goes to its end. ``trusted`` closures keep at least the weight that mu = 1 gives them."""
        if len(self.closures) == 0:
            return
        if gm:
            mu, at_last = first_mu_gm(self.squared, gate), 0
            while at_last < _SETTLING:
                self._step(gm_weights(self.squared, gate, mu), f"gnc-gm {mu:.3g}")
                if self._budget.stop() or (mu == 1.0 and self._change < _STILL):
                    return
                mu = max(1.0, mu / FACTOR)
                at_last += mu == 1.0
            return
        doubtful = np.ones(len(self.weight), dtype=bool) if trusted is None else ~trusted
        mu = min(first_mu_tls(self.squared[doubtful], gate[doubtful]), 1.0)
        while mu <= _LARGEST and not self._budget.stop():
            weight = tls_weights(self.squared, gate, np.where(doubtful, mu, max(mu, 1.0)))
            self._step(weight, f"gnc {mu:.3g}")
            if mu > 1.0 and not ((weight > _DECIDED) & (weight < 1.0 - _DECIDED)).any():
                return
            mu *= FACTOR

    def settle(self, gate: Callable[[], Array]) -> None:
        """Steps with weights of 0 and 1 until the set of closures below the gate stands."""
        before = None
        for number in range(_SETTLING):
            keep = self.squared <= gate()
            if before is not None and number > _FREE:
                keep &= before
            still = before is not None and np.array_equal(keep, before) and self._change < _STILL
            if still or self._budget.stop():
                self.weight = keep.astype(np.float64)
                return
            self._step(keep.astype(np.float64), "set")
            before = keep

    def variance(self, stated: float, weight: float) -> float:
        """Noise over the stated noise, as a variance: chi2 of what is kept per degree of freedom.

        ``stated`` counts as that of ``weight`` further degrees of freedom.
        """
        chi2 = sum(
            float(loss.evaluate(squared, slice(None))[0].sum())
            for loss, squared in zip(self._losses, self.graph.edge_chi2(self.values), strict=True)
        )
        rows = sum(len(f) * f.kind.dimension for f in self.graph.factors)
        rows -= int(self.closures.dimensions[self.weight < 0.5].sum())
        dof = max(rows - self._free, 0)
        return (chi2 + weight * stated) / (dof + weight)

    def _step(self, weight: Array, stage: str) -> None:
        """One Gauss-Newton step under new weights."""
        began = time.perf_counter()
        self.weight = weight
        for loss, spread in zip(self._losses, self.closures.spread(weight), strict=True):
            loss.weight = spread
        now = self.problem.linearize(self.values)
        delta = self._solved(now)
        values = self.problem.retract(self.values, delta)
        after = self.problem.chi2(values)
        squared = self.closures.chi2(values)
        if not (np.isfinite(after) and np.isfinite(squared).all()):
            raise NumericalError(
                "graduated non-convexity diverged: chi2 is not finite", ("  another --robust method or --init may do",)
            )
        self._change = abs(now.chi2 - after) / max(after, np.finfo(np.float64).tiny)
        self.values, self.squared = values, squared
        self._budget.count += 1
        record = IterationRecord(
            iteration=self._budget.count,
            chi2=after,
            chi2_change=after - now.chi2,
            gradient_norm=now.gradient_norm,
            step_norm=norm(delta),
            damping=None,
            trials=1,
            accepted=True,
            step="gauss-newton",
            time=time.perf_counter() - began,
            stage=stage,
        )
        self._budget.record(record)

    def _solved(self, now: LinearSystem) -> Array:
        """The step; damped a little where closures of weight 0 leave H singular."""
        largest = float(self.problem.diagonal(now).max(initial=0.0))
        for shift in (None, *SHIFTS):
            damping = None if shift is None else np.full(self.problem.pattern.dimension, shift * largest)
            try:
                return self.problem.solve(now, damping)
            except NotPositiveDefiniteError:
                continue
        raise NumericalError("the Hessian is not positive definite under any damping that was tried")
