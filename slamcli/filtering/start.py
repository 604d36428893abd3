"""The state before the first step, and whether log and options fit together."""

from __future__ import annotations

import numpy as np

from slamcli.errors import UsageError
from slamcli.filtering.compressed import CompressedState
from slamcli.filtering.options import EkfOptions
from slamcli.filtering.readings import Stream
from slamcli.filtering.state import POSE, State
from slamcli.graph.sensor_log import SensorLog

#: Landmarks that may wait for their place at the same time without more memory being reserved.
_WAITING = 16


def start_state(log: SensorLog, options: EkfOptions, streams: list[Stream]) -> State:
    """The state before the first step, with room for all landmarks if their number is known."""
    covariance = np.diag(np.square(np.asarray(options.start_deviations, dtype=np.float64)))
    capacity = 64
    if options.association == "known":
        landmarks = {landmark for stream in streams for landmark in stream.landmarks if landmark >= 0}
        waits = any(not stream.places for stream in streams)
        capacity = POSE + 2 * len(landmarks) + 2 + waits * POSE * options.max_views * min(len(landmarks), _WAITING)
    start = np.asarray(log.start, dtype=np.float64)
    if not options.compressed:
        return State(start, covariance, capacity)
    distances = np.concatenate([np.empty(0), *(stream.distance[stream.in_range] for stream in streams)])
    distances = distances[np.isfinite(distances)]
    radius = options.area_radius
    if radius is None:
        if len(distances) == 0:
            raise UsageError("bearings have no distance: a compressed filter needs area_radius for them")
        radius = 2.0 * float(distances.max())
    return CompressedState(start, covariance, capacity, radius)


def require_places(streams: list[Stream]) -> None:
    """Raises ``UsageError`` where readings of unknown landmarks do not place them."""
    for stream in streams:
        if not stream.places and stream.landmarks:
            raise UsageError(
                f"{stream.sensor.name} readings do not place a landmark, and cannot be associated by distance",
                ("  use the association known, with the ids of the log",),
            )
