"""How time and memory of filter and smoother grow with the number of landmarks.

The world is a square street of one landmark for each metre, so that a larger one is more of the same: readings for
each landmark and landmarks in view stay as they are. The robot drives round it once and a fifth of a second time, in
which the filter has all landmarks: the updates of this part are timed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from slamcli.batch.closing import head
from slamcli.batch.smoother import smooth
from slamcli.errors import UsageError
from slamcli.evaluation.monte_carlo import simulated_log
from slamcli.filtering.options import EkfOptions
from slamcli.filtering.run import run
from slamcli.graph.sensor_log import SensorLog
from slamcli.models.base import Array
from slamcli.simulation.scenario import Landmarks, Robot, Scenario, Sensor

LEAST = 20
#: Readings are made at every so manieth metre, of landmarks within so many metres.
_EVERY, _RANGE = 4, 5.0
#: Metres of the second lap, at least.
_LEAST_AGAIN = 40


@dataclass(frozen=True)
class ScalingPoint:
    """Filter and smoother in one world.

    Attributes
    ----------
    landmarks, poses, readings
        In the world.
    updates
        Updates that were timed: those of the filter with all landmarks.
    update_seconds
        Their median time.
    filter_seconds, smoother_seconds
        Of the whole run of each.
    filter_bytes
        8 for each entry of the covariance.
    nnz_factor
        Nonzeros of the smoother's factor L.
    smoother_bytes
        8 for each of them.
    iterations, iteration_seconds
        Of the smoother, and the median time of one.
    """

    landmarks: int
    poses: int
    readings: int
    updates: int
    update_seconds: float
    filter_seconds: float
    smoother_seconds: float
    filter_bytes: int
    nnz_factor: int
    smoother_bytes: int
    iterations: int
    iteration_seconds: float


@dataclass(frozen=True)
class Fit:
    """A power law y = c N^exponent, by least squares on logarithms.

    Attributes
    ----------
    exponent
        Its slope.
    error
        Standard error of the slope; None for fewer than three points.
    last
        Slope between the two largest N: fixed costs hide the growth at small ones.
    """

    exponent: float
    error: float | None
    last: float


#: What is fitted.
FITTED = (
    "update_seconds",
    "filter_seconds",
    "filter_bytes",
    "iteration_seconds",
    "smoother_seconds",
    "smoother_bytes",
)


@dataclass(frozen=True)
class Scaling:
    """All worlds and the fits.

    Attributes
    ----------
    points
        By number of landmarks.
    fits
        For each name of ``FITTED``.
    """

    points: list[ScalingPoint]
    fits: dict[str, Fit]


def scenario(landmarks: int, seed: int) -> Scenario:
    """Two laps through the world with so many landmarks."""
    return Scenario(
        world="square",
        poses=2 * _lap(landmarks) + 1,
        seed=seed,
        path={"laps": 2},
        robot=Robot(noise=[0.02, 0.02, 0.002]),
        landmarks=Landmarks(count=landmarks),
        sensors=(Sensor(kind="range-bearing", range=_RANGE, noise=[0.1, 0.01], every=_EVERY),),
    )


def _lap(landmarks: int) -> int:
    """Steps of one metre round the square."""
    return 4 * -(-landmarks // 4)


def scaling(
    counts: Sequence[int],
    options: Callable[[SensorLog], EkfOptions] = lambda log: EkfOptions(),
    *,
    seed: int = 0,
    tick: Callable[[], None] = lambda: None,
) -> Scaling:
    """Measure worlds of so many landmarks each.

    Parameters
    ----------
    counts
        At least two different numbers.
    options
        Makes the options for a log.
    seed
        Of the worlds.
    tick
        Called after each.

    Raises
    ------
    UsageError
        If there are fewer than two numbers, or one is too small.
    """
    sizes = sorted(set(counts))
    if len(sizes) < 2 or sizes[0] < LEAST:
        raise UsageError(f"scaling needs at least two numbers of landmarks, each at least {LEAST}, got {list(counts)}")
    points = []
    for size in sizes:
        points.append(_point(size, options, seed))
        tick()
    landmarks = np.array([point.landmarks for point in points], dtype=np.float64)
    fits = {name: fit(landmarks, np.array([getattr(p, name) for p in points], dtype=np.float64)) for name in FITTED}
    return Scaling(points, fits)


def fit(x: Array, y: Array) -> Fit:
    """The power law through positive points (n,), at least two of them, x ascending."""
    u, v = np.log(x), np.log(y)
    centred = u - u.mean()
    spread = float(centred @ centred)
    slope = float(centred @ v) / spread
    last = float((v[-1] - v[-2]) / (u[-1] - u[-2]))
    if len(x) < 3:
        return Fit(slope, None, last)
    rest = v - v.mean() - slope * centred
    return Fit(slope, float(np.sqrt(rest @ rest / (len(x) - 2) / spread)), last)


def _point(landmarks: int, options_of: Callable[[SensorLog], EkfOptions], seed: int) -> ScalingPoint:
    last = _lap(landmarks) + max(_lap(landmarks) // 5, _LEAST_AGAIN)
    log = head(simulated_log(scenario(landmarks, seed)), last, last)
    options = options_of(log)
    result = run(log, options)
    smoothed = smooth(log, options, result)
    sparsity = smoothed.result.sparsity
    assert sparsity is not None
    assert sparsity.nnz_factor is not None  # few landmarks: nothing is left to conjugate gradients
    full = result.updates.dimension >= result.updates.dimension.max()
    return ScalingPoint(
        landmarks=len(result.landmarks),
        poses=len(log),
        readings=sum(len(entry) for entry in log.observations),
        updates=int(np.count_nonzero(full)),
        update_seconds=float(np.median(result.updates.seconds[full])),
        filter_seconds=result.seconds,
        smoother_seconds=smoothed.seconds,
        filter_bytes=result.covariance_bytes,
        nnz_factor=sparsity.nnz_factor,
        smoother_bytes=8 * sparsity.nnz_factor,
        iterations=smoothed.result.iterations,
        iteration_seconds=float(np.median([record.time for record in smoothed.result.trace])),
    )
