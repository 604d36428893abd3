"""Robust kernels in g2o's definitions: what the squared residual s = e^T Omega e of an edge counts.

All act on s, and the weight of an edge is rho'(s) (g2o, ``core/robust_kernel_impl.cpp`` and
``BaseEdge::robustInformation``): the same rho that other libraries write as a function of the residual's norm, without
their factor of one half. With width w:

    huber          s, beyond w^2: 2 w sqrt(s) - w^2
    pseudo-huber   2 w^2 (sqrt(1 + s / w^2) - 1)
    cauchy         w^2 log(1 + s / w^2)
    geman-mcclure  w s / (w + s)
    welsch         w^2 (1 - exp(-s / w^2))
    fair           2 w^2 (sqrt(s) / w - log(1 + sqrt(s) / w))
    tukey          w^2 (1 - (1 - s / w^2)^3) / 3, beyond w^2: w^2 / 3
    saturated      min(s, w^2)
    dcs            s, beyond w: w (3 s - w) / (s + w)

The width is a norm, in units of sqrt(s) (standard deviations where an edge has one dimension), but for geman-mcclure
and dcs, where it is a squared norm, in units of s. Where none is given, it is that of the s which one in a hundred true
edges exceeds: the quantile of chi2 with as many degrees of freedom as the edge has dimensions.

``dcs`` is not g2o's. Dynamic covariance scaling weighs an edge with the square of its scale min(1, 2 w / (w + s))
(Agarwal, Tipaldi, Spinello, Stachniss, Burgard, "Robust Map Optimization using Dynamic Covariance Scaling", ICRA 2013);
the cost that has this derivative is the one above (MacTavish, Barfoot, "At all Costs", CRV 2015). g2o takes the scaled
square for the cost and its derivative for the weight, which is negative beyond w: such edges push poses apart, and H
loses its definiteness.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from slamcli.graph import FactorGraph
from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.graph.topology import is_loop_closure
from slamcli.models import SWITCH_PRIOR
from slamcli.models.base import Array
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.robust.loss import Losses
from slamcli.solver.robust.quantile import chi2_quantile

#: ``(s (m,), width) -> rho (m,), rho' (m,)`` for s >= 0.
Kernel = Callable[[Array, float], tuple[Array, Array]]


def _huber(s: Array, width: float) -> tuple[Array, Array]:
    root = np.sqrt(np.maximum(s, width**2))
    return np.where(s <= width**2, s, width * (2.0 * root - width)), width / root


def _pseudo_huber(s: Array, width: float) -> tuple[Array, Array]:
    root = np.sqrt(1.0 + s / width**2)
    return 2.0 * s / (1.0 + root), 1.0 / root  # w^2 (root - 1) without cancellation


def _cauchy(s: Array, width: float) -> tuple[Array, Array]:
    scaled = s / width**2
    return width**2 * np.log1p(scaled), 1.0 / (1.0 + scaled)


def _geman_mcclure(s: Array, width: float) -> tuple[Array, Array]:
    scale = width / (width + s)
    return scale * s, scale * scale


def _welsch(s: Array, width: float) -> tuple[Array, Array]:
    scaled = s / width**2
    return -(width**2) * np.expm1(-scaled), np.exp(-scaled)


def _fair(s: Array, width: float) -> tuple[Array, Array]:
    scaled = np.sqrt(s) / width
    series = scaled * (1.0 / 2.0 - scaled * (1.0 / 3.0 - scaled * (1.0 / 4.0 - scaled * (1.0 / 5.0 - scaled / 6.0))))
    half = np.where(
        scaled < 1e-3, width * series, width - width * np.log1p(scaled) / np.where(scaled > 0.0, scaled, 1.0)
    )
    return 2.0 * np.sqrt(s) * half, 1.0 / (1.0 + scaled)


def _tukey(s: Array, width: float) -> tuple[Array, Array]:
    scaled = np.minimum(s / width**2, 1.0)
    left = 1.0 - scaled
    return width**2 * scaled * (1.0 + left + left * left) / 3.0, left * left


def _dcs(s: Array, width: float) -> tuple[Array, Array]:
    scale = np.minimum(2.0 * width / (width + s), 1.0)
    return np.where(s <= width, s, width * (3.0 - 2.0 * scale)), scale * scale


def _saturated(s: Array, width: float) -> tuple[Array, Array]:
    return np.minimum(s, width**2), np.where(s <= width**2, 1.0, 0.0)


#: By the names of ``options.KERNELS``.
KERNELS: dict[str, Kernel] = {
    "huber": _huber,
    "pseudo-huber": _pseudo_huber,
    "cauchy": _cauchy,
    "geman-mcclure": _geman_mcclure,
    "welsch": _welsch,
    "fair": _fair,
    "tukey": _tukey,
    "dcs": _dcs,
    "saturated": _saturated,
}

#: Kernels whose width is in units of s.
SQUARED_WIDTH = ("geman-mcclure", "dcs")
#: The default width: so many of the true edges have a smaller s.
PROBABILITY = 0.99


@dataclass(frozen=True, eq=False)
class KernelLoss:
    """A kernel on some factors of a column; the squares of the others count as they are.

    Attributes
    ----------
    kernel
        Its function.
    width
        See the head of this file for its unit.
    affected
        (n,) which factors of the column.
    """

    kernel: Kernel
    width: float
    affected: BoolArray

    def evaluate(self, squared: Array, rows: slice | IndexArray) -> tuple[Array, Array]:
        """See ``Loss``. What is not finite stays so, whatever the kernel is bounded by: it is for the run to see."""
        with np.errstate(all="ignore"):
            cost, weight = self.kernel(np.maximum(squared, 0.0), self.width)  # rounding may have made it negative
        use = self.affected[rows] & np.isfinite(squared)
        return np.where(use, cost, squared), np.where(use, weight, 1.0)


def width(options: OptimizeOptions, dimension: int) -> float:
    """Width of the kernel of the options for edges of so many dimensions."""
    if options.kernel_width is not None:
        return options.kernel_width
    squared = chi2_quantile(dimension, PROBABILITY)
    return squared if options.kernel in SQUARED_WIDTH else math.sqrt(squared)


def affected(graph: FactorGraph, options: OptimizeOptions) -> list[BoolArray]:
    """On which factors the kernel of the options acts, one mask for each column of factors.

    ``closures`` are relative poses whose ids are not neighbours; ``all`` leaves out the priors of switches, which
    measure nothing.
    """
    if options.kernel == "none":
        return [np.zeros(len(factors), dtype=bool) for factors in graph.factors]
    if options.kernel_on == "closures":
        return [is_loop_closure(graph, factors) for factors in graph.factors]
    return [np.full(len(factors), factors.kind is not SWITCH_PRIOR) for factors in graph.factors]


def losses(graph: FactorGraph, options: OptimizeOptions) -> Losses | None:
    """What the squared residuals of a graph count under the kernel of the options; None without a kernel."""
    if options.kernel == "none":
        return None
    kernel = KERNELS[options.kernel]
    return [
        KernelLoss(kernel, width(options, factors.kind.dimension), mask) if mask.any() else None
        for factors, mask in zip(graph.factors, affected(graph, options), strict=True)
    ]


def weights(graph: FactorGraph, options: OptimizeOptions) -> list[Array]:
    """rho'(s) of every factor at the graph's values, one array for each column: 1 where the kernel does not act."""
    found = losses(graph, options) or [None] * len(graph.factors)
    return [
        np.ones(len(squared)) if loss is None else loss.evaluate(squared, slice(None))[1]
        for squared, loss in zip(graph.edge_chi2(), found, strict=True)
    ]
