"""Optimizes graphs with landmarks that bearings or ranges see: without the under-observed ones, trying both sides.

Chi2 of ranges has a minimum on either side of the path. With the poses at the end of a run each landmark is placed
once more by all its sightings; where that clearly lowers chi2, the run goes on from there (``--init auto``). Where both
sides fit the data alike, that is said.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from slamcli import models
from slamcli.graph import FactorGraph
from slamcli.graph.columns import Values
from slamcli.solver import bundle, diagnosis, gauge, landmark_sides, under_observed
from slamcli.solver.initialization import camera_points, initialize
from slamcli.solver.initialization.initialize import FROM_FILE
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.result import Result, Status
from slamcli.solver.under_observed import HeldBack, Landmarks

#: Runs with more or fewer landmarks held back, and from other sides, at most.
_ROUNDS, _FLIPS = 3, 10
#: A result is lower if its chi2 is by this share.
_LOWER = 1e-6

Once = Callable[[FactorGraph, OptimizeOptions], Result]


def run(graph: FactorGraph, options: OptimizeOptions, once: Once) -> Result:
    """Optimize a graph by ``once``, without what is under-observed.

    Parameters
    ----------
    graph
        The graph.
    options
        Of the optimization.
    once
        Optimizes a graph in which every landmark is determined.
    """
    if not graph.factors:
        return once(graph, options)  # which says so
    fixed = bundle.with_intrinsics(graph, options.intrinsics).with_fixed(options.fix)
    if (result := _without_unplaced(fixed, options, once)) is not None:
        return result
    wanted = under_observed.suspects(fixed)
    if not wanted:
        return once(graph, options)
    adapted = replace(bundle.adapted(options, fixed), fix=())
    result = _without(fixed, wanted, adapted, once) or once(graph, options)
    init = adapted.init if bundle.has_projections(fixed) else options.init
    return replace(result, options=replace(result.options, init=init, fix=options.fix))


def _without_unplaced(fixed: FactorGraph, options: OptimizeOptions, once: Once) -> Result | None:
    """The result without points that their images do not determine; None if there are none, or no edge would be left.

    Methods that need a regular H have no use for points that one image shows, even with a value.
    """
    if not bundle.has_projections(fixed):
        return None
    lost = camera_points.undetermined(fixed, also_known=options.method in ("gn", "dogleg"))
    if not lost.any():
        return None
    masks = {models.XYZ.name: lost}
    result = _reduced(fixed, masks, replace(options, fix=()), once)
    if result is None:
        return None
    options = replace(result.options, fix=options.fix)
    return replace(result, options=options, under_observed=under_observed.described(fixed, masks))


def _without(graph: FactorGraph, wanted: Landmarks, options: OptimizeOptions, once: Once) -> Result | None:
    """The result without those of some landmarks that are under-observed; None if no edge would be left."""
    lost = under_observed.among(graph, wanted, _poses(graph, options))
    result = _reduced(graph, lost, options, once)
    if result is None:
        return None
    if result.status is Status.FAILED and options.method == "auto":
        result = _by_dogleg(graph, lost, options, once) or result
    for _ in range(_ROUNDS):
        now = under_observed.among(graph, wanted, result.graph.values)
        failed = result.status is Status.FAILED
        changed = _union(lost, now) if failed else _intersection(lost, now)
        if _same(changed, lost) or result.status is Status.INTERRUPTED:
            break
        if failed:  # what has run away is left out
            again = _reduced(graph, changed, options, once)
        else:  # what the poses of the end determine is taken in
            again = _taken_in(result, lost, changed, options, once)
        if again is None:
            break
        lost, result = changed, again
    return replace(result, under_observed=under_observed.described(graph, lost))


def _by_dogleg(graph: FactorGraph, lost: Landmarks, options: OptimizeOptions, once: Once) -> Result | None:
    """The result of bounded steps, where a step of Gauss-Newton sent a landmark too far away to come back."""
    result = _reduced(graph, lost, replace(options, method="dogleg"), once)
    if result is None or result.status is Status.FAILED:
        return None
    words = f"{result.start}, by dogleg since longer steps failed"
    return replace(result, options=replace(result.options, method=options.method), start=words)


def _taken_in(
    result: Result, before: Landmarks, lost: Landmarks, options: OptimizeOptions, once: Once
) -> Result | None:
    """The result with landmarks that the poses of the end determine; None if that goes wrong."""
    columns, count = dict(result.graph.variables), 0
    for name, mask in before.items():
        new = mask & ~lost[name] if name in lost else mask
        places = under_observed.places(result.graph, name, new)
        column = columns[name]
        values = np.where(new[:, None], places, column.values)
        columns[name] = replace(column, values=values, known=column.known | new)
        count += int(np.count_nonzero(new))
    graph = replace(result.graph, variables=columns)
    again = _reduced(graph, lost, replace(options, init="file"), once)
    if again is None or again.status is Status.FAILED:
        return None
    return _continued(result, again, f"then with {count} more landmarks", stage=f"without {count} landmarks")


def _continued(first: Result, then: Result, words: str, stage: str | None = None) -> Result:
    """A run that begins where another one ended, as one; ``stage`` is the name of the first."""
    done = [replace(record, stage=record.stage or stage) for record in first.trace]
    trace = [replace(record, iteration=record.iteration + first.iterations) for record in then.trace]
    time = {phase: first.time.get(phase, 0.0) + then.time.get(phase, 0.0) for phase in {**first.time, **then.time}}
    return replace(
        then,
        start=f"{first.start}, {words}",
        starts=first.starts,
        doubt=first.doubt,
        initial_chi2=first.initial_chi2,
        trace=done + trace,
        time=time,
    )


def _poses(graph: FactorGraph, options: OptimizeOptions) -> Values:
    """The state at whose poses it is decided which landmarks are determined."""
    method = options.init
    if method == "auto":  # the file's poses may be anything
        method = "odometry" if options.robust != "none" else "chordal"
    if graph.poses == 0 or (
        method == "file" and all(c.known.all() for c in graph.variables.values() if c.kind.is_pose)
    ):
        return graph.values
    return initialize(graph, method, gauge.choose(graph)[1], complete=False)[0]


def _reduced(graph: FactorGraph, lost: Landmarks, options: OptimizeOptions, once: Once) -> Result | None:
    """The result without some landmarks; None if no edge would be left, or one is no edge: that of all says which."""
    if not lost:
        return _lowest(graph, options, once)
    held_back = HeldBack.of(graph, lost)
    part = held_back.reduced()
    if not part.factors or diagnosis.indefinite_information(graph) is not None:
        return None
    result = _lowest(part, options, once)
    restored = held_back.restored(result.graph)
    rejection = None if result.rejection is None else held_back.expanded(result.rejection)
    return replace(result, graph=restored, reduced=result.graph, held_back=held_back, rejection=rejection)


def _lowest(graph: FactorGraph, options: OptimizeOptions, once: Once) -> Result:
    """The result; of ``--init auto`` the lowest that other sides of landmarks lead to."""
    result = once(graph, options)
    if result.status in (Status.FAILED, Status.INTERRUPTED):
        return result
    if options.init != "auto" or options.max_iterations == 0:
        return replace(result, ambiguous=landmark_sides.of(result)[2])
    from_file = result.start.startswith(FROM_FILE)
    given = {name: column.known for name, column in graph.variables.items()} if from_file else None
    return _other_sides(result, given, options, once)


def _is_lower(other: Result, result: Result) -> bool:
    return other.final_chi2 < result.final_chi2 * (1.0 - _LOWER)


def _other_sides(result: Result, given: Landmarks | None, options: OptimizeOptions, once: Once) -> Result:
    """The result of going on from landmarks at other places, as long as that lowers chi2; ambiguous ones are named."""
    for number in range(_FLIPS + 1):
        values, moved, ambiguous = landmark_sides.of(result, given)
        if moved == 0 or number == _FLIPS:
            break
        other = once(result.graph.with_values(values), replace(options, init="file"))
        if other.status in (Status.FAILED, Status.INTERRUPTED) or not _is_lower(other, result):
            break
        result = _continued(result, other, f"then {moved} landmarks elsewhere")
    return replace(result, ambiguous=ambiguous)


def _union(first: Landmarks, second: Landmarks) -> Landmarks:
    both = {name: first[name] | second[name] for name in first if name in second}
    return {**first, **second, **both}


def _intersection(first: Landmarks, second: Landmarks) -> Landmarks:
    both = {name: first[name] & second[name] for name in first if name in second}
    return {name: mask for name, mask in both.items() if mask.any()}


def _same(first: Landmarks, second: Landmarks) -> bool:
    return first.keys() == second.keys() and all(np.array_equal(first[name], second[name]) for name in first)
