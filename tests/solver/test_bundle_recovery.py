"""Perturb and recover: simulated scenes, start perturbed by stated sigmas, end at the noise of the pixels.

At the optimum chi2 / sigma^2 is chi-square distributed with ``dof`` degrees of freedom, of mean dof and variance 2 dof.
"""

from dataclasses import replace

import numpy as np
import pytest

import slamcli
from slamcli import models
from slamcli.evaluation.reprojection import reprojection
from slamcli.formats import bal_pinhole, bundler, pinhole_conversion, render, scene_conversion
from slamcli.graph import FactorGraph
from slamcli.simulation import corruption
from slamcli.simulation.camera_scenes import CameraScene, simulate_cameras
from slamcli.solver.result import Result, Status

SIGMA = 0.5
FOCAL = 500.0
BAND = 4.0  # standard deviations of chi2


def scene(world: str, seed: int, *, same: bool = False) -> FactorGraph:
    """A simulated scene at its true values; with ``same`` intrinsics in all cameras and without distortion."""
    truth = simulate_cameras(CameraScene(world, seed=seed, cameras=8, points=120, noise=SIGMA)).truth
    if not same:
        return truth
    cameras = truth.values["CAMERA"].copy()
    cameras[:, 7:] = [FOCAL, 0.0, 0.0]
    factors = truth.factors[0]
    exact = models.BAL_PROJECTION.residual(
        (cameras[factors.indices[:, 0]], truth.values["XYZ"][factors.indices[:, 1]]), np.zeros((len(factors), 2)), None
    )
    noise = np.random.default_rng([seed, 9]).normal(0.0, SIGMA, exact.shape)
    made = replace(truth, factors=[replace(factors, measurements=exact + noise)])
    return made.with_values({**truth.values, "CAMERA": cameras})


def moved(graph: FactorGraph, seed: int) -> FactorGraph:
    """As ``inject --perturb`` moves it: places by 0.05 m, orientations by 0.01 rad."""
    rng = np.random.default_rng([seed, 5])
    return replace(graph, variables=corruption.perturb(graph, 0.05, 0.01, rng))


def require_noise(result: Result) -> None:
    """The end is at the noise of the pixels."""
    assert result.status is Status.CONVERGED
    assert abs(result.final_chi2 / SIGMA**2 - result.dof) < BAND * np.sqrt(2.0 * result.dof)
    seen = reprojection(result.graph)
    assert seen is not None
    assert seen.behind == 0
    expected = SIGMA * np.sqrt(result.dof / (2.0 * result.graph.edges))
    assert seen.sigma == pytest.approx(expected, rel=BAND * np.sqrt(0.5 / result.dof))


worlds = pytest.mark.parametrize("world", ["camera-ring", "camera-flight"])
seeds = pytest.mark.parametrize("seed", range(3))


@worlds
@seeds
def test_cameras_with_intrinsics_of_their_own(world: str, seed: int) -> None:
    graph = scene(world, seed)
    result = slamcli.optimize(moved(graph, seed))
    assert result.dof == 2 * graph.edges - 9 * 8 - 3 * graph.landmarks + 7
    require_noise(result)


@worlds
@seeds
def test_constant_intrinsics(world: str, seed: int) -> None:
    graph = scene(world, seed)
    result = slamcli.optimize(moved(graph, seed), intrinsics="fixed")
    assert result.dof == 2 * graph.edges - 6 * 8 - 3 * graph.landmarks + 7
    require_noise(result)
    before, after = graph.values["CAMERA"][:, 7:], result.graph.values["CALIBRATED_CAMERA"][:, 7:]
    np.testing.assert_array_equal(after, before)


@worlds
@seeds
def test_shared_intrinsics_of_bal(world: str, seed: int) -> None:
    graph = scene(world, seed, same=True)
    start = moved(graph, seed)
    cameras = start.values["CAMERA"].copy()
    cameras[:, 7] *= 1.02
    result = slamcli.optimize(start.with_values({**start.values, "CAMERA": cameras}), intrinsics="shared")
    assert result.dof == 2 * graph.edges - 6 * 8 - 3 - 3 * graph.landmarks + 7
    require_noise(result)
    if world == "camera-ring":  # height above a flat field and focal length are nearly the same
        assert abs(result.graph.values["BAL_INTRINSICS"][0, 0] - FOCAL) < 5.0


@worlds
@seeds
def test_shared_intrinsics_of_pinholes(world: str, seed: int) -> None:
    graph = scene(world, seed, same=True)
    shared, _ = pinhole_conversion.to_shared(moved(graph, seed))
    values = {**shared.values, "PINHOLE_INTRINSICS": shared.values["PINHOLE_INTRINSICS"] + [10.0, -5.0, 3.0, -3.0]}
    result = slamcli.optimize(shared.with_values(values), intrinsics="shared")
    assert result.dof == 2 * graph.edges - 6 * 8 - 4 - 3 * graph.landmarks + 7
    require_noise(result)


