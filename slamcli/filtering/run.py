"""EKF-SLAM over a whole log: predict, associate, update, initialize, step by step."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from slamcli.errors import NumericalError
from slamcli.filtering.association import compare, gate, joint_compatibility, nearest
from slamcli.filtering.compressed import CompressedState
from slamcli.filtering.controls import displacements
from slamcli.filtering.delayed import Waiting
from slamcli.filtering.ekf import predict, update
from slamcli.filtering.initialization import Placement, View, enter, place
from slamcli.filtering.ledger import Ledger
from slamcli.filtering.options import EkfOptions
from slamcli.filtering.readings import Linearization, Reading, Sighting, distances_alone, linearize, streams_of
from slamcli.filtering.result import (
    EkfResult,
    Landmarks,
    StepRecord,
    UpdateColumns,
)
from slamcli.filtering.start import require_places, start_state
from slamcli.filtering.state import POSE, Block, State, local_covariance
from slamcli.filtering.tracks import Track, Tracks
from slamcli.graph.columns import IdArray, IndexArray
from slamcli.graph.sensor_log import SensorLog
from slamcli.models.base import Array

#: Landmarks up to this many times the distance of the farthest reading are looked at in an association.
_MARGIN = 1.5


def run(
    log: SensorLog,
    options: EkfOptions,
    *,
    on_step: Callable[[StepRecord], None] | None = None,
    progress: Callable[[int], None] | None = None,
    interrupted: Callable[[], bool] | None = None,
) -> EkfResult:
    """Filter a log.

    Parameters
    ----------
    log
        Controls and readings.
    options
        See ``EkfOptions``.
    on_step
        Called with a record of each step; making them takes time.
    progress
        Called with the number of each step that is done.
    interrupted
        Asked before each step but the first; if it says so, the run ends there with what it has.

    Raises
    ------
    UsageError
        If log and options do not fit together: no noise for odometry or a sensor, or readings of one number whose
        landmarks are not known.
    InputError
        If an information matrix of the log has no inverse.
    NumericalError
        If a covariance or an estimate loses its meaning.
    """
    return _Run(log, options, on_step is not None).go(on_step, progress, interrupted)


class _Run:
    """The filter on its way through a log."""

    def __init__(self, log: SensorLog, options: EkfOptions, traced: bool) -> None:
        self.started = time.perf_counter()
        self.log, self.options, self.traced = log, options, traced
        self.displacement, self.noise = displacements(log, options)
        self.streams = streams_of(log, options)
        self.known = options.association == "known"
        if not self.known:
            require_places(self.streams)
        self.state = start_state(log, options, self.streams)
        self.tracks = Tracks(options.confirm_sightings, options.provisional_steps)
        self.by_id: dict[int, Track] = {}
        self.waiting = Waiting()
        self.copies: list[Block] = []  # the copy of this step's pose, if one was made
        self.ledger = Ledger(self.streams, traced)
        self.seconds = dict.fromkeys(("prediction", "update", "association"), 0.0)
        self.largest = self.reserved = 0
        self.updates: list[tuple[int, float, int, int, float]] = []
        self.first = options.jacobians == "first-estimates"
        self.step = 0

    def go(
        self,
        on_step: Callable[[StepRecord], None] | None,
        progress: Callable[[int], None] | None,
        interrupted: Callable[[], bool] | None,
    ) -> EkfResult:
        """All steps."""
        steps = len(self.log)
        poses, covariances = np.empty((steps, POSE)), np.empty((steps, POSE, POSE))
        trace, dimension = np.zeros(steps), np.empty(steps, dtype=np.intp)
        done = 0
        for step in range(steps):
            if step and interrupted is not None and interrupted():
                break
            self.step, updates, size = step, len(self.updates), self.state.size
            if step:
                self._predict(step)
            self._read(step)
            poses[step], covariances[step] = self.state.mean[:POSE], self.state.pose_covariance()
            dimension[step] = self.state.dimension
            changed = len(self.updates) > updates or self.state.size != size or step == 0
            trace[step] = self.state.map_trace() if changed else trace[step - 1]
            done = step + 1
            if on_step is not None:
                on_step(self._record(step, poses[step], covariances[step], float(trace[step]), updates))
            if progress is not None:
                progress(step)
        finite = np.isfinite(poses[:done]).all(axis=1) & np.isfinite(covariances[:done]).all(axis=(1, 2))
        finite &= np.isfinite(trace[:done])
        if not finite.all():
            bad = int(np.flatnonzero(~finite)[0])
            raise NumericalError(f"the estimate or its covariance is not finite from step {bad} on")
        local = local_covariance(covariances[:done], poses[:done, 2])
        return self._result(poses[:done], local, trace[:done], dimension[:done], done < steps)

    def _predict(self, step: int) -> None:
        begin = time.perf_counter()
        predict(self.state, self.displacement[step - 1], self.noise[step - 1], self.first)
        self.seconds["prediction"] += time.perf_counter() - begin

    def _read(self, step: int) -> None:
        """Everything that was read at the end of a step."""
        readings = self._readings(step)
        self.copies = []
        if readings:
            begin = time.perf_counter()
            matched, new = self._associate(readings)
            self.seconds["association"] += time.perf_counter() - begin
            begin = time.perf_counter()
            if matched:
                self._update(matched)
            if new:
                self._start_landmarks(new)
            self.seconds["update"] += time.perf_counter() - begin
        if not self.known:
            gone = self.tracks.forgotten(step)
            self.state.remove([track.block for track in gone])
        self.largest = max(self.largest, self.state.nbytes)
        self.reserved = max(self.reserved, self.state.reserved_bytes)

    def _readings(self, step: int) -> list[Reading]:
        """The readings of a step that are in range."""
        out = []
        for number, stream in enumerate(self.streams):
            for row in range(stream.bounds[step], stream.bounds[step + 1]):
                reading = Reading(number, row)
                if stream.in_range[row]:
                    out.append(reading)
                else:
                    self.ledger.decide(reading, "out-of-range")
        return out

    # -- data association

    def _associate(self, readings: list[Reading]) -> tuple[list[tuple[Reading, Track]], list[Reading]]:
        """Readings of landmarks in the state, and readings that are to start one."""
        if self.known:
            matched, new = [], []
            for reading in readings:
                landmark = self.ledger.landmark(reading)
                if landmark < 0:
                    self.ledger.decide(reading, "no-id")
                elif landmark in self.by_id:
                    matched.append((reading, self.by_id[landmark]))
                else:
                    new.append(reading)
            self.state.require(track.block for _, track in matched)
            return matched, new
        farthest = max(float(self.streams[reading.stream].distance[reading.row]) for reading in readings)
        self.state.require_around(_MARGIN * farthest)
        candidates = [track for track in self.tracks.live if track.block.start >= 0]
        if not candidates:
            return [], readings
        wide = gate(2, self.options.new_probability)
        pairs = compare(self.state, self.streams, readings, [track.block for track in candidates], wide)
        narrow = gate(2, self.options.gate_probability)
        if self.options.association == "nearest":
            found = nearest(pairs, narrow)
        else:
            hypothesis = joint_compatibility(
                pairs.inside(narrow), self.options.gate_probability, self.options.node_limit
            )
            self.ledger.searched(hypothesis)
            found = hypothesis.landmarks
        near = set(pairs.readings.tolist())
        for number in sorted(near - found.keys()):
            self.ledger.decide(readings[number], "ambiguous")
        matched = [(readings[i], candidates[j]) for i, j in sorted(found.items())]
        return matched, [reading for i, reading in enumerate(readings) if i not in near]

    # -- updates

    def _update(self, matched: list[tuple[Reading, Track]]) -> None:
        """Update by readings from the robot's pose, after leaving out those that cannot be used."""
        gated = self.known and self.options.gate_known
        robot = self.state.robot
        sightings = {Sighting(reading, robot, track.block): track for reading, track in matched}
        stacked = linearize(self.state, self.streams, list(sightings), self.first)
        alone: list[float] | None = None
        finite = bool(np.isfinite(stacked.jacobian).all() and np.isfinite(stacked.innovation).all())
        if gated or self.traced or not finite:
            alone = distances_alone(self.state, stacked)
            kept = self._kept(stacked, alone, gated)
            if len(kept) < len(stacked.sightings):
                for sighting in stacked.sightings:
                    if sighting not in kept:
                        del sightings[sighting]
                if not kept:
                    return
                stacked = linearize(self.state, self.streams, kept, self.first)
                alone = distances_alone(self.state, stacked) if self.traced else None
        self._correct(stacked)
        at = 0
        for k, sighting in enumerate(stacked.sightings):
            track = sightings[sighting]
            innovation = stacked.innovation[at : at + stacked.sizes[k]]
            at += stacked.sizes[k]
            self.tracks.see(track, self.step)
            self.ledger.used(sighting.reading, track, innovation, None if alone is None else alone[k])

    def _kept(self, stacked: Linearization, alone: list[float], gated: bool) -> list[Sighting]:
        """The sightings that can be used: with a derivative and, if gated, inside of the gate."""
        kept = []
        for sighting, size, distance in zip(stacked.sightings, stacked.sizes, alone, strict=True):
            if not np.isfinite(distance):
                self.ledger.decide(sighting.reading, "undefined")
            elif gated and distance > gate(size, self.options.new_probability):
                self.ledger.decide(sighting.reading, "outlier", nis=distance)
            else:
                kept.append(sighting)
        return kept

    def _correct(self, stacked: Linearization) -> None:
        begin = time.perf_counter()
        try:
            found = update(self.state, stacked, self.options.form == "joseph")
        except NumericalError as error:
            at = f"step {self.step} (pose {self.log.ids[self.step]})"
            raise NumericalError(f"{at}: {error.message}", error.details) from None
        seconds = time.perf_counter() - begin
        self.updates.append((self.step, found.nis, found.degrees_of_freedom, self.state.size, seconds))

    # -- new landmarks

    def _start_landmarks(self, readings: list[Reading]) -> None:
        """Readings of landmarks that are not in the state: place those, or wait until they can be placed."""
        later: list[tuple[Reading, Track]] = []
        for reading in sorted(readings, key=lambda reading: not self.streams[reading.stream].places):
            landmark = self.ledger.landmark(reading)
            if self.known and landmark in self.by_id:  # another reading of this step has just placed it
                later.append((reading, self.by_id[landmark]))
            elif self.streams[reading.stream].places:
                view = View(reading, self.state.robot)
                self._enter(place(self.state, self.streams, view), landmark, reading)
            else:
                self._wait(reading, landmark)
        if later:
            self._update(later)

    def _wait(self, reading: Reading, landmark: int) -> None:
        """A reading of one number."""
        placement = self.waiting.placement(self.state, self.streams, landmark, reading, self.options)
        if placement is None:
            dropped = self.waiting.dropped
            self.waiting.keep(self.state, landmark, reading, self.options, self.copies)
            self.ledger.note(reading, "waiting" if self.waiting.dropped == dropped else "dropped")
            return
        track = self._enter(placement, landmark, reading)
        if track is None:
            return
        for view in placement.rest:
            self.tracks.see(track, self.step)
            self.ledger.used(view.reading, track)
        for view in placement.views:
            self.ledger.decide(view.reading, "initialized", track)
        track.sightings = len(placement.views) + len(placement.rest)
        self.waiting.placed(self.state, landmark)

    def _enter(self, placement: Placement, landmark: int, reading: Reading) -> Track | None:
        """Put a landmark into the state; None if it has no derivative there."""
        try:
            block, rest = enter(self.state, self.streams, placement, self.first)
        except np.linalg.LinAlgError:
            self.ledger.decide(reading, "undefined")
            return None
        if rest is not None:
            self._correct(rest)
        if not self.known and landmark >= 0:
            self.ledger.duplicates += any(track.landmark == landmark for track in self.tracks.live)
        track = self.tracks.start(landmark, block, self.step, self.known)
        if self.known:
            self.by_id[landmark] = track
        if len(placement.views) == 1:
            self.ledger.decide(reading, "initialized", track)
            self.waiting.placed(self.state, landmark)
        return track

    # -- what is told

    def _record(self, step: int, pose: Array, covariance: Array, trace: float, updates: int) -> StepRecord:
        new = self.updates[updates:]
        return StepRecord(
            step=step,
            id=int(self.log.ids[step]),
            time=float(self.log.times[step]),
            pose=pose.copy(),
            covariance=local_covariance(covariance, pose[2]),
            map_trace=trace,
            landmarks=len(self.tracks.live),
            dimension=self.state.dimension,
            nis=sum(entry[1] for entry in new),
            degrees_of_freedom=sum(entry[2] for entry in new),
            readings=self.ledger.taken_records(),
        )

    def _result(
        self, poses: Array, covariances: Array, trace: Array, dimension: IndexArray, stopped: bool
    ) -> EkfResult:
        done = len(poses)
        waited = {"waiting": self.waiting.readings, "dropped": self.waiting.dropped}
        state = self.state.complete()
        return EkfResult(
            ids=self.log.ids[:done],
            times=self.log.times[:done],
            poses=poses,
            covariances=covariances,
            map_trace=trace,
            dimension=dimension,
            updates=UpdateColumns.of(self.updates),
            landmarks=self._landmarks(state),
            state=state,
            counts=self.ledger.counts | waited,
            association=self.ledger.association(self.tracks.started, self.tracks.deleted),
            assignments=self.ledger.assignments,
            predictions=max(done - 1, 0),
            prediction_seconds=self.seconds["prediction"],
            update_seconds=self.seconds["update"],
            association_seconds=self.seconds["association"],
            seconds=time.perf_counter() - self.started,
            covariance_bytes=self.largest,
            reserved_bytes=self.reserved,
            areas=self.state.areas if isinstance(self.state, CompressedState) else 1,
            interrupted=stopped,
            free_id=_free_id(self.log),
            notes=list(self.log.notes),
        )

    def _landmarks(self, state: State) -> Landmarks:
        live = self.tracks.live
        starts = np.array([self.state.place_of(track.block) for track in live], dtype=np.intp)
        return Landmarks(
            tracks=_ids([track.number for track in live]),
            ids=_ids([track.landmark for track in live]),
            positions=state.mean[starts[:, None] + np.arange(2)],
            covariances=state.landmark_covariances(starts)[0],
            sightings=np.array([track.sightings for track in live], dtype=np.intp),
            confirmed=np.array([track.confirmed for track in live], dtype=bool),
            starts=starts,
        )


def _free_id(log: SensorLog) -> int:
    """Above all ids of the log and its truth."""
    columns = [log.ids, *(entry.landmarks for entry in log.observations)]
    if log.true_landmarks is not None:
        columns.append(log.true_landmarks[0])
    if log.true_trajectory is not None and log.true_trajectory.ids is not None:
        columns.append(log.true_trajectory.ids)
    return 1 + max((int(column.max()) for column in columns if len(column)), default=-1)


def _ids(numbers: list[int]) -> IdArray:
    return np.array(numbers, dtype=np.int64)
