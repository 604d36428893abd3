"""Everything that was asked of a graph's covariances, in one convention and scale."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from slamcli.graph import FactorGraph
from slamcli.graph.columns import BoolArray, IdArray
from slamcli.models import VariableKind
from slamcli.models.base import Array
from slamcli.solver.gauge import Gauge

if TYPE_CHECKING:
    from slamcli.solver.under_observed import UnderObserved

SCALES = ("none", "posterior")
SELECTIONS = ("all", "poses", "landmarks")


@dataclass(frozen=True)
class CovarianceRequest:
    """What to recover.

    Attributes
    ----------
    of
        ``all``, ``poses`` or ``landmarks``.
    ids
        Ids instead of that, in this order; empty for none.
    joint
        Ids whose joint covariance is wanted, in this order.
    relative
        Pairs of ids: the second in the frame of the first.
    cross
        Whether to recover the cross-covariances of connected pairs among the chosen variables.
    convention
        Name of the tangent space (see ``conventions``).
    scale
        ``none``, or ``posterior``: times chi2 over the degrees of freedom.
    """

    of: str = "all"
    ids: tuple[int, ...] = ()
    joint: tuple[int, ...] = ()
    relative: tuple[tuple[int, int], ...] = ()
    cross: bool = False
    convention: str = "slamcli"
    scale: str = "none"


@dataclass(frozen=True, eq=False)
class Marginals:
    """Marginal covariances of variables of one kind.

    Attributes
    ----------
    kind
        Their kind.
    ids, values, held
        (n,), (n, size), (n,).
    covariance
        (n, d, d) in the convention asked for; zero where held.
    local
        The same in the tangent space of ``VariableKind.retract``.
    """

    kind: VariableKind
    ids: IdArray
    values: Array
    held: BoolArray
    covariance: Array
    local: Array


@dataclass(frozen=True, eq=False)
class Cross:
    """Cross-covariances (m, d, k) of connected pairs (m, 2) of ids, of two kinds."""

    kinds: tuple[VariableKind, VariableKind]
    ids: IdArray
    covariance: Array


@dataclass(frozen=True, eq=False)
class Joint:
    """Joint covariance (D, D) of variables; ``names`` of its rows are id and component, such as ``7 theta``."""

    ids: tuple[int, ...]
    names: tuple[str, ...]
    covariance: Array


@dataclass(frozen=True, eq=False)
class Relative:
    """Variable ``ids[1]`` in the frame of ``ids[0]``: its value, and its covariance at that value."""

    ids: tuple[int, int]
    kind: VariableKind
    value: Array
    covariance: Array
    local: Array


@dataclass(frozen=True, eq=False)
class CovarianceResult:
    """What was recovered.

    Attributes
    ----------
    graph
        Linearized at its values.
    request
        What was asked for.
    gauge
        What was held, which has zero covariance.
    factor
        What all covariances were multiplied by: 1, or chi2 over the degrees of freedom.
    chi2, dof
        At the values of the graph.
    predicted_decrease
        How much chi2 would fall in one Gauss-Newton step: the squared Mahalanobis distance to the optimum.
    marginals, cross, joint, relative
        What was asked for.
    under_observed
        Landmarks that were left out, since their edges do not determine them; the graph is without them.
    edges_left_out
        Number of their edges.
    """

    graph: FactorGraph
    request: CovarianceRequest
    gauge: Gauge
    factor: float
    chi2: float
    dof: int
    predicted_decrease: float
    marginals: list[Marginals]
    cross: list[Cross]
    joint: Joint | None
    relative: list[Relative]
    under_observed: tuple[UnderObserved, ...] = ()
    edges_left_out: int = 0

    @property
    def at_optimum(self) -> bool:
        """Whether the values are within a tenth of a standard deviation of an optimum (see docs/covariance.md)."""
        return self.predicted_decrease <= max(0.01, 1e-6 * self.chi2)
