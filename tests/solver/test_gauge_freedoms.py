"""The seven freedoms of scenes of cameras: how many are left, and that holding some of them changes no image."""

from dataclasses import replace

import numpy as np
import pytest
from bundle_scenes import perturbed, ring

import slamcli
from slamcli import models
from slamcli.errors import UsageError
from slamcli.geometry import so3
from slamcli.graph import FactorGraph, Factors
from slamcli.graph.topology import component_labels
from slamcli.solver import freedoms, gauge
from slamcli.solver.linear_system import Linearizer
from slamcli.solver.result import Status
from slamcli.solver.stopwatch import Stopwatch


def null_space(graph: FactorGraph) -> int:
    """Dimension of the null space of H with nothing held but what the graph fixes."""
    held = {name: column.fixed for name, column in graph.variables.items()}
    linearizer = Linearizer(graph, held, Stopwatch())
    pattern, system = linearizer.pattern, linearizer.linearize(graph.values)
    dense = np.zeros((pattern.dimension, pattern.dimension))
    dense[pattern.scalar_rows, pattern.scalar_columns] = system.hessian
    dense = np.triu(dense) + np.triu(dense, 1).T
    root = 1.0 / np.sqrt(dense.diagonal())
    return int((np.linalg.eigvalsh(dense * root * root[:, None]) < 1e-11).sum())


def with_prior(graph: FactorGraph, points: list[int]) -> FactorGraph:
    """With the places of some points measured."""
    rows = np.array(points)[:, None]
    information = np.tile(np.eye(3), (len(points), 1, 1))
    prior = Factors(models.POINT_PRIOR_3D, rows, graph.values["XYZ"][points], information)
    return replace(graph, factors=[*graph.factors, prior])


@pytest.mark.parametrize(
    ("fix", "measured", "left"),
    [
        ([], [], 7),
        ([0], [], 1),
        ([0, 3], [], 0),
        ([6], [], 4),  # a point: what is left turns about it, and scales
        ([6, 7], [], 1),
        ([6, 7, 8], [], 0),
        ([], [0], 4),
        ([], [0, 5], 1),
        ([0], [4], 0),
    ],
)
def test_freedoms_that_are_left_are_the_null_space(fix: list[int], measured: list[int], left: int) -> None:
    scene = ring().with_fixed(fix)
    scene = with_prior(scene, measured) if measured else scene
    chosen, held = gauge.choose(scene, "free")
    assert chosen.freedoms == left == null_space(scene)
    assert chosen.frozen == {}
    first, _ = gauge.choose(scene, "first")
    assert sum(int(mask.sum()) for mask in first.frozen.values()) == left
    plain = scene.degrees_of_freedom(held)
    assert chosen.degrees_of_freedom(scene, held) == first.degrees_of_freedom(scene, held) == plain + left


@pytest.mark.parametrize(("fix", "left"), [([], 6), ([0], 0), ([40], 3)])
def test_a_stereo_baseline_measures_the_scale(fix: list[int], left: int) -> None:
    mono = ring()
    cameras = mono.variables["CAMERA"]
    turn = so3.compose(cameras.values[:, 3:7], np.tile([1.0, 0.0, 0.0, 0.0], (6, 1)))  # looks along +z
    values = np.concatenate([cameras.values[:, :3], turn, np.tile([500.0, 500.0, 320.0, 240.0, 0.5], (6, 1))], axis=1)
    columns = {"SBA_CAMERA": replace(cameras, kind=models.SBA_CAMERA, values=values), "XYZ": mono.variables["XYZ"]}
    rows = mono.factors[0].indices[:, ::-1]
    x = columns["XYZ"].values[rows[:, 0]], values[rows[:, 1]]
    pixels = models.SBA_STEREO_PROJECTION.residual(x, np.zeros((len(rows), 3)), None)
    factors = Factors(models.SBA_STEREO_PROJECTION, rows, pixels, np.broadcast_to(np.eye(3), (len(rows), 3, 3)))
    scene = FactorGraph(columns, [factors]).with_fixed(fix)
    chosen, _ = gauge.choose(scene, "free")
    assert chosen.freedoms == left == null_space(scene)
    first, _ = gauge.choose(scene, "first")
    assert sum(int(mask.sum()) for mask in first.frozen.values()) == left
    auto, held = gauge.choose(scene)
    assert auto.freedoms == 0 if not fix else auto.freedoms == left
    assert auto.degrees_of_freedom(scene, held) == scene.degrees_of_freedom() + left


