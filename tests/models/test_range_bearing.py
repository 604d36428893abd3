"""Range and bearing: the sensor model that simulator and filter call, and its factors in files and in the solver."""

import math
from dataclasses import replace
from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from numpy.testing import assert_allclose, assert_array_equal
from support import dataset, write_file

import slamcli
from slamcli import models
from slamcli.errors import ExitCode
from slamcli.formats import render
from slamcli.geometry import se2, so2
from slamcli.models import range_bearing
from slamcli.models.base import Array
from slamcli.models.motion import DifferentialDrive, OdometryMotion, VelocityMotion
from slamcli.simulation.portable import PortableArray, portable
from slamcli.solver.optimize import optimize

pytestmark = pytest.mark.filterwarnings("error")

LESSON = np.array([[2.0, 1.0, np.pi / 6]]), np.array([[5.0, 5.0]])
NO_INFORMATION = "1780 EDGE_RANGE_SE2_XY records have no information: the identity is used"


def states(count: int = 200, seed: int = 0) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    return se2.normalize(rng.normal(scale=3.0, size=(count, 3))), rng.normal(scale=3.0, size=(count, 2))


# -- the sensor model ------------------------------------------------------------------------------------------------


def test_prediction_by_hand() -> None:
    """A landmark 3 m east and 4 m north of a robot that looks 30 degrees to the north of east."""
    distance, bearing = range_bearing.predict(*LESSON)
    assert distance == 5.0
    assert_allclose(np.degrees(bearing), math.degrees(math.atan2(4.0, 3.0)) - 30.0, rtol=1e-15)


def test_textbook_jacobian_by_hand() -> None:
    """[[-dx/r, -dy/r, 0], [dy/q, -dx/q, -1]] with dx, dy, r, q = 3, 4, 5, 25, whatever the heading."""
    for heading in (0.0, np.pi / 6, -3.0):
        pose = np.array([[2.0, 1.0, heading]])
        _, _, by_pose, by_point = range_bearing.linearize(pose, LESSON[1])
        world = range_bearing.world_jacobian(by_pose, pose)
        assert_allclose(world, [[[-0.6, -0.8, 0.0], [0.16, -0.12, -1.0]]], rtol=0, atol=1e-15)
        assert_allclose(by_point, [[[0.6, 0.8], [-0.16, 0.12]]], rtol=0, atol=1e-15)


def test_jacobians_against_finite_differences() -> None:
    pose, point = states()
    distance, bearing, by_pose, by_point = range_bearing.linearize(pose, point)
    assert_array_equal((distance, bearing), range_bearing.predict(pose, point))
    world = range_bearing.world_jacobian(by_pose, pose)
    step = 1e-6

    def slope(ahead: tuple[Array, Array], behind: tuple[Array, Array]) -> Array:
        distances, bearings = zip(range_bearing.predict(*ahead), range_bearing.predict(*behind), strict=True)
        return so2.pack(distances[0] - distances[1], so2.wrap(bearings[0] - bearings[1])) / (2.0 * step)

    near = np.maximum(1.0, 1.0 / distance**3)[:, None]  # the third derivative grows as the point comes near
    for k in range(3):
        delta = np.zeros(3)
        delta[k] = step
        ends = [(se2.retract(pose, s * delta[None]), point) for s in (1, -1)]
        assert_allclose(by_pose[:, :, k] / near, slope(*ends) / near, rtol=0, atol=1e-8)
        ends = [(pose + s * delta, point) for s in (1, -1)]
        assert_allclose(world[:, :, k] / near, slope(*ends) / near, rtol=0, atol=1e-8)
    for k in range(2):
        delta = np.zeros(2)
        delta[k] = step
        assert_allclose(by_point[:, :, k] / near, slope((pose, point + delta), (pose, point - delta)) / near, atol=1e-8)


def test_bearings_are_in_the_half_open_range() -> None:
    """Straight behind is -pi, from either side; at the pose itself range and bearing are 0."""
    pose = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -np.pi], [1.0, 2.0, 0.5]])
    point = np.array([[-1.0, 0.0], [1.0, 0.0], [1.0, 2.0]])
    distance, bearing = range_bearing.predict(pose, point)
    assert_array_equal(distance, [1.0, 1.0, 0.0])
    assert_allclose(bearing, [-np.pi, -np.pi, 0.0], rtol=0, atol=2e-16)
    assert (bearing >= -np.pi).all()
    assert (bearing < np.pi).all()


