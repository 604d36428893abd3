"""A robot whose odometry is a relative pose with noise that does not depend on it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from slamcli.errors import UsageError
from slamcli.models.base import Array, VariableKind
from slamcli.models.motion.base import carried
from slamcli.models.variables import SE2


@dataclass(frozen=True)
class BodyMotion:
    """Control = displacement, a relative pose in SE(2) or SE(3); dt is not used.

    The measurement model of ``RelativePose2D`` and ``RelativePose3D``: noise is a local step of the displacement,
    ``retract(control, noise)``, with the same covariance at every step.

    Attributes
    ----------
    deviations
        Standard deviations of the noise, in the order of ``kind.components``: metres, then radians for SE2 and the
        vector part of a quaternion for SE3, which is half an angle (0.5 degrees there are 1 degree of rotation).
    kind
        SE2 or SE3.
    """

    name: ClassVar[str] = "body"

    deviations: tuple[float, ...] = (0.0, 0.0, 0.0)
    kind: VariableKind = SE2

    def __post_init__(self) -> None:
        if len(self.deviations) != self.kind.dimension or not all(0.0 <= s < np.inf for s in self.deviations):
            raise UsageError(
                f"deviations of the motion model must be {self.kind.dimension} numbers that are not negative, "
                f"got {self.deviations!r}"
            )

    @property
    def components(self) -> tuple[str, ...]:
        """Those of a local step."""
        return self.kind.components

    def control(self, relative: Array, dt: Array | float) -> Array:
        """The displacement."""
        return relative

    def remainder(self, relative: Array, dt: Array | float) -> Array:
        """Nothing: every displacement is possible."""
        return np.tile(self.kind.identity, (len(relative), 1))

    def displacement(self, control: Array, dt: Array | float) -> Array:
        """The control."""
        return control

    def perturb(self, control: Array, noise: Array) -> Array:
        """The control with a local step."""
        return self.kind.retract(control, noise)

    def jacobian(self, control: Array, dt: Array | float) -> Array:
        """The identity, (m, d, d)."""
        return np.tile(np.eye(self.kind.dimension), (len(control), 1, 1))

    def variances(self, control: Array, dt: Array | float) -> Array:
        """The squared deviations, (m, d)."""
        return np.tile(np.square(self.deviations), (len(control), 1))

    def covariance(self, control: Array, dt: Array | float) -> Array:
        """The diagonal matrix of the variances, (m, d, d)."""
        return np.tile(np.diag(np.square(self.deviations)), (len(control), 1, 1))

    def propagate(self, pose: Array, control: Array, dt: Array | float) -> tuple[Array, Array, Array]:
        """See ``MotionModel``."""
        return self.kind.compose(pose, control), carried(self.kind, control), self.jacobian(control, dt)
