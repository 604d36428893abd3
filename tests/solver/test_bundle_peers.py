"""The optimum of a scene beside that of Ceres on the same problem, with a cost function written independently."""

import numpy as np
import pytest
from bundle_scenes import perturbed, ring

import slamcli
from slamcli.formats.bal import world_to_camera
from slamcli.geometry import so3


def image(camera: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Snavely's camera by Rodrigues' formula; complex numbers go through it."""
    rotation, translation, (f, k1, k2) = camera[:3], camera[3:6], camera[6:]
    angle = np.sqrt((rotation * rotation).sum())
    axis = rotation / angle
    across = np.array(
        [
            axis[1] * point[2] - axis[2] * point[1],
            axis[2] * point[0] - axis[0] * point[2],
            axis[0] * point[1] - axis[1] * point[0],
        ]
    )
    turned = np.cos(angle) * point + np.sin(angle) * across + (1.0 - np.cos(angle)) * (axis * point).sum() * axis
    p = turned + translation
    q = -p[:2] / p[2]
    square = (q * q).sum()
    return f * (1.0 + k1 * square + k2 * square * square) * q


def derivative(camera: np.ndarray, point: np.ndarray, which: int) -> np.ndarray:
    """By the complex step, exact to rounding."""
    parts = [camera.astype(complex), point.astype(complex)]
    out = np.empty((2, len(parts[which])))
    for k in range(len(parts[which])):
        moved = [part.copy() for part in parts]
        moved[which][k] += 1e-30j
        out[:, k] = image(*moved).imag / 1e-30
    return out


def test_ceres_ends_at_the_same_cost() -> None:
    pyceres = pytest.importorskip("pyceres")

    class Observation(pyceres.CostFunction):
        def __init__(self, pixel: np.ndarray) -> None:
            pyceres.CostFunction.__init__(self)
            self.pixel = pixel
            self.set_num_residuals(2)
            self.set_parameter_block_sizes([9, 3])

        def Evaluate(self, parameters, residuals, jacobians) -> bool:
            camera, point = (np.array(part) for part in parameters)
            residuals[:] = image(camera, point) - self.pixel
            if jacobians is not None:
                for which in (0, 1):
                    if jacobians[which] is not None:
                        jacobians[which][:] = derivative(camera, point, which).ravel()
            return True

    scene = perturbed(ring(cameras=4, points=20, share=1.0))
    turn, translation = world_to_camera(scene.values["CAMERA"])
    cameras = np.concatenate([so3.log(turn), translation, scene.values["CAMERA"][:, 7:]], axis=1)
    cameras, points = [row.copy() for row in cameras], [row.copy() for row in scene.values["XYZ"]]
    problem, costs = pyceres.Problem(), []
    for (i, j), pixel in zip(scene.factors[0].indices.tolist(), scene.factors[0].measurements, strict=True):
        costs.append(Observation(pixel))
        problem.add_residual_block(costs[-1], None, [cameras[i], points[j]])
    options, summary = pyceres.SolverOptions(), pyceres.SolverSummary()
    options.linear_solver_type = pyceres.LinearSolverType.DENSE_SCHUR
    options.function_tolerance = 1e-12
    options.max_num_iterations = 100
    options.num_threads = 1
    pyceres.solve(options, problem, summary)
    result = slamcli.optimize(scene, tolerance=1e-12)
    assert 0.5 * result.initial_chi2 == pytest.approx(summary.initial_cost, rel=1e-12)
    assert 0.5 * result.final_chi2 == pytest.approx(summary.final_cost, rel=1e-7)
