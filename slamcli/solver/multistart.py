"""``--init auto``: one run from the best start; more runs only where the first leaves a doubt.

Least squares on rotations has local minima, and no cheap test tells which start leads to the lowest. What does tell is
the run itself. Starts are ranked by chi2 before any step. The run from the first is believed unless

* it failed after its first step or did not converge,
* it was erratic: chi2 stayed above its lowest value for more than ``CALM`` steps in a row (it then pauses there),
* its first step gained far less than promised and chi2 per degree of freedom is too large for the stated noise, or
* it began at the file's values and chi2 per degree of freedom says nothing in their favour: then the file may
  hold a local minimum.

In a doubt the other starts are run to their ends, too, and the lowest chi2 counts; a paused run goes on only if no
other came below what it had reached. Under a robust kernel chi2 has no degrees of freedom to be judged by (``dof`` is
None).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

from slamcli.errors import NumericalError
from slamcli.solver.attempt import Attempt
from slamcli.solver.initialization import Start

#: The file's values are taken without a look at others where chi2 per degree of freedom is at most this. One would
#: not do: torus3D has a local minimum with 0.82, at 19972 instead of 14575.
SMALL = 0.25
#: Steps without a new lowest chi2 that a good start takes (M3500b: two).
CALM = 4
#: A first step that gains less than this share of what it promised leaves the region where its model holds.
_POOR_GAIN = 0.25
#: chi2 with n degrees of freedom has the standard deviation sqrt(2 n): what is more above n than this many of them is
#: no accident of the noise.
_DEVIATIONS = 5.0
#: Starts with a chi2 of more than this times the lowest are not run.
_HOPELESS = 10.0
#: Minima that differ by less than this share are the same: the first counts.
_TIE = 1e-6


def ranked(
    starts: Iterator[Callable[[], Start]], chi2: Callable[[Start], float], dof: int | None
) -> list[tuple[float, Start]]:
    """Starts with their chi2, the lowest first; ends with the first that is good enough.

    Raises
    ------
    NumericalError
        If no start can be made.
    """
    found: list[tuple[float, Start]] = []
    failure: NumericalError | None = None
    for make in starts:
        try:
            start = make()
        except NumericalError as error:
            failure = error
            continue
        cost = chi2(start)
        found.append((cost if math.isfinite(cost) else math.inf, start))
        if dof is not None and cost <= SMALL * max(dof, 1):
            break
    if not found and failure is not None:
        raise failure
    return sorted(found, key=lambda pair: pair[0])


def erratic(attempt: Attempt) -> bool:
    """Whether chi2 went up for so long that another start may do better."""
    return longest_rise(attempt) > CALM


def doubt(attempt: Attempt, dof: int | None, *, from_file: bool) -> str | None:
    """Why the run that has ended may have missed the lowest minimum, in words, or None."""
    if attempt.singular:
        return None  # from nowhere else there would be more edges
    if erratic(attempt):
        return f"chi2 stayed above its lowest value for {longest_rise(attempt)} steps"
    if not attempt.converged:
        return "did not converge"
    if dof is None or attempt.chi2 <= SMALL * max(dof, 1):
        return None
    if from_file:
        return f"chi2 per degree of freedom {attempt.chi2 / max(dof, 1):.3g} does not tell whether this is the minimum"
    gain = attempt.trace[0].gain_ratio if attempt.trace else None
    if gain is not None and gain < _POOR_GAIN and attempt.chi2 > dof + _DEVIATIONS * math.sqrt(2.0 * max(dof, 1)):
        return f"chi2 per degree of freedom {attempt.chi2 / max(dof, 1):.3g} is too large for the stated noise"
    return None


def longest_rise(attempt: Attempt) -> int:
    """The largest number of steps in a row that ended above the lowest chi2."""
    lowest, since, longest = attempt.initial, 0, 0
    for record in attempt.trace:
        since = since + 1 if record.chi2 > lowest * (1.0 + _TIE) else 0
        lowest, longest = min(lowest, record.chi2), max(longest, since)
    return longest


def best(attempts: list[Attempt]) -> Attempt:
    """The run with the lowest chi2; the first among equals, and a converged one before others."""
    usable = [a for a in attempts if math.isfinite(a.chi2) and not a.failed] or attempts
    lowest = min(a.lowest for a in usable)
    near = [a for a in usable if a.lowest <= lowest * (1.0 + _TIE)]
    return next((a for a in near if a.converged), near[0])


def worth_a_run(others: list[tuple[float, Start]], lowest: float) -> list[Start]:
    """Of the starts that are left those that are not hopeless."""
    return [start for chi2, start in others if chi2 <= _HOPELESS * lowest]
