"""The smoother beside a filter: all poses and landmarks of the same data at once, from the filter's estimates."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from slamcli.errors import NumericalError
from slamcli.filtering.chain import filled
from slamcli.filtering.controls import displacements
from slamcli.filtering.options import EkfOptions
from slamcli.filtering.result import EkfResult
from slamcli.filtering.smoother_graph import SmootherGraph, smoother_graph
from slamcli.graph.columns import IndexArray
from slamcli.graph.sensor_log import SensorLog
from slamcli.models import SE2, XY
from slamcli.models.base import Array
from slamcli.solver.covariance import recovery_of
from slamcli.solver.optimize import optimize
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.result import Result, Status

#: Far below what a correction of a single reading changes.
_TOLERANCE = 1e-12


@dataclass(frozen=True, eq=False)
class Smoothed:
    """A smoother's solution.

    Attributes
    ----------
    poses
        (t, 3) of all steps, those between kept ones filled in.
    landmarks
        (k, 2) in the order of the filter's landmarks.
    built
        The graph it was made of.
    result
        The optimization.
    method
        ``gn``, or ``lm`` where that failed.
    seconds
        Of making the graph and optimizing it.
    """

    poses: Array
    landmarks: Array
    built: SmootherGraph
    result: Result
    method: str
    seconds: float

    def covariances(self, steps: IndexArray) -> tuple[Array, Array]:
        """Marginal covariances (s, 3, 3) of poses of kept steps, in their frames, and (k, 2, 2) of all landmarks.

        Raises
        ------
        NumericalError
            If H is singular.
        """
        found = recovery_of(self.result).marginals()
        poses = found[SE2.name][np.searchsorted(self.built.kept, steps)]
        return poses, found.get(XY.name, np.empty((0, 2, 2)))


def smooth(log: SensorLog, options: EkfOptions, result: EkfResult) -> Smoothed:
    """The optimum of all that a run of the filter has used.

    Gauss-Newton from the values of ``smoother_graph``; where it does not converge, Levenberg-Marquardt from the same.

    Raises
    ------
    NumericalError
        If neither converges.
    """
    begin = time.perf_counter()
    built = smoother_graph(log, options, result)
    for method in ("gn", "lm"):
        found = optimize(built.graph, options=OptimizeOptions(method, "file", 100, _TOLERANCE))
        if found.status is Status.CONVERGED and not found.final_chi2 > found.initial_chi2:
            break
    else:
        raise NumericalError(f"the smoother of {log.source} did not converge: {found.reason}", found.diagnosis)
    seconds = time.perf_counter() - begin
    values = found.graph.values
    displacement, covariance = displacements(log, options)
    poses = filled(values[SE2.name], displacement, covariance, built.kept)
    return Smoothed(poses, values.get(XY.name, np.empty((0, 2))), built, found, method, seconds)
