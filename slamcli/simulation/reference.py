"""Where the variables of a graph really are, as far as that is known: what decides whether a false edge is false."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.errors import InputError, SlamcliError
from slamcli.graph import FactorGraph
from slamcli.graph.columns import BoolArray, Values
from slamcli.solver.optimize import optimize
from slamcli.solver.result import Status

#: Up to this chi2 per degree of freedom, values fit the edges of their graph.
SENSIBLE = 10.0


@dataclass(frozen=True, eq=False)
class Reference:
    """Values to hold claims against.

    Attributes
    ----------
    values
        Of all variables, by kind.
    known
        Which of them are known, by kind.
    source
        Where they come from, in words.
    doubtful
        Whether they contradict the graph's own edges, so that a false edge might be true.
    """

    values: Values
    known: dict[str, BoolArray]
    source: str
    doubtful: bool = False


def from_truth(graph: FactorGraph, truth: FactorGraph, path: str = "the truth") -> Reference:
    """The truth's values of a graph's variables, matched by id.

    Raises
    ------
    InputError
        If the truth has none of the graph's poses.
    """
    values, known = {}, {}
    for name, column in graph.variables.items():
        theirs = truth.variables.get(name)
        rows = np.full(len(column), -1) if theirs is None else theirs.rows_of(column.ids.astype(theirs.ids.dtype))
        values[name], known[name] = column.values.copy(), rows >= 0
        if theirs is not None:
            known[name][rows >= 0] = theirs.known[rows[rows >= 0]]
            values[name][known[name]] = theirs.values[rows[known[name]]]
    found = sum(int(known[name].sum()) for name, column in graph.variables.items() if column.kind.is_pose)
    if not found:
        raise InputError(f"{path}: has none of the poses of the graph", ("  poses are matched by kind and id",))
    return Reference(values, known, path if found == graph.poses else f"{path}, with {found} of {graph.poses} poses")


def from_graph(graph: FactorGraph) -> Reference:
    """A graph's own values where they fit its edges, else the best optimum that can be found of it.

    The optimum is sought by Gauss-Newton from the values and, where that ends badly, by Levenberg-Marquardt from a
    spanning tree.
    """
    complete = all(column.known.all() for column in graph.variables.values())
    dof = max(graph.degrees_of_freedom(), 1)
    candidates = [(graph.chi2() / dof, "values of the graph", graph.values)] if complete else []
    for method, init in (("gn", "file"), ("lm", "spanning-tree")):
        if candidates and min(candidates, key=lambda c: c[0])[0] <= SENSIBLE:
            break
        try:
            result = optimize(graph, method=method, init=init)
        except SlamcliError:
            continue
        if result.status is not Status.FAILED and np.isfinite(result.final_chi2):
            candidates.append((result.final_chi2 / dof, "optimum of the graph", result.graph.values))
    if not candidates:
        known = {name: column.known for name, column in graph.variables.items()}
        return Reference(graph.values, known, "values of the graph", True)
    fit, source, values = min(candidates, key=lambda c: c[0])
    every = {name: np.ones(len(column), dtype=bool) for name, column in graph.variables.items()}
    return Reference(values, every, source, not fit <= SENSIBLE)
