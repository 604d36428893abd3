"""What one loop closure does to every pose: measured with and without the readings of its step, in filter and smoother.

A closure is a step at which landmarks are seen again after a long absence. Where a whole lap does so step after step,
its first step is the closure: the later ones correct what is left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from slamcli.batch.smoother import smooth
from slamcli.errors import UsageError
from slamcli.filtering.controls import displacements
from slamcli.filtering.options import EkfOptions
from slamcli.filtering.result import EkfResult
from slamcli.filtering.run import run
from slamcli.geometry import se2
from slamcli.graph.columns import BoolArray, IdArray, IndexArray
from slamcli.graph.sensor_log import Observations, SensorLog
from slamcli.models.base import Array

CHOICES = ("last", "largest")
#: A landmark was absent for long if it was not seen for this part of the steps.
ABSENCE = 0.1
#: A closure begins where no landmark came back from a long absence in this part of the steps before (at least so many).
CALM, LEAST_CALM = 0.02, 10
#: Poses that move by more than this part of the largest correction count as moved.
MOVED = 0.1


@dataclass(frozen=True, eq=False)
class Correction:
    """Metres by which poses move.

    Attributes
    ----------
    metres
        (s,) for each pose up to the closing one.
    """

    metres: Array

    @property
    def largest(self) -> float:
        """Of all poses."""
        return float(self.metres.max())

    @property
    def mean(self) -> float:
        """Over all poses."""
        return float(self.metres.mean())

    @property
    def earlier(self) -> float:
        """Largest of the poses before the closing one."""
        return float(self.metres[:-1].max(initial=0.0))

    @property
    def moved(self) -> float:
        """Share of the poses that move by more than ``MOVED`` of the largest correction."""
        return float(np.mean(self.metres > MOVED * self.largest)) if self.largest > 0.0 else 0.0


@dataclass(frozen=True, eq=False)
class Closing:
    """One loop closure.

    Attributes
    ----------
    step
        Its step.
    ids
        (step + 1,) ids of the poses up to it.
    absence
        Steps for which the landmark had not been seen that was away longest.
    readings
        Readings of the step that were used.
    filter, smoother
        What they do to each pose.
    """

    step: int
    ids: IdArray
    absence: int
    readings: int
    filter: Correction
    smoother: Correction


@dataclass(frozen=True, eq=False)
class Returns:
    """Steps at which a landmark is seen again after a long absence.

    Attributes
    ----------
    steps, absences
        (r,) steps, ascending, and the longest absence that ends there, in steps.
    onsets
        (r,) whether a closure begins there.
    """

    steps: IndexArray
    absences: IndexArray
    onsets: BoolArray


def returns(log: SensorLog, assignments: list[IdArray]) -> Returns:
    """Where landmarks come back after at least ``ABSENCE`` of the steps."""
    steps = np.concatenate([np.empty(0, dtype=np.intp), *(entry.steps for entry in log.observations)])
    tracks = np.concatenate([np.empty(0, dtype=np.int64), *assignments])
    used = tracks >= 0
    steps, tracks = steps[used], tracks[used]
    order = np.lexsort((steps, tracks))
    steps, tracks = steps[order], tracks[order]
    away = np.where(tracks[1:] == tracks[:-1], steps[1:] - steps[:-1], 0)
    long = away >= max(2, math.ceil(ABSENCE * (len(log) - 1)))
    longest = np.zeros(len(log), dtype=np.intp)
    np.maximum.at(longest, steps[1:][long], away[long])
    found = np.flatnonzero(longest)
    # the first one begins a closure, however short the log is
    calm = np.diff(found, prepend=-len(log) - LEAST_CALM) > max(LEAST_CALM, math.ceil(CALM * (len(log) - 1)))
    return Returns(found, longest[found], calm)


def closing_step(log: SensorLog, options: EkfOptions, result: EkfResult, choice: str | int) -> int | None:
    """The step of the closure to look at, None if there is none.

    Parameters
    ----------
    choice
        ``last``: where the last closure begins. ``largest``: of all returns the one at which the filter's position
        jumps farthest. Or the id of a pose.

    Raises
    ------
    UsageError
        If the pose of this id is the first one, or has no reading that was used.
    """
    if isinstance(choice, int):
        return _step_of(log, result, choice)
    found = returns(log, result.assignments)
    if len(found.steps) == 0:
        return None
    if choice == "last":
        return int(found.steps[found.onsets][-1])
    steps = found.steps[found.steps > 0]
    displacement, _ = displacements(log, options)
    expected = se2.compose(result.poses[steps - 1], displacement[steps - 1])
    jump = np.square(result.poses[steps, :2] - expected[:, :2]).sum(axis=1)
    return int(steps[np.argmax(jump)])


def closing(log: SensorLog, options: EkfOptions, result: EkfResult, step: int) -> Closing:
    """The corrections of the readings of a step: filter and smoother up to it, with and without them.

    Raises
    ------
    NumericalError
        As ``filtering.run`` and ``batch.smoother``.
    """
    until = head(log, step, step)
    before = head(log, step, step - 1)
    with_it, without = run(until, options), run(before, options)
    smooth_with = smooth(until, options, with_it)
    smooth_without = smooth(before, options, without)
    found = returns(log, result.assignments)
    there = np.flatnonzero(found.steps == step)
    used = sum(
        int(np.count_nonzero(assigned[entry.steps == step] >= 0))
        for entry, assigned in zip(log.observations, result.assignments, strict=True)
    )
    return Closing(
        step=step,
        ids=log.ids[: step + 1],
        absence=int(found.absences[there[0]]) if len(there) else 0,
        readings=used,
        filter=_moved(without.poses, with_it.poses),
        smoother=_moved(smooth_without.poses, smooth_with.poses),
    )


def head(log: SensorLog, step: int, last: int) -> SensorLog:
    """The log up to a step, with the readings up to the step ``last``."""
    return replace(
        log,
        times=log.times[: step + 1],
        ids=log.ids[: step + 1],
        controls=log.controls[:step],
        information=None if log.information is None else log.information[:step],
        observations=[_readings_until(entry, last) for entry in log.observations],
    )


def _readings_until(entry: Observations, last: int) -> Observations:
    count = int(np.searchsorted(entry.steps, last, side="right"))
    return Observations(
        kind=entry.kind,
        steps=entry.steps[:count],
        landmarks=entry.landmarks[:count],
        measurements=entry.measurements[:count],
        information=None if entry.information is None else entry.information[:count],
    )


def _moved(before: Array, after: Array) -> Correction:
    return Correction(np.sqrt(np.square(after[:, :2] - before[:, :2]).sum(axis=1)))


def _step_of(log: SensorLog, result: EkfResult, wanted: int) -> int:
    found = np.flatnonzero(log.ids == wanted)
    if len(found) == 0:
        raise UsageError(f"no pose has the id {wanted}", (f"  ids: {log.ids.min()} to {log.ids.max()}",))
    step = int(found[0])
    if step == 0:
        raise UsageError(f"pose {wanted} is the first one: it closes no loop")
    for entry, assigned in zip(log.observations, result.assignments, strict=True):
        if (assigned[entry.steps == step] >= 0).any():
            return step
    raise UsageError(f"the filter used no reading at pose {wanted}: it closes no loop")
