"""End to end: optima of simulated graphs are as far from the truth as their covariances say, over many seeds."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import slamcli
from slamcli.cli.main import main
from slamcli.evaluation.consistency import chi2_band
from slamcli.formats.covariances import read_all_covariances
from slamcli.geometry import se2, se3
from slamcli.simulation.settings import scenario_of
from slamcli.simulation.simulate import simulate
from slamcli.solver.covariance import CovarianceRecovery

SEEDS = 100
#: Small noise, for which a linearization holds.
WORLDS = {
    "planar": {"world": "manhattan", "poses": 60, "robot": {"noise": [0.02, 0.02, 0.005]}},
    "spatial": {"world": "sphere", "poses": 60, "robot": {"noise": [0.01, 0.01, 0.01, 0.004, 0.004, 0.004]}},
    "landmarks": {
        "world": "circle",
        "poses": 40,
        "robot": {"noise": [0.02, 0.02, 0.005]},
        "landmarks": {"count": 15},
        "sensors": [{"kind": "xy", "range": 15, "noise": [0.05, 0.05]}],
    },
}


def errors(kind: str, estimate: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Steps from the estimate to the truth, in the tangent space of the covariances."""
    return {"SE2": se2.local, "SE3": se3.local}.get(kind, lambda x, y: y - x)(estimate, truth)


@pytest.mark.parametrize("name", WORLDS)
def test_mean_nees_over_seeds(name: str) -> None:
    """Of the last variable of each kind, one number a seed, so that the band of independent numbers holds.

    The joint NEES of all variables, e^T H e, has nearly one degree of freedom for each unknown: a narrow band.
    """
    nees: dict[str, list[float]] = {}
    joint, unknowns = 0.0, 0
    for seed in range(SEEDS):
        simulation = simulate(scenario_of({**WORLDS[name], "seed": seed}, "test"))
        graph = slamcli.optimize(simulation.graph, method="gn", init="file").graph
        recovery = CovarianceRecovery(graph)
        whole = []
        for kind, covariance in recovery.marginals().items():
            column = graph.variables[kind]
            true = simulation.truth.variables[kind]
            error = errors(kind, column.values, true.values[true.rows_of(column.ids)])
            whole.append(error[~recovery.held[kind]].ravel())
            nees.setdefault(kind, []).append(float(error[-1] @ np.linalg.solve(covariance[-1], error[-1])))
        assert recovery.problem is not None
        pattern = recovery.problem.pattern
        joint += pattern.quadratic_form(recovery.problem.linearize(graph.values).hessian, np.concatenate(whole))
        unknowns += pattern.dimension
    for kind, values in nees.items():
        size = graph.variables[kind].kind.dimension
        low, high = chi2_band(size * SEEDS, 0.99)
        assert low <= sum(values) <= high, (kind, sum(values) / SEEDS)
    low, high = chi2_band(unknowns, 0.99)
    assert low <= joint <= high, joint / unknowns


def test_the_commands_together(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """simulate, optimize --covariances, evaluate --covariances, plot --covariances: npz, CSV and JSON say the same."""
    graph, truth, optimum = (str(tmp_path / name) for name in ("graph.g2o", "truth.g2o", "optimum.g2o"))
    setting = ["--set", "robot.noise=[0.02, 0.02, 0.005]"]
    assert main(["simulate", "manhattan", "--poses", "80", *setting, "-o", graph, "--truth", truth, "-q"]) == 0
    found = []
    for ending in ("npz", "csv", "json"):
        path = str(tmp_path / f"covariances.{ending}")
        assert main(["optimize", graph, "-o", optimum, "--covariances", path, "-q"]) == 0
        (table,) = read_all_covariances(path)
        found.append(table.covariance)
        capsys.readouterr()
        assert main(["evaluate", optimum, "--truth", truth, "--covariances", path, "--json"]) == 0
        scores = json.loads(capsys.readouterr().out)["estimates"][0]["nees"]
        assert scores["count"] == 79 and 0.0 < scores["mean"] < 15.0
        again = str(tmp_path / f"again.{ending}")
        assert main(["covariance", optimum, "-o", again]) == 0
        np.testing.assert_allclose(read_all_covariances(again)[0].covariance, table.covariance, rtol=1e-9, atol=1e-15)
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0], found[2])
    picture = str(tmp_path / "map.png")
    assert main(["plot", optimum, "--covariances", str(tmp_path / "covariances.npz"), "-o", picture]) == 0
