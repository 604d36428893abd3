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

    def linearize_into(
        self,
        residual: Array,
        jacobians: tuple[Array, ...],
        x: tuple[Array, ...],
        measurement: Array,
        parameter: Array | None,
    ) -> None:
        """Residuals and Jacobians; see the base class."""
        residual[:] = x[1] - x[0] - measurement
        jacobians[0][:] = -np.eye(self.dimension)
        jacobians[1][:] = np.eye(self.dimension)


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

    def linearize_into(
        self,
        residual: Array,
        jacobians: tuple[Array, ...],
        x: tuple[Array, ...],
        measurement: Array,
        parameter: Array | None,
    ) -> None:
        """Residuals and Jacobians; see the base class."""
        np.subtract(x[0], measurement, out=residual)
        jacobians[0][:] = np.eye(self.dimension)
