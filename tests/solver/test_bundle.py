"""Bundle adjustment as a whole: gauge, method, recovery of a perturbed scene, and scenes that are none."""

from dataclasses import replace

import numpy as np
import pytest
from bundle_scenes import perturbed, ring
from support import dataset

import slamcli
from slamcli.errors import UsageError
from slamcli.graph import FactorGraph
from slamcli.solver import bundle, gauge
from slamcli.solver.result import Status


def test_no_camera_is_held_and_the_run_is_damped() -> None:
    scene = perturbed(ring())
    result = slamcli.optimize(scene)
    assert result.gauge.held == ()
    assert result.gauge.reason == "place, orientation and scale left free"
    assert (result.options.method, result.options.scaling, result.options.init) == ("lm", "marquardt", "file")
    assert result.status is Status.CONVERGED
    assert all(record.step == "damped" for record in result.trace)


def test_a_fixed_camera_stays() -> None:
    scene = perturbed(ring())
    result = slamcli.optimize(scene, fix=[2])
    assert result.gauge.held == (2,)
    np.testing.assert_array_equal(result.graph.values["CAMERA"][2], scene.values["CAMERA"][2])


def test_a_camera_that_sees_nothing_is_held() -> None:
    scene = ring(cameras=4, share=1.0)
    factors = scene.factors[0]
    keep = factors.indices[:, 0] != 3
    alone = replace(scene, factors=[factors.part(np.flatnonzero(keep))])
    chosen, held = gauge.choose(alone)
    assert chosen.held == (3,)
    assert held["CAMERA"].tolist() == [False, False, False, True]
    assert slamcli.optimize(perturbed(alone)).status is Status.CONVERGED


def test_a_perturbed_scene_is_recovered_to_the_noise_of_its_pixels() -> None:
    """chi2 at the optimum is sigma^2 times a chi-square variable of (residuals - parameters + 7 freedoms) degrees."""
    sigma = 0.5
    scene = ring(cameras=8, points=150, noise=sigma)
    result = slamcli.optimize(perturbed(scene))
    residuals = 2 * scene.edges
    freedom = residuals - 9 * 8 - 3 * 150 + 7
    assert result.status is Status.CONVERGED
    assert abs(result.final_chi2 / sigma**2 - freedom) < 4.0 * np.sqrt(2.0 * freedom)
    exact = slamcli.optimize(perturbed(ring(noise=0.0)), tolerance=1e-14)
    assert exact.final_chi2 < 1e-14 * exact.initial_chi2


def test_scale_and_place_do_not_drift() -> None:
    """Damped steps have no part in the seven freedoms, to first order: the scene stays about where it was."""
    scene = ring(cameras=8, points=150)
    result = slamcli.optimize(perturbed(scene))
    assert np.abs(result.graph.values["CAMERA"][:, :3] - scene.values["CAMERA"][:, :3]).max() < 0.25


def test_an_outlier_is_left_aside_by_a_kernel() -> None:
    scene = ring(cameras=6, points=60, noise=0.1)
    factors = scene.factors[0]
    pixels = factors.measurements.copy()
    pixels[5] += 80.0
    bad = replace(scene, factors=[replace(factors, measurements=pixels)])
    plain = slamcli.optimize(perturbed(bad))
    robust = slamcli.optimize(perturbed(bad), kernel="cauchy", kernel_on="all")
    error = [np.abs(factors.residual(r.graph.values)).mean() for r in (plain, robust)]
    assert error[1] < 0.5 * error[0]


@pytest.mark.parametrize("init", ["chordal", "odometry", "spanning-tree"])
def test_starts_that_need_relative_poses_are_refused(init: str) -> None:
    with pytest.raises(UsageError, match="relative poses"):
        slamcli.optimize(ring(), init=init)


def in_the_plane(scene: FactorGraph) -> FactorGraph:
    """With the first point of the first camera exactly where that camera is."""
    values = {name: value.copy() for name, value in scene.values.items()}
    camera, point = scene.factors[0].indices[0]
    values["XYZ"][point] = values["CAMERA"][camera, :3]
    return scene.with_values(values)


def test_a_point_at_a_camera_is_named() -> None:
    result = slamcli.optimize(in_the_plane(ring()))
    assert result.status is Status.FAILED
    assert result.exit_code == 5
    assert "not finite" in result.reason
    assert any("bal 0 6" in line for line in result.diagnosis)


def test_one_camera_and_points_seen_once_end_without_a_failure() -> None:
    result = slamcli.optimize(perturbed(ring(cameras=1, points=50, share=1.0)))
    assert result.status is Status.CONVERGED
    assert result.final_chi2 < 1e-6


@pytest.mark.parametrize("method", ["gn", "dogleg"])
def test_methods_that_need_a_regular_hessian_say_so(method: str) -> None:
    result = slamcli.optimize(perturbed(ring()), method=method)
    assert result.status is Status.FAILED
    assert any("--fix" in line for line in result.diagnosis)


@pytest.mark.parametrize(
    ("name", "initial", "cost"),
    [("bal/problem-16-22106-pre.txt", 4185660.0, 18033.9), ("bal/dubrovnik-3-7-pre.txt", 2764.22, 1e-3)],
)
def test_the_standard_sets_reach_the_cost_of_ceres(name: str, initial: float, cost: float) -> None:
    result = slamcli.optimize(slamcli.read(str(dataset(name))))
    assert 0.5 * result.initial_chi2 == pytest.approx(initial, rel=1e-6)
    assert 0.5 * result.final_chi2 <= cost * (1.0 + 1e-5)


@pytest.mark.parametrize("intrinsics", ["fixed", "shared", "free"])
@pytest.mark.parametrize("robust", ["gnc", "switchable"])
def test_robust_runs_have_nothing_to_reject_in_images(intrinsics: str, robust: str) -> None:
    plain = slamcli.optimize(perturbed(ring()), intrinsics=intrinsics)
    result = slamcli.optimize(perturbed(ring()), intrinsics=intrinsics, robust=robust)
    assert result.rejection is not None
    assert (result.final_chi2, result.dof) == (plain.final_chi2, plain.dof)
    assert (result.rejection.count, result.rejection.inlier_dof) == (0, plain.dof)


def test_points_that_went_behind_cameras_are_a_doubt() -> None:
    """Scaled damping moves a distant point through the plane of a camera; the minimum there is not the lowest."""
    scene = slamcli.read(str(dataset("bal/gbp_fr1desk_vsmall.txt")))
    scaled = slamcli.optimize(scene, method="lm", scaling="marquardt")
    assert bundle.gone_behind(scene, scene.values, scaled.graph.values) > 0
    result = slamcli.optimize(scene)
    assert result.doubt is not None and "behind the camera" in result.doubt
    assert [start.name for start in result.starts] == ["file", "file-unscaled"]
    assert bundle.gone_behind(scene, scene.values, result.graph.values) == 0
    assert result.final_chi2 < 0.8 * scaled.final_chi2
    assert (result.options.scaling, result.start) == ("none", result.starts[1].words)
    assert result.trace == list(result.starts[1].trace)


def test_points_that_go_behind_are_counted() -> None:
    scene = ring()
    mirrored = {name: values.copy() for name, values in scene.values.items()}
    mirrored["XYZ"] *= -1e3
    there = bundle.gone_behind(scene, scene.values, mirrored)
    assert 0 < there < len(scene.factors[0])
    assert bundle.gone_behind(scene, scene.values, scene.values) == 0
    assert bundle.gone_behind(scene, mirrored, scene.values) == 0  # what comes back is no doubt
