"""GTSAM on a pose graph: GN and LM, COLAMD and METIS, its chordal and LAGO starts.

GTSAM's residual is the logarithm of the whole error pose, rotation first. A g2o file's information of rotations is that
of half the rotation vector, so it is handed over divided by 4 (2 where it meets translations). Both costs then agree
to second order, but not beyond; so GTSAM's optimum is looked for in its own cost and polished for ours.
"""

from __future__ import annotations

import contextlib
import time
from typing import Any

import gtsam
import numpy as np

from slamcli.batch.benchmark.case import Case, Trial
from slamcli.batch.benchmark.peers.settings import Setting
from slamcli.graph.columns import Values
from slamcli.models.base import Array

#: Order and scale from (t, vector part of q) to (rotation vector, t).
_ORDER = np.array([3, 4, 5, 0, 1, 2])
_SCALE = np.array([0.5, 0.5, 0.5, 1.0, 1.0, 1.0])


class Peer:
    """GTSAM with the graph loaded."""

    def __init__(self, case: Case) -> None:
        self.case = case
        self.graph = gtsam.NonlinearFactorGraph()
        spatial = case.space == 3
        between = gtsam.BetweenFactorPose3 if spatial else gtsam.BetweenFactorPose2
        information = case.information
        if spatial:
            information = information[:, _ORDER[:, None], _ORDER] * np.outer(_SCALE, _SCALE)
        for (i, j), measured, weight in zip(case.pairs.tolist(), case.measurements, information, strict=True):
            noise = gtsam.noiseModel.Gaussian.Information(weight)
            self.graph.add(between(i, j, self._pose(measured), noise))
        self.priorless = self.graph
        # The prior fits exactly at any optimum, whatever its weight; a large one costs digits in the factorization.
        self.weight = float(np.median(np.diagonal(information, axis1=1, axis2=2)))
        self.graph = self._held(self.priorless, case.start("file")[0])
        self.diagonal = self.graph if spatial else self._with_diagonal_noise()

    def _held(self, priorless: Any, poses: Array) -> Any:
        """A graph with priors that hold what we hold where these poses are."""
        graph = gtsam.NonlinearFactorGraph(priorless)
        prior = gtsam.PriorFactorPose3 if self.case.space == 3 else gtsam.PriorFactorPose2
        noise = gtsam.noiseModel.Isotropic.Precision(6 if self.case.space == 3 else 3, self.weight)
        for rank in self.case.held_ranks:
            graph.add(prior(rank, self._pose(poses[rank]), noise))
        return graph

    def _with_diagonal_noise(self) -> Any:
        """The graph for LAGO, which takes no other."""
        graph = gtsam.NonlinearFactorGraph()
        weights = np.diagonal(self.case.information, axis1=1, axis2=2)
        for (i, j), measured, weight in zip(self.case.pairs.tolist(), self.case.measurements, weights, strict=True):
            noise = gtsam.noiseModel.Diagonal.Precisions(weight)
            graph.add(gtsam.BetweenFactorPose2(i, j, self._pose(measured), noise))
        return self._held(graph, self.case.start("file")[0])

    def _pose(self, row: Array) -> Any:
        if self.case.space == 2:
            return gtsam.Pose2(*row.tolist())
        x, y, z, qx, qy, qz, qw = row.tolist()
        return gtsam.Pose3(gtsam.Rot3.Quaternion(qw, qx, qy, qz), np.array([x, y, z]))

    def _values(self, poses: Array) -> Any:
        values = gtsam.Values()
        for rank, row in enumerate(poses):
            values.insert(rank, self._pose(row))
        return values

    def _poses(self, values: Any) -> Array:
        if self.case.space == 2:
            return np.asarray(gtsam.utilities.extractPose2(values))
        rows = [values.atPose3(rank) for rank in range(len(self.case.column))]
        quaternions = [pose.rotation().toQuaternion() for pose in rows]
        return np.array(
            [[*p.translation(), q.x(), q.y(), q.z(), q.w()] for p, q in zip(rows, quaternions, strict=True)]
        )

    def own_best(self, optimum: Values) -> float:
        """Its cost (without the prior, which fits exactly) where its own iterations end from the best known optimum.

        That may lie above its cost at our optimum: its derivatives leave out that of the logarithm, and so a fixed
        point of its iterations is no exact minimum of its cost.
        """
        poses = self.case.poses(optimum)
        values = self._values(poses)
        optimizer = gtsam.GaussNewtonOptimizer(self._held(self.priorless, poses), values, gtsam.GaussNewtonParams())
        with contextlib.suppress(RuntimeError):  # then the last cost stands in
            for _ in range(15):  # not optimize(), which stops at the first rise
                optimizer.iterate()
        return float(self.priorless.error(optimizer.values()))

    def run(self, setting: Setting, count: int, course: list[float] | None) -> Trial:
        """One run; with a course, iteration by iteration, until nothing changes any more."""
        start, seconds = None, 0.0
        if not setting.start.startswith("own"):
            poses, seconds = self.case.start(setting.start)
            start = self._values(poses)
        started = time.perf_counter()
        if start is None:
            start = self._initialized(setting)
        optimizer = self._optimizer(setting, start, count)
        values = self._watched(optimizer, count, course) if course is not None else optimizer.optimize()
        seconds += time.perf_counter() - started
        ended, own = self.case.values(self._poses(values)), self.priorless.error(values)
        return Trial(self.case, ended, seconds, optimizer.iterations(), own)

    def _initialized(self, setting: Setting) -> Any:
        if self.case.space == 2:
            return gtsam.lago.initialize(self.diagonal, setting.start == "own")
        if setting.start == "own-tree":
            raise ValueError("planar graphs only")
        return gtsam.InitializePose3.initialize(self.graph)

    def _optimizer(self, setting: Setting, start: Any, count: int) -> Any:
        optimizer: Any = gtsam.GaussNewtonOptimizer
        parameters: Any
        if setting.method == "gn":
            parameters = gtsam.GaussNewtonParams()
        else:
            optimizer = gtsam.LevenbergMarquardtOptimizer
            ceres = setting.method == "lm-ceres"
            make = gtsam.LevenbergMarquardtParams
            parameters = make.CeresDefaults() if ceres else make.LegacyDefaults()
        parameters.setMaxIterations(count)
        parameters.setRelativeErrorTol(0.0)
        parameters.setAbsoluteErrorTol(0.0)
        parameters.setOrderingType(setting.solver)
        return optimizer(self.graph, start, parameters)

    def _watched(self, optimizer: Any, count: int, course: list[float]) -> Any:
        best_error, best_values = optimizer.error(), gtsam.Values(optimizer.values())  # a copy: it changes in place
        stale = 0
        for _ in range(count):
            optimizer.iterate()
            error = optimizer.error()
            course.append(self.priorless.error(optimizer.values()))
            stale = 0 if error < best_error * (1.0 - 1e-10) else stale + 1
            if error < best_error:
                best_error, best_values = error, gtsam.Values(optimizer.values())
            if stale == 3 or not np.isfinite(error):
                break
        return best_values
