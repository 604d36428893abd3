"""Points without a value, placed by what cameras see of them; those that cannot be are named and held back."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bundle_scenes import ring

import slamcli
from slamcli import models
from slamcli.errors import NumericalError
from slamcli.formats import pinhole_conversion, scene_conversion
from slamcli.graph import FactorGraph, camera_intrinsics
from slamcli.solver.initialization import camera_points
from slamcli.solver.result import Status


def unknown(graph: FactorGraph, rows: slice = slice(None)) -> FactorGraph:
    """The graph without values of some points."""
    column = graph.variables["XYZ"]
    known, values = column.known.copy(), column.values.copy()
    known[rows], values[rows] = False, 0.0
    return replace(graph, variables={**graph.variables, "XYZ": replace(column, known=known, values=values)})


def alike(graph: FactorGraph) -> FactorGraph:
    """With one set of intrinsics, without distortion or noise."""
    cameras = graph.values["CAMERA"].copy()
    cameras[:, 7:] = [500.0, 0.0, 0.0]
    factors = graph.factors[0]
    x = cameras[factors.indices[:, 0]], graph.values["XYZ"][factors.indices[:, 1]]
    exact = models.BAL_PROJECTION.residual(x, np.zeros((len(factors), 2)), None)
    made = replace(graph, factors=[replace(factors, measurements=exact)])
    return made.with_values({**graph.values, "CAMERA": cameras})


SCENES = {
    "bal": lambda: ring(noise=0.0),
    "calibrated": lambda: camera_intrinsics.calibrated(ring(noise=0.0)),
    "shared": lambda: camera_intrinsics.shared(alike(ring())),
    "pinhole": lambda: pinhole_conversion.to_shared(alike(ring()))[0],
    "expmap": lambda: scene_conversion.to_g2o(alike(ring()))[0],
    "sba": lambda: pinhole_conversion.to_sba(pinhole_conversion.to_shared(alike(ring()))[0])[0],
}


@pytest.mark.parametrize("name", SCENES)
def test_exact_images_give_exact_points(name: str) -> None:
    """Without noise triangulation is exact, for every kind of camera, distorted or not."""
    truth = SCENES[name]()
    found, good = camera_points.triangulated(unknown(truth), truth.values, np.ones(40, dtype=bool))
    assert good.all()
    np.testing.assert_allclose(found, truth.values["XYZ"], atol=1e-9)


def test_noisy_points_are_near_the_optimum() -> None:
    truth = ring(noise=0.5, points=100, share=1.0)
    result = slamcli.optimize(unknown(truth))
    known = slamcli.optimize(truth)
    assert result.start == "values of the file; 100 points triangulated from images"
    assert result.status is Status.CONVERGED
    assert result.final_chi2 == pytest.approx(known.final_chi2, rel=1e-6)
    found, _ = camera_points.triangulated(unknown(truth), truth.values, np.ones(100, dtype=bool))
    points = replace(truth, variables={**truth.variables})
    best = slamcli.optimize(points.with_fixed(range(6)))  # with the cameras held
    at_start = truth.chi2({**truth.values, "XYZ": found})
    assert best.final_chi2 <= at_start < 1.02 * best.final_chi2


def stereo(views: int) -> FactorGraph:
    """A stereo camera, or two, that see two points without values: the second one in front of the first by hand."""
    text = "VERTEX_CAM 0 0 0 0 0 0 0 1 500 500 320 240 0.1\nVERTEX_CAM 1 1 0 0 0 0 0 1 500 500 320 240 0.1\n"
    # (0.2, -0.1, 2): u = 50 + 320, v = -25 + 240, u of the right camera = 25 + 320
    edges = ["EDGE_PROJECT_P2SC 7 0 370 215 345 1 0 0 1 0 1\n", "EDGE_PROJECT_P2SC 7 1 120 215 95 1 0 0 1 0 1\n"]
    from slamcli.formats.reader import parse

    data = (text + "".join(edges[:views])).encode()
    return parse("stereo.g2o", data, data)


@pytest.mark.parametrize("views", [1, 2])
def test_a_stereo_image_alone_places_a_point(views: int) -> None:
    graph = stereo(views)
    found, good = camera_points.triangulated(graph, graph.values, np.ones(1, dtype=bool))
    assert good.all()
    np.testing.assert_allclose(found, [[0.2, -0.1, 2.0]], atol=1e-12)


def test_points_seen_once_are_held_back_and_named() -> None:
    truth = ring(noise=0.2)
    factors = truth.factors[0]
    lonely = (factors.indices[:, 1] != 5) | (factors.indices[:, 0] == factors.indices[factors.indices[:, 1] == 5, 0][0])
    graph = unknown(replace(truth, factors=[factors.part(np.flatnonzero(lonely))]))
    result = slamcli.optimize(graph)
    assert result.status is Status.CONVERGED
    assert [landmark.id for landmark in result.under_observed] == [6 + 5]
    assert not result.graph.variables["XYZ"].known[5]
    without = slamcli.optimize(replace(truth, factors=[factors.part(np.flatnonzero(factors.indices[:, 1] != 5))]))
    assert result.final_chi2 == pytest.approx(without.final_chi2, rel=1e-6)


@pytest.mark.parametrize("method", ["gn", "dogleg"])
def test_methods_that_need_a_regular_hessian_leave_points_seen_once_as_they_are(method: str) -> None:
    truth = ring(noise=0.2)
    factors = truth.factors[0]
    first = factors.indices[factors.indices[:, 1] == 5, 0][0]
    keep = np.flatnonzero((factors.indices[:, 1] != 5) | (factors.indices[:, 0] == first))
    graph = replace(truth, factors=[factors.part(keep)])
    result = slamcli.optimize(graph, method=method, gauge="first")
    assert result.status is Status.CONVERGED
    assert [landmark.id for landmark in result.under_observed] == [11]
    np.testing.assert_array_equal(result.graph.values["XYZ"][5], truth.values["XYZ"][5])
    damped = slamcli.optimize(graph, method="lm")
    assert damped.under_observed == ()
    assert damped.final_chi2 == pytest.approx(result.final_chi2, rel=1e-6)  # one image of one point fits exactly


def test_two_views_from_one_place_say_no_distance() -> None:
    truth = ring(cameras=2, share=1.0)
    values = {name: value.copy() for name, value in truth.values.items()}
    values["CAMERA"][1] = values["CAMERA"][0]
    factors = truth.factors[0]
    exact = models.BAL_PROJECTION.residual(factors.gather(values), np.zeros((len(factors), 2)), None)
    graph = replace(truth, factors=[replace(factors, measurements=exact)]).with_values(values)
    _, good = camera_points.triangulated(unknown(graph), values, np.ones(40, dtype=bool))
    assert not good.any()
    assert camera_points.undetermined(unknown(graph), also_known=False).all()
    assert not camera_points.undetermined(graph, also_known=True).any()


def test_points_behind_a_camera_are_not_placed() -> None:
    """Rays that meet behind the cameras: pixels of a point mirrored in both."""
    truth = ring(noise=0.0, share=1.0)
    factors = truth.factors[0]
    mirrored = replace(factors, measurements=np.where(factors.indices[:, 1:] == 3, -1.0, 1.0) * factors.measurements)
    graph = unknown(replace(truth, factors=[mirrored]))
    found, good = camera_points.triangulated(graph, truth.values, np.ones(40, dtype=bool))
    others = np.arange(40) != 3
    assert good[others].all()
    assert not good[3] or np.linalg.norm(found[3] - truth.values["XYZ"][3]) > 0.1


def test_cameras_without_a_value_are_named(tmp_path: Path) -> None:
    text = (
        "PARAMS_CAMERAPARAMETERS 3 500 320 240 0\nVERTEX_SE3:EXPMAP 1 0 0 0 0 0 0 1\nVERTEX_XYZ 5 0 0 3\n"
        "EDGE_PROJECT_XYZ2UV:EXPMAP 5 1 3 320 240 1 0 1\nEDGE_PROJECT_XYZ2UV:EXPMAP 5 2 3 320 240 1 0 1\n"
    )
    path = tmp_path / "lost.g2o"
    path.write_text(text)
    graph = slamcli.read(str(path))
    with pytest.raises(NumericalError, match="1 camera has no estimate, and images of points place none: 2"):
        camera_points.place_points_from_cameras(graph, graph.values, {"XYZ": np.ones(1, dtype=bool)})
    result = slamcli.optimize(graph)
    assert (result.status, result.exit_code) == (Status.FAILED, 5)
    assert "no estimate" in result.reason
