"""TORO files: their order and frame of the information, Euler angles, and conversions in both directions."""

from pathlib import Path

import hypothesis.extra.numpy as nps
import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from numpy.testing import assert_allclose
from support import BUNDLED, dataset, vectors, write_file

import slamcli
from slamcli import models
from slamcli.formats import render
from slamcli.formats.toro import TORO, pose_from_euler, pose_to_euler
from slamcli.geometry import se3
from slamcli.graph import FactorGraph
from slamcli.models.base import Array

of_file = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=50)
(EDGE3,) = (record for record in TORO.edges if record.tag == "EDGE3")
angles = st.floats(-3.1, 3.1)
POSES_2D = "VERTEX2 0 0.1 0.2 0.3\nVERTEX2 1 1.2 0.3 -0.4\n"


def information(dimension: int) -> st.SearchStrategy[Array]:
    """Any positive definite matrix, not only isotropic ones."""
    square = nps.arrays(np.float64, (dimension, dimension), elements=st.floats(-2, 2))
    return square.map(lambda a: a @ a.T + np.eye(dimension))


def convert(graph: FactorGraph, tmp_path: Path, dialect: str) -> FactorGraph:
    """The graph written in a dialect and read again."""
    return slamcli.read(str(write_file(tmp_path, render(graph, dialect).data, f"converted.{dialect}")))


def toro_residual_2d(first: Array, second: Array, z: Array) -> Array:
    """TORO's error: the numbers that the record should have had, minus those that it has."""
    c, s = np.cos(first[2]), np.sin(first[2])
    dx, dy = second[:2] - first[:2]
    turn = (second[2] - first[2] - z[2] + np.pi) % (2 * np.pi) - np.pi
    return np.array([c * dx + s * dy - z[0], c * dy - s * dx - z[1], turn])


@of_file
@given(information(3), nps.arrays(np.float64, 2, elements=st.floats(-5, 5)), angles)
def test_chi2_of_an_edge_is_that_of_toro(tmp_path: Path, omega: Array, shift: Array, angle: float) -> None:
    """Information order I11 I12 I22 I33 I13 I23, weighing a translation in the frame of pose i."""
    numbers = [omega[i, j] for i, j in ((0, 0), (0, 1), (1, 1), (2, 2), (0, 2), (1, 2))]
    record = " ".join(map(repr, [*shift.tolist(), angle, *map(float, numbers)]))
    graph = slamcli.read(str(write_file(tmp_path, f"{POSES_2D}EDGE2 0 1 {record}\n")))
    e = toro_residual_2d(*graph.variables["SE2"].values, np.array([*shift, angle]))
    assert graph.chi2() == pytest.approx(e @ omega @ e, rel=1e-12, abs=1e-12)


def test_the_fourth_number_is_that_of_the_angle(tmp_path: Path) -> None:
    """Read row by row, 100 0 100 400 0 0 would be a singular matrix with information 400 of y."""
    text = "VERTEX2 0 0 0 0\nVERTEX2 1 1 0 0\nEDGE2 0 1 1 0 0 100 0 100 400 0 0\n"
    graph = slamcli.read(str(write_file(tmp_path, text)))
    assert graph.factors[0].information[0].tolist() == np.diag([100.0, 100.0, 400.0]).tolist()
    assert b"EDGE_SE2 0 1 1 0 0 100 0 0 100 0 400\n" in render(graph, "g2o").data


@of_file
@given(information(3), nps.arrays(np.float64, 2, elements=st.floats(-5, 5)), angles)
def test_planar_conversion_keeps_chi2_there_and_back(tmp_path: Path, omega: Array, z: Array, angle: float) -> None:
    upper = " ".join(map(repr, omega[np.triu_indices(3)].tolist()))
    text = "VERTEX_SE2 0 0.1 0.2 0.3\nVERTEX_SE2 1 1.2 0.3 -0.4\nEDGE_SE2 {} {} {!r} {!r} {!r} {}\n"
    for i, j in ((0, 1), (1, 0)):
        graph = slamcli.read(str(write_file(tmp_path, text.format(i, j, *z.tolist(), angle, upper))))
        toro = convert(graph, tmp_path, "toro")
        back = convert(toro, tmp_path, "g2o")
        assert toro.chi2() == pytest.approx(graph.chi2(), rel=1e-9, abs=1e-9)
        assert_allclose(back.factors[0].information, graph.factors[0].information, rtol=1e-12, atol=1e-12)
        assert back.factors[0].measurements.tolist() == graph.factors[0].measurements.tolist()


