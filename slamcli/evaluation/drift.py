"""Dead reckoning: what the odometry alone makes of a graph, and how far off its end is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.evaluation.association import Association, associate
from slamcli.evaluation.errors import absolute_errors, path_distance, relative_errors
from slamcli.graph import FactorGraph
from slamcli.graph.trajectory import Trajectory
from slamcli.solver import gauge
from slamcli.solver.initialization import initialize


@dataclass(frozen=True)
class Gap:
    """Where a trajectory ends, and how far that is from where it should.

    Attributes
    ----------
    path_length
        Metres along the truth between its first and last pose that the estimate has, too; along the estimate where
        there is no truth.
    closing_distance, closing_rotation
        Metres and degrees between the first and the last pose of the estimate.
    translation, rotation
        Metres and degrees by which the motion from the first to the last pose differs from the true one; None
        without truth. They do not depend on the alignment.
    drift_translation
        ``translation`` in percent of the path length; None without truth or without motion.
    drift_rotation
        ``rotation`` in degrees per metre of the path, likewise.
    """

    path_length: float
    closing_distance: float
    closing_rotation: float
    translation: float | None = None
    rotation: float | None = None
    drift_translation: float | None = None
    drift_rotation: float | None = None


def dead_reckoning(graph: FactorGraph) -> FactorGraph:
    """The graph at the integrated odometry, the landmarks hung off the drifting path.

    The poses start from what the gauge holds (see ``solver.gauge``) and follow the edges between neighbouring ids;
    other edges are used only where that chain is broken.

    Raises
    ------
    NumericalError
        If a landmark has no value and no edge that places it.
    """
    _, held = gauge.choose(graph)
    values, _ = initialize(graph, "odometry", held)
    return graph.with_values(values)


def gap(estimate: Trajectory, truth: Trajectory | None = None, association: Association | None = None) -> Gap:
    """The gap at the end of a trajectory of at least one pose.

    Parameters
    ----------
    estimate
        The trajectory.
    truth
        The true one, if there is one.
    association
        Which poses belong together; ``associate`` finds out if it is not given.

    Raises
    ------
    InputError
        If no pose of the estimate has a partner in the truth.
    """
    poses = estimate.lifted()
    ends = poses[[0, -1]]
    closing = absolute_errors(ends[1:], ends[:1])
    closing_distance, closing_rotation = float(closing.translation[0]), float(closing.rotation[0])
    if truth is None:
        return Gap(estimate.length, closing_distance, closing_rotation)
    pairs = associate(estimate, truth) if association is None else association
    rows, true_rows = pairs.estimate[[0, -1]], pairs.truth[[0, -1]]
    true_poses = truth.lifted()
    error = relative_errors(poses[rows], true_poses[true_rows], np.array([[0, 1]]))
    translation, rotation = float(error.translation[0]), float(error.rotation[0])
    distance = path_distance(true_poses[:, :3])
    length = abs(float(distance[true_rows[1]] - distance[true_rows[0]]))
    moved = length > 0.0
    return Gap(
        path_length=length,
        closing_distance=closing_distance,
        closing_rotation=closing_rotation,
        translation=translation,
        rotation=rotation,
        drift_translation=100.0 * translation / length if moved else None,
        drift_rotation=rotation / length if moved else None,
    )