@given(st.integers(0, 2**32 - 1))
def test_place_is_the_inverse_of_predict(seed: int) -> None:
    pose, point = states(20, seed)
    reading = so2.pack(*range_bearing.predict(pose, point))
    placed = models.RANGE_BEARING_2D.place(pose, reading, None)
    assert_allclose(placed, point, rtol=0, atol=1e-13)
    assert_allclose(models.RANGE_BEARING_2D.residual((pose, point), reading, None), 0.0, rtol=0, atol=0)


def test_factors_have_the_sign_of_the_innovation() -> None:
    """Reading minus prediction, (5.2 m, 21 deg) - (5 m, 23.13 deg), in the factors of all three sensors."""
    reading = np.array([[5.2, math.radians(21.0)]])
    both = models.RANGE_BEARING_2D.residual(LESSON, reading, None)
    assert_allclose(both, [[0.2, math.radians(21.0 + 30.0) - math.atan2(4.0, 3.0)]], rtol=0, atol=1e-15)
    assert_array_equal(models.RANGE_2D.residual(LESSON, reading[:, :1], None), both[:, :1])
    assert_array_equal(models.BEARING_2D.residual(LESSON, reading[:, 1:], None), both[:, 1:])


def test_jacobians_of_factors_are_those_of_the_sensor() -> None:
    pose, point = states()
    _, _, by_pose, by_point = range_bearing.linearize(pose, point)
    for kind, rows in ((models.RANGE_BEARING_2D, [0, 1]), (models.RANGE_2D, [0]), (models.BEARING_2D, [1])):
        _, (pose_rows, point_rows) = kind.linearize((pose, point), np.zeros((len(pose), len(rows))), None)
        assert_array_equal(pose_rows, -by_pose[:, rows])
        assert_array_equal(point_rows, -by_point[:, rows])


def test_predictions_and_factors_agree_with_gtsam() -> None:
    """GTSAM has the bearing first and an error of half of chi2."""
    gtsam = pytest.importorskip("gtsam")
    pose, point = states(50)
    distance, bearing = range_bearing.predict(pose, point)
    reading = np.random.default_rng(1).normal(loc=(5.0, 0.0), size=(50, 2))
    residual = models.RANGE_BEARING_2D.residual((pose, point), reading, None)
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.1, 0.3]))
    for k in range(len(pose)):
        there = gtsam.Pose2(*pose[k])
        assert there.range(point[k]) == pytest.approx(distance[k], rel=1e-14)
        assert there.bearing(point[k]).theta() == pytest.approx(bearing[k], abs=1e-14)
        factor = gtsam.BearingRangeFactor2D(0, 1, gtsam.Rot2(reading[k, 1]), reading[k, 0], noise)
        values = gtsam.Values()
        values.insert(0, there)
        values.insert(1, point[k])
        chi2 = (residual[k, 0] / 0.3) ** 2 + (residual[k, 1] / 0.1) ** 2
        assert 2.0 * factor.error(values) == pytest.approx(chi2, rel=1e-12)


def test_all_sines_are_those_of_the_array(monkeypatch: pytest.MonkeyPatch) -> None:
    """The simulator passes arrays with sines of their own, which refuse all but elementwise arithmetic."""
    originals = {name: getattr(np, name) for name in ("sin", "cos", "arctan2")}

    def guarded(name: str):
        def call(*values: Array) -> Array:
            assert any(isinstance(value, PortableArray) for value in values), f"np.{name} of a plain array"
            return originals[name](*values)

        return call

    pose, point = states()
    relative = portable(np.concatenate([pose, np.zeros((1, 3))]))
    for name in originals:
        monkeypatch.setattr(np, name, guarded(name))
    for model in (VelocityMotion(*[0.1] * 6), OdometryMotion(*[0.1] * 4), DifferentialDrive(0.3, 0.1)):
        control = portable(model.control(relative, 0.5))
        model.remainder(relative, 0.5)
        model.displacement(control, 0.5)
        model.covariance(control, 0.5)
    range_bearing.predict(portable(pose), portable(point))
    range_bearing.linearize(portable(pose), portable(point))


# -- files and solver ------------------------------------------------------------------------------------------------

SQUARE = """\
VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 2 0 1.5707963267948966
EDGE_SE2 0 1 2 0 1.5707963267948966 1 0 0 1 0 1
EDGE_SE2_RB 0 7 1.4142135623730951 0.7853981633974483 4 0 9
LANDMARK2:RB 1 8 3 0 4 0 9
EDGE_BEARING_SE2_RB 1 7 1.4142135623730951 0.7853981633974483 4 0 9
"""


