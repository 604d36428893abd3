"""The sensor log of a planar landmark graph: its odometry and its observations in the order of the poses' ids."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.errors import InputError
from slamcli.geometry import se2
from slamcli.graph.columns import Factors, IdArray, IndexArray, Variables
from slamcli.graph.factor_graph import FactorGraph
from slamcli.graph.sensor_log import Observations, SensorLog
from slamcli.models import (
    BEARING_2D,
    POINT_OBSERVATION_2D,
    RANGE_2D,
    RANGE_BEARING_2D,
    RELATIVE_POSE_2D,
    SE2,
    XY,
    FactorKind,
)
from slamcli.models.base import Array

#: The kinds of factor that are readings of a landmark.
OBSERVATION_KINDS: tuple[FactorKind, ...] = (RANGE_BEARING_2D, BEARING_2D, RANGE_2D, POINT_OBSERVATION_2D)


@dataclass(frozen=True, eq=False)
class _Odometry:
    """Displacements (n - 1, 3), their information (n - 1, 3, 3), and how many edges are not part of them."""

    displacements: Array
    information: Array
    backward: int
    repeated: int
    closures: int


def graph_log(graph: FactorGraph) -> SensorLog:
    """The log of a robot that drove the poses of a graph in the order of their ids.

    Parameters
    ----------
    graph
        A planar graph. Relative poses of neighbours in the order of ids are the odometry; those that were measured
        from the later pose are turned round, with their information. Observations of points (``XY``) are readings
        of the step of their pose. All other factors are left out and counted in the notes.

    Returns
    -------
    SensorLog
        Of model ``body``. A graph has no clock: ``times`` are 0, 1, 2, ... seconds. The start is the value of the
        first pose, or the origin where the graph gives none. Landmarks keep their ids.

    Raises
    ------
    InputError
        If the graph has no planar pose or spatial ones, or if no edge joins a pose to the next one.
    """
    poses = graph.variables.get(SE2.name)
    if poses is None or len(poses) == 0:
        raise InputError("a sensor log needs planar poses (SE2), and the graph has none")
    if any(column.kind.space == 3 for column in graph.variables.values() if len(column)):
        raise InputError("a sensor log needs a planar graph, and this one has spatial variables")
    order = np.argsort(poses.rank)
    odometry = _odometry(graph, poses, order)
    first = int(order[0])
    notes = ["a graph has no clock: steps are one second apart"]
    if poses.known[first]:
        start = np.array(poses.values[first], dtype=np.float64)
    else:
        start = np.zeros(3)
        notes.append(f"the start is the origin: the graph gives pose {poses.ids[first]} no value")
    return SensorLog(
        times=np.arange(len(poses), dtype=np.float64),
        ids=poses.ids[order],
        model="body",
        controls=se2.normalize(odometry.displacements),
        information=odometry.information,
        observations=_observations(graph, poses),
        start=start,
        source=graph.report.path if graph.report else "",
        notes=notes + _left_out(graph, odometry),
    )


def _odometry(graph: FactorGraph, poses: Variables, order: IndexArray) -> _Odometry:
    """The steps from each pose to the next; of several measurements of a step the first one counts."""
    steps = len(poses) - 1
    relative = [factors for factors in graph.factors if factors.kind is RELATIVE_POSE_2D]
    ranks = np.concatenate([np.empty((0, 2), dtype=np.intp), *(poses.rank[factors.indices] for factors in relative)])
    measured = np.concatenate([np.empty((0, 3)), *(factors.measurements for factors in relative)])
    information = np.concatenate([np.empty((0, 3, 3)), *(factors.information for factors in relative)])
    neighbours = np.flatnonzero(np.abs(ranks[:, 1] - ranks[:, 0]) == 1)
    used, position = np.unique(ranks[neighbours].min(axis=1), return_index=True)
    if len(used) < steps:
        missing = np.setdiff1d(np.arange(steps), used)
        before, after = poses.ids[order[missing[0]]], poses.ids[order[missing[0] + 1]]
        more = f", and {len(missing) - 1} more such gaps" if len(missing) > 1 else ""
        raise InputError(
            f"no edge joins pose {before} to the next one, {after}{more}",
            ("  a sensor log is driven pose by pose, in the order of the ids: every step needs its odometry",),
        )
    chosen = neighbours[position]
    turned = ranks[chosen, 0] > ranks[chosen, 1]
    displacements, weights = measured[chosen], information[chosen]
    displacements[turned], weights[turned] = _turned_round(displacements[turned], weights[turned])
    repeated, closures = len(neighbours) - len(chosen), len(ranks) - len(neighbours)
    return _Odometry(displacements, weights, int(np.count_nonzero(turned)), repeated, closures)


def _turned_round(measured: Array, information: Array) -> tuple[Array, Array]:
    """Measurements of the first pose from the second as measurements of the second from the first.

    With z = Z exp(e) the inverse is Z^-1 exp(-Ad(Z) e): the information Omega of e is A^T Omega A of the other
    error, with A = Ad(Z^-1), to first order in e.
    """
    inverse = se2.inverse(measured)
    adjoint = se2.adjoint(inverse)
    return inverse, adjoint.transpose(0, 2, 1) @ information @ adjoint


def _observations(graph: FactorGraph, poses: Variables) -> list[Observations]:
    """Readings by kind, in the order of their steps; those of one step keep the order of the file."""
    out = []
    for kind in OBSERVATION_KINDS:
        parts = [factors for factors in graph.factors if factors.kind is kind and len(factors)]
        if not parts:
            continue
        steps = np.concatenate([poses.rank[factors.indices[:, 0]] for factors in parts])
        landmarks = np.concatenate([_landmark_ids(graph, factors) for factors in parts])
        order = np.argsort(steps, kind="stable")
        out.append(
            Observations(
                kind=kind,
                steps=steps[order],
                landmarks=landmarks[order],
                measurements=np.concatenate([factors.measurements for factors in parts])[order],
                information=np.concatenate([factors.information for factors in parts])[order],
            )
        )
    return out


def _landmark_ids(graph: FactorGraph, factors: Factors) -> IdArray:
    """Signed ids: -1 is kept for landmarks that are not known."""
    ids = graph.variables[XY.name].ids[factors.indices[:, 1]]
    wrong = ids > np.uint64(2**63 - 1) if ids.dtype == np.uint64 else ids < 0
    if wrong.any():
        raise InputError(f"the id of a landmark of a sensor log must be from 0 to 2^63 - 1, found {ids[wrong][0]}")
    return ids.astype(np.int64)


def _left_out(graph: FactorGraph, odometry: _Odometry) -> list[str]:
    """What the log does not hold, and what was turned round."""
    used = {RELATIVE_POSE_2D.name, *(kind.name for kind in OBSERVATION_KINDS)}
    others: dict[str, int] = {}
    for factors in graph.factors:
        if factors.kind.name not in used and len(factors):
            others[factors.kind.name] = others.get(factors.kind.name, 0) + len(factors)
    counts = [
        (odometry.backward, "steps of the odometry were measured backward and are turned round"),
        (odometry.repeated, "further measurements of a step are left out: the first one counts"),
        (odometry.closures, "loop closures between poses are left out"),
        *((count, f"factors of the kind {name} are left out") for name, count in others.items()),
    ]
    return [f"{count} {what}" for count, what in counts if count]
