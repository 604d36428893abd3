"""Landmarks that one reading does not place: their readings wait, with the poses they were made from.

Those poses are kept in the state (stochastic cloning), so that nothing is lost and nothing is taken to be independent
that is not: once the readings place the landmark, it enters the state with its right correlations, and the readings
that were not needed for that update the state afterwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from slamcli.filtering.ekf import keep_pose
from slamcli.filtering.initialization import Placement, View, triangulate, trilaterate
from slamcli.filtering.options import EkfOptions
from slamcli.filtering.readings import Reading, Stream
from slamcli.filtering.state import Block, State


@dataclass(eq=False)
class Waiting:
    """The landmarks that wait for their place.

    Attributes
    ----------
    views
        By id and stream of the landmark, oldest first.
    dropped
        Number of readings that were neither kept nor used.
    """

    views: dict[tuple[int, int], list[View]] = field(default_factory=dict)
    dropped: int = 0

    def placement(
        self, state: State, streams: Sequence[Stream], landmark: int, reading: Reading, options: EkfOptions
    ) -> Placement | None:
        """Where a landmark is, with a reading from the robot's pose and all before."""
        views = [*self.views.get((landmark, reading.stream), ()), View(reading, state.robot)]
        if "bearing" in streams[reading.stream].sensor.kind.components:
            return triangulate(state, streams, views, options.min_parallax)
        return trilaterate(state, streams, views)

    def keep(self, state: State, landmark: int, reading: Reading, options: EkfOptions, copies: list[Block]) -> None:
        """Keep a reading, if the robot has moved on since the last one that was kept.

        ``copies`` holds the copy of this step's pose, if there is one already, and takes it.
        """
        views = self.views.setdefault((landmark, reading.stream), [])
        if views and self._moved(state, views[-1]) < options.min_baseline:
            self.dropped += 1
            return
        if not copies:
            copies.append(keep_pose(state))
        if len(views) >= options.max_views:
            gone = views.pop(1)  # the first has the longest baseline
            self.dropped += 1
            self._release(state, [gone])
        views.append(View(reading, copies[0]))

    def placed(self, state: State, landmark: int) -> None:
        """Forget what waits for a landmark that is in the state now."""
        keys = [key for key in self.views if key[0] == landmark]
        gone = [view for key in keys for view in self.views.pop(key)]
        self._release(state, gone)

    def _release(self, state: State, gone: list[View]) -> None:
        """Remove poses from the state that no landmark waits with."""
        needed = {view.pose for views in self.views.values() for view in views}
        state.remove({view.pose for view in gone if view.pose is not state.robot} - needed)

    @staticmethod
    def _moved(state: State, view: View) -> float:
        x, y = state.mean[view.pose.start : view.pose.start + 2] - state.mean[:2]
        return float(np.hypot(x, y))

    @property
    def readings(self) -> int:
        """Number of readings that wait."""
        return sum(len(views) for views in self.views.values())
