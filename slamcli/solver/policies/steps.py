"""What the step policies share: the outcome of one iteration, and what a policy is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from slamcli.solver.linear_system import LinearSystem
from slamcli.solver.problem import Problem


@dataclass(frozen=True, eq=False)
class Step:
    """Outcome of one iteration.

    Attributes
    ----------
    system
        Linearized at the new state; the old one if no step was accepted.
    norm
        Euclidean norm of the last step tried.
    largest
        Its largest component.
    damping
        See ``IterationRecord.damping``.
    trials
        Steps that were tried.
    accepted
        Whether the last one was taken.
    kind
        See ``IterationRecord.step``.
    gain
        Decrease of chi2 over the decrease that the quadratic model promised, None where that is not known.
    """

    system: LinearSystem
    norm: float
    largest: float
    damping: float | None
    trials: int
    accepted: bool
    kind: str
    gain: float | None = None


class Policy(Protocol):
    """How a method moves from one linearized state to the next."""

    def step(self, problem: Problem, now: LinearSystem) -> Step:
        """One iteration; raises NotPositiveDefiniteError where the method needs a positive definite H."""
