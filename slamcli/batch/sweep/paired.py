"""Differences between the levels of an axis at the same seed.

All methods see the same worlds (common random numbers), so that the worlds' share of the spread falls out of the
difference: its interval is as a rule much narrower than those of the two means.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from slamcli.batch.sweep.plan import SummaryOptions, Task
from slamcli.batch.sweep.run import State
from slamcli.batch.sweep.summary import Statistics, grouped, statistics


@dataclass(frozen=True)
class Difference:
    """A level minus the reference.

    Attributes
    ----------
    labels
        Of the group, by axis; that of the compared axis is the level.
    statistics
        By metric, of the differences; their ``count`` is the number of pairs. None without any.
    """

    labels: dict[str, Any]
    statistics: dict[str, Statistics | None]


def differences(state: State, options: SummaryOptions, metrics: Sequence[str]) -> list[Difference]:
    """The differences by group; none where nothing is to be compared."""
    if options.compare is None:
        return []
    axis, reference = options.compare
    figures = {_place(task): record.figures for task, record in state.ended}
    by = (*(name for name in options.by if name != axis), axis)
    found = []
    for labels, members in grouped(state, by):
        if labels[axis] == reference:
            continue
        values: dict[str, list[float]] = {name: [] for name in metrics}
        for task, record in members:
            other = figures.get(_place(task, axis, reference), {})
            for name in metrics:
                ours, theirs = record.figures.get(name), other.get(name)
                if ours is not None and theirs is not None:
                    values[name].append(ours - theirs)
        found.append(Difference(labels, {name: statistics(values[name], options.confidence) for name in metrics}))
    return found


def _place(task: Task, axis: str | None = None, label: Any = None) -> tuple[Any, ...]:
    """Labels and seed of a task; with another label on an axis."""
    labels = task.labels if axis is None else {**task.labels, axis: label}
    return (*labels.values(), task.seed)
