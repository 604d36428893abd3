"""Which pose of an estimate belongs to which pose of the truth: by id, by time stamp or by position in the file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.errors import InputError, UsageError
from slamcli.graph.columns import IdArray, IndexArray
from slamcli.graph.trajectory import Trajectory
from slamcli.models.base import Array

METHODS = ("auto", "id", "time", "index")
#: Seconds by which the time stamps of two poses that belong together may differ.
MAX_TIME_DIFFERENCE = 0.01


@dataclass(frozen=True, eq=False)
class Association:
    """Pairs of poses.

    Attributes
    ----------
    method
        ``"id"``, ``"time"`` or ``"index"``.
    estimate, truth
        (k,) rows of the poses that belong together. By time, a pose of the longer trajectory may be the nearest of
        several; every other row occurs once.
    unmatched_estimate, unmatched_truth
        How many poses have no partner.
    reused
        How many pairs take a pose that an earlier pair has taken.
    largest_time_difference
        Seconds between the stamps of the worst pair, None for other methods.
    """

    method: str
    estimate: IndexArray
    truth: IndexArray
    unmatched_estimate: int
    unmatched_truth: int
    reused: int = 0
    largest_time_difference: float | None = None

    def __len__(self) -> int:
        return len(self.estimate)


def associate(
    estimate: Trajectory, truth: Trajectory, method: str = "auto", max_time_difference: float = MAX_TIME_DIFFERENCE
) -> Association:
    """Pair the poses of two trajectories.

    Parameters
    ----------
    estimate, truth
        The trajectories.
    method
        ``"id"``: equal ids; whole time stamps stand in for ids that a file does not have. ``"time"``: each pose of
        the shorter trajectory and its nearest neighbour in the other, as evo does. ``"index"``: the first with the
        first, and so on, as far as both go. ``"auto"``: by time where both have stamps, else by id where both have
        ids, else by index where a file has neither (KITTI) and both have equally many poses.
    max_time_difference
        Seconds, for ``"time"``.

    Raises
    ------
    InputError
        If the files do not hold what the method needs, or no pose has a partner.
    UsageError
        If there is no such method, or the time difference is not a number of at least 0.
    """
    if method not in METHODS:
        raise UsageError(f"unknown way to associate poses {method!r}", (f"  one of: {', '.join(METHODS)}",))
    if not max_time_difference >= 0.0:
        raise UsageError(f"the largest time difference must be at least 0, got {max_time_difference}")
    chosen = _choose(estimate, truth) if method == "auto" else method
    largest = None
    if chosen == "time":
        rows_estimate, rows_truth, largest = _by_time(estimate, truth, max_time_difference)
    elif chosen == "id":
        rows_estimate, rows_truth = _by_id(estimate, truth)
    else:
        rows_estimate = rows_truth = np.arange(min(len(estimate), len(truth)))
    if len(rows_estimate) == 0:
        raise _no_match(estimate, truth, chosen, max_time_difference)
    used = [len(np.unique(rows)) for rows in (rows_estimate, rows_truth)]
    return Association(
        method=chosen,
        estimate=rows_estimate,
        truth=rows_truth,
        unmatched_estimate=len(estimate) - used[0],
        unmatched_truth=len(truth) - used[1],
        reused=len(rows_estimate) - min(used),
        largest_time_difference=largest,
    )


def match_ids(first: IdArray, second: IdArray) -> tuple[IndexArray, IndexArray]:
    """Rows of equal ids in two arrays of unique ids, in the order of the first."""
    if first.dtype != second.dtype:  # int64 and uint64: numpy would compare them as floats
        low, high = np.flatnonzero(first >= 0), np.flatnonzero(second >= 0)
        a, b = match_ids(first[low].astype(np.uint64), second[high].astype(np.uint64))
        return low[a], high[b]
    if len(first) == 0 or len(second) == 0:
        return np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp)
    order = np.argsort(second, kind="stable")
    place = np.minimum(np.searchsorted(second[order], first), len(second) - 1)
    rows = order[place]
    found = np.flatnonzero(second[rows] == first)
    return found, rows[found]


def nearest_in_time(short: Array, long: Array, limit: float) -> tuple[IndexArray, IndexArray]:
    """Rows of stamps and of their nearest neighbours at most ``limit`` seconds away, of two as near the earlier."""
    order = np.argsort(long, kind="stable")
    sorted_long = long[order]
    after = np.minimum(np.searchsorted(sorted_long, short, side="right"), len(long) - 1)
    before = np.maximum(after - 1, 0)
    to_after, to_before = np.abs(sorted_long[after] - short), np.abs(short - sorted_long[before])
    best = np.where(to_after < to_before, after, before)
    near = np.flatnonzero(np.minimum(to_after, to_before) <= limit)
    return near, order[best[near]]


def _choose(estimate: Trajectory, truth: Trajectory) -> str:
    if estimate.stamps is not None and truth.stamps is not None:
        return "time"
    if _ids(estimate) is not None and _ids(truth) is not None:
        return "id"
    nameless = [t for t in (estimate, truth) if t.ids is None and t.stamps is None]
    if nameless and len(estimate) == len(truth):
        return "index"
    hints = [f"  {_said(estimate)}; {_said(truth)}"]
    if nameless:
        hints.append("  --associate index pairs the first with the first, and so on, as far as both go")
    else:
        hints += [
            "  --timestamps FILE (--truth-timestamps FILE) gives the poses of a graph time stamps, one a line",
            "  --associate index pairs the first with the first, and so on, as far as both go",
        ]
    raise InputError(f"nothing tells which poses of {estimate.source} and {truth.source} belong together", tuple(hints))


def _said(trajectory: Trajectory) -> str:
    """What a trajectory has to name its poses by."""
    has = [name for name, what in (("ids", trajectory.ids), ("time stamps", trajectory.stamps)) if what is not None]
    return f"{trajectory.source} has {len(trajectory)} poses with {' and '.join(has) or 'neither ids nor time stamps'}"


def _ids(trajectory: Trajectory) -> IdArray | None:
    """Ids, or whole time stamps in their place: that is how a graph without stamps is written as TUM."""
    if trajectory.ids is not None or trajectory.stamps is None:
        return trajectory.ids
    stamps = trajectory.stamps
    whole = (stamps == np.floor(stamps)).all() and (np.abs(stamps) < 2.0**53).all()
    ids = stamps.astype(np.int64) if whole else None
    return ids if ids is not None and len(np.unique(ids)) == len(ids) else None


def _by_id(estimate: Trajectory, truth: Trajectory) -> tuple[IndexArray, IndexArray]:
    ids = []
    for trajectory in (estimate, truth):
        found = _ids(trajectory)
        if found is None:
            raise InputError(f"{trajectory.source} has no ids to associate its poses by", (f"  {_said(trajectory)}",))
        ids.append(found)
    return match_ids(ids[0], ids[1])


def _by_time(estimate: Trajectory, truth: Trajectory, limit: float) -> tuple[IndexArray, IndexArray, float | None]:
    for trajectory, option in ((estimate, "--timestamps"), (truth, "--truth-timestamps")):
        if trajectory.stamps is None:
            raise InputError(
                f"{trajectory.source} has no time stamps to associate its poses by",
                (f"  {option} FILE gives them, one a line in the order of the ids",),
            )
    a, b = estimate.stamps, truth.stamps
    assert a is not None and b is not None
    if len(a) > len(b):
        rows_truth, rows_estimate = nearest_in_time(b, a, limit)
    else:
        rows_estimate, rows_truth = nearest_in_time(a, b, limit)
    largest = float(np.abs(a[rows_estimate] - b[rows_truth]).max()) if len(rows_estimate) else None
    return rows_estimate, rows_truth, largest


def _no_match(estimate: Trajectory, truth: Trajectory, method: str, limit: float) -> InputError:
    """Why nothing fits: the ranges of what was compared."""
    what = {"id": "no id in common", "time": f"no time stamps within {limit:g} s of each other", "index": "no poses"}
    details = []
    for trajectory in (estimate, truth):
        if len(trajectory) == 0:
            details.append(f"  {trajectory.source}: no pose")
            continue
        keys = trajectory.stamps if method == "time" else _ids(trajectory)
        if keys is not None:
            low, high = keys.min().item(), keys.max().item()
            details.append(f"  {trajectory.source}: {'ids' if method == 'id' else 'stamps'} {low!r} to {high!r}")
    if method == "time":
        details.append("  clocks that differ? seconds against nanoseconds? --max-time-difference S allows more")
    return InputError(f"{estimate.source} and {truth.source} have {what[method]}", tuple(details))
