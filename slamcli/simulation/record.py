"""A simulation as its files have it: the log of the sensors, the true trajectory, where the numbers come from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamcli.formats.log import LogBlock
from slamcli.graph.trajectory import Trajectory, of_graph
from slamcli.models.base import Array
from slamcli.simulation.scenario import Scenario
from slamcli.simulation.simulate import Simulation

#: What the log calls the readings of each kind of factor.
_WORDS = {
    "point_observation_2d": "xy",
    "range_bearing_2d": "range-bearing",
    "bearing_2d": "bearing",
    "range_2d": "range",
    "point_observation_3d": "point",
    "position_prior_2d": "gps",
    "position_prior_3d": "gps",
}


def comment(scenario: Scenario) -> str:
    """Where a file comes from."""
    return f"slamcli simulate: world {scenario.world}, {scenario.poses} poses, seed {scenario.seed}"


def true_trajectory(simulation: Simulation) -> Trajectory:
    """The true path with time stamps."""
    trajectory = of_graph(simulation.truth, "truth")
    return replace(trajectory, stamps=np.arange(len(trajectory), dtype=np.float64) * simulation.scenario.robot.period)


def log_blocks(simulation: Simulation) -> list[LogBlock]:
    """Odometry, the controls behind it, loop closures and readings; clutter has the landmark -1."""
    period = np.float64(simulation.scenario.robot.period)
    odometry, closures = simulation.odometry, simulation.closures
    later = np.arange(1, len(odometry.measurements) + 1)
    blocks = []
    if odometry.control != "relative-pose":
        blocks.append(LogBlock(odometry.control, later * period, later, later - 1, odometry.controls, None))
    blocks.append(LogBlock("odometry", later * period, later, later - 1, odometry.measurements, odometry.information))
    blocks.append(
        LogBlock(
            "closure",
            closures.pairs[:, 1] * period,
            closures.pairs[:, 1],
            closures.pairs[:, 0],
            closures.measurements,
            _repeated(closures.information, len(closures.pairs)),
        )
    )
    first_landmark = simulation.graph.poses
    for reading in simulation.readings:
        others = np.where(reading.false, -1, first_landmark + reading.landmarks) if len(reading.landmarks) else None
        information = _repeated(reading.information, len(reading.poses))
        word = _WORDS[reading.kind.name]
        blocks.append(LogBlock(word, reading.poses * period, reading.poses, others, reading.measurements, information))
    return blocks


def _repeated(matrix: Array, count: int) -> Array:
    return np.asarray(np.broadcast_to(matrix, (count, *matrix.shape)))