@of_file
@given(information(6), nps.arrays(np.float64, 3, elements=st.floats(-5, 5)), angles, st.floats(-1.4, 1.4), angles)
def test_spatial_information_against_differences_of_the_euler_map(
    omega: Array, shift: Array, roll: float, pitch: float, yaw: float
) -> None:
    """Near the measurement, an error of the record's numbers costs the same in both formats."""
    record = np.array([[*shift, roll, pitch, yaw]])
    measurement, converted = EDGE3.decode(models.RELATIVE_POSE_3D, record, omega[np.triu_indices(6)][None])
    step = 1e-6
    jacobian = np.empty((6, 6))  # of our residual by the numbers of the record of a pose
    for k in range(6):
        ends = [se3.local(measurement, pose_from_euler(record + sign * step * np.eye(6)[k]))[0] for sign in (1.0, -1.0)]
        jacobian[:, k] = (ends[0] - ends[1]) / (2 * step)
    scale = np.abs(omega).max()
    assert_allclose(jacobian.T @ converted[0] @ jacobian, omega, rtol=0, atol=1e-6 * scale)
    again, numbers = EDGE3.encode(models.RELATIVE_POSE_3D, measurement, converted)
    assert_allclose(se3.to_matrix(pose_from_euler(again)), se3.to_matrix(measurement), rtol=0, atol=1e-12)
    assert_allclose(numbers[0], omega[np.triu_indices(6)], rtol=0, atol=1e-9 * scale)


@given(nps.arrays(np.float64, 3, elements=st.floats(-5, 5)), angles, st.floats(-1.5, 1.5), angles)
def test_euler_angles_there_and_back(shift: Array, roll: float, pitch: float, yaw: float) -> None:
    record = np.array([[*shift, roll, pitch, yaw]])
    assert_allclose(pose_to_euler(pose_from_euler(record)), record, rtol=0, atol=1e-12)


@given(angles, angles, angles)
def test_euler_angles_are_rotations_about_z_then_y_then_x(roll: float, pitch: float, yaw: float) -> None:
    def about(axis: int, angle: float) -> Array:
        quaternion = np.zeros((1, 7))
        quaternion[0, 3 + axis], quaternion[0, 6] = np.sin(angle / 2), np.cos(angle / 2)
        return quaternion

    together = se3.compose(se3.compose(about(2, yaw), about(1, pitch)), about(0, roll))
    found = pose_from_euler(np.array([[0.0, 0.0, 0.0, roll, pitch, yaw]]))
    assert_allclose(se3.to_matrix(found), se3.to_matrix(together), rtol=0, atol=1e-14)


@of_file
@given(information(6), nps.arrays(np.float64, 6, elements=st.floats(-1.4, 1.4)))
def test_spatial_conversion_keeps_chi2_there_and_back(tmp_path: Path, omega: Array, record: Array) -> None:
    upper = " ".join(map(repr, omega[np.triu_indices(6)].tolist()))
    z = " ".join(map(repr, record.tolist()))
    text = f"VERTEX3 0 0 0 0 0.1 0.2 0.3\nVERTEX3 7 1 2 3 -0.5 0.6 3.0\nEDGE3 7 0 {z} {upper}\n"
    graph = slamcli.read(str(write_file(tmp_path, text)))
    assume(graph.chi2() > 1e-9)
    g2o = convert(graph, tmp_path, "g2o")
    back = convert(g2o, tmp_path, "toro")
    assert g2o.chi2() == pytest.approx(graph.chi2(), rel=1e-9)
    assert back.chi2() == pytest.approx(graph.chi2(), rel=1e-9)
    assert_allclose(back.factors[0].information, graph.factors[0].information, rtol=1e-9, atol=1e-9)


def test_edges_from_a_later_to_an_earlier_pose_are_never_turned_round(tmp_path: Path) -> None:
    text = "# TORO writes them so\nVERTEX2 0 0 0 0\nVERTEX2 1 1 0 0.1\nEDGE2 1 0 -1 0.25 0 5 0 5 7 0 0\n"
    graph = slamcli.read(str(write_file(tmp_path, text)))
    assert graph.factors[0].variable_ids(graph.variables).tolist() == [[1, 0]]
    assert render(graph).data == text.encode()
    assert render(graph, "g2o").data.decode() == (
        "# TORO writes them so\nVERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0.1\nEDGE_SE2 1 0 -1 0.25 0 5 0 0 5 0 7\n"
    )


