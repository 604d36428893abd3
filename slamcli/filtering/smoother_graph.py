"""The factor graph of what a filter has used: the same displacements, readings, noise and landmarks, for a smoother."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slamcli.filtering.chain import composed
from slamcli.filtering.controls import displacements
from slamcli.filtering.estimate import estimated_graph
from slamcli.filtering.options import EkfOptions
from slamcli.filtering.readings import streams_of
from slamcli.filtering.result import EkfResult
from slamcli.geometry import so2
from slamcli.graph import FactorGraph, Factors
from slamcli.graph.columns import BoolArray, IndexArray, Variables
from slamcli.graph.sensor_log import SensorLog
from slamcli.models import POSE_PRIOR_2D, RELATIVE_POSE_2D, SE2, XY
from slamcli.models.base import Array

#: Above so many steps those without readings are composed with their neighbours.
MOST_POSES = 20_000
#: Deviation in metres and radians of a part of the first pose that is known, where another part is not.
_LEAST_DEVIATION = 1e-6
#: A step's covariance counts as singular if its smallest eigenvalue is below this part of what is usual in the log (the
#: median of the largest ones), as that of a robot that stands still; an information matrix takes that much more.
_SINGULAR = 1e-9


@dataclass(frozen=True, eq=False)
class SmootherGraph:
    """The graph of a run.

    Attributes
    ----------
    graph
        Poses (``SE2``) of the kept steps and landmarks (``XY``) in the order of the run. Values: each pose as the
        filter had it at its step, and each landmark where the first reading that places it puts it from there (where
        none does, as the filter had it at the end). These fit each other: from the filter's last map Gauss-Newton
        fails on long loops.
    kept
        (k,) steps whose poses are variables.
    softened, softening
        Displacements with singular noise, and the deviation in metres and radians that each of these takes more.
    deleted
        Readings left out because the filter deleted their landmark.
    """

    graph: FactorGraph
    kept: IndexArray
    softened: int
    softening: float
    deleted: int


def smoother_graph(log: SensorLog, options: EkfOptions, result: EkfResult, most: int = MOST_POSES) -> SmootherGraph:
    """The graph of a run of the filter.

    Parameters
    ----------
    log, options
        Of the run.
    result
        What came of it: all steps, and which landmark each reading was taken for.
    most
        Steps without readings are left out but for some (``evenly_spread``), their displacements and covariances
        composed (``filtering.chain``), where there are more steps than this, or where the noise of single steps is
        singular.

    Raises
    ------
    UsageError, InputError
        As ``filtering.run``.
    """
    displacement, covariance = displacements(log, options)
    observed, deleted = _observations(log, options, result)
    kept = np.arange(len(log))
    if len(log) > most or _is_singular(covariance)[0].any():
        used = [entry.indices[:, 0] for entry in observed]
        kept = np.unique(np.concatenate([evenly_spread(len(log)), *used]))
    displacement, covariance = composed(displacement, covariance, kept)
    information, softened, softening = _information(covariance)
    steps = np.arange(len(kept) - 1)
    odometry = Factors(
        RELATIVE_POSE_2D, np.stack([steps, steps + 1], axis=1), displacement, information, tag="EDGE_SE2"
    )
    factors = [odometry] if len(steps) else []
    for entry in observed:
        rows = np.searchsorted(kept, entry.indices[:, 0])
        factors.append(replace(entry, indices=np.stack([rows, entry.indices[:, 1]], axis=1)))
    variables = dict(estimated_graph(result).variables)
    poses = variables[SE2.name]
    fixed = np.zeros(len(kept), dtype=bool)
    deviations = np.asarray(options.start_deviations, dtype=np.float64)
    if deviations.any():
        factors.append(_prior(np.asarray(log.start, dtype=np.float64), np.maximum(deviations, _LEAST_DEVIATION)))
    else:
        fixed[0] = True
    column = Variables(SE2, poses.ids[kept], poses.values[kept], fixed, poses.known[kept], poses.lines[kept])
    variables[SE2.name] = column
    if XY.name in variables:
        points = first_seen(factors, column.values, variables[XY.name].values)
        variables[XY.name] = replace(variables[XY.name], values=points)
    return SmootherGraph(FactorGraph(variables, factors), kept, softened, softening, deleted)


def evenly_spread(steps: int) -> IndexArray:
    """Steps that are kept in any case, first and last among them: one of 20, at most 500."""
    return np.linspace(0, steps - 1, min(max(steps // 20, 2), 500)).astype(np.intp)


def start_covariance(log: SensorLog, options: EkfOptions) -> Array:
    """(3, 3) of the first pose in its own frame; the options have it along the axes of the world."""
    rotation = np.eye(3)
    rotation[:2, :2] = so2.to_matrix(np.array([log.start[2]]))
    return rotation.T @ np.diag(np.square(np.asarray(options.start_deviations, dtype=np.float64))) @ rotation


def first_seen(factors: list[Factors], poses: Array, points: Array) -> Array:
    """Landmarks (k, 2) where the first reading that places each one puts it; the others as in ``points``.

    Parameters
    ----------
    factors
        Of poses and landmarks, in the order of time.
    poses
        (n, 3) of the variables that they join.
    points
        (k, 2).
    """
    out = points.copy()
    earliest = np.full(len(points), len(poses))
    for entry in factors:
        if entry.kind.variables[-1] is not XY:
            continue
        landmarks, rows = np.unique(entry.indices[:, 1], return_index=True)
        seen = entry.indices[rows, 0]
        placed = entry.kind.place(poses[seen], entry.measurements[rows], None)
        sooner = seen < earliest[landmarks]
        if placed is not None:
            out[landmarks[sooner]] = placed[sooner]
            earliest[landmarks[sooner]] = seen[sooner]
    return out


def _observations(log: SensorLog, options: EkfOptions, result: EkfResult) -> tuple[list[Factors], int]:
    """Readings that the filter has taken for a landmark of its map: (step, landmark) as indices."""
    out, deleted = [], 0
    order = np.argsort(result.landmarks.tracks)
    tracks = result.landmarks.tracks[order]
    entries = zip(log.observations, streams_of(log, options), result.assignments, strict=True)
    for entry, stream, assigned in entries:
        place = np.minimum(np.searchsorted(tracks, assigned), max(len(tracks) - 1, 0))
        live = (assigned >= 0) & (tracks[place] == assigned) if len(tracks) else np.zeros(len(assigned), dtype=bool)
        deleted += int(np.count_nonzero((assigned >= 0) & ~live))
        rows = np.flatnonzero(live)
        if len(rows) == 0:
            continue
        stated = entry.information
        information = np.asarray(np.linalg.inv(stream.noise[rows])) if stated is None else stated[rows]
        indices = np.stack([entry.steps[rows], order[place[rows]]], axis=1)
        out.append(Factors(entry.kind, indices, stream.measurements[rows], information, tag=stream.sensor.tag))
    return out, deleted


def _is_singular(covariance: Array) -> tuple[BoolArray, float]:
    """Which covariances (m, 3, 3) cannot be inverted, and the variance that they lack."""
    values = np.linalg.eigvalsh(covariance)
    usual = values[values[:, -1] > 0.0, -1]
    least = _SINGULAR * float(np.median(usual)) if len(usual) else _LEAST_DEVIATION**2
    return np.asarray(~(values[:, 0] > least)), least


def _information(covariance: Array) -> tuple[Array, int, float]:
    """Inverses of covariances (m, 3, 3), how many of them were singular, and the deviation that these took more."""
    if len(covariance) == 0:
        return np.empty((0, 3, 3)), 0, 0.0
    singular, least = _is_singular(covariance)
    inverse = np.linalg.inv(covariance + singular[:, None, None] * least * np.eye(3))
    return 0.5 * (inverse + inverse.transpose(0, 2, 1)), int(np.count_nonzero(singular)), float(np.sqrt(least))


def _prior(start: Array, deviations: Array) -> Factors:
    """What is known of the first pose."""
    rotation = np.eye(3)
    rotation[:2, :2] = so2.to_matrix(start[2:3])
    weight: Array = rotation.T @ np.diag(1.0 / np.square(deviations)) @ rotation
    return Factors(POSE_PRIOR_2D, np.zeros((1, 1), dtype=np.intp), start[None], weight[None], tag="EDGE_PRIOR_SE2")
