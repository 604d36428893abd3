"""What a certification finds."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from slamcli.graph import FactorGraph
from slamcli.solver.options import OptimizeOptions

#: What is tried, in this order, where a certificate fails.
RESTARTS = ("chordal", "staircase")


def is_robust(options: OptimizeOptions) -> bool:
    """Whether a run with these options minimizes something else than the sum over all edges: nothing to certify."""
    return options.kernel != "none" or options.robust != "none"


class CertificateStatus(StrEnum):
    """Whether the isotropic chordal objective is known to be at its global minimum."""

    CERTIFIED = "certified"
    NOT_CERTIFIED = "not_certified"
    INAPPLICABLE = "inapplicable"


@dataclass(frozen=True)
class Escape:
    """A critical point that is no minimum of the relaxation, and the direction that leads away from it.

    Attributes
    ----------
    rank
        Rows r of the point X: d for poses, more on the staircase.
    cost
        There.
    eigenvalue, error
        Smallest eigenvalue of Q - Lambda, and how far it is at most from a true one.
    movers
        The poses that move most along its eigenvector: id and share of its squared norm.
    """

    rank: int
    cost: float
    eigenvalue: float
    error: float
    movers: tuple[tuple[int, float], ...]


@dataclass(frozen=True, eq=False)
class Certificate:
    """A statement on the global minimum of the isotropic chordal objective; see ``dual`` for the mathematics.

    Attributes
    ----------
    status
        The verdict.
    reason
        In words.
    graph
        The transformed graph at the point of the statement: a critical point, the minimum if it is certified. None if
        the certificate is inapplicable.
    cost
        The objective there.
    estimate_cost, polished_cost
        The objective at the estimate that was given, and at the critical point next to it.
    dual_value
        Sum of tr(Lambda_i) over the poses. At a critical point it is the cost.
    eta
        Shift with which Q - Lambda + eta I was found positive definite by Cholesky; NaN if it was not certified.
    scale
        Largest diagonal entry of M among the rotations, for comparison with eta.
    smallest_eigenvalue, next_eigenvalue
        Of Q - Lambda. In a certified solution the smallest is zero up to rounding, once for each row of the rotations
        of each component; the next one is the smallest of the rest. Where it is clearly positive, the minimum is unique
        up to the gauge. None where it was not computed.
    lower_bound
        No poses have a lower cost than this.
    gradient_norm
        Largest entry of X S, half the gradient over poses as matrices.
    escapes
        Critical points on the way that were found not to be minima, in order.
    time
        Seconds by phase: polish, assemble, factorize, eigenvalue, staircase.
    """

    status: CertificateStatus
    reason: str
    graph: FactorGraph | None = None
    cost: float = np.nan
    estimate_cost: float = np.nan
    polished_cost: float = np.nan
    dual_value: float = np.nan
    eta: float = np.nan
    scale: float = np.nan
    smallest_eigenvalue: float | None = None
    next_eigenvalue: float | None = None
    lower_bound: float = np.nan
    gradient_norm: float = np.nan
    escapes: tuple[Escape, ...] = ()
    time: dict[str, float] = field(default_factory=dict)

    @property
    def certified(self) -> bool:
        """Whether the point is the global minimum, up to ``suboptimality``."""
        return self.status == CertificateStatus.CERTIFIED

    @property
    def suboptimality(self) -> float:
        """By how much the cost can exceed the global minimum at most."""
        return self.cost - self.lower_bound

    @property
    def relative_suboptimality(self) -> float:
        """The same as a share of the cost."""
        return self.suboptimality / self.cost if self.cost > 0.0 else 0.0

    @property
    def relative_eta(self) -> float:
        """Eta over the scale of S."""
        return self.eta / self.scale
