"""A graph as the benchmarks need it: its starts, its chi2, and whether a result has reached the optimum."""

from __future__ import annotations

import time
from functools import cached_property
from typing import Any

import numpy as np

import slamcli
from slamcli.graph.columns import IndexArray, Values, Variables
from slamcli.models.base import Array
from slamcli.solver import gauge
from slamcli.solver.initialization import initialize

#: A result reaches an optimum within this share of it, and within what rounding leaves of an optimum of zero.
REACHED, ZERO = 1e-6, 1e-12
#: What the file gives, and the start that is not counted.
_FREE = ("file", "chordal")


def reaches(chi2: float, best: float) -> bool:
    """Whether a chi2 is at the best known one, or below it."""
    return chi2 <= max(best * (1.0 + REACHED), ZERO)


class Case:
    """A graph, its starts, and the lowest chi2 that is known.

    Parameters
    ----------
    path
        File of the graph.
    best
        Lowest known chi2; minus infinity if none is known.

    Attributes
    ----------
    graph
        As it was read.
    load
        Seconds that took.
    held
        Variables that slamcli holds, (n,) by kind.
    """

    def __init__(self, path: str, best: float) -> None:
        started = time.perf_counter()
        self.graph = slamcli.read(path)
        self.load = time.perf_counter() - started
        self.best = best
        _, self.held = gauge.choose(self.graph)
        self._starts: dict[str, tuple[Values, float]] = {}

    @cached_property
    def is_pose_graph(self) -> bool:
        """Whether there are poses of one kind and relative poses between them, and nothing else."""
        kinds = sum(len(column) > 0 for column in self.graph.variables.values())
        return kinds == 1 and all(factors.kind.relative_pose for factors in self.graph.factors)

    @cached_property
    def column(self) -> Variables:
        """The poses of a pose graph.

        Raises
        ------
        ValueError
            If the graph is something else.
        """
        if not self.is_pose_graph:
            raise ValueError("takes graphs of relative poses only")
        return next(column for column in self.graph.variables.values() if len(column))

    @property
    def space(self) -> int:
        """2 or 3."""
        return self.column.kind.space

    @cached_property
    def held_ranks(self) -> list[int]:
        """Which poses of a pose graph are held, in the order of the ids."""
        return sorted(self.column.rank[self.held[self.column.kind.name]].tolist())

    @cached_property
    def pairs(self) -> IndexArray:
        """(m, 2) poses that the edges of a pose graph join, in the order of the ids."""
        return self.column.rank[np.concatenate([factors.indices for factors in self.graph.factors])]

    @cached_property
    def measurements(self) -> Array:
        """(m, size) relative poses of a pose graph."""
        return np.concatenate([factors.measurements for factors in self.graph.factors])

    @cached_property
    def information(self) -> Array:
        """(m, d, d) of a pose graph."""
        return np.concatenate([factors.information for factors in self.graph.factors])

    def initial(self, name: str) -> tuple[Values, float]:
        """Values of a start of slamcli, and the seconds that it took to make them (0 for those that are not counted).

        ``file`` is the odometry where the file lacks values.
        """
        if name not in self._starts:
            complete = all(column.known.all() for column in self.graph.variables.values())
            started = time.perf_counter()
            values, _ = initialize(self.graph, name if complete or name != "file" else "odometry", self.held)
            seconds = time.perf_counter() - started
            self._starts[name] = values, 0.0 if name in _FREE else seconds
        return self._starts[name]

    def start(self, name: str) -> tuple[Array, float]:
        """``initial`` of a pose graph as (n, size) poses in the order of the ids."""
        values, seconds = self.initial(name)
        return self.poses(values), seconds

    def poses(self, values: Values) -> Array:
        """Poses of a pose graph (n, size) in the order of the ids."""
        return values[self.column.kind.name][np.argsort(self.column.rank)]

    def values(self, poses: Array) -> Values:
        """The state of poses in the order of the ids."""
        kind = self.column.kind
        return {**self.graph.values, kind.name: kind.normalize(poses[self.column.rank])}

    def polished(self, values: Values) -> float:
        """chi2 at which slamcli's Gauss-Newton ends from these values."""
        return slamcli.optimize(self.graph.with_values(values), method="gn", init="file").final_chi2

    def reached(self, chi2: float) -> bool:
        """Whether a chi2 is at the best known one, or below it."""
        return reaches(chi2, self.best)


class Trial:
    """One run: the values that it ended with, and what it took.

    Parameters
    ----------
    case
        The graph.
    values
        At the end.
    seconds
        Between the loaded graph and the converged one.
    iterations
        Number of iterations.
    own
        The peer's own cost at the end, if that is another one.
    note
        What is to be said about the time.
    """

    def __init__(
        self, case: Case, values: Values, seconds: float, iterations: int, own: float = np.nan, note: str = ""
    ) -> None:
        self.values, self.seconds, self.iterations, self.own, self.note = values, seconds, iterations, own, note
        self.chi2 = case.graph.chi2(values)

    def document(self, case: Case, note: str = "", **more: Any) -> dict[str, Any]:
        """For JSON."""
        return {
            "solve": self.seconds,
            "iterations": self.iterations,
            "chi2": self.chi2,
            "reached": case.reached(self.chi2),
            "note": "; ".join(words for words in (note, self.note) if words),
            **more,
        }
