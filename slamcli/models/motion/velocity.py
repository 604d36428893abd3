"""A robot that is commanded by velocities."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from slamcli.geometry import so2
from slamcli.models.base import Array
from slamcli.models.motion.arc import sinc, unit_arc
from slamcli.models.motion.base import Partial, Path, PlanarMotion, require_not_negative, way


@dataclass(frozen=True)
class VelocityMotion(PlanarMotion):
    """Control (v, omega, gamma): drive at v m/s and omega rad/s, then turn on the spot by gamma dt.

    Thrun, Burgard, Fox, "Probabilistic Robotics", 2005, table 5.3. Without gamma a displacement would lie on the
    two-dimensional set of arcs, and its covariance would be singular. The noise does not depend on dt.

    Attributes
    ----------
    alpha1
        Variance of v by v^2: relative error of the speed, squared.
    alpha2
        Variance of v by omega^2, in (m/rad)^2.
    alpha3
        Variance of omega by v^2, in (rad/m)^2.
    alpha4
        Variance of omega by omega^2: relative error of the rate of turn, squared.
    alpha5
        Variance of gamma by v^2, in (rad/m)^2.
    alpha6
        Variance of gamma by omega^2: relative error of the heading at the end, squared.
    """

    name: ClassVar[str] = "velocity"
    components: ClassVar[tuple[str, ...]] = ("v", "omega", "gamma")

    alpha1: float = 0.0
    alpha2: float = 0.0
    alpha3: float = 0.0
    alpha4: float = 0.0
    alpha5: float = 0.0
    alpha6: float = 0.0

    def __post_init__(self) -> None:
        require_not_negative(self, *(f"alpha{k}" for k in range(1, 7)))

    def control(self, relative: Array, dt: Array | float) -> Array:
        """Controls (m, 3) that make displacements (m, 3), dt > 0.

        The arc that leaves straight ahead, or in reverse to what lies behind, turns by at most half a turn; gamma
        does the rest. A turn on the spot is done by omega.
        """
        distance, direction = way(relative)
        length = distance / sinc(direction)
        turn = 2.0 * direction + relative[:, 2] * (distance == 0.0)
        return so2.pack(length / dt, turn / dt, so2.wrap(relative[:, 2] - turn) / dt)

    def variances(self, control: Array, dt: Array | float) -> Array:
        """Variances (m, 3) in (m/s)^2 and (rad/s)^2."""
        v, omega = np.square(control[:, 0]), np.square(control[:, 1])
        return so2.pack(
            self.alpha1 * v + self.alpha2 * omega,
            self.alpha3 * v + self.alpha4 * omega,
            self.alpha5 * v + self.alpha6 * omega,
        )

    def _path(self, control: Array, dt: Array | float) -> Path:
        length, turn = control[:, 0] * dt, control[:, 1] * dt
        arc = unit_arc(turn)
        return Path(length * arc.x, length * arc.y, turn + control[:, 2] * dt)

    def _partials(self, control: Array, dt: Array | float) -> tuple[Partial, ...]:
        arc = unit_arc(control[:, 1] * dt)
        length = control[:, 0] * dt
        return (arc.x * dt, arc.y * dt, 0.0), (length * arc.dx * dt, length * arc.dy * dt, dt), (0.0, 0.0, dt)
