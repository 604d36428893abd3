"""Switchable constraints: loop closures with switches of their own, and the way back.

Suenderhauf, Protzel, "Switchable Constraints for Robust Pose Graph SLAM", IROS 2012, with the linear switch function
and the prior gamma = 1. For a given residual with s = e^T Omega e and a prior of information Xi, the best switch is
Xi / (Xi + s), and what is left of the cost is Xi s / (Xi + s): the kernel ``geman-mcclure`` of width Xi. So a graph
with free switches and one with this kernel have the same minima. Dynamic covariance scaling of the same width has
another weight: it takes the best switch times two, but at most one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from slamcli.graph import FactorGraph, Factors, Variables
from slamcli.graph.columns import BoolArray, IdArray
from slamcli.models import (
    RELATIVE_POSE_2D,
    RELATIVE_POSE_3D,
    SWITCH,
    SWITCH_PRIOR,
    SWITCHABLE_RELATIVE_POSE_2D,
    SWITCHABLE_RELATIVE_POSE_3D,
)
from slamcli.models.base import Array
from slamcli.models.switchable import SwitchableRelativePose
from slamcli.solver.robust import kernels
from slamcli.solver.robust.quantile import chi2_quantile

_SWITCHABLE = {
    RELATIVE_POSE_2D: (SWITCHABLE_RELATIVE_POSE_2D, "EDGE_SE2_SWITCHABLE"),
    RELATIVE_POSE_3D: (SWITCHABLE_RELATIVE_POSE_3D, "EDGE_SE3_SWITCHABLE"),
}


def with_switches(graph: FactorGraph, closures: Sequence[BoolArray], information: float | None = None) -> FactorGraph:
    """A graph in which some relative poses are switchable, each with a switch of its own, at 1, and a prior on it.

    Parameters
    ----------
    graph
        The graph; it is not changed. Its own switches stay.
    closures
        Which factors, one mask for each column. None but relative poses may be marked.
    information
        Xi of the priors: what it costs, in units of chi2, to switch a closure off. None: chi2 at its 99 % quantile
        for a closure; Vertigo has 1, which also switches off true closures with an ordinary chi2.

    Returns
    -------
    FactorGraph
        The columns of the graph without the marked factors (a column of which nothing is left is gone), then the
        switchable ones, then the priors. Written as g2o, it is a file for Vertigo.

    Raises
    ------
    ValueError
        If a factor that is no relative pose is marked.
    """
    columns, switchable, costs, count = [], [], [], 0
    own = graph.variables.get(SWITCH.name)
    first = 0 if own is None else len(own)
    for factors, mask in zip(graph.factors, closures, strict=True):
        if not mask.any():
            columns.append(factors)
            continue
        if factors.kind not in _SWITCHABLE:
            raise ValueError(f"{factors.kind.name} factors cannot be switched")
        if not mask.all():
            columns.append(factors.part(np.flatnonzero(~mask)))
        part = factors.part(np.flatnonzero(mask))
        kind, tag = _SWITCHABLE[factors.kind]
        switches = first + count + np.arange(len(part))
        indices = np.column_stack([part.indices, switches])
        none = np.zeros(len(part), dtype=np.intp)
        switchable.append(replace(part, kind=kind, tag=tag, indices=indices, lines=none))
        cost = chi2_quantile(kind.dimension, kernels.PROBABILITY) if information is None else information
        costs.append(np.full((len(part), 1, 1), cost))
        count += len(part)
    if count == 0:
        return graph
    new = Variables.made(SWITCH, _unused_ids(graph, count), np.ones((count, 1)))
    prior = Factors(
        kind=SWITCH_PRIOR,
        indices=first + np.arange(count)[:, None],
        measurements=np.ones((count, 1)),
        information=np.concatenate(costs),
        tag="EDGE_SWITCH_PRIOR",
        lines=np.zeros(count, dtype=np.intp),
    )
    variables = {**graph.variables, SWITCH.name: new if own is None else own.followed_by(new)}
    return replace(graph, variables=variables, factors=[*columns, *switchable, prior])


def weights(graph: FactorGraph) -> list[Array]:
    """The weight s^2 of every factor at the graph's values, one array for each column: 1 where there is no switch."""
    return [_switches(graph, factors) ** 2 for factors in graph.factors]


def source_weights(graph: FactorGraph, closures: Sequence[BoolArray]) -> list[Array]:
    """Weights of the factors of the graph that ``with_switches`` was given, one array for each of its columns.

    Parameters
    ----------
    graph
        What ``with_switches`` made, at any values.
    closures
        As they were given to it.
    """
    made = [f for f in graph.factors if isinstance(f.kind, SwitchableRelativePose)]
    made = made[len(made) - sum(bool(mask.any()) for mask in closures) :]  # before them are the source's own
    found = iter(made)
    out = []
    for mask in closures:
        weight = np.ones(len(mask))
        if mask.any():
            weight[mask] = _switches(graph, next(found)) ** 2
        out.append(weight)
    return out


def without_switches(graph: FactorGraph, source: FactorGraph) -> FactorGraph:
    """The estimate of a graph that ``with_switches`` made, on its source: same factors, the poses as estimated."""
    return source.with_values({name: graph.values[name][: len(column)] for name, column in source.variables.items()})


def at_their_switches(graph: FactorGraph) -> FactorGraph:
    """A graph without switches: switchable relative poses are ordinary ones, their information times s^2.

    Initialization takes this graph. The graph itself where it has no switch.
    """
    if SWITCH.name not in graph.variables:
        return graph
    factors = [
        replace(f, kind=f.kind.relative, indices=f.indices[:, :2], information=_weighted(graph, f))
        if isinstance(f.kind, SwitchableRelativePose)
        else f
        for f in graph.factors
        if f.kind is not SWITCH_PRIOR
    ]
    variables = {name: column for name, column in graph.variables.items() if name != SWITCH.name}
    return replace(graph, variables=variables, factors=factors)


def _switches(graph: FactorGraph, factors: Factors) -> Array:
    """The switch (m,) of each factor, 1 where it has none."""
    if not isinstance(factors.kind, SwitchableRelativePose):
        return np.ones(len(factors))
    return graph.variables[SWITCH.name].values[factors.indices[:, 2], 0]


def _weighted(graph: FactorGraph, factors: Factors) -> Array:
    return _switches(graph, factors)[:, None, None] ** 2 * factors.information


def _unused_ids(graph: FactorGraph, count: int) -> IdArray:
    """Ids for new variables: above all others, or, where 64 bits end before that, the lowest free ones."""
    taken = np.concatenate([column.ids for column in graph.variables.values()])
    highest = int(taken.max())
    if highest + count <= np.iinfo(taken.dtype).max:
        return np.arange(highest + 1, highest + 1 + count, dtype=taken.dtype)
    free = np.setdiff1d(np.arange(len(taken) + count, dtype=taken.dtype), taken)
    return free[:count]
