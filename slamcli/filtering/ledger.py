"""What became of each reading of a run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slamcli.filtering.association import Hypothesis
from slamcli.filtering.readings import Reading, Stream
from slamcli.filtering.result import DECISIONS, AssociationCounts, ReadingRecord
from slamcli.filtering.tracks import Track
from slamcli.graph.columns import IdArray
from slamcli.models.base import Array


class Ledger:
    """Counts decisions, keeps assignments and, for a trace, records of the readings of a step.

    Attributes
    ----------
    counts
        Readings by decision; those that wait change theirs once their landmark is placed, and are counted then.
    assignments
        For each stream (m,) the track of each reading, -1 where it has none.
    duplicates
        Landmarks that were started while another one with the same id was in the state.
    """

    def __init__(self, streams: Sequence[Stream], traced: bool) -> None:
        self.counts = dict.fromkeys(DECISIONS, 0)
        self.assignments: list[IdArray] = [np.full(len(s.landmarks), -1, dtype=np.int64) for s in streams]
        self.duplicates = 0
        self._streams, self._traced = streams, traced
        self._records: list[ReadingRecord] = []
        self._correct = self._wrong = self._nodes = self._cut_short = 0

    def landmark(self, reading: Reading) -> int:
        """Id in the log, -1 without."""
        return self._streams[reading.stream].landmarks[reading.row]

    def decide(
        self,
        reading: Reading,
        decision: str,
        track: Track | None = None,
        innovation: Array | None = None,
        nis: float | None = None,
    ) -> None:
        """One of ``DECISIONS`` about a reading, with its landmark and its innovation if there are any."""
        self.counts[decision] += 1
        if track is not None:
            self.assignments[reading.stream][reading.row] = track.number
        self.note(reading, decision, track, innovation, nis)

    def note(
        self,
        reading: Reading,
        decision: str,
        track: Track | None = None,
        innovation: Array | None = None,
        nis: float | None = None,
    ) -> None:
        """A record for the trace, not counted."""
        if self._traced:
            name, number = self._streams[reading.stream].sensor.name, -1 if track is None else track.number
            self._records.append(ReadingRecord(name, self.landmark(reading), number, decision, innovation, nis))

    def used(self, reading: Reading, track: Track, innovation: Array | None = None, nis: float | None = None) -> None:
        """A reading updated the state as one of this landmark."""
        landmark = self.landmark(reading)
        if landmark >= 0 and track.landmark >= 0:
            self._correct += landmark == track.landmark
            self._wrong += landmark != track.landmark
        self.decide(reading, "used", track, innovation, nis)

    def searched(self, hypothesis: Hypothesis) -> None:
        """A joint hypothesis was looked for."""
        self._nodes += hypothesis.nodes
        self._cut_short += not hypothesis.complete

    def taken_records(self) -> list[ReadingRecord]:
        """The records since this was asked last."""
        records, self._records = self._records, []
        return records

    def association(self, started: int, deleted: int) -> AssociationCounts:
        """The counts of associations, with those of landmarks."""
        return AssociationCounts(
            made=self.counts["used"],
            correct=self._correct,
            wrong=self._wrong,
            started=started,
            deleted=deleted,
            duplicates=self.duplicates,
            nodes=self._nodes,
            cut_short=self._cut_short,
        )