@pytest.mark.parametrize("intrinsics", ["auto", "fixed", "shared"])
def test_points_and_cameras_that_see_nothing_stay(intrinsics: str) -> None:
    graph = scene("camera-ring", 1)
    factors = graph.factors[0]
    used = np.flatnonzero((factors.indices[:, 0] < 6) & (factors.indices[:, 1] > 4))
    start = moved(replace(graph, factors=[factors.part(used)]), 1)
    result = slamcli.optimize(start, intrinsics=intrinsics)
    assert result.status is Status.CONVERGED
    np.testing.assert_array_equal(result.graph.values["XYZ"][:5], start.values["XYZ"][:5])
    cameras = next(iter(result.graph.values.values()))
    np.testing.assert_array_equal(cameras[6:, :7], start.values["CAMERA"][6:, :7])


@pytest.mark.parametrize("elimination", ["none", "schur"])
def test_points_are_eliminated_beside_shared_intrinsics(elimination: str) -> None:
    start = moved(scene("camera-ring", 0), 0)
    result = slamcli.optimize(start, intrinsics="shared", elimination=elimination, gauge="first", tolerance=1e-14)
    assert result.status is Status.CONVERGED
    assert result.problem is not None
    assert (result.problem.schur is not None) == (elimination == "schur")
    if elimination == "schur":
        assert result.problem.sparsity.reduced is not None
        assert result.problem.sparsity.reduced.dimension == 6 * 8 + 3
    assert result.final_chi2 == pytest.approx(slamcli.optimize(start, intrinsics="shared").final_chi2, rel=1e-8)


@pytest.mark.parametrize("intrinsics", ["auto", "fixed", "shared"])
@seeds
def test_gross_outliers_are_left_aside_by_huber(intrinsics: str, seed: int) -> None:
    """Ten pixels that are off by a hundred: the others end at about the noise."""
    graph = scene("camera-ring", seed, same=True)
    factors = graph.factors[0]
    rng = np.random.default_rng([seed, 7])
    bad = rng.choice(len(factors), 10, replace=False)
    pixels = factors.measurements.copy()
    pixels[bad] += rng.choice([-100.0, 100.0], (10, 2))
    information = np.broadcast_to(np.eye(2) / SIGMA**2, factors.information.shape)
    spoiled = replace(graph, factors=[replace(factors, measurements=pixels, information=information)])
    good = np.setdiff1d(np.arange(len(factors)), bad)
    sizes = []
    for kernel in ("none", "huber"):
        result = slamcli.optimize(moved(spoiled, seed), intrinsics=intrinsics, kernel=kernel, kernel_on="all")
        assert result.status is Status.CONVERGED
        residual = result.graph.factors[0].residual(result.graph.values)[good]
        sizes.append(float(np.sqrt(np.square(residual).mean())))
    assert sizes[1] < 1.15 * SIGMA < sizes[0]


def test_a_scene_that_was_shared_is_written_as_bal() -> None:
    graph = scene("camera-ring", 0, same=True)
    result = slamcli.optimize(moved(graph, 0), intrinsics="shared")
    rendered = render(result.graph)
    whole, _ = scene_conversion.to_whole(result.graph)
    assert len(np.unique(whole.values["CAMERA"][:, 7])) == 1
    assert whole.chi2() == pytest.approx(result.final_chi2)
    assert rendered.data == render(whole).data


def test_freed_pinhole_intrinsics_are_written() -> None:
    shared, _ = pinhole_conversion.to_shared(scene("camera-ring", 0, same=True))
    result = slamcli.optimize(shared, intrinsics="shared")
    data = render(result.graph).data
    again = bal_pinhole.parse("x", data, data)
    np.testing.assert_array_equal(again.values["PINHOLE_INTRINSICS"], result.graph.values["PINHOLE_INTRINSICS"])
    assert again.chi2() == pytest.approx(result.final_chi2)


@pytest.mark.parametrize("intrinsics", ["fixed", "shared"])
def test_bundler_keeps_colours_and_keys(intrinsics: str) -> None:
    data = render(scene("camera-ring", 0, same=True), "bundler").data
    lines = data.decode().split("\n")
    at = next(k for k, text in enumerate(lines) if text == "128 128 128")
    lines[at] = "1 2 3"
    views = lines[at + 1].split()
    views[2] = "777"
    lines[at + 1] = " ".join(views)
    text = "\n".join(lines).encode()
    result = slamcli.optimize(bundler.parse("bundle.out", text, text), intrinsics=intrinsics)
    written = render(result.graph)
    assert written.losses == []
    assert written.data.decode().split("\n")[at] == "1 2 3"
    assert written.data.decode().split("\n")[at + 1].split()[2] == "777"