def test_the_seven_directions_change_no_image() -> None:
    """J N = 0 for what cameras see, at any values."""
    scene = perturbed(ring())
    one = freedoms.scene(scene, component_labels(scene), 0)
    factors = scene.factors[0]
    jacobians = factors.linearize(scene.values)[1]
    total = sum(
        jacobian @ one.in_metres(kind.name)[factors.indices[:, slot]]
        for slot, (kind, jacobian) in enumerate(zip(factors.kind.variables, jacobians, strict=True))
    )
    assert np.abs(total).max() < 1e-9 * np.abs(jacobians[0]).max()


@pytest.mark.parametrize("method", ["gn", "dogleg", "lm", "auto"])
def test_with_the_first_camera_held_all_methods_reach_the_same_minimum(method: str) -> None:
    scene = perturbed(ring())
    free = slamcli.optimize(scene, tolerance=1e-14)
    held = slamcli.optimize(scene, method=method, gauge="first", tolerance=1e-14)
    assert held.status is Status.CONVERGED
    assert held.final_chi2 == pytest.approx(free.final_chi2, rel=1e-9)
    assert held.gauge.held == ()
    assert held.gauge.dimensions[0] == ("x", "y", "z", "qx", "qy", "qz")
    before, after = scene.values["CAMERA"], held.graph.values["CAMERA"]
    np.testing.assert_array_equal(after[0, :3], before[0, :3])
    np.testing.assert_allclose(after[0, 3:7], before[0, 3:7], rtol=0, atol=1e-15)
    assert after[0, 7] != before[0, 7]  # intrinsics move
    assert held.dof == free.dof == 2 * scene.edges - 9 * 6 - 3 * 40 + 7


@pytest.mark.parametrize("elimination", ["none", "schur"])
def test_steps_have_no_part_in_frozen_dimensions(elimination: str) -> None:
    scene = perturbed(ring())
    result = slamcli.optimize(scene, gauge="first", method="gn", elimination=elimination)
    scale = [i for i in result.gauge.dimensions if i != 0]
    assert len(scale) == 1
    assert len(result.gauge.dimensions[scale[0]]) == 1
    assert result.status is Status.CONVERGED


def test_every_component_has_a_gauge_of_its_own() -> None:
    one, two = perturbed(ring(cameras=4)), perturbed(ring(cameras=5, seed=3))
    columns = {
        name: one.variables[name].followed_by(replace(two.variables[name], ids=two.variables[name].ids + 1000))
        for name in ("CAMERA", "XYZ")
    }
    shift = [4, 40]
    factors = [one.factors[0], replace(two.factors[0], indices=two.factors[0].indices + shift)]
    both = FactorGraph(columns, factors)
    chosen, _ = gauge.choose(both, "first")
    assert chosen.freedoms == 14
    assert chosen.reason == "pose of 0 and z of 2 held, likewise in 1 more components"
    result = slamcli.optimize(both, gauge="first", method="gn", tolerance=1e-12)
    alone = [slamcli.optimize(scene, gauge="first", method="gn", tolerance=1e-12).final_chi2 for scene in (one, two)]
    assert result.final_chi2 == pytest.approx(sum(alone), rel=1e-9)


def test_cameras_at_one_place_have_no_scale_to_hold() -> None:
    scene = ring(cameras=2, share=1.0)
    values = {name: value.copy() for name, value in scene.values.items()}
    values["CAMERA"][:, :3] = values["CAMERA"][0, :3]
    chosen, _ = gauge.choose(scene.with_values(values), "first")
    assert chosen.reason == "pose of 0 held, scale left free"


def test_a_gauge_without_cameras_is_refused() -> None:
    graph = FactorGraph(ring().variables, [])
    with pytest.raises(UsageError, match="no"):
        gauge.choose(graph, "first")
