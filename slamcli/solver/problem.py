"""The four steps that every method is made of: linearize, factorize, solve, retract."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from slamcli.graph import FactorGraph
from slamcli.graph.columns import Values
from slamcli.models.base import Array, dot
from slamcli.solver import backends, ordering, schur
from slamcli.solver.gauge import Held
from slamcli.solver.linear_system import Linearizer, LinearSystem
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.robust.loss import Losses
from slamcli.solver.stopwatch import Stopwatch
from slamcli.solver.symbolic import Sparsity

#: Damping that makes a singular H factorize, as shares of its largest diagonal entry.
SHIFTS = (1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1e-2, 1.0)


@dataclass(frozen=True)
class FullStep:
    """The full Gauss-Newton step from a state.

    Attributes
    ----------
    decrease
        Of chi2 that it promises, g^T H^-1 g.
    largest
        Its largest component.
    singular
        Whether H is singular, so that it had to be damped.
    """

    decrease: float
    largest: float
    singular: bool


class Problem:
    """One graph with its gauge, pattern, elimination order and symbolic factorization: all that is made once.

    Parameters
    ----------
    graph
        The graph.
    held
        Which variables do not move.
    options
        Ordering and linear solver.
    stopwatch
        Where the time goes.
    losses
        What the squared residuals count, for each column of factors; None for plain least squares.
    """

    def __init__(
        self,
        graph: FactorGraph,
        held: Held,
        options: OptimizeOptions,
        stopwatch: Stopwatch,
        losses: Losses | None = None,
    ) -> None:
        self.stopwatch = stopwatch
        self.options = options
        with stopwatch.phase("pattern"):
            self._linearizer = Linearizer(graph, held, stopwatch, losses)
        self.pattern = self._linearizer.pattern
        with stopwatch.phase("order"):
            self.schur = schur.select(options.elimination, options.ordering, graph, held, self.pattern)
            self.elimination = self.schur.elimination if self.schur else ordering.find(options.ordering, self.pattern)
        with stopwatch.phase("analyze"):
            self.permutation = ordering.expand(self.pattern, self.elimination.order)
            self._factorization = (
                self.schur.factorization(options.linear_solver)
                if self.schur
                else backends.make(options.linear_solver, self.pattern, self.permutation)
            )

    def linearize(self, values: Values) -> LinearSystem:
        """chi2, gradient and H at a state."""
        return self._linearizer.linearize(values)

    def chi2(self, values: Values) -> float:
        """chi2 at a state."""
        return self._linearizer.chi2(values)

    @property
    def robust(self) -> bool:
        """Whether some squared residuals count as a loss makes them."""
        return any(loss is not None for loss in self._linearizer.losses)

    def rounding(self, values: Values) -> float:
        """See ``Linearizer.rounding``."""
        return self._linearizer.rounding(values)

    def retract(self, values: Values, delta: Array) -> Values:
        """The state after a tangent step."""
        return self._linearizer.retract(values, delta)

    def solve(self, system: LinearSystem, damping: Array | None = None) -> Array:
        """The step (H + diag(damping)) delta = -gradient.

        Raises
        ------
        NotPositiveDefiniteError
            If the matrix is not positive definite.
        """
        hessian = system.hessian
        if damping is not None:
            hessian = hessian.copy()
            hessian[self.pattern.diagonal] += damping
        with self.stopwatch.phase("factorize"):
            self._factorization.factorize(hessian)
        with self.stopwatch.phase("solve"):
            return self._factorization.solve(-system.gradient)

    def solve_again(self, system: LinearSystem) -> Array:
        """The step for a gradient with the factor of the last ``solve``."""
        with self.stopwatch.phase("solve"):
            return self._factorization.solve(-system.gradient)

    def diagonal(self, system: LinearSystem) -> Array:
        """Diagonal of H."""
        return system.hessian[self.pattern.diagonal]

    def model_decrease(self, system: LinearSystem, delta: Array) -> float:
        """Decrease of chi2 that the quadratic model predicts for a step: -2 g^T delta - delta^T H delta."""
        return -2.0 * dot(system.gradient, delta) - self.pattern.quadratic_form(system.hessian, delta)

    def full_step(self, system: LinearSystem) -> FullStep:
        """What the full Gauss-Newton step promises; where H is singular, the step with the least damping that works."""
        largest = float(self.diagonal(system).max(initial=0.0))
        for shift in (None, *SHIFTS):
            try:
                delta = self.solve(system, None if shift is None else np.full_like(system.gradient, shift * largest))
            except backends.NotPositiveDefiniteError:
                continue
            decrease = -dot(system.gradient, delta)
            return FullStep(decrease, float(np.abs(delta).max(initial=0.0)), singular=shift is not None)
        return FullStep(np.inf, np.inf, singular=True)

    @cached_property
    def sparsity(self) -> Sparsity:
        """Sparsity of H and of its factor, by symbolic analysis."""
        analysis = self.elimination.analysis(self.pattern)
        dimension, nnz = self.pattern.dimension, self.pattern.nnz
        return Sparsity(
            dimension=dimension,
            nnz_hessian=nnz,
            nnz_factor=analysis.nnz_factor,
            fill_in=analysis.nnz_factor / max(nnz, 1),
            factor_flops=analysis.flops,
            ordering=self.elimination.name,
            density=(2 * nnz - dimension) / max(np.square(float(dimension)), 1.0),
            reduced=None if self.schur is None else self.schur.reduced_system,
        )
