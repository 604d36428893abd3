"""The loop closures of a graph as one list: what robust methods may reject. All other factors are known inliers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from slamcli.graph import FactorGraph, Factors
from slamcli.graph.columns import BoolArray, IndexArray, Values
from slamcli.graph.topology import is_loop_closure
from slamcli.models.base import Array
from slamcli.solver.robust.quantile import chi2_quantile


@dataclass(frozen=True, eq=False)
class Closures:
    """The loop closures of a graph, column after column.

    Attributes
    ----------
    graph
        The graph.
    masks
        Which factors are loop closures, one mask for each column.
    """

    graph: FactorGraph
    masks: list[BoolArray]

    @classmethod
    def of(cls, graph: FactorGraph) -> Closures:
        """The relative poses whose ids are not neighbours and that are marked as such by ``is_loop_closure``."""
        return cls(
            graph,
            [
                is_loop_closure(graph, f) if f.kind.relative_pose else np.zeros(len(f), dtype=bool)
                for f in graph.factors
            ],
        )

    def __len__(self) -> int:
        return sum(int(np.count_nonzero(mask)) for mask in self.masks)

    @cached_property
    def columns(self) -> list[tuple[int, IndexArray, Factors]]:
        """Number of the column of factors, rows in it, and the closures, for each column that has some."""
        found = ((k, np.flatnonzero(mask)) for k, mask in enumerate(self.masks))
        return [(k, rows, self.graph.factors[k].part(rows)) for k, rows in found if len(rows)]

    @cached_property
    def dimensions(self) -> IndexArray:
        """(c,) residual dimension of each closure."""
        none = np.empty(0, dtype=np.intp)
        return np.concatenate([none, *(np.full(len(rows), f.kind.dimension) for _, rows, f in self.columns)])

    def chi2(self, values: Values) -> Array:
        """(c,) e^T Omega e of each closure at a state."""
        return np.concatenate([np.empty(0), *(factors.chi2(values) for _, _, factors in self.columns)])

    def quantile(self, probability: float) -> Array:
        """(c,) quantile of the chi-square distribution with the closure's residual dimension."""
        table = {int(d): chi2_quantile(int(d), probability) for d in np.unique(self.dimensions)}
        return np.array([table[int(d)] for d in self.dimensions])

    def spread(self, weight: Array) -> list[Array]:
        """Weights of all factors, one array for each column: those of the closures (c,), 1 for all others."""
        out = [np.ones(len(factors)) for factors in self.graph.factors]
        start = 0
        for k, rows, _ in self.columns:
            out[k][rows] = weight[start : start + len(rows)]
            start += len(rows)
        return out

    def subgraph(self, keep: BoolArray) -> FactorGraph:
        """The graph with all other factors and the closures ``keep`` (c,)."""
        masks = [weight > 0.0 for weight in self.spread(keep.astype(np.float64))]
        parts = [
            factors if mask.all() else factors.part(np.flatnonzero(mask))
            for factors, mask in zip(self.graph.factors, masks, strict=True)
        ]
        return replace(self.graph, factors=[part for part in parts if len(part)])
