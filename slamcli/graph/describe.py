"""Describes a graph: counts, connectivity, extent, cost at its values, quality of its information matrices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.graph.factor_graph import FactorGraph
from slamcli.graph.topology import analyze
from slamcli.models.base import Array
from slamcli.models.information import eigenvalue_range, indefinite


@dataclass(frozen=True)
class VariableSummary:
    """One kind of variable: how many, which ids, how many without an estimate, which are fixed."""

    kind: str
    count: int
    lowest_id: int
    highest_id: int
    consecutive_ids: bool
    without_estimate: int
    fixed: int


@dataclass(frozen=True)
class FactorSummary:
    """One tag: how many, chi2 at the graph's values, range of the eigenvalues of the information."""

    tag: str
    kind: str
    count: int
    loop_closures: int
    chi2: float | None
    smallest_eigenvalue: float
    largest_eigenvalue: float
    indefinite: int


@dataclass(frozen=True)
class GraphDescription:
    """What ``slamcli info`` tells.

    Attributes
    ----------
    variables, factors
        By kind and by tag.
    dimension
        Tangent dimensions of all variables.
    residuals
        Residual dimensions of all factors.
    component_sizes
        Sizes of the connected components, largest first.
    isolated
        Variables without any factor to another one.
    degree_min, degree_mean, degree_max
        Over all variables.
    loop_closures, parallel_edges, self_edges
        See ``topology``.
    path_length
        Metres along the poses in the order of ids, None where poses have no estimate.
    bounding_box
        Smallest and largest coordinate along each axis in metres, None where variables have no estimate or no place.
    chi2
        At the graph's values, None where variables have no estimate.
    """

    variables: list[VariableSummary]
    factors: list[FactorSummary]
    dimension: int
    residuals: int
    component_sizes: list[int]
    isolated: int
    degree_min: int
    degree_mean: float
    degree_max: int
    loop_closures: int
    parallel_edges: int
    self_edges: int
    path_length: float | None
    bounding_box: list[tuple[float, float]] | None
    chi2: float | None


@dataclass(frozen=True)
class WorstEdge:
    """An edge and its share of chi2."""

    tag: str
    ids: tuple[int, ...]
    line: int
    chi2: float
    residual: tuple[float, ...]


def describe(graph: FactorGraph) -> GraphDescription:
    """Everything that ``slamcli info`` tells about a graph."""
    topology = analyze(graph)
    known = all(column.known.all() for column in graph.variables.values())
    chi2 = [float(part.sum()) for part in graph.edge_chi2()] if known else [None] * len(graph.factors)
    sizes = np.sort(np.bincount(topology.components))[::-1]
    degrees = topology.degrees
    return GraphDescription(
        variables=[
            VariableSummary(
                kind=name,
                count=len(column),
                lowest_id=int(column.ids.min()),
                highest_id=int(column.ids.max()),
                consecutive_ids=int(column.ids.max()) - int(column.ids.min()) == len(column) - 1,
                without_estimate=int(np.count_nonzero(~column.known)),
                fixed=int(np.count_nonzero(column.fixed)),
            )
            for name, column in graph.variables.items()
        ],
        factors=[
            _factor_summary(factors.tag or factors.kind.name, factors.kind.name, factors.information, loops.sum(), cost)
            for factors, loops, cost in zip(graph.factors, topology.loop_closures, chi2, strict=True)
        ],
        dimension=sum(len(column) * column.kind.dimension for column in graph.variables.values()),
        residuals=sum(len(factors) * factors.kind.dimension for factors in graph.factors),
        component_sizes=sizes.tolist(),
        isolated=int(np.count_nonzero(degrees == 0)),
        degree_min=int(degrees.min()) if len(degrees) else 0,
        degree_mean=float(degrees.mean()) if len(degrees) else 0.0,
        degree_max=int(degrees.max(initial=0)),
        loop_closures=topology.loop_closure_count,
        parallel_edges=topology.parallel_edges,
        self_edges=topology.self_edges,
        path_length=_path_length(graph) if known else None,
        bounding_box=_bounding_box(graph) if known and graph.poses + graph.landmarks else None,
        chi2=graph.chi2() if known else None,
    )


def worst_edges(graph: FactorGraph, count: int) -> list[WorstEdge]:
    """The edges with the largest chi2 at the graph's values, worst first."""
    costs = graph.edge_chi2()
    if count <= 0 or not costs:
        return []
    flat = np.concatenate(costs)
    starts = np.concatenate([[0], np.cumsum([len(cost) for cost in costs])])
    out = []
    for position in np.argsort(-flat, kind="stable")[:count].tolist():
        column = int(np.searchsorted(starts, position, side="right")) - 1
        factors, row = graph.factors[column], position - int(starts[column])
        out.append(
            WorstEdge(
                tag=factors.tag or factors.kind.name,
                ids=tuple(factors.variable_ids(graph.variables)[row].tolist()),
                line=int(factors.lines[row]) if len(factors.lines) else 0,
                chi2=float(flat[position]),
                residual=tuple(factors.residual(graph.values)[row].tolist()),
            )
        )
    return out


def _factor_summary(tag: str, kind: str, information: Array, loops: int, chi2: float | None) -> FactorSummary:
    low, high = eigenvalue_range(information)
    return FactorSummary(
        tag=tag,
        kind=kind,
        count=len(information),
        loop_closures=int(loops),
        chi2=chi2,
        smallest_eigenvalue=float(low.min()),
        largest_eigenvalue=float(high.max()),
        indefinite=int(np.count_nonzero(indefinite(information))),
    )


def _path_length(graph: FactorGraph) -> float:
    total = 0.0
    for column in graph.variables.values():
        if column.kind.is_pose:
            positions = column.values[np.argsort(column.rank), : column.kind.space]
            total += float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())
    return total


def _bounding_box(graph: FactorGraph) -> list[tuple[float, float]]:
    box = []
    for axis in range(graph.space):
        parts = [column.values[:, axis] for column in graph.variables.values() if column.kind.space > axis]
        together = np.concatenate(parts)
        box.append((float(together.min()), float(together.max())))
    return box
