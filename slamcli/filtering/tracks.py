"""The landmarks of a run: which are in the state, how often they were seen, which are still provisional."""

from __future__ import annotations

from dataclasses import dataclass, field

from slamcli.filtering.state import Block


@dataclass(eq=False)
class Track:
    """A landmark in the state.

    Attributes
    ----------
    number
        Its number in the run, in order of appearance.
    landmark
        Id in the log of the reading that started it, -1 where the log has none.
    block
        Where it is in the state.
    sightings
        Readings that it took, the first included.
    first_step, last_step
        Steps of its first and its last reading.
    confirmed
        Whether it is not provisional any more.
    """

    number: int
    landmark: int
    block: Block
    sightings: int
    first_step: int
    last_step: int
    confirmed: bool


@dataclass(eq=False)
class Tracks:
    """All landmarks in the state, and how many there were.

    Attributes
    ----------
    confirm_sightings, provisional_steps
        See ``EkfOptions``.
    live
        In the order of the state.
    started, deleted
        Counts.
    """

    confirm_sightings: int
    provisional_steps: int
    live: list[Track] = field(default_factory=list)
    started: int = 0
    deleted: int = 0

    def start(self, landmark: int, block: Block, step: int, confirmed: bool) -> Track:
        """A landmark that was seen for the first time."""
        track = Track(self.started, landmark, block, 1, step, step, confirmed or self.confirm_sightings <= 1)
        self.started += 1
        self.live.append(track)
        return track

    def see(self, track: Track, step: int) -> None:
        """One more sighting."""
        track.sightings += 1
        track.last_step = step
        track.confirmed |= track.sightings >= self.confirm_sightings

    def forgotten(self, step: int) -> list[Track]:
        """Take out the provisional ones that were not seen for too long."""
        gone = [t for t in self.live if not t.confirmed and step - t.last_step > self.provisional_steps]
        if gone:
            lost = set(gone)
            self.live = [track for track in self.live if track not in lost]
            self.deleted += len(gone)
        return gone
