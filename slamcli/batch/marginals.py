"""Marginal covariances of chosen variables at a solution: blocks of H^-1, by solving for their columns."""

from __future__ import annotations

import numpy as np

from slamcli.graph import FactorGraph
from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array
from slamcli.solver import backends, gauge, ordering
from slamcli.solver.linear_system import Linearizer
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.stopwatch import Stopwatch


def marginals(graph: FactorGraph, wanted: dict[str, IndexArray], options: OptimizeOptions) -> dict[str, Array]:
    """Marginal covariances of variables at the graph's values.

    Parameters
    ----------
    graph
        At its optimum.
    wanted
        Rows of variables by the name of their kind. Each dimension costs one solution with the factor.
    options
        Ordering and linear solver.

    Returns
    -------
    dict
        (k, d, d) for each kind, in the frame of ``VariableKind.retract``; zero for variables that are held.

    Raises
    ------
    slamcli.solver.backends.NotPositiveDefiniteError
        If H is singular.
    """
    _, held = gauge.choose(graph)
    linearizer = Linearizer(graph, held, Stopwatch())
    system = linearizer.linearize(graph.values)
    pattern = linearizer.pattern
    permutation = ordering.expand(pattern, ordering.order(options.ordering, pattern))
    factorization = backends.make(options.linear_solver, pattern, permutation)
    factorization.factorize(system.hessian)
    out, before = {}, 0
    for name, column in graph.variables.items():
        free, size = linearizer.free[name], column.kind.dimension
        place = np.full(len(column), -1, dtype=np.intp)
        place[free] = before + size * np.arange(len(free))
        before += size * len(free)
        if name not in wanted:
            continue
        starts = place[wanted[name]]
        blocks = np.zeros((len(starts), size, size))
        for k in np.flatnonzero(starts >= 0).tolist():
            rows = slice(starts[k], starts[k] + size)
            for j in range(size):
                unit = np.zeros(pattern.dimension)
                unit[starts[k] + j] = 1.0
                blocks[k, :, j] = factorization.solve(unit)[rows]
        out[name] = 0.5 * (blocks + blocks.transpose(0, 2, 1))
    return out
