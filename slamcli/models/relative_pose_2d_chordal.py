"""Relative pose of two planar poses with the chord of the angle as residual: isotropic chordal objective of SE-Sync."""

from __future__ import annotations

import numpy as np

from slamcli.models.base import Array
from slamcli.models.relative_pose_2d import RelativePose2D


class RelativePose2DChordal(RelativePose2D):
    """e = (e_t, 2 sin(e_theta / 2)) with e_t and e_theta of ``RelativePose2D``.

    The chord is what a rotation by e_theta moves a point of the unit circle by, so that

        || R(e_theta) - I ||_F^2 = 4 (1 - cos e_theta) = 2 (2 sin(e_theta / 2))^2

    In space the residual of ``RelativePose3D`` has this form already: || R - I ||_F^2 = 8 |vec(q)|^2. No file has
    edges of this kind: ``slamcli.solver.certificate.isotropic`` makes them.
    """

    name = "relative_pose_2d_chordal"
    components = ("x", "y", "chord")

    def residual(self, x: tuple[Array, ...], measurement: Array, parameter: Array | None) -> Array:
        """Residuals (m, 3): x, y in metres, the chord between -2 and 2 (radians where it is small)."""
        residual = super().residual(x, measurement, parameter)
        residual[:, 2] = 2.0 * np.sin(0.5 * residual[:, 2])
        return residual

    def linearize_into(
        self,
        residual: Array,
        jacobians: tuple[Array, ...],
        x: tuple[Array, ...],
        measurement: Array,
        parameter: Array | None,
    ) -> None:
        """Residuals and Jacobians; see the base class."""
        super().linearize_into(residual, jacobians, x, measurement, parameter)
        half = 0.5 * residual[:, 2]
        slope = np.cos(half)
        jacobians[0][:, 2, 2] = -slope
        jacobians[1][:, 2, 2] = slope
        residual[:, 2] = 2.0 * np.sin(half)
