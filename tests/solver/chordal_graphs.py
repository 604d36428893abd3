"""What the tests of the chordal start share: exact graphs with wrong values, and the comparison with the truth."""

from dataclasses import replace

import numpy as np
import pytest
from graphs import exact_graph, information, random_values, variables
from numpy.testing import assert_allclose

from slamcli import models
from slamcli.geometry import se3
from slamcli.graph import FactorGraph, Factors
from slamcli.graph.columns import Values
from slamcli.models import FactorKind
from slamcli.solver import gauge
from slamcli.solver.initialization import initialize

PLANE = models.SE2, models.RELATIVE_POSE_2D
SPACE = models.SE3, models.RELATIVE_POSE_3D
each_space = pytest.mark.parametrize(("kind", "relative"), [PLANE, SPACE], ids=["plane", "space"])


def start(graph: FactorGraph) -> Values:
    """Values at the chordal start."""
    return initialize(graph, "chordal", gauge.choose(graph)[1])[0]


def spoiled(graph: FactorGraph, keep: dict[str, list[int]] | None = None, seed: int = 99) -> FactorGraph:
    """The graph with values that are far off, but for some rows (the first pose, if nothing is said)."""
    rng = np.random.default_rng(seed)
    values = {}
    for name, column in graph.variables.items():
        values[name] = random_values(rng, column.kind, len(column))
        rows = ([0] if column.kind.is_pose else []) if keep is None else keep.get(name, [])
        values[name][rows] = column.values[rows]
    return graph.with_values(values)


def assert_truth(graph: FactorGraph, found: Values, tolerance: float = 1e-8) -> None:
    """Every variable is where the graph has it, orientations included."""
    for name, column in graph.variables.items():
        if column.kind.is_pose:
            between = column.kind.compose(column.kind.inverse(column.values), found[name])
            off = se3.log(between) if column.kind is models.SE3 else column.kind.normalize(between)
        else:
            off = found[name] - column.values
        assert_allclose(off, 0.0, atol=tolerance, err_msg=name)


def with_factors(graph: FactorGraph, *factors: Factors) -> FactorGraph:
    return replace(graph, factors=[*graph.factors, *factors])


def landmark_graph(kind: FactorKind, seed: int = 8) -> FactorGraph:
    """Exact poses that observe exact points."""
    space = kind.variables[0].space
    graph = exact_graph(*(PLANE if space == 2 else SPACE), 12, seed)
    rng = np.random.default_rng(seed)
    point = kind.variables[1]
    points = variables(point, range(100, 108), 5.0 * rng.standard_normal((8, space)))
    graph = replace(graph, variables={**graph.variables, point.name: points})
    indices = np.stack([rng.integers(0, 12, 40), np.arange(40) % 8], axis=1)
    parameters = None if kind.parameter is None else random_values(rng, models.SE3, 40)
    zero = Factors(
        kind, indices, np.zeros((40, kind.measurement_size)), information(rng, 40, kind.dimension), parameters
    )
    residual = zero.residual(graph.values)
    sign = 1.0 if kind in (models.POINT_OBSERVATION_2D, models.POINT_OBSERVATION_3D) else -1.0
    return with_factors(graph, replace(zero, measurements=sign * residual))
