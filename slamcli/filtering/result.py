"""What a run of the filter leaves: one dataclass for the run, one record for each step that was asked for."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from slamcli.filtering.state import POSE, State
from slamcli.graph.columns import BoolArray, IdArray, IndexArray
from slamcli.models.base import Array

#: What can become of a reading. The first two correct or extend the state.
DECISIONS = (
    "used",  # it updated the state
    "initialized",  # it placed a new landmark
    "waiting",  # it waits, with its pose, for more readings of a landmark that it does not place by itself
    "dropped",  # as waiting, but from too near to a reading that waits already, or too old
    "out-of-range",  # farther away than the sensor range of the options
    "no-id",  # the association is known, but not for this reading
    "ambiguous",  # near a landmark, but not near enough, or another reading took it
    "outlier",  # its landmark is known, but it is outside of the gate
    "undefined",  # the robot is on the landmark: no derivative exists
)


@dataclass(frozen=True, eq=False)
class ReadingRecord:
    """What became of one reading.

    Attributes
    ----------
    sensor
        Name of the sensor.
    landmark
        Id in the log, -1 without.
    track
        Number of the landmark in the run, -1 without.
    decision
        One of ``DECISIONS``.
    innovation
        (d,) z - h, or None where it was compared with no landmark.
    nis
        Its squared Mahalanobis distance, alone; None as ``innovation``.
    """

    sensor: str
    landmark: int
    track: int
    decision: str
    innovation: Array | None = None
    nis: float | None = None


@dataclass(frozen=True, eq=False)
class StepRecord:
    """The filter after one step.

    Attributes
    ----------
    step, id, time
        Number of the step, id of its pose, seconds.
    pose
        (3,).
    covariance
        (3, 3) in the frame of the pose.
    map_trace
        Sum of the variances of all landmarks (and poses that are kept), in m^2.
    landmarks, dimension
        Landmarks in the state, and its dimension.
    nis, degrees_of_freedom
        Of all innovations of the step together; 0 where nothing was read.
    readings
        What became of each reading of the step.
    """

    step: int
    id: int
    time: float
    pose: Array
    covariance: Array
    map_trace: float
    landmarks: int
    dimension: int
    nis: float
    degrees_of_freedom: int
    readings: list[ReadingRecord]


@dataclass(frozen=True, eq=False)
class UpdateColumns:
    """All updates of a run; a step with landmarks that were placed late has two.

    Attributes
    ----------
    step
        (u,) step of each.
    nis
        (u,) squared Mahalanobis distance of its innovations.
    degrees_of_freedom
        (u,) their number.
    dimension
        (u,) dimension of the state.
    seconds
        (u,) time of each update: linearization, gain, mean and covariance; without data association.
    """

    step: IndexArray
    nis: Array
    degrees_of_freedom: IndexArray
    dimension: IndexArray
    seconds: Array

    def __len__(self) -> int:
        return len(self.step)

    @classmethod
    def of(cls, rows: list[tuple[int, float, int, int, float]]) -> UpdateColumns:
        """From one tuple for each update."""
        step, nis, freedom, dimension, seconds = zip(*rows, strict=True) if rows else [()] * 5
        whole = (np.array(column, dtype=np.intp) for column in (step, freedom, dimension))
        steps, freedoms, dimensions = whole
        return cls(steps, np.array(nis, dtype=np.float64), freedoms, dimensions, np.array(seconds, dtype=np.float64))


@dataclass(frozen=True, eq=False)
class Landmarks:
    """The landmarks at the end of a run, in the order of the state.

    Attributes
    ----------
    tracks
        (k,) numbers in the run, in order of appearance.
    ids
        (k,) id in the log of the reading that started each, -1 where it has none.
    positions, covariances
        (k, 2) metres in the world, (k, 2, 2).
    sightings
        (k,) readings that each one took.
    confirmed
        (k,) which are not provisional any more.
    starts
        (k,) where each begins in the state.
    """

    tracks: IdArray
    ids: IdArray
    positions: Array
    covariances: Array
    sightings: IndexArray
    confirmed: BoolArray
    starts: IndexArray

    def __len__(self) -> int:
        return len(self.tracks)


@dataclass(frozen=True)
class AssociationCounts:
    """How readings found their landmarks.

    Attributes
    ----------
    made
        Readings that were taken for a landmark in the state.
    correct, wrong
        Of those, the ones whose id in the log is, or is not, that of the reading which started the landmark. Readings
        and landmarks without an id are in neither.
    started, deleted
        Landmarks that were put into the state, and provisional ones that were taken out of it.
    duplicates
        Landmarks that were started while another one with the same id was in the state.
    nodes
        Nodes that joint compatibility visited.
    cut_short
        Steps in which it ran into the limit of nodes.
    """

    made: int = 0
    correct: int = 0
    wrong: int = 0
    started: int = 0
    deleted: int = 0
    duplicates: int = 0
    nodes: int = 0
    cut_short: int = 0


@dataclass(frozen=True, eq=False)
class EkfResult:
    """A run of the filter.

    Attributes
    ----------
    ids, times
        (s,) ids and seconds of the steps that were made: all, or those before an interruption.
    poses
        (s, 3) the estimate of each pose *at its step*: a filter never returns to it.
    covariances
        (s, 3, 3) in the frame of each pose (steps of ``SE2.retract``).
    map_trace
        (s,) sum of the variances of all landmarks (and kept poses), in m^2. In a compressed run the part outside of the
        local area is as old as the area.
    dimension
        (s,) dimension of the state after each step.
    updates
        All updates.
    landmarks
        The map at the end.
    state
        The state at the end, up to date; the covariance of its pose is of steps along the axes of the world.
    counts
        Readings by what became of them, in the order of ``DECISIONS``.
    association
        How readings found their landmarks.
    assignments
        For each entry of the log's observations (m,) the track of each reading, -1 where it has none.
    predictions
        Number of predictions.
    prediction_seconds, update_seconds, association_seconds, seconds
        Time of all predictions, updates (initialization included), associations, and of the whole run.
    covariance_bytes
        8 for each entry of the largest covariance there was (and of the local area of a compressed run).
    reserved_bytes
        Of the array that holds it: its capacity doubles where the number of landmarks is not known beforehand.
    areas
        Local areas of a compressed run, else 1.
    interrupted
        Whether it was.
    free_id
        Above all ids of poses and landmarks in the log and its truth: from here on ids mean nothing else.
    notes
        Assumptions and what was left out, one sentence each.
    """

    ids: IdArray
    times: Array
    poses: Array
    covariances: Array
    map_trace: Array
    dimension: IndexArray
    updates: UpdateColumns
    landmarks: Landmarks
    state: State
    counts: dict[str, int]
    association: AssociationCounts
    assignments: list[IdArray]
    predictions: int
    prediction_seconds: float
    update_seconds: float
    association_seconds: float
    seconds: float
    covariance_bytes: int
    reserved_bytes: int
    areas: int
    interrupted: bool
    free_id: int = 0
    notes: list[str] = field(default_factory=list)

    def covariance(self) -> Array:
        """(3 + 2 k, 3 + 2 k) of the last pose, steps along the axes of the world, and all landmarks. A copy."""
        entries = (self.landmarks.starts[:, None] + np.arange(2)).ravel()
        return self.state.block(np.concatenate([np.arange(POSE), entries]))

    def correlation(self) -> Array:
        """``covariance`` scaled to a unit diagonal; what has no variance has no correlation."""
        covariance = self.covariance()
        deviation = np.sqrt(np.maximum(covariance.diagonal(), 0.0))
        scale = np.divide(1.0, deviation, out=np.zeros_like(deviation), where=deviation > 0.0)
        return covariance * scale * scale[:, None]

    def coupling(self) -> float:
        """Mean absolute correlation between the same coordinate of two landmarks, 0 to 1; NaN below two landmarks."""
        count = len(self.landmarks)
        if count < 2:
            return float("nan")
        correlation = np.abs(self.correlation()[POSE:, POSE:])
        total = sum(float(correlation[k::2, k::2].sum() - correlation[k::2, k::2].trace()) for k in range(2))
        return total / (2 * count * (count - 1))
