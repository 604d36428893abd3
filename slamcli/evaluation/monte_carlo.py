"""Consistency of the filter over many simulated runs: the mean NEES of every step, with its band (ANEES).

With N runs the NEES of a step, three numbers each, sums up to a chi-square variable of 3 N degrees of freedom if the
filter knows its own errors (Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and Navigation",
2001, section 5.4). Above the band the filter is too sure of itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from slamcli.evaluation.consistency import chi2_band
from slamcli.evaluation.filter_run import CONFIDENCE
from slamcli.filtering.options import EkfOptions
from slamcli.filtering.run import run
from slamcli.geometry import se2
from slamcli.graph.graph_log import graph_log
from slamcli.graph.sensor_log import SensorLog
from slamcli.graph.trajectory import of_graph
from slamcli.models import XY
from slamcli.models.base import Array
from slamcli.simulation.scenario import Scenario
from slamcli.simulation.simulate import simulate


@dataclass(frozen=True, eq=False)
class MonteCarlo:
    """Mean errors of many runs.

    Attributes
    ----------
    runs
        Number of seeds.
    nees
        (t,) mean NEES of each step over the runs, over its three degrees of freedom; 1 is expected. NaN at step 0.
    band
        In which a step's lies with a probability of 95 %.
    position_rmse, heading_rmse
        (t,) of each step over the runs: metres, degrees.
    position_sigma
        (t,) what the filter says: root of the mean of the variances along both axes, added up.
    nis
        Mean NIS of all updates of all runs over their degrees of freedom; NaN without updates.
    """

    runs: int
    nees: Array
    band: tuple[float, float]
    position_rmse: Array
    heading_rmse: Array
    position_sigma: Array
    nis: float

    @property
    def mean(self) -> float:
        """Mean of ``nees`` over the steps."""
        return float(np.nanmean(self.nees))

    @property
    def inside(self) -> float:
        """Share of the steps within the band; 0.95 is expected."""
        return float(np.mean((self.nees[1:] >= self.band[0]) & (self.nees[1:] <= self.band[1])))


def simulated_log(scenario: Scenario) -> SensorLog:
    """The log of a simulation, with its truth.

    Raises
    ------
    InputError
        If it has no landmarks or is not planar.
    """
    simulation = simulate(scenario)
    log = graph_log(simulation.graph)
    truth = simulation.truth
    landmarks = truth.variables.get(XY.name)
    return replace(
        log,
        start=of_graph(truth).poses[0],
        true_trajectory=of_graph(truth, "truth"),
        true_landmarks=None if landmarks is None else (landmarks.ids, landmarks.values),
        source=f"{scenario.world}, seed {scenario.seed}",
    )


def monte_carlo(
    scenarios: Sequence[Scenario],
    options: Callable[[SensorLog], EkfOptions],
    *,
    jobs: int = 1,
    tick: Callable[[], None] = lambda: None,
) -> MonteCarlo:
    """Run the filter on every scenario, on several processes, and average.

    Parameters
    ----------
    scenarios
        At least one; they differ in their seeds.
    options
        Makes the options for a log.
    jobs
        Number of processes.
    tick
        Called after each run.
    """
    if jobs == 1:
        found = map(_errors, ((scenario, options) for scenario in scenarios))
    else:
        from joblib import Parallel, delayed

        found = Parallel(n_jobs=jobs, return_as="generator")(delayed(_errors)((s, options)) for s in scenarios)
    total: list[Array] = []
    innovations = np.zeros(2)
    for sums, nis in found:
        total = list(sums) if not total else [a + b for a, b in zip(total, sums, strict=True)]
        innovations += nis
        tick()
    runs = len(scenarios)
    nees, squared, turned, variance = (part / runs for part in total)
    low, high = chi2_band(3 * runs, CONFIDENCE)
    return MonteCarlo(
        runs=runs,
        nees=nees / 3.0,
        band=(low / (3 * runs), high / (3 * runs)),
        position_rmse=np.sqrt(squared),
        heading_rmse=np.degrees(np.sqrt(turned)),
        position_sigma=np.sqrt(variance),
        nis=float(innovations[0] / innovations[1]) if innovations[1] else float("nan"),
    )


def _errors(task: tuple[Scenario, Callable[[SensorLog], EkfOptions]]) -> tuple[tuple[Array, ...], Array]:
    """Of one run: NEES (NaN where the pose is known), squared errors of position and heading, variances; NIS."""
    scenario, options = task
    log = simulated_log(scenario)
    result = run(log, options(log))
    assert log.true_trajectory is not None
    error = se2.local(log.true_trajectory.poses, result.poses)
    # the covariance is of steps of the estimate in its own frame
    own = -se2.local(result.poses, log.true_trajectory.poses)
    nees = np.full(len(own), np.nan)
    known = np.linalg.eigvalsh(result.covariances)[:, 0] <= 0.0
    solved = np.linalg.solve(result.covariances[~known], own[~known, :, None])[:, :, 0]
    nees[~known] = (own[~known] * solved).sum(axis=1)
    squared = np.square(error[:, :2]).sum(axis=1)
    variance = result.covariances[:, 0, 0] + result.covariances[:, 1, 1]
    nis = np.array([result.updates.nis.sum(), result.updates.degrees_of_freedom.sum()])
    return (nees, squared, np.square(error[:, 2]), variance), nis
