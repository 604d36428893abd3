"""A robot on two driven wheels that slip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from slamcli.errors import UsageError
from slamcli.geometry import so2
from slamcli.models.base import Array
from slamcli.models.motion.arc import sinc, unit_arc
from slamcli.models.motion.base import Partial, Path, PlanarMotion, require_not_negative


@dataclass(frozen=True)
class DifferentialDrive(PlanarMotion):
    """Control (left, right): the way of each wheel in metres; dt is not used.

    The robot drives an arc of length (left + right) / 2 that turns by (right - left) / baseline. The variance of a
    wheel's way is slip^2 times the way, as if every piece of it slipped on its own (Chong and Kleeman, "Accurate
    odometry and error modelling for a mobile robot", 1997): two half steps have the noise of a whole one.

    A control has two numbers and a displacement three: the covariance of a displacement has rank 2.

    Attributes
    ----------
    baseline
        Distance between the wheels in metres.
    slip
        Standard deviation of a wheel's way after one metre, in metres (that is, in square roots of a metre).
    """

    name: ClassVar[str] = "differential-drive"
    components: ClassVar[tuple[str, ...]] = ("left", "right")

    baseline: float = 0.5
    slip: float = 0.0

    def __post_init__(self) -> None:
        require_not_negative(self, "slip", "baseline")
        if self.baseline == 0.0:
            raise UsageError("baseline of the motion model must be positive")

    def control(self, relative: Array, dt: Array | float) -> Array:
        """Controls (m, 2) that make displacements (m, 3), but for what lies across the way (see ``remainder``).

        The turn is that of the displacement; the end point is the one nearest to the displacement's.
        """
        along, _, half = _chord(relative)
        length = along / sinc(half)
        return so2.pack(length - half * self.baseline, length + half * self.baseline)

    def remainder(self, relative: Array, dt: Array | float) -> Array:
        """What lies across the way: wheels do not move sideways. (m, 3), seen from the end of the step."""
        _, across, half = _chord(relative)
        return so2.pack(across * np.sin(half), across * np.cos(half), np.zeros(len(relative)))

    def variances(self, control: Array, dt: Array | float) -> Array:
        """Variances (m, 2) in m^2."""
        return self.slip * self.slip * np.absolute(control)

    def _path(self, control: Array, dt: Array | float) -> Path:
        length, turn = self._length_and_turn(control)
        arc = unit_arc(turn)
        return Path(length * arc.x, length * arc.y, turn)

    def _partials(self, control: Array, dt: Array | float) -> tuple[Partial, ...]:
        length, turn = self._length_and_turn(control)
        arc = unit_arc(turn)
        dx, dy, dturn = length * arc.dx / self.baseline, length * arc.dy / self.baseline, 1.0 / self.baseline
        return (0.5 * arc.x - dx, 0.5 * arc.y - dy, -dturn), (0.5 * arc.x + dx, 0.5 * arc.y + dy, dturn)

    def _length_and_turn(self, control: Array) -> tuple[Array, Array]:
        left, right = control[:, 0], control[:, 1]
        return 0.5 * (left + right), (right - left) / self.baseline


def _chord(relative: Array) -> tuple[Array, Array, Array]:
    """Displacement along and across the chord of an arc with its turn, in metres, and half that turn."""
    x, y, half = relative[:, 0], relative[:, 1], 0.5 * relative[:, 2]
    cosine, sine = np.cos(half), np.sin(half)
    return x * cosine + y * sine, y * cosine - x * sine, half
