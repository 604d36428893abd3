"""chi2 does not depend on the frame of the world, on the names of the variables or on the order of the lines."""

from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from support import BUNDLED, write_file

import slamcli
from slamcli import models
from slamcli.geometry import se2, se3
from slamcli.graph import FactorGraph
from slamcli.graph.columns import Values

BUNDLED_RELATIVE = ("manhattan_small.g2o", "sphere_small.g2o", "landmarks_small.g2o", "square_toro.graph")
each_graph = pytest.mark.parametrize("name", BUNDLED_RELATIVE)
coordinates = st.floats(-50.0, 50.0)

# One loop of each kind that is relative, none of them at its optimum.
PLANE = [
    "VERTEX_SE2 0 0.1 0.2 0.3",
    "VERTEX_SE2 1 1.2 0.3 -0.4",
    "VERTEX_SE2 2 1.0 1.4 3.0",
    "VERTEX_XY 10 2.0 1.5",
    "EDGE_SE2 0 1 1.0 0.1 -0.5 10 1 0.5 20 0.2 30",
    "EDGE_SE2 2 1 0.9 0.2 3.1 10 1 0.5 20 0.2 30",
    "EDGE_SE2_XY 0 10 1.9 0.6 10 1 20",
    "EDGE_BEARING_SE2_XY 2 10 -3.1 100",
]


def moved(graph: FactorGraph, planar: np.ndarray, spatial: np.ndarray) -> Values:
    """All variables seen from another world frame."""
    act = {"XY": (se2, planar), "XYZ": (se3, spatial)}
    frame = {"SE2": planar, "SE3": spatial}
    return {
        name: column.kind.compose(frame[name], column.values)
        if name in frame
        else act[name][0].act(act[name][1], column.values)
        for name, column in graph.variables.items()
    }


@each_graph
@settings(max_examples=10)
@given(coordinates, coordinates, coordinates, st.floats(-np.pi, np.pi), st.integers(0, 2**32 - 1))
def test_rigid_motion(name: str, x: float, y: float, z: float, angle: float, seed: int) -> None:
    graph = slamcli.read(str(BUNDLED / name))
    quaternion = np.random.default_rng(seed).normal(size=4)
    planar = np.array([x, y, angle])
    spatial = models.SE3.normalize(np.array([[x, y, z, *quaternion]]))[0]
    assert graph.chi2(moved(graph, planar, spatial)) == pytest.approx(graph.chi2(), rel=1e-9)


@given(coordinates, coordinates, st.floats(-np.pi, np.pi))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_rigid_motion_with_bearings(tmp_path: Path, x: float, y: float, angle: float) -> None:
    graph = slamcli.read(str(write_file(tmp_path, "\n".join(PLANE))))
    values = moved(graph, np.array([x, y, angle]), np.zeros(7))
    assert graph.chi2(values) == pytest.approx(graph.chi2(), rel=1e-10)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.permutations(PLANE),
    st.lists(st.integers(-(2**63), 2**63 - 1), min_size=4, max_size=4, unique=True),
)
def test_order_of_lines_and_names_of_variables(tmp_path: Path, lines: list[str], names: list[int]) -> None:
    """Vertices may follow their edges; ids may be any 64-bit numbers."""
    reference = slamcli.read(str(write_file(tmp_path, "\n".join(PLANE)))).chi2()
    new = dict(zip(("0", "1", "2", "10"), map(str, names), strict=True))
    renamed = []
    for line in lines:
        tag, *numbers = line.split()
        count = 1 if tag.startswith("VERTEX") else 2
        renamed.append(" ".join([tag, *(new[i] for i in numbers[:count]), *numbers[count:]]))
    graph = slamcli.read(str(write_file(tmp_path, "\n".join(renamed))))
    assert graph.poses == 3
    assert graph.landmarks == 1
    assert graph.chi2() == pytest.approx(reference, rel=1e-13)


def test_chi2_has_no_factor_of_one_half_and_is_quadratic_in_the_information(tmp_path: Path) -> None:
    edge = "VERTEX_XY 0 0 0\nVERTEX_XY 1 3 4\nEDGE_POINTXY 0 1 0 0 {} 0 {}\n"
    for weight in (1.0, 2.0, 7.0):
        graph = slamcli.read(str(write_file(tmp_path, edge.format(weight, weight))))
        assert graph.chi2() == weight * 25.0
