"""The four steps that every method is made of: linearize, factorize, solve, retract."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from slamcli.graph import FactorGraph
from slamcli.graph.columns import IndexArray, Values
from slamcli.models.base import Array, dot
from slamcli.solver import backends, ordering, schur
from slamcli.solver.freedoms import Frozen
from slamcli.solver.gauge import Held
from slamcli.solver.linear_system import Linearizer, LinearSystem
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.ordering import FoundOrder
from slamcli.solver.robust.loss import Losses
from slamcli.solver.stopwatch import Stopwatch
from slamcli.solver.symbolic import Sparsity

#: Damping that makes a singular H factorize, as shares of its largest diagonal entry.
SHIFTS = (1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1e-2, 1.0)

#: Relative residual of a full step that is found by iteration: its promise is then right to a few percent.
_ROUGH = 1e-3


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
    factorized
        Whether conjugate gradients are no choice for what the options leave open.
    """

    def __init__(
        self,
        graph: FactorGraph,
        held: Held,
        options: OptimizeOptions,
        stopwatch: Stopwatch,
        losses: Losses | None = None,
        frozen: Frozen | None = None,
        *,
        factorized: bool = False,
    ) -> None:
        self.stopwatch = stopwatch
        self.options = options
        with stopwatch.phase("pattern"):
            self._linearizer = Linearizer(graph, held, stopwatch, losses, frozen)
        self.pattern = self._linearizer.pattern
        with stopwatch.phase("order"):
            solver = options.reduced_solver
            if (factorized and solver == "iterative") or (solver == "auto" and (factorized or options.method != "lm")):
                solver = "factorized"  # only damped steps may be inexact, and need no word on whether H is singular
            self.schur = schur.select(options.elimination, solver, options.ordering, graph, held, self.pattern)
        self._iterative: schur.ImplicitSchur | None = None
        self._factorization: backends.Factorization
        if isinstance(self.schur, schur.ImplicitSelection):
            with stopwatch.phase("analyze"):
                self._factorization = self._iterative = self.schur.factorization()
            return
        with stopwatch.phase("order"):
            order = self.elimination.order
        with stopwatch.phase("analyze"):
            self.permutation = ordering.expand(self.pattern, order)
            self._factorization = (
                self.schur.factorization(options.linear_solver)
                if self.schur
                else backends.make(options.linear_solver, self.pattern, self.permutation)
            )

    @cached_property
    def elimination(self) -> FoundOrder:
        """Elimination order of the whole H."""
        if isinstance(self.schur, schur.Selection):
            return self.schur.elimination
        return ordering.find(self.options.ordering, self.pattern)

    @property
    def iterative(self) -> bool:
        """Whether systems are solved by conjugate gradients: H is then never found singular, steps may be inexact."""
        return self._iterative is not None

    @property
    def linear_iterations(self) -> int | None:
        """Iterations of conjugate gradients so far; None where matrices are factorized."""
        return None if self._iterative is None else self._iterative.iterations

    @property
    def unfinished(self) -> int:
        """Solutions so far that conjugate gradients ended before their criterion (see ``schur.ImplicitSchur``)."""
        return 0 if self._iterative is None else self._iterative.unfinished

    @property
    def frozen(self) -> IndexArray:
        """Scalar rows of H that do not move: they have nothing but their diagonal entry, and no gradient."""
        return self._linearizer.frozen

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

    def solve(
        self,
        system: LinearSystem,
        damping: Array | None = None,
        *,
        inexact: bool = False,
        tolerance: float | None = None,
    ) -> Array:
        """The step (H + diag(damping)) delta = -gradient.

        Parameters
        ----------
        system, damping
            The system.
        inexact
            Whether a step will do that is as good as its share of the way is worth, where that is found by iteration
            (see ``schur.conjugate_gradients``). For it as for the exact one, delta^T (H + D) delta = -gradient^T delta.
        tolerance
            Otherwise, and where it is found by iteration, its relative residual; None for as small as can be.

        Raises
        ------
        NotPositiveDefiniteError
            If the matrix is not positive definite.
        """
        diagonal = self.diagonal(system)
        try:
            if damping is not None:  # in place, since a copy takes as long as some factorizations
                system.hessian[self.pattern.diagonal] = diagonal + damping
            with self.stopwatch.phase("factorize"):
                self._factorization.factorize(system.hessian)
        finally:
            system.hessian[self.pattern.diagonal] = diagonal
        with self.stopwatch.phase("solve"):
            if self._iterative is not None and inexact:
                return self._iterative.solve_inexactly(-system.gradient)
            if self._iterative is not None and tolerance is not None:
                return self._iterative.solve(-system.gradient, tolerance)
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
        """What the full Gauss-Newton step promises; where H is singular, the step with the least damping that works.

        Infinity where conjugate gradients do not find it.
        """
        largest = float(self.diagonal(system).max(initial=0.0))
        for shift in (None, *SHIFTS):
            try:
                damping = None if shift is None else np.full_like(system.gradient, shift * largest)
                delta = self.solve(system, damping, tolerance=_ROUGH)
            except schur.NotSolvedError:
                return FullStep(np.inf, np.inf, singular=False)  # nobody knows what it promises
            except backends.NotPositiveDefiniteError:
                continue
            decrease = -dot(system.gradient, delta)
            return FullStep(decrease, float(np.abs(delta).max(initial=0.0)), singular=shift is not None)
        return FullStep(np.inf, np.inf, singular=True)

    @cached_property
    def sparsity(self) -> Sparsity:
        """Sparsity of H and of its factor, by symbolic analysis."""
        analysis = None if self.iterative else self.elimination.analysis(self.pattern)
        dimension, nnz = self.pattern.dimension, self.pattern.nnz
        return Sparsity(
            dimension=dimension,
            nnz_hessian=nnz,
            nnz_factor=None if analysis is None else analysis.nnz_factor,
            fill_in=None if analysis is None else analysis.nnz_factor / max(nnz, 1),
            factor_flops=None if analysis is None else analysis.flops,
            ordering=None if analysis is None else self.elimination.name,
            density=(2 * nnz - dimension) / max(np.square(float(dimension)), 1.0),
            reduced=None if self.schur is None else self.schur.reduced_system,
        )
