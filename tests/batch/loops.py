"""Simulated loops that the tests of batch/ compare on."""

from __future__ import annotations

from typing import Any

from slamcli.evaluation.monte_carlo import simulated_log
from slamcli.graph.sensor_log import SensorLog
from slamcli.simulation.settings import scenario_of

LOOP: dict[str, Any] = {
    "world": "square",
    "poses": 121,
    "closures": {"by": "none"},
    "landmarks": {"count": 25},
    "robot": {"noise": [0.05, 0.05, 0.01]},
    "sensors": [{"kind": "range-bearing", "range": 6.0, "noise": [0.15, 0.02]}],
}


def loop(**changes: Any) -> SensorLog:
    """The log of a drive round a square, with its truth."""
    return simulated_log(scenario_of({**LOOP, **changes}, "test"))
