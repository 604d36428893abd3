"""How dead reckoning drifts as one option of a scenario changes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from slamcli.evaluation.drift import gap
from slamcli.graph.trajectory import of_graph
from slamcli.models.base import Array
from slamcli.simulation.scenario import Scenario
from slamcli.simulation.simulate import Simulation, simulate


@dataclass(frozen=True)
class DriftPoint:
    """Dead reckoning of one value of the option, over several seeds.

    Attributes
    ----------
    value
        As it was given.
    runs
        Number of seeds.
    gap_mean, gap_std, gap_max
        Metres by which the last pose is off, seen from the first.
    rotation_mean
        Degrees by which its heading is off, without sign.
    drift_mean
        The gap in percent of the path.
    landmark_rmse
        Metres, of the landmarks hung off the path, over all runs; None without landmarks.
    """

    value: object
    runs: int
    gap_mean: float
    gap_std: float
    gap_max: float
    rotation_mean: float
    drift_mean: float
    landmark_rmse: float | None


def drift_sweep(scenarios: Iterable[tuple[object, list[Scenario]]], tick: Callable[[], None]) -> list[DriftPoint]:
    """Drift of each value's scenarios; ``tick`` is called after each simulation."""
    points = []
    for value, runs in scenarios:
        gaps, landmarks = [], []
        for scenario in runs:
            simulation = simulate(replace(scenario, guess="odometry"))  # the truth would not drift
            gaps.append(gap(of_graph(simulation.graph), of_graph(simulation.truth)))
            landmarks.append(_landmark_errors(simulation))
            tick()
        distance = np.array([g.translation or 0.0 for g in gaps])
        squares = np.concatenate(landmarks)
        points.append(
            DriftPoint(
                value=value,
                runs=len(gaps),
                gap_mean=float(distance.mean()),
                gap_std=float(distance.std(ddof=1)) if len(gaps) > 1 else 0.0,
                gap_max=float(distance.max()),
                rotation_mean=float(np.mean([g.rotation or 0.0 for g in gaps])),
                drift_mean=float(np.mean([g.drift_translation or 0.0 for g in gaps])),
                landmark_rmse=float(np.sqrt(squares.mean())) if len(squares) else None,
            )
        )
    return points


def _landmark_errors(simulation: Simulation) -> Array:
    """Squared errors of the landmarks in metres^2."""
    none = np.empty(0)
    columns = [
        np.square(column.values - simulation.truth.variables[name].values).sum(axis=1)
        for name, column in simulation.graph.variables.items()
        if column.kind.is_point
    ]
    return np.concatenate([none, *columns])
