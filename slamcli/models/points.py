"""Factors between points, and priors on them: g2o's EDGE_POINTXY, EDGE_PRIOR_XY, EDGE_POINTXYZ, EDGE_POINTXYZ_PRIOR.

One class serves both dimensions, since the residuals are linear with constant Jacobians.
"""

from __future__ import annotations

import numpy as np

from slamcli.models.base import Array, FactorKind, VariableKind


class PointDifference(FactorKind):
    """e = (b - a) - z, in metres (g2o, ``EdgePointXY`` and ``EdgePointXYZ``)."""

    def __init__(self, point: VariableKind) -> None:
        self.name = f"point_difference_{point.space}d"
        self.variables = (point, point)
        self.components = point.components
        self.measurement_size = point.size

    def place(self, first: Array, measurement: Array, parameter: Array | None) -> Array:
        """Second point = first point + measurement."""
        return first + measurement

    def residual(self, x: tuple[Array, ...], measurement: Array, parameter: Array | None) -> Array:
        """Residuals (m, space) in metres."""
        return x[1] - x[0] - measurement

    def linearize(
        self, x: tuple[Array, ...], measurement: Array, parameter: Array | None
    ) -> tuple[Array, tuple[Array, ...]]:
        """Residuals (m, space) and the constant Jacobians -I and I."""
        eye = _identities(len(x[0]), self.dimension)
        return x[1] - x[0] - measurement, (-eye, eye)


class PointPrior(FactorKind):
    """e = l - z, in metres (g2o, ``EdgeXYPrior`` and ``EdgeXYZPrior``)."""

    def __init__(self, point: VariableKind) -> None:
        self.name = f"point_prior_{point.space}d"
        self.variables = (point,)
        self.components = point.components
        self.measurement_size = point.size

    def place(self, first: Array, measurement: Array, parameter: Array | None) -> Array:
        """Point = the measurement."""
        return measurement

    def residual(self, x: tuple[Array, ...], measurement: Array, parameter: Array | None) -> Array:
        """Residuals (m, space) in metres."""
        return x[0] - measurement

    def linearize(
        self, x: tuple[Array, ...], measurement: Array, parameter: Array | None
    ) -> tuple[Array, tuple[Array, ...]]:
        """Residuals (m, space) and the constant Jacobian I."""
        return x[0] - measurement, (_identities(len(x[0]), self.dimension),)


def _identities(count: int, dimension: int) -> Array:
    """A stack of identity matrices (count, dimension, dimension)."""
    return np.broadcast_to(np.eye(dimension), (count, dimension, dimension))
