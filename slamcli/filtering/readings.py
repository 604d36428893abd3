"""The readings of a log by step, with their noise, and their linearization about the state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slamcli.errors import UsageError
from slamcli.filtering.controls import inverses
from slamcli.filtering.innovation import SENSORS, Sensor
from slamcli.filtering.options import EkfOptions
from slamcli.filtering.state import POSE, Block, State
from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.graph.sensor_log import Observations, SensorLog
from slamcli.models.base import Array
from slamcli.models.range_bearing import world_jacobian

_SENSOR_OF = {sensor.kind.name: sensor for sensor in SENSORS.values()}


@dataclass(frozen=True, eq=False)
class Stream:
    """The readings of one entry of a log's observations.

    Attributes
    ----------
    sensor
        Its sensor.
    landmarks
        Ids, -1 where not known.
    measurements
        (m, d).
    noise
        (m, d, d) covariances.
    in_range
        (m,) which are to be used.
    distance
        (m,) measured distances in metres, NaN for bearings.
    bounds
        Row of the first reading of each step, and at the end the number of readings.
    """

    sensor: Sensor
    landmarks: list[int]
    measurements: Array
    noise: Array
    in_range: BoolArray
    distance: Array
    bounds: list[int]

    @property
    def places(self) -> bool:
        """Whether one reading places a landmark."""
        return len(self.sensor.units) == 2


class Reading(NamedTuple):
    """One reading: its stream and its row there."""

    stream: int
    row: int


class Sighting(NamedTuple):
    """A reading of a landmark from a pose, both in the state."""

    reading: Reading
    pose: Block
    landmark: Block


def streams_of(log: SensorLog, options: EkfOptions) -> list[Stream]:
    """The readings of a log, with the noise of the options where the log has none.

    Raises
    ------
    UsageError
        If a sensor is not one that a planar filter knows, or nobody says how precise it is.
    InputError
        If an information matrix has no inverse.
    """
    return [_stream(entry, len(log), options) for entry in log.observations]


def _stream(entry: Observations, steps: int, options: EkfOptions) -> Stream:
    sensor = _SENSOR_OF.get(entry.kind.name)
    if sensor is None:
        raise UsageError(f"the filter has no sensor for {entry.kind.name}", (f"  it has: {', '.join(SENSORS)}",))
    d = entry.kind.dimension
    if entry.information is not None:
        noise = inverses(entry.information, f"the {sensor.name} reading", np.arange(len(entry)))
    else:
        deviations = options.sensor_deviations.get(sensor.name)
        if deviations is None or len(deviations) != d or not all(0.0 < s < np.inf for s in deviations):
            units = ", ".join(sensor.units)
            raise UsageError(
                f"the log does not say how precise its {sensor.name} readings are",
                (
                    f"  give {d} positive standard deviation{'s' * (d > 1)} ({units}), got {deviations}",
                    f"  such as --noise {sensor.name}={','.join('0.1' for _ in range(d))}",
                ),
            )
        noise = np.tile(np.diag(np.square(deviations)), (len(entry), 1, 1))
    measurements = entry.kind.normalize(np.asarray(entry.measurements, dtype=np.float64))
    distance = _distance(sensor, measurements)
    limit = np.inf if options.sensor_range is None else options.sensor_range
    bounds = np.searchsorted(entry.steps, np.arange(steps + 1)).tolist()
    return Stream(sensor, entry.landmarks.tolist(), measurements, noise, ~(distance > limit), distance, bounds)


def _distance(sensor: Sensor, measurements: Array) -> Array:
    if sensor.name == "xy":
        return np.hypot(measurements[:, 0], measurements[:, 1])
    if "range" in sensor.kind.components:
        return measurements[:, 0]
    return np.full(len(measurements), np.nan)


class Linearization(NamedTuple):
    """Readings of one step, stacked: innovation = H (error of the state) + noise.

    Attributes
    ----------
    entries
        (m,) of the state that H touches.
    jacobian
        (d, m) H.
    innovation
        (d,) z - h, angles wrapped.
    noise
        (d, d) Q, block diagonal.
    sizes
        Numbers of each sighting, in the order of ``sightings``.
    sightings
        The sightings, those of one stream together.
    """

    entries: IndexArray
    jacobian: Array
    innovation: Array
    noise: Array
    sizes: list[int]
    sightings: list[Sighting]


def linearize(state: State, streams: Sequence[Stream], sightings: list[Sighting], first: bool) -> Linearization:
    """Stack the readings of a step; where a reading has no derivative (robot on the landmark) it is not finite.

    Parameters
    ----------
    state
        Its mean gives the innovations.
    streams
        Of the log.
    sightings
        At least one.
    first
        Whether Jacobians are those at the first estimates instead of the mean.
    """
    if len({sighting.reading.stream for sighting in sightings}) > 1:
        sightings = sorted(sightings, key=lambda sighting: sighting.reading.stream)
    place: dict[Block, int] = {}
    width = 0
    poses_first = [sighting.pose for sighting in sightings] + [sighting.landmark for sighting in sightings]
    for block in poses_first:
        if block not in place:
            place[block] = width
            width += block.size
    sizes = [len(streams[sighting.reading.stream].sensor.units) for sighting in sightings]
    rows = sum(sizes)
    jacobian, innovation, noise = np.zeros((rows, width)), np.empty(rows), np.zeros((rows, rows))
    index = np.concatenate([np.arange(block.start, block.start + block.size) for block in place])
    done = row = 0
    while done < len(sightings):
        number = sightings[done].reading.stream
        group = [sighting for sighting in sightings[done:] if sighting.reading.stream == number]
        stream, d = streams[number], sizes[done]
        chosen = [sighting.reading.row for sighting in group]
        poses, points = _values(state.mean, group)
        at = _values(state.first, group) if first else (poses, points)
        nu, by_pose, by_point = linearize_readings(stream.sensor, poses, points, stream.measurements[chosen], at)
        for k, sighting in enumerate(group):
            lines, p, q = slice(row, row + d), place[sighting.pose], place[sighting.landmark]
            jacobian[lines, p : p + POSE], jacobian[lines, q : q + 2] = by_pose[k], by_point[k]
            noise[lines, lines] = stream.noise[chosen[k]]
            innovation[lines] = nu[k]
            row += d
        done += len(group)
    return Linearization(index, jacobian, innovation, noise, sizes, sightings)


def _values(estimates: Array, group: list[Sighting]) -> tuple[Array, Array]:
    """Poses (k, 3) and landmarks (k, 2) of sightings."""
    poses = np.array([sighting.pose.start for sighting in group])[:, None] + _POSE_ENTRIES
    points = np.array([sighting.landmark.start for sighting in group])[:, None] + _POINT_ENTRIES
    return estimates[poses], estimates[points]


_POSE_ENTRIES, _POINT_ENTRIES = np.arange(POSE), np.arange(2)


def linearize_readings(
    sensor: Sensor, poses: Array, points: Array, measurements: Array, at: tuple[Array, Array] | None = None
) -> tuple[Array, Array, Array]:
    """Innovations (k, d) at the poses and points, and Jacobians (k, d, 3), (k, d, 2) there or ``at`` others.

    Pose steps are along the axes of the world.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        residual, (by_pose, by_point) = sensor.kind.linearize((poses, points), measurements, None)
        if at is not None and at[0] is not poses:
            _, (by_pose, by_point) = sensor.kind.linearize(at, measurements, None)
    if sensor.sign > 0:  # residual = z - h: H is minus its derivative
        by_pose, by_point = -by_pose, -by_point
    else:
        residual = -residual
    return residual, world_jacobian(by_pose, poses if at is None else at[0]), by_point


def distances_alone(state: State, stacked: Linearization) -> list[float]:
    """Squared Mahalanobis distance of each sighting by itself; not finite where it has no derivative."""
    finite = np.isfinite(stacked.jacobian).all(axis=1) & np.isfinite(stacked.innovation)
    jacobian = np.where(finite[:, None], stacked.jacobian, 0.0)
    covariance = jacobian @ state.block(stacked.entries) @ jacobian.T + stacked.noise
    out, at = [], 0
    for size in stacked.sizes:
        rows = slice(at, at + size)
        at += size
        if finite[rows].all():
            nu = stacked.innovation[rows]
            out.append(float(nu @ np.linalg.solve(covariance[rows, rows], nu)))
        else:
            out.append(np.inf)
    return out
