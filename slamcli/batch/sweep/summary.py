"""Means and medians over the seeds, with confidence intervals.

The interval of a mean is Student's: mean ± t s / sqrt(n), with t of n - 1 degrees of freedom. It is exact for normal
figures and good for the mean of many others. That of a median takes no distribution for granted: from the k-th smallest
to the k-th largest value, with the largest k for which the probability 1 - 2 P(B < k), B binomial (n, 1/2), is at least
the confidence asked for (Conover, Practical Nonparametric Statistics, section 3.2).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from slamcli.batch.sweep.journal import Record
from slamcli.batch.sweep.plan import SummaryOptions, Task
from slamcli.batch.sweep.run import State


@dataclass(frozen=True)
class Interval:
    """An estimate with its confidence interval, which is None where there are too few values for one."""

    value: float
    low: float | None
    high: float | None


@dataclass(frozen=True)
class Statistics:
    """Of a metric in a group.

    Attributes
    ----------
    count
        Tasks that have a value.
    mean, median
        Of these.
    deviation
        Standard deviation of the values, None below two.
    """

    count: int
    mean: Interval
    median: Interval
    deviation: float | None


@dataclass(frozen=True)
class Group:
    """The tasks that have the same levels.

    Attributes
    ----------
    labels
        By axis.
    tasks
        That have ended.
    codes
        Number of them by exit code.
    statistics
        By metric; None where no task has a value.
    """

    labels: dict[str, Any]
    tasks: int
    codes: dict[int, int]
    statistics: dict[str, Statistics | None]

    @property
    def failed(self) -> int:
        """Number of tasks whose exit code is not 0."""
        return sum(count for code, count in self.codes.items() if code != 0)


def summarize(state: State, options: SummaryOptions, metrics: Sequence[str]) -> list[Group]:
    """The groups; the levels of the last axis of ``by`` follow each other."""
    return [
        _group(labels, [record for _, record in members], options, metrics)
        for labels, members in grouped(state, options.by)
    ]


def grouped(state: State, by: Sequence[str]) -> list[tuple[dict[str, Any], list[tuple[Task, Record]]]]:
    """The tasks that have ended, by their levels on some axes."""
    groups: dict[tuple[Any, ...], list[tuple[Task, Record]]] = {}
    for task, record in state.ended:
        groups.setdefault(tuple(task.labels[name] for name in by), []).append((task, record))
    # levels in the order of the file, in which they come up in the tasks
    orders: list[dict[Any, int]] = [{} for _ in by]
    for task in state.tasks:
        for order, name in zip(orders, by, strict=True):
            order.setdefault(task.labels[name], len(order))
    keys = sorted(groups, key=lambda key: [order[label] for order, label in zip(orders, key, strict=True)])
    return [(dict(zip(by, key, strict=True)), groups[key]) for key in keys]


def statistics(values: Sequence[float], confidence: float) -> Statistics | None:
    """Of numbers; None of none."""
    if not values:
        return None
    numbers = np.sort(np.array(values, dtype=np.float64))
    return Statistics(
        count=len(numbers),
        mean=mean_interval(numbers, confidence),
        median=median_interval(numbers, confidence),
        deviation=float(numbers.std(ddof=1)) if len(numbers) > 1 else None,
    )


def mean_interval(numbers: np.ndarray[Any, np.dtype[np.float64]], confidence: float) -> Interval:
    """Student's interval of the mean of (n,) numbers."""
    mean, n = float(numbers.mean()), len(numbers)
    if n < 2:
        return Interval(mean, None, None)
    from scipy.special import stdtrit

    half = float(stdtrit(n - 1, 0.5 + confidence / 2.0)) * float(numbers.std(ddof=1)) / math.sqrt(n)
    return Interval(mean, mean - half, mean + half)


def median_interval(numbers: np.ndarray[Any, np.dtype[np.float64]], confidence: float) -> Interval:
    """The interval between order statistics of (n,) ascending numbers."""
    from scipy.special import bdtr

    n = len(numbers)
    median = float(np.median(numbers))
    below = bdtr(np.arange(n // 2), n, 0.5)  # P(B < k) for k from 1
    k = int(np.count_nonzero(1.0 - 2.0 * below >= confidence))
    return Interval(median, float(numbers[k - 1]), float(numbers[n - k])) if k else Interval(median, None, None)


def _group(labels: dict[str, Any], records: list[Record], options: SummaryOptions, metrics: Sequence[str]) -> Group:
    codes = [record.exit_code for record in records]
    values = {name: [v for record in records if (v := record.figures.get(name)) is not None] for name in metrics}
    return Group(
        labels=labels,
        tasks=len(records),
        codes={code: codes.count(code) for code in sorted(set(codes))},
        statistics={name: statistics(values[name], options.confidence) for name in metrics},
    )
