"""Which loop closures a robust run rejected, and the graph without them.

A closure is rejected if its weight at the end is below 0.5. Methods that decide (graduated non-convexity, pairwise
consistency) leave weights of 0 and 1, so that says the same as the set. A switch s has the weight s^2 and rejects its
closure below s = 0.5, where chi2 is above what the prior on the switch costs. Kernels decide nothing: their weight
says how much an edge still pulls, and its meaning is another one for each kernel; a closure under a kernel is rejected
if its chi2 is above the gate.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slamcli.graph import FactorGraph
from slamcli.graph.columns import BoolArray
from slamcli.models.base import Array
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.robust import kernels
from slamcli.solver.robust.closures import Closures

#: A closure with less weight is rejected; one with a switch where that is below one half, its weight being the square.
LEAST_WEIGHT, LEAST_SWITCHED = 0.5, 0.25


@dataclass(frozen=True)
class RejectedEdge:
    """A rejected closure.

    Attributes
    ----------
    line
        In the source, 0 if it has none.
    tag
        Of the file.
    ids
        Of the joined variables.
    weight
        At the end.
    chi2
        e^T Omega e at the end.
    """

    line: int
    tag: str
    ids: tuple[int, ...]
    weight: float
    chi2: float


@dataclass(frozen=True, eq=False)
class Rejection:
    """What a robust run decided about the loop closures of its graph.

    Attributes
    ----------
    method
        ``--robust``, or the name of the kernel.
    rejected
        One mask for each column of factors.
    weight, chi2
        Of all factors at the end, one array for each column.
    probability
        With which a right closure passes the gate.
    noise_scale
        Noise over the stated noise that the gate was set for, None where the method has no gate.
    closures
        Number of loop closures.
    inlier_chi2
        Sum of e^T Omega e over what is not rejected.
    inlier_dof
        Its degrees of freedom.
    """

    method: str
    rejected: list[BoolArray]
    weight: list[Array]
    chi2: list[Array]
    probability: float
    noise_scale: float | None
    closures: int
    inlier_chi2: float
    inlier_dof: int

    @property
    def count(self) -> int:
        """Number of rejected closures."""
        return sum(int(np.count_nonzero(mask)) for mask in self.rejected)


def of_weights(
    graph: FactorGraph, weight: list[Array], options: OptimizeOptions, dof: int, scale: float | None
) -> Rejection:
    """The rejection of closures by weight.

    Parameters
    ----------
    graph
        At the final values.
    weight
        Of all factors, one array for each column.
    options
        Method and probability.
    dof
        Degrees of freedom of chi2 with all closures.
    scale
        See ``Rejection.noise_scale``.
    """
    masks = Closures.of(graph).masks
    least = LEAST_SWITCHED if options.robust == "switchable" else LEAST_WEIGHT
    rejected = [mask & (w < least) for mask, w in zip(masks, weight, strict=True)]
    return _rejection(graph, rejected, weight, options.robust, options.robust_probability, dof, scale)


def of_kernel(graph: FactorGraph, options: OptimizeOptions, dof: int) -> Rejection:
    """The closures whose chi2 is above the gate at the end of a run with a robust kernel."""
    closures = Closures.of(graph)
    beyond = closures.chi2(graph.values) > closures.quantile(options.robust_probability)
    rejected = [part < LEAST_WEIGHT for part in closures.spread(np.where(beyond, 0.0, 1.0))]
    weight = kernels.weights(graph, options)
    return _rejection(graph, rejected, weight, options.kernel, options.robust_probability, dof, None)


def _rejection(
    graph: FactorGraph,
    rejected: list[BoolArray],
    weight: list[Array],
    method: str,
    probability: float,
    dof: int,
    scale: float | None,
) -> Rejection:
    chi2 = graph.edge_chi2()
    lost = sum(int(np.count_nonzero(mask)) * f.kind.dimension for mask, f in zip(rejected, graph.factors, strict=True))
    return Rejection(
        method=method,
        rejected=rejected,
        weight=weight,
        chi2=chi2,
        probability=probability,
        noise_scale=scale,
        closures=len(Closures.of(graph)),
        inlier_chi2=sum(float(c[~mask].sum()) for c, mask in zip(chi2, rejected, strict=True)),
        inlier_dof=dof - lost,
    )


def without_rejected(graph: FactorGraph, rejection: Rejection) -> FactorGraph:
    """The graph without its rejected closures; what it is written to keeps the other records' bytes."""
    parts = [
        factors.part(np.flatnonzero(~mask)) if mask.any() else factors
        for factors, mask in zip(graph.factors, rejection.rejected, strict=True)
    ]
    return replace(graph, factors=[part for part in parts if len(part)])


def rejected_edges(graph: FactorGraph, rejection: Rejection) -> list[RejectedEdge]:
    """All rejected closures, those with the largest chi2 first."""
    out = []
    for k, factors in enumerate(graph.factors):
        rows = np.flatnonzero(rejection.rejected[k])
        ids = factors.part(rows).variable_ids(graph.variables).tolist()
        lines = factors.lines[rows] if len(factors.lines) else np.zeros(len(rows), dtype=np.intp)
        columns = (lines.tolist(), ids, rejection.weight[k][rows].tolist(), rejection.chi2[k][rows].tolist())
        name = factors.tag or factors.kind.name
        out += [RejectedEdge(line, name, tuple(pair), w, c) for line, pair, w, c in zip(*columns, strict=True)]
    return sorted(out, key=lambda edge: (-edge.chi2, edge.line, edge.ids))
