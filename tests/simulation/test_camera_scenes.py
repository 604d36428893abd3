"""Simulated scenes: what they hold, and that optimizing recovers the noise of the pixels."""

from pathlib import Path

import numpy as np
import pytest

import slamcli
from slamcli import models
from slamcli.cli.main import main
from slamcli.errors import UsageError
from slamcli.evaluation.reprojection import reprojection
from slamcli.simulation.camera_scenes import CAMERA_WORLDS, CameraScene, simulate_cameras
from slamcli.solver.result import Status


@pytest.mark.parametrize("world", CAMERA_WORLDS)
def test_what_a_scene_holds(world: str) -> None:
    scene = CameraScene(world=world, cameras=12, points=300, extent=4.0)
    made = simulate_cameras(scene)
    factors = made.truth.factors[0]
    x = factors.gather(made.truth.values)
    assert (models.BAL_PROJECTION.depth(x) > 0.0).all()
    assert (np.abs(factors.measurements) <= scene.image + 6.0 * scene.noise).all()
    assert np.bincount(factors.indices[:, 1]).min() >= 2
    assert made.truth.landmarks + made.dropped == 300
    residual = factors.residual(made.truth.values)
    assert residual.std() == pytest.approx(scene.noise, rel=5.0 / np.sqrt(2.0 * residual.size))
    assert made.graph.factors is made.truth.factors
    moved = made.graph.values["XYZ"] - made.truth.values["XYZ"]
    assert moved.std() == pytest.approx(scene.position, rel=5.0 / np.sqrt(2.0 * moved.size))


@pytest.mark.parametrize("world", CAMERA_WORLDS)
@pytest.mark.parametrize("seed", [0, 1])
def test_the_noise_of_the_pixels_is_recovered(world: str, seed: int) -> None:
    """chi2 / sigma^2 is chi-square distributed with residuals - unknowns + 7 degrees: a band of 4 deviations."""
    scene = CameraScene(world=world, seed=seed, cameras=15, points=400, extent=5.0)
    made = simulate_cameras(scene)
    result = slamcli.optimize(made.graph)
    freedom = 2 * made.graph.edges - 9 * made.graph.poses - 3 * made.graph.landmarks + 7
    assert result.status is Status.CONVERGED
    assert abs(result.final_chi2 / scene.noise**2 - freedom) < 4.0 * np.sqrt(2.0 * freedom)
    found = reprojection(result.graph)
    assert found is not None
    assert found.sigma * np.sqrt(2 * made.graph.edges / freedom) == pytest.approx(scene.noise, rel=0.05)


def test_without_noise_the_truth_is_the_optimum() -> None:
    made = simulate_cameras(CameraScene(cameras=6, points=50, noise=0.0))
    assert made.truth.chi2() < 1e-18
    assert slamcli.optimize(made.graph, tolerance=1e-14).final_chi2 < 1e-15 * made.graph.chi2()


def test_the_same_seed_gives_the_same_scene() -> None:
    one, two = (simulate_cameras(CameraScene(seed=5, cameras=4, points=30)) for _ in range(2))
    np.testing.assert_array_equal(one.graph.values["CAMERA"], two.graph.values["CAMERA"])
    np.testing.assert_array_equal(one.graph.factors[0].measurements, two.graph.factors[0].measurements)
    other = simulate_cameras(CameraScene(seed=6, cameras=4, points=30))
    assert not np.array_equal(one.graph.values["CAMERA"], other.graph.values["CAMERA"])


@pytest.mark.parametrize(
    "change",
    [
        {"world": "square"},
        {"cameras": 0},
        {"points": 0},
        {"radius": 0.0},
        {"noise": -1.0},
        {"noise": float("nan")},
        {"probability": 0.0},
        {"probability": 1.5},
        {"seed": -1},
    ],
)
def test_impossible_scenes(change: dict[str, object]) -> None:
    with pytest.raises(UsageError):
        CameraScene(**change)  # type: ignore[arg-type]


def test_one_camera_sees_no_point_twice() -> None:
    with pytest.raises(UsageError, match="no point is seen by two cameras"):
        simulate_cameras(CameraScene(cameras=1))


def test_inject_perturbs_places_and_orientations_but_no_intrinsics(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    words = "simulate camera-ring --set cameras=30 --set points=200 -o start.bal --truth truth.bal -q"
    assert main(words.split()) == 0
    assert main(["inject", "truth.bal", "--perturb", "0.2,0.02", "-o", "worse.bal"]) == 0
    truth, worse = slamcli.read("truth.bal"), slamcli.read("worse.bal")
    moved = worse.values["CAMERA"] - truth.values["CAMERA"]
    np.testing.assert_array_equal(moved[:, 7:], 0.0)
    assert moved[:, :3].std() == pytest.approx(0.2, rel=0.4)
    assert (worse.values["XYZ"] - truth.values["XYZ"]).std() == pytest.approx(0.2, rel=0.2)
    assert 0.0 < np.abs(moved[:, 3:7]).max() < 0.1
