"""A robot whose odometry is read as turn, way, turn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from slamcli.geometry import so2
from slamcli.models.base import Array
from slamcli.models.motion.base import Partial, Path, PlanarMotion, require_not_negative, way


@dataclass(frozen=True)
class OdometryMotion(PlanarMotion):
    """Control (rot1, trans, rot2): turn by rot1 rad, go trans m straight ahead, turn by rot2 rad; dt is not used.

    Thrun, Burgard, Fox, "Probabilistic Robotics", 2005, table 5.6.

    Attributes
    ----------
    alpha1
        Variance of a turn by that turn squared: its relative error, squared.
    alpha2
        Variance of each turn by trans^2, in (rad/m)^2.
    alpha3
        Variance of trans by trans^2: relative error of the way, squared.
    alpha4
        Variance of trans by rot1^2 + rot2^2, in (m/rad)^2.
    """

    name: ClassVar[str] = "odometry"
    components: ClassVar[tuple[str, ...]] = ("rot1", "trans", "rot2")

    alpha1: float = 0.0
    alpha2: float = 0.0
    alpha3: float = 0.0
    alpha4: float = 0.0

    def __post_init__(self) -> None:
        require_not_negative(self, "alpha1", "alpha2", "alpha3", "alpha4")

    def control(self, relative: Array, dt: Array | float) -> Array:
        """Controls (m, 3) that make displacements (m, 3).

        What lies behind is reached in reverse (trans < 0), where the book's atan2 would turn the robot round and
        charge the noise of that turn. A turn on the spot is all rot2.
        """
        trans, rot1 = way(relative)
        return so2.pack(rot1, trans, so2.wrap(relative[:, 2] - rot1))

    def variances(self, control: Array, dt: Array | float) -> Array:
        """Variances (m, 3) in rad^2, m^2, rad^2."""
        rot1, trans, rot2 = (np.square(control[:, k]) for k in range(3))
        return so2.pack(
            self.alpha1 * rot1 + self.alpha2 * trans,
            self.alpha3 * trans + self.alpha4 * (rot1 + rot2),
            self.alpha1 * rot2 + self.alpha2 * trans,
        )

    def _path(self, control: Array, dt: Array | float) -> Path:
        rot1, trans = control[:, 0], control[:, 1]
        return Path(trans * np.cos(rot1), trans * np.sin(rot1), rot1 + control[:, 2])

    def _partials(self, control: Array, dt: Array | float) -> tuple[Partial, ...]:
        cosine, sine, trans = np.cos(control[:, 0]), np.sin(control[:, 0]), control[:, 1]
        return (-trans * sine, trans * cosine, 1.0), (cosine, sine, 0.0), (0.0, 0.0, 1.0)
