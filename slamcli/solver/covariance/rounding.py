"""Whether it is rounding alone that keeps H regular.

The last pivot of a singular H is zero but for rounding, and where rounding makes it positive the factor claims huge
variances in the place of infinite ones. A column x of H^-1 has the energy x^T H x = x_j. Taken from the Jacobians, as
sum |J x|^2, it is next to zero for a direction that no edge sees, and x_j where a variance is large but real.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamcli.graph import FactorGraph
from slamcli.models.base import Array
from slamcli.solver.backends import NotPositiveDefiniteError
from slamcli.solver.gauge import Held
from slamcli.solver.linear_system import LinearSystem
from slamcli.solver.problem import Problem

#: Variance beside that with all other variables held, H_ii^-1, from which on the energy is looked at ...
_SUSPICIOUS = 1e10
#: ... and the relative error of the energy that says that there is no such inverse.
_ENERGY = 0.1


def regular_by_rounding(graph: FactorGraph, held: Held, problem: Problem, system: LinearSystem, inverse: Array) -> bool:
    """Whether the inverse of H is a product of rounding.

    Parameters
    ----------
    graph, held, problem, system
        H is that of the problem, linearized at the system's values.
    inverse
        (pattern.stored,) entries of H^-1 on the pattern of H.
    """
    inflation = problem.diagonal(system) * inverse[problem.pattern.diagonal]
    if inflation.max(initial=1.0) < _SUSPICIOUS:
        return False
    scalar = int(inflation.argmax())
    unit = np.zeros_like(system.gradient)
    unit[scalar] = -1.0
    try:
        column = problem.solve(replace(system, gradient=unit))
    except NotPositiveDefiniteError:  # another order of the operations, and it does not pass any more
        return True
    error = abs(_energy(graph, held, system, column) - column[scalar])
    return not error <= _ENERGY * column[scalar]


def _energy(graph: FactorGraph, held: Held, system: LinearSystem, step: Array) -> float:
    """Sum over all factors of |J x|^2, weighted with their information, for a step x of the free variables."""
    steps = {name: np.zeros((len(column), column.kind.dimension)) for name, column in graph.variables.items()}
    start = 0
    for name, mask in held.items():
        width = steps[name].shape[1]
        stop = start + int(np.count_nonzero(~mask)) * width
        steps[name][~mask] = step[start:stop].reshape(-1, width)
        start = stop
    energy = 0.0
    for factors in graph.factors:
        jacobians = factors.linearize(system.values)[1]
        moved = np.zeros(jacobians[0].shape[:2])
        for slot, (kind, jacobian) in enumerate(zip(factors.kind.variables, jacobians, strict=True)):
            moved += np.matvec(jacobian, steps[kind.name][factors.indices[:, slot]])
        energy += float(np.vecdot(moved, np.matvec(factors.information, moved)).sum())
    return energy
