"""What an optimization returns: one record for each iteration, one result for the run."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import TYPE_CHECKING

from slamcli.errors import ExitCode
from slamcli.graph import FactorGraph
from slamcli.solver.gauge import Gauge
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.robust import kernels
from slamcli.solver.symbolic import Sparsity

if TYPE_CHECKING:
    from slamcli.solver.attempt import Attempt
    from slamcli.solver.initialization import Start
    from slamcli.solver.landmark_sides import Ambiguous
    from slamcli.solver.problem import Problem
    from slamcli.solver.robust.rejection import Rejection
    from slamcli.solver.under_observed import HeldBack, UnderObserved


class Status(StrEnum):
    """How a run ended."""

    CONVERGED = "converged"
    NOT_CONVERGED = "not_converged"
    INTERRUPTED = "interrupted"
    FAILED = "numerical_failure"

    @property
    def exit_code(self) -> ExitCode:
        """The exit code of the command line for this status."""
        return {
            Status.CONVERGED: ExitCode.SUCCESS,
            Status.NOT_CONVERGED: ExitCode.NOT_CONVERGED,
            Status.INTERRUPTED: ExitCode.INTERRUPTED,
            Status.FAILED: ExitCode.NUMERICAL_FAILURE,
        }[self]


@dataclass(frozen=True)
class IterationRecord:
    """One iteration.

    Attributes
    ----------
    iteration
        Number, from 1.
    chi2
        After the step.
    chi2_change
        chi2 after the step minus chi2 before it.
    gradient_norm
        Largest component of the gradient J^T Omega e after the step.
    step_norm
        Euclidean norm of the tangent step.
    damping
        Levenberg-Marquardt's lambda, dogleg's trust radius, None for Gauss-Newton.
    trials
        Steps that were tried, the last one included.
    accepted
        Whether the last one was taken.
    step
        Kind of the step: ``gauss-newton``, ``simplified-newton`` (with the factor of the step before), ``accelerated``
        (extrapolated), ``damped``, ``steepest-descent`` or ``dogleg``.
    time
        Seconds.
    gain_ratio
        Decrease of chi2 over the decrease that the quadratic model promised, None where that is not known.
    stage
        Of a robust run: ``gnc`` or ``gnc-gm`` and mu, then ``set``. Of a run that takes landmarks in when the poses
        determine them: without how many of them. None in the final optimization and in other runs.
    linear_iterations
        Iterations of conjugate gradients, of all its trials; None where matrices are factorized.
    """

    iteration: int
    chi2: float
    chi2_change: float
    gradient_norm: float
    step_norm: float
    damping: float | None
    trials: int
    accepted: bool
    step: str
    time: float
    gain_ratio: float | None = None
    stage: str | None = None
    linear_iterations: int | None = None


@dataclass(frozen=True)
class StartRecord:
    """A start that ``--init auto`` considered.

    Attributes
    ----------
    name
        ``file``, ``chordal`` or ``chordal-anchors``.
    words
        Where its values come from.
    initial_chi2
        At the start.
    status, reason, final_chi2
        Of the run from it; None if there was none.
    trace
        The iterations of that run.
    """

    name: str
    words: str
    initial_chi2: float
    status: Status | None = None
    reason: str | None = None
    final_chi2: float | None = None
    trace: tuple[IterationRecord, ...] = ()

    @classmethod
    def unused(cls, start: Start, chi2: float) -> StartRecord:
        """Of a start from which nothing was run."""
        return cls(start.name, start.words, chi2)

    @classmethod
    def of(cls, attempt: Attempt) -> StartRecord:
        """Of a run that has ended."""
        assert attempt.verdict is not None
        verdict, start = attempt.verdict, attempt.start
        trace = tuple(attempt.trace)
        return cls(start.name, start.words, attempt.initial, verdict.status, verdict.reason, attempt.chi2, trace)


@dataclass
class Result:
    """Outcome of an optimization.

    Attributes
    ----------
    graph
        The graph at the final values.
    options
        As they were in effect.
    gauge
        What was held.
    status, reason
        How the run ended, and why in words.
    diagnosis
        Details of a numerical failure, one line each.
    start
        Where the run started, in words.
    initial_chi2, final_chi2
        At the start and at the end: what was minimized, so with a robust kernel its cost (see ``plain_chi2``).
    dof
        Residual dimensions minus free tangent dimensions.
    trace
        The iterations from the start that was taken.
    starts
        What ``--init auto`` considered, empty with other starts.
    doubt
        Why it ran more than one of them, None if it did not.
    time
        Seconds by phase: gauge, check, init, pattern, order, analyze, linearize, assemble, factorize, solve, retract.
    problem
        The linear problem of the run, for what is computed on demand; None if it was never built.
    rejection
        Which loop closures a robust run rejected; None in other runs. ``final_chi2`` and ``dof`` then cover what is
        kept.
    under_observed
        Landmarks that were held back with their edges, since these do not determine them.
    ambiguous
        Landmarks with a second place that fits their edges as well.
    held_back
        What was left out, None if nothing was.
    reduced
        The graph that was optimized then; ``optimized`` is it or ``graph``.
    """

    graph: FactorGraph
    options: OptimizeOptions
    gauge: Gauge
    status: Status
    reason: str
    start: str
    initial_chi2: float
    final_chi2: float
    dof: int
    trace: list[IterationRecord] = field(default_factory=list)
    starts: list[StartRecord] = field(default_factory=list)
    doubt: str | None = None
    diagnosis: tuple[str, ...] = ()
    time: dict[str, float] = field(default_factory=dict)
    problem: Problem | None = None
    rejection: Rejection | None = None
    under_observed: tuple[UnderObserved, ...] = ()
    ambiguous: tuple[Ambiguous, ...] = ()
    held_back: HeldBack | None = None
    reduced: FactorGraph | None = None

    @property
    def optimized(self) -> FactorGraph:
        """The graph whose chi2 was minimized, at the final values: ``graph`` without what was held back."""
        return self.graph if self.reduced is None else self.reduced

    @cached_property
    def sparsity(self) -> Sparsity | None:
        """Sparsity of the linear system, analyzed when it is first asked for; None if it was never built."""
        return None if self.problem is None else self.problem.sparsity

    @cached_property
    def plain_chi2(self) -> float:
        """Sum of e^T Omega e over all edges at the end, whatever was minimized."""
        plain = self.options.kernel == "none" and self.options.robust == "none"
        return self.final_chi2 if plain else self.optimized.chi2()

    @cached_property
    def kernel_edges(self) -> int:
        """Number of edges on which the robust kernel acts."""
        return sum(int(mask.sum()) for mask in kernels.affected(self.optimized, self.options))

    @cached_property
    def kernel_widths(self) -> tuple[float, ...]:
        """Widths of the robust kernel: one for each dimension of the edges on which it acts, where none was given."""
        factors = self.optimized.factors
        masks = zip(factors, kernels.affected(self.optimized, self.options), strict=True)
        return tuple(sorted({kernels.width(self.options, f.kind.dimension) for f, mask in masks if mask.any()}))

    @property
    def iterations(self) -> int:
        """Number of iterations."""
        return len(self.trace)

    @property
    def linear_iterations(self) -> int | None:
        """Iterations of conjugate gradients in the trace; None where matrices are factorized."""
        counts = [record.linear_iterations for record in self.trace if record.linear_iterations is not None]
        return sum(counts) if self.problem is not None and self.problem.iterative else None

    @property
    def unfinished(self) -> int | None:
        """See ``Problem.unfinished``; None where matrices are factorized."""
        return self.problem.unfinished if self.problem is not None and self.problem.iterative else None

    @property
    def exit_code(self) -> ExitCode:
        """The exit code of the command line."""
        return self.status.exit_code
