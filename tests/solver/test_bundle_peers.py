"""The optimum of a scene beside that of Ceres on the same problem, with a cost function written independently."""

from typing import Any

import numpy as np
import pytest
from bundle_scenes import perturbed, ring
from support import dataset

import slamcli
from slamcli.formats.bal import world_to_camera
from slamcli.geometry import so3
from slamcli.graph import FactorGraph

CAMERA, POINT = 9, 3


def image(unknowns: np.ndarray) -> np.ndarray:
    """Pixels (..., 2) of Snavely's camera by Rodrigues' formula.

    The unknowns (..., 12) are rotation vector, translation, f, k1, k2 and the point; complex numbers go through.
    """
    rotation, translation, f, k1, k2, point = np.split(unknowns, [3, 6, 7, 8, 9], axis=-1)
    angle = np.sqrt((rotation * rotation).sum(axis=-1, keepdims=True))
    axis = rotation / angle
    along = (axis * point).sum(axis=-1, keepdims=True)
    turned = np.cos(angle) * point + np.sin(angle) * np.cross(axis, point) + (1.0 - np.cos(angle)) * along * axis
    p = turned + translation
    q = -p[..., :2] / p[..., 2:]
    square = (q * q).sum(axis=-1, keepdims=True)
    return f * (1.0 + k1 * square + k2 * square * square) * q


def derivatives(unknowns: np.ndarray) -> np.ndarray:
    """(n, 2, 12) by the complex step, exact to rounding."""
    directions = 1e-30j * np.eye(CAMERA + POINT)
    return image(unknowns[:, None] + directions).imag.transpose(0, 2, 1) / 1e-30


def ceres(scene: FactorGraph) -> tuple[float, float]:
    """Cost that Ceres begins and ends with."""
    pyceres = pytest.importorskip("pyceres")

    class Track(pyceres.CostFunction):  # type: ignore[misc, name-defined]
        """All observations of a point."""

        def __init__(self, pixels: np.ndarray) -> None:
            pyceres.CostFunction.__init__(self)
            self.pixels = pixels
            self.set_num_residuals(pixels.size)
            self.set_parameter_block_sizes([CAMERA] * len(pixels) + [POINT])

        def Evaluate(self, parameters: Any, residuals: Any, jacobians: Any) -> bool:
            *cameras, point = map(np.array, parameters)
            unknowns = np.array([np.concatenate([camera, point]) for camera in cameras])
            residuals[:] = (image(unknowns) - self.pixels).ravel()
            if jacobians is not None:
                whole = derivatives(unknowns)
                for k in range(len(cameras)):
                    if jacobians[k] is not None:
                        one = np.zeros((*self.pixels.shape, CAMERA))
                        one[k] = whole[k, :, :CAMERA]
                        jacobians[k][:] = one.ravel()
                if jacobians[-1] is not None:
                    jacobians[-1][:] = whole[:, :, CAMERA:].ravel()
            return True

    turn, translation = world_to_camera(scene.values["CAMERA"])
    cameras = list(np.concatenate([so3.log(turn), translation, scene.values["CAMERA"][:, 7:]], axis=1))
    points = [row.copy() for row in scene.values["XYZ"]]
    (factors,) = scene.factors
    problem, costs = pyceres.Problem(), []
    for k, point in enumerate(points):
        seen = np.flatnonzero(factors.indices[:, 1] == k)
        if len(seen):
            costs.append(Track(factors.measurements[seen]))
            seeing = [cameras[i] for i in factors.indices[seen, 0].tolist()]
            problem.add_residual_block(costs[-1], None, [*seeing, point])
    options, summary = pyceres.SolverOptions(), pyceres.SolverSummary()
    options.linear_solver_type = pyceres.LinearSolverType.DENSE_SCHUR
    options.function_tolerance = 1e-12
    options.max_num_iterations = 100
    options.num_threads = 1
    pyceres.solve(options, problem, summary)
    return summary.initial_cost, summary.final_cost


def test_ceres_ends_at_the_same_cost() -> None:
    scene = perturbed(ring(cameras=4, points=20, share=1.0))
    initial, final = ceres(scene)
    result = slamcli.optimize(scene, tolerance=1e-12)
    assert 0.5 * result.initial_chi2 == pytest.approx(initial, rel=1e-12)
    assert 0.5 * result.final_chi2 == pytest.approx(final, rel=1e-7)


@pytest.mark.parametrize(
    "name", ["dubrovnik-1-1-pre.txt", "dubrovnik-3-7-pre.txt", "dubrovnik-3-7-18-pre.txt", "Balbianello.out"]
)
def test_ceres_ends_no_lower_on_the_small_problems(name: str) -> None:
    """(All but the last one can be satisfied exactly: their residuals are fewer than their unknowns.)"""
    scene = slamcli.read(dataset(f"bal/{name}"))
    initial, final = ceres(scene)
    result = slamcli.optimize(scene)
    assert 0.5 * result.initial_chi2 == pytest.approx(initial, rel=1e-9)
    assert 0.5 * result.final_chi2 <= (1.0 + 1e-4) * final + 1e-12 * initial
