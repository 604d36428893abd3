"""g2o (the wheel g2opy, which has Eigen's sparse Cholesky only) on a pose graph: GN, LM, dogleg, its spanning tree."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

import g2opy as g2o
import numpy as np

from slamcli.batch.benchmark.case import Case, Trial
from slamcli.batch.benchmark.peers.settings import Setting
from slamcli.graph.columns import Values
from slamcli.models.base import Array

_METHODS = {
    "gn": g2o.OptimizationAlgorithmGaussNewton,
    "lm": g2o.OptimizationAlgorithmLevenberg,
    "dogleg": g2o.OptimizationAlgorithmDogleg,
}
#: Relative decrease at which the search for the fewest iterations stops.
GAIN = 1e-10


class Peer:
    """g2o with the graph in a file of its own, all digits in it: every run loads it anew."""

    def __init__(self, case: Case) -> None:
        self.case = case
        self._folder = tempfile.TemporaryDirectory()
        self.path = Path(self._folder.name) / "graph.g2o"
        vertex, edge = ("VERTEX_SE2", "EDGE_SE2") if case.space == 2 else ("VERTEX_SE3:QUAT", "EDGE_SE3:QUAT")
        upper = np.triu_indices(case.column.kind.dimension)
        weights = case.information[:, upper[0], upper[1]]
        lines = [f"{vertex} {k} {_words(row)}\n" for k, row in enumerate(case.start("file")[0])]
        lines += [
            f"{edge} {i} {j} {_words(measured)} {_words(weight)}\n"
            for (i, j), measured, weight in zip(case.pairs.tolist(), case.measurements, weights, strict=True)
        ]
        self.path.write_text("".join(lines), encoding="ascii")

    def own_best(self, optimum: Values) -> None:
        """Its cost is ours."""

    def run(self, setting: Setting, count: int, course: list[float] | None) -> Trial:
        """One run; with a course, iteration by iteration, until nothing changes any more."""
        optimizer, seconds = self._loaded(setting)
        for rank in self.case.held_ranks:
            optimizer.vertex(rank).set_fixed(True)
        if setting.start in ("spanning-tree", "chordal"):
            poses, seconds = self.case.start(setting.start)
            for rank, row in enumerate(poses):
                optimizer.vertex(rank).set_estimate_data(row)
        action = g2o.SparseOptimizerTerminateAction()  # kept alive until the run is over
        if course is not None:
            action.set_gain_threshold(GAIN)
            optimizer.add_post_iteration_action(action)
            optimizer.set_compute_batch_statistics(True)
        started = time.perf_counter()
        optimizer.initialize_optimization()
        if setting.start == "own":
            optimizer.compute_initial_guess()
        done = optimizer.optimize(count)
        seconds += time.perf_counter() - started
        if course is not None:
            course += [step.chi2 for step in optimizer.batch_statistics() if step.iteration >= 0]
        ended = np.array([optimizer.vertex(k).get_estimate_data() for k in range(len(self.case.column))])
        return Trial(self.case, self.case.values(ended), seconds, done)

    def _loaded(self, setting: Setting) -> tuple[Any, float]:
        optimizer = g2o.SparseOptimizer()
        if self.case.space == 2:
            linear, block = g2o.LinearSolverEigenSE2(), g2o.BlockSolverSE2
        else:
            linear, block = g2o.LinearSolverEigenSE3(), g2o.BlockSolverSE3
        linear.set_block_ordering(setting.solver == "Eigen-block")
        optimizer.set_algorithm(_METHODS[setting.method](block(linear)))
        optimizer.load(str(self.path))
        return optimizer, 0.0


def _words(numbers: Array) -> str:
    return " ".join(map(repr, numbers.tolist()))
