"""What the filter estimated, as other commands want it: a graph of vertices, a trajectory."""

from __future__ import annotations

from itertools import islice

import numpy as np

from slamcli.filtering.result import EkfResult
from slamcli.graph import FactorGraph, Variables
from slamcli.graph.columns import IdArray
from slamcli.graph.trajectory import Trajectory
from slamcli.models import SE2, XY

_LARGEST = 2**63 - 1


def estimated_graph(result: EkfResult) -> FactorGraph:
    """The poses as they were estimated at their steps, and the landmarks at the end; no factors.

    Landmarks have the ids of the log; those without one, and further ones with an id that is taken, get new ids, which
    neither the log nor its truth has (the smallest that the graph does not have, where there is nothing above those).
    """
    variables = {SE2.name: Variables.made(SE2, result.ids, result.poses)}
    if len(result.landmarks):
        variables[XY.name] = Variables.made(XY, landmark_ids(result), result.landmarks.positions)
    return FactorGraph(variables, [])


def estimated_trajectory(result: EkfResult, source: str) -> Trajectory:
    """The poses as they were estimated at their steps, with ids and time stamps, and the graph of the landmarks."""
    return Trajectory(SE2, result.poses, result.ids, result.times, source, estimated_graph(result))


def landmark_ids(result: EkfResult) -> IdArray:
    """Unique ids (k,) of the landmarks; see ``estimated_graph``."""
    ids = result.landmarks.ids.astype(np.int64)
    first = np.zeros(len(ids), dtype=bool)
    first[np.unique(ids, return_index=True)[1]] = True
    unnamed = ~first | (ids < 0)
    count = int(np.count_nonzero(unnamed))
    taken = {int(known) for column in (result.ids, ids) for known in column.tolist()}
    new = max(result.free_id, max(taken, default=-1) + 1)
    if new + count > _LARGEST:
        ids[unnamed] = list(islice((k for k in range(_LARGEST) if k not in taken), count))
    else:
        ids[unnamed] = new + np.arange(count)
    return ids
