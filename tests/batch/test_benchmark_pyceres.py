"""Ceres with slamcli's residuals: the cost is half of chi2, the Jacobians are those of the numbers of a value."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from support import BUNDLED, vectors, write_file

pytest.importorskip("pyceres")

import slamcli
from slamcli.batch.benchmark.case import Case
from slamcli.batch.benchmark.peers.pyceres import EDGES, EdgeCost, Peer, _roots, parts
from slamcli.batch.benchmark.peers.settings import tried
from slamcli.graph.columns import Factors
from slamcli.models.base import Array

#: One camera of BAL, turned, and one point.
SCENE = "1 1 1\n0 0 1.5 -2.5\n" + "0.1 -0.2 0.3 0.4 0.5 -0.6 100 0.01 0.001 0.3 0.2 -3".replace(" ", "\n") + "\n"


def evaluated(factors: Factors, values: list[Array]) -> tuple[Array, list[Array]]:
    """Residual and Jacobians (d, size) by slot, as Ceres gets them."""
    cost = EdgeCost(factors, _roots(factors)[0])
    kinds = factors.kind.variables
    bounds = [np.cumsum([0, *parts(kind)]) for kind in kinds]
    pairs = zip(values, bounds, strict=True)
    blocks = [value[a:b].copy() for value, ends in pairs for a, b in pairwise(ends.tolist())]
    assert cost.parameter_block_sizes() == [len(block) for block in blocks]
    residual, alone = np.empty(factors.kind.dimension), np.empty(factors.kind.dimension)
    jacobians = [np.empty(len(residual) * len(block)) for block in blocks]
    assert cost.Evaluate(blocks, residual, jacobians) and cost.Evaluate(blocks, alone, None)
    assert residual == pytest.approx(alone, abs=1e-12)
    wide = iter(jacobian.reshape(len(residual), -1) for jacobian in jacobians)
    return residual, [np.hstack([next(wide) for _ in parts(kind)]) for kind in kinds]


def graphs(tmp_path: Path) -> list[slamcli.FactorGraph]:
    return [
        slamcli.read(str(write_file(tmp_path, vectors))),
        slamcli.read(str(write_file(tmp_path, SCENE, "scene.txt"))),
    ]


def test_jacobians_against_finite_differences(tmp_path: Path) -> None:
    """Along every tangent step: J (x(step) - x) is the change of the residual."""
    seen = set()
    for graph in graphs(tmp_path):
        for factors in graph.factors:
            if any(kind.space == 0 for kind in factors.kind.variables):
                continue
            one = factors.part(slice(0, 1))
            values = [column[0].astype(float) for column in one.gather(graph.values)]
            residual, jacobians = evaluated(one, values)
            assert residual @ residual == pytest.approx(one.chi2(graph.values)[0], rel=1e-12)
            for slot, kind in enumerate(factors.kind.variables):
                seen.add(kind.name)
                for k in range(kind.dimension):
                    moved = []
                    for step in (1e-6, -1e-6):
                        delta = np.zeros((1, kind.dimension))
                        delta[0, k] = step
                        moved.append(kind.retract(values[slot][None], delta)[0])
                    ahead, behind = (evaluated(one, [*values[:slot], x, *values[slot + 1 :]])[0] for x in moved)
                    expected = jacobians[slot] @ (moved[0] - moved[1])
                    scale = max(1.0, np.abs(residual).max())
                    assert (ahead - behind) / 2e-6 == pytest.approx(expected / 2e-6, rel=1e-5, abs=1e-6 * scale)
    assert {"SE2", "SE3", "XY", "XYZ", "CAMERA"} <= seen


@pytest.mark.parametrize("name", ["landmarks_small", "sphere_small"])
def test_ceres_ends_where_slamcli_does(name: str) -> None:
    path = BUNDLED / f"{name}.g2o"
    case = Case(str(path), slamcli.optimize(slamcli.read(str(path))).final_chi2)
    course: list[float] = []
    trial = Peer(case).run(tried("pyceres")[0], 20, course)
    assert case.reached(trial.chi2)
    assert course[-1] == pytest.approx(trial.chi2, rel=1e-9), "twice the cost of Ceres is our chi2"
    assert "in costs called in Python" in trial.note
    held = case.held
    for kind, column in case.graph.variables.items():
        assert np.array_equal(trial.values[kind][held[kind]], column.values[held[kind]])


def test_what_would_take_minutes_is_left_out() -> None:
    case = Case(str(BUNDLED / "manhattan_small.g2o"), 0.0)
    (factors,) = case.graph.factors
    many = np.zeros(EDGES + 1, dtype=np.intp)
    case.graph = replace(case.graph, factors=[factors.part(many)])
    with pytest.raises(ValueError, match=f"left out above {EDGES} edges"):
        Peer(case)
