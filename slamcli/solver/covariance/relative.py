"""Covariance of one variable as seen from another, from their joint covariance.

The Jacobians of X_i^-1 X_j are those of the relative-pose factor where its residual vanishes: its error is then the
tangent step at X_i^-1 X_j itself. The same holds for a point in the frame of a pose and for the difference of points.
"""

from __future__ import annotations

import numpy as np

from slamcli import models
from slamcli.errors import UsageError
from slamcli.graph import FactorGraph
from slamcli.models import SE2, SE3, XY, XYZ, FactorKind, VariableKind
from slamcli.models.base import Array
from slamcli.solver.covariance.recovery import CovarianceRecovery, Member

_FACTORS: dict[tuple[str, str], tuple[FactorKind, VariableKind]] = {
    (SE2.name, SE2.name): (models.RELATIVE_POSE_2D, SE2),
    (SE3.name, SE3.name): (models.RELATIVE_POSE_3D, SE3),
    (SE2.name, XY.name): (models.POINT_OBSERVATION_2D, XY),
    (SE3.name, XYZ.name): (models.POINT_OBSERVATION_3D, XYZ),
    (XY.name, XY.name): (models.POINT_DIFFERENCE_2D, XY),
    (XYZ.name, XYZ.name): (models.POINT_DIFFERENCE_3D, XYZ),
}


def relative(recovery: CovarianceRecovery, first: Member, second: Member) -> tuple[VariableKind, Array, Array]:
    """The second variable in the frame of the first, with its covariance.

    Returns
    -------
    kind
        Of the relative variable: a pose between poses, a point otherwise.
    value
        (size,) X_i^-1 X_j, the point in the frame of pose i, or the difference of two points.
    covariance
        (d, d) J C J^T with C the joint covariance, in the tangent space at that value.

    Raises
    ------
    UsageError
        If there is no such relation between their kinds.
    NumericalError
        If H is singular or indefinite.
    """
    kind, value, jacobian = jacobians(recovery.graph, first, second)
    return kind, value, jacobian @ recovery.joint([first, second]) @ jacobian.T


def jacobians(graph: FactorGraph, first: Member, second: Member) -> tuple[VariableKind, Array, Array]:
    """The relative variable's kind and value, and its Jacobian (d, d_i + d_j) by the tangent steps of both.

    Raises
    ------
    UsageError
        If there is no such relation between their kinds.
    """
    pair = (first[0], second[0])
    if pair not in _FACTORS:
        raise UsageError(
            f"nothing is relative from {pair[0]} to {pair[1]}",
            ("  from a pose to a pose or a landmark, or between landmarks",),
        )
    if first == second:
        raise UsageError("a relative pose needs two different variables")
    factor, kind = _FACTORS[pair]
    x = tuple(graph.variables[name].values[row : row + 1] for name, row in (first, second))
    parameter = None if factor.parameter is None else np.array([factor.parameter.identity])
    if kind.is_pose or not factor.variables[0].is_pose:
        value = kind.compose(kind.inverse(x[0]), x[1])
    else:
        value = factor.residual(x, np.zeros((1, factor.measurement_size)), parameter)
    _, parts = factor.linearize(x, value, parameter)
    return kind, value[0], np.concatenate([part[0] for part in parts], axis=1)