def test_landmarks_are_placed_by_range_and_bearing(tmp_path: Path) -> None:
    """Also by either of the other two names of the record."""
    graph = slamcli.read(str(write_file(tmp_path, SQUARE)))
    for init in ("file", "odometry", "spanning-tree"):
        result = optimize(graph, init=init)
        assert result.exit_code == ExitCode.SUCCESS
        column = result.graph.variables["XY"]
        assert_allclose(column.values[[column.row_of(7), column.row_of(8)]], [[1.0, 1.0], [2.0, 3.0]], atol=1e-12)


def test_a_range_places_nothing(tmp_path: Path) -> None:
    content = SQUARE + "EDGE_RANGE_SE2_XY 0 9 1 1\n"
    result = optimize(slamcli.read(str(write_file(tmp_path, content))))
    assert result.exit_code == ExitCode.SUCCESS
    (landmark,) = result.under_observed
    assert (landmark.id, landmark.edges, landmark.reason, landmark.has_value) == (9, 1, "a single range", False)


def test_two_ranges_and_a_vertex_determine_a_landmark(tmp_path: Path) -> None:
    """Circles round (0, 0) and (2, 0), of radius sqrt(2): the crossing on the side of the vertex."""
    content = "EDGE_RANGE_SE2_XY 0 9 1.4142135623730951\nEDGE_RANGE_SE2_XY 1 9 1.4142135623730951 25\n"
    for y in (0.3, -0.3):
        graph = slamcli.read(str(write_file(tmp_path, f"{SQUARE}VERTEX_XY 9 0.8 {y}\n{content}")))
        assert graph.report is not None
        assert graph.report.notes == ["1 EDGE_RANGE_SE2_XY records have no information: the identity is used"]
        result = optimize(graph)
        assert result.exit_code == ExitCode.SUCCESS
        column = result.graph.variables["XY"]
        assert_allclose(column.values[column.row_of(9)], [1.0, math.copysign(1.0, y)], rtol=0, atol=1e-8)


def test_records_are_written_under_the_first_name(tmp_path: Path) -> None:
    graph = slamcli.read(str(write_file(tmp_path, SQUARE)))
    assert render(graph).data.decode() == SQUARE  # unchanged records keep their bytes
    graph.document = graph.report = None
    graph.factors = [replace(factors, tag="") for factors in graph.factors]
    tags = [line.split()[0] for line in render(graph).data.decode().splitlines()]
    assert tags.count("EDGE_SE2_RB") == 3


def with_information(name: str, tmp_path: Path) -> Path:
    """A range-only data set, with the information that its EDGE_SE2 records lack."""
    lines = dataset(f"landmark2d/slam2d_range_only_{name}.g2o").read_text().splitlines()
    full = (f"{line} 1 0 0 1 0 1" if line.startswith("EDGE_SE2 ") else line for line in lines)
    return write_file(tmp_path, "\n".join(full) + "\n")


@pytest.mark.datasets
def test_chi2_of_ranges_to_known_landmarks(tmp_path: Path) -> None:
    """Against the sum in plain Python."""
    path = with_information("ground_truth", tmp_path)
    graph = slamcli.read(str(path))
    records = [line.split() for line in path.read_text().splitlines()]
    position = {r[1]: (float(r[2]), float(r[3])) for r in records if r[0].startswith("VERTEX")}
    ranges = [(r[1], r[2], float(r[3])) for r in records if r[0] == "EDGE_RANGE_SE2_XY"]
    expected = math.fsum((z - math.dist(position[i], position[j])) ** 2 for i, j, z in ranges)
    (found,) = (f for f in graph.factors if f.kind is models.RANGE_2D)
    assert len(found) == len(ranges) == 1780
    assert found.chi2(graph.values).sum() == pytest.approx(expected, rel=1e-12)
    assert graph.chi2() == pytest.approx(2.435932, abs=1e-6)
    assert graph.report is not None
    assert graph.report.notes == [NO_INFORMATION]
    result = optimize(graph)
    assert result.exit_code == ExitCode.SUCCESS
    assert [(landmark.id, landmark.reason) for landmark in result.under_observed] == [(62, "a single range")]
    assert result.final_chi2 < graph.chi2()