def test_an_edge_without_information_has_the_identity_of_the_record(tmp_path: Path) -> None:
    """Among edges that have one; only TORO's 3-D edges may lack it, and it is said."""
    upper = " ".join(map(repr, (4.0 * np.eye(6))[np.triu_indices(6)].tolist()))
    text = f"VERTEX3 0 0 0 0 0 0 0\nEDGE3 0 1 1 0 0 0 0 0\nEDGE3 0 1 1 0 0 0 0 0 {upper}\nEDGE3 1 2 1 0 0 0 0 0\n"
    graph = slamcli.read(str(write_file(tmp_path, text)))
    unit = np.diag([1.0, 1.0, 1.0, 4.0, 4.0, 4.0])  # a small angle is twice the quaternion's vector part
    assert_allclose(graph.factors[0].information, np.stack([unit, 4.0 * unit, unit]), atol=1e-14)
    assert graph.report is not None
    assert graph.report.notes == ["2 EDGE3 records have no information: the identity is used"]


def test_what_toro_cannot_express_is_said(tmp_path: Path) -> None:
    graph = slamcli.read(str(write_file(tmp_path, vectors + "FIX 0 20\nROBOTLASER1 0 1 2\n# end\n")))
    rendered = render(graph, "toro")
    tags = [line.split()[0] for line in rendered.data.decode().splitlines()]
    assert tags == ["VERTEX2", "VERTEX2", "VERTEX3", "VERTEX3", "EDGE2", "EDGE3", "#"]
    losses = "\n".join(rendered.losses)
    written = {"EDGE_SE2", "EDGE_SE3:QUAT"}
    for factors in graph.factors:
        assert (f"1 {factors.tag} edges" in losses) == (factors.tag not in written)
    others = ("2 XY vertices", "4 XYZ vertices", "1 SWITCH vertices", "2 parameters", "2 fixed vertices")
    others += ("1 SBA_CAMERA vertices", "1 SE3_EXPMAP vertices")
    for loss in (*others, "1 ROBOTLASER1 records"):
        assert loss in losses
    assert len(rendered.losses) == len(graph.factors) - len(written) + len(others) + 1
    assert render(graph, "g2o").losses == []


def test_malformed_records_are_a_loss_of_a_conversion(tmp_path: Path) -> None:
    path = write_file(tmp_path, "VERTEX2 0 0 0 0\nVERTEX2 1 x 0 0\n")
    graph = slamcli.read(str(path), lenient=True)
    rendered = render(graph, "g2o")
    assert rendered.data == b"VERTEX_SE2 0 0 0 0\n"
    assert rendered.losses == ["1 malformed records, left out"]


def test_new_vertices_of_a_conversion_come_before_the_first_edge_even_if_that_is_left_out(tmp_path: Path) -> None:
    text = "\ufeffEDGE_SE2_XY 0 9 1 1 1 0 1\n# odometry\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n"
    graph = slamcli.read(str(write_file(tmp_path, text)))
    estimated = graph.with_values({name: column.values for name, column in graph.variables.items()})
    expected = "\ufeffVERTEX2 0 0 0 0\nVERTEX2 1 0 0 0\n# odometry\nEDGE2 0 1 1 0 0 1 0 1 1 0 0\n"
    assert render(estimated, "toro").data.decode() == expected


@pytest.mark.parametrize(
    ("name", "dialect"), [("manhattan_small.g2o", "toro"), ("sphere_small.g2o", "toro"), ("square_toro.graph", "g2o")]
)
def test_bundled_data_sets_in_the_other_format(tmp_path: Path, name: str, dialect: str) -> None:
    graph = slamcli.read(str(BUNDLED / name))
    other = convert(graph, tmp_path, dialect)
    assert other.chi2() == pytest.approx(graph.chi2(), rel=1e-9)
    assert (other.poses, other.edges) == (graph.poses, graph.edges)
    for one, two in zip(other.factors, graph.factors, strict=True):
        assert one.variable_ids(other.variables).tolist() == two.variable_ids(graph.variables).tolist()


@pytest.mark.datasets
def test_the_same_graphs_in_both_formats() -> None:
    toro, g2o = slamcli.read(str(dataset("toro/M3500_mrob_toro.txt"))), slamcli.read(str(dataset("pose2d/M3500.g2o")))
    assert toro.chi2() == pytest.approx(g2o.chi2(), rel=1e-9)
    assert_allclose(toro.factors[0].information, g2o.factors[0].information, rtol=1e-9, atol=1e-9)
    # another author's conversion, with the numbers of the file rounded to about seven digits
    toro = slamcli.read(str(dataset("toro/CSAIL_P_toro.graph")))
    g2o = slamcli.read(str(dataset("pose2d/CSAIL_sesync.g2o")))
    scale = np.abs(g2o.factors[0].information).max(axis=(1, 2), keepdims=True)
    assert_allclose(toro.factors[0].information / scale, g2o.factors[0].information / scale, rtol=0, atol=1e-6)
