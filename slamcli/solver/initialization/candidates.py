"""Choice among several starts, by chi2 after one step from each.

A start is worth what the optimization makes of it, so what counts is chi2 after one full Gauss-Newton step: a start
that is bent but close falls at once, and one from another basin does not. Where H is singular or the step's chi2 is not
finite, chi2 at the start itself counts. One step tells a useless start from a good one; between two good starts from
which the step raises chi2 it says little about where each of them ends.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from slamcli.graph.columns import Values
from slamcli.solver.backends import NotPositiveDefiniteError
from slamcli.solver.problem import Problem

#: A start is kept without a look at the others where chi2 per degree of freedom after its step is at most this. One
#: would not do: torus3D has a local minimum with 0.82, at 19972 instead of 14575.
PLAUSIBLE = 0.25
#: Costs that differ by less than this share of them are equal: steps from two good starts end at one minimum.
_TIE = 1e-6


@dataclass(frozen=True, eq=False)
class Candidate:
    """A start.

    Attributes
    ----------
    name
        Short, for the list of candidates.
    values
        Of all variables.
    words
        Where they come from, as the summary says it.
    """

    name: str
    values: Values
    words: str


def choose(makers: Iterable[Callable[[], Candidate]], problem: Problem, dof: int) -> tuple[Candidate, str]:
    """The candidate with the least cost, and in words the choice and all costs.

    Parameters
    ----------
    makers
        Make the candidates, at least one; called in turn until a candidate is plausible. Among equals the first counts.
    problem
        The graph, to take the steps.
    dof
        Degrees of freedom of chi2.
    """
    seen: list[tuple[float, str, Candidate]] = []
    for make in makers:
        candidate = make()
        seen.append((*_cost(problem, candidate.values), candidate))
        if seen[-1][0] <= PLAUSIBLE * max(dof, 1):
            break
    least = min((cost for cost, _, _ in seen if math.isfinite(cost)), default=math.inf)
    best, when, chosen = next((row for row in seen if row[0] <= least * (1.0 + _TIE)), seen[0])
    others = "".join(
        f"; {c.name} {cost:.4g}" + (f" {at}" if at != when else "") for cost, at, c in seen if c is not chosen
    )
    return chosen, f"auto: {chosen.words} (chi2 {best:.4g} {when}{others})"


def _cost(problem: Problem, values: Values) -> tuple[float, str]:
    """chi2 after a full Gauss-Newton step, or at the start where there is no such step; and which of them, in words."""
    at_start = "at the start"
    system = problem.linearize(values)
    try:
        with np.errstate(all="ignore"):
            if not system.is_finite:
                return system.chi2, at_start
            after = problem.chi2(problem.retract(values, problem.solve(system)))
    except NotPositiveDefiniteError:
        return system.chi2, at_start
    return (after, "after a step") if math.isfinite(after) else (system.chi2, at_start)
