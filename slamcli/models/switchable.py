"""Switchable relative poses and the priors of their switches: Vertigo's EDGE_SE2_SWITCHABLE, EDGE_SE3_SWITCHABLE and
EDGE_SWITCH_PRIOR.

Suenderhauf, Protzel, "Switchable Constraints for Robust Pose Graph SLAM", IROS 2012: each loop closure has a variable
of its own, the switch s in [0, 1], which scales its residual, and a prior that pulls the switch to 1. A closure that
contradicts the rest of the graph is switched off where that costs less than keeping it.
"""

from __future__ import annotations

import numpy as np

from slamcli.models.base import Array, FactorKind
from slamcli.models.variables import SWITCH


class SwitchableRelativePose(FactorKind):
    """e = s e_relative with the linear switch function: the weight of the relative pose is s^2.

    Parameters
    ----------
    relative
        The kind of relative pose that is switched. Its measurement and information are those of this kind, too.
    """

    def __init__(self, relative: FactorKind) -> None:
        self.relative = relative
        self.name = f"switchable_{relative.name}"
        self.variables = (*relative.variables, SWITCH)
        self.components = relative.components
        self.measurement_size = relative.measurement_size

    @property
    def relative_pose(self) -> bool:
        """True: the measurement is pose j seen from pose i."""
        return True

    def normalize(self, measurement: Array) -> Array:
        """As the relative pose does."""
        return self.relative.normalize(measurement)

    def residual(self, x: tuple[Array, ...], measurement: Array, parameter: Array | None) -> Array:
        """Residuals (m, d): those of the relative pose times the switch."""
        return x[2] * self.relative.residual(x[:2], measurement, parameter)

    def linearize_into(
        self,
        residual: Array,
        jacobians: tuple[Array, ...],
        x: tuple[Array, ...],
        measurement: Array,
        parameter: Array | None,
    ) -> None:
        """Residuals and Jacobians; see the base class."""
        self.relative.linearize_into(residual, jacobians[:2], x[:2], measurement, parameter)
        switch = x[2]
        jacobians[2][:, :, 0] = residual
        residual *= switch
        for jacobian in jacobians[:2]:
            jacobian *= switch[:, :, None]


class SwitchPrior(FactorKind):
    """e = gamma - s: measurement minus switch, as in Vertigo; without unit."""

    name = "switch_prior"
    variables = (SWITCH,)
    components = ("s",)
    measurement_size = 1

    def place(self, first: Array, measurement: Array, parameter: Array | None) -> Array:
        """Switch = the measurement."""
        return measurement

    def residual(self, x: tuple[Array, ...], measurement: Array, parameter: Array | None) -> Array:
        """Residuals (m, 1)."""
        return measurement - x[0]

    def linearize_into(
        self,
        residual: Array,
        jacobians: tuple[Array, ...],
        x: tuple[Array, ...],
        measurement: Array,
        parameter: Array | None,
    ) -> None:
        """Residuals and Jacobians; see the base class."""
        np.subtract(measurement, x[0], out=residual)
        jacobians[0][:, 0, 0] = -1.0
