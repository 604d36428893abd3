"""Innovation of a reading: how far it is from its prediction, and how far that is for its noise.

Sensors are the factor kinds that optimizer and simulator use, seen as z = h(pose, landmark) + noise:

    innovation   nu = z - h                                  angles wrapped
    covariance   S = Hx P Hx^T + Hl L Hl^T + Q               pose, landmark and reading independent
    NIS          nu^T S^-1 nu                                chi-square with as many degrees of freedom as readings

(Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, section 5.4.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from slamcli import models
from slamcli.errors import UsageError
from slamcli.models import FactorKind
from slamcli.models.base import Array
from slamcli.models.range_bearing import world_jacobian

FRAMES = ("world", "local")

#: Smallest eigenvalue of S, scaled to a unit diagonal, below which it counts as singular.
_SINGULAR = 1e-12


@dataclass(frozen=True)
class Sensor:
    """A sensor on a planar pose that observes a point.

    Attributes
    ----------
    name
        As the command line names it.
    kind
        The factor that a reading becomes.
    sign
        +1 if the residual of that factor is z - h, -1 if it is h - z.
    units
        ``"m"`` or ``"rad"`` for each number of a reading.
    tag
        Record of such a factor in g2o's notation.
    """

    name: str
    kind: FactorKind
    sign: int
    units: tuple[str, ...]
    tag: str

    def innovation(self, pose: Array, landmark: Array, reading: Array) -> Array:
        """Innovations z - h, (m, d), of readings (m, d) from poses (m, 3) of landmarks (m, 2)."""
        return self.sign * self.kind.residual((pose, landmark), reading, None)

    def observe(self, pose: Array, landmark: Array) -> tuple[Array, Array, Array]:
        """Predictions h (m, d), their Jacobians by a local step of the pose (m, d, 3) and by the landmark (m, d, 2)."""
        nothing = np.zeros((len(pose), self.kind.measurement_size))
        residual, (by_pose, by_landmark) = self.kind.linearize((pose, landmark), nothing, None)
        return self.kind.normalize(-self.sign * residual), -self.sign * by_pose, -self.sign * by_landmark


SENSORS: dict[str, Sensor] = {
    sensor.name: sensor
    for sensor in (
        Sensor("range-bearing", models.RANGE_BEARING_2D, 1, ("m", "rad"), "EDGE_SE2_RB"),
        Sensor("bearing", models.BEARING_2D, 1, ("rad",), "EDGE_BEARING_SE2_XY"),
        Sensor("range", models.RANGE_2D, 1, ("m",), "EDGE_RANGE_SE2_XY"),
        Sensor("xy", models.POINT_OBSERVATION_2D, -1, ("m", "m"), "EDGE_SE2_XY"),
    )
}


@dataclass(frozen=True, eq=False)
class Prediction:
    """What a sensor should read, and what a reading says.

    Attributes
    ----------
    sensor
        The sensor.
    frame
        ``"world"``: pose steps are (x, y, theta) along the axes of the world; ``"local"``: along those of the pose.
    pose, landmark
        (3,) and (2,) metres and radians.
    predicted
        (d,) h.
    jacobian_pose, jacobian_landmark
        (d, 3) Hx by a pose step in ``frame``, and (d, 2) Hl.
    reading, innovation
        (d,) z, and z - h; None without a reading.
    covariance
        (d, d) S, None without any noise.
    nis
        Squared Mahalanobis distance; None without a reading, or where S is singular.
    probability
        That a reading from this landmark has as large a NIS or a larger one; None as ``nis``.
    """

    sensor: Sensor
    frame: str
    pose: Array
    landmark: Array
    predicted: Array
    jacobian_pose: Array
    jacobian_landmark: Array
    reading: Array | None = None
    innovation: Array | None = None
    covariance: Array | None = None
    nis: float | None = None
    probability: float | None = None


def predict(
    sensor: Sensor,
    pose: Array,
    landmark: Array,
    reading: Array | None = None,
    *,
    frame: str = "world",
    reading_deviations: Array | None = None,
    pose_deviations: Array | None = None,
    landmark_deviations: Array | None = None,
) -> Prediction:
    """Prediction of one reading.

    Parameters
    ----------
    sensor
        One of ``SENSORS``.
    pose, landmark, reading
        (3,), (2,) and (d,), in metres and radians.
    frame
        One of ``FRAMES``; of the pose steps in Hx and in ``pose_deviations``.
    reading_deviations, pose_deviations, landmark_deviations
        Standard deviations (d,), (3,), (2,) of independent errors; None: no error.

    Raises
    ------
    UsageError
        If the prediction has no derivative there: the landmark is at the pose.
    """
    pose, here, there = models.SE2.normalize(pose), pose[None], landmark[None]
    with np.errstate(all="ignore"):  # what is not finite is refused below
        predicted, by_pose, by_landmark = sensor.observe(here, there)
    _require_finite(sensor, pose, landmark, predicted, by_pose, by_landmark)
    if frame == "world":
        by_pose = world_jacobian(by_pose, here)
    errors = ((by_pose, pose_deviations), (by_landmark, landmark_deviations))
    covariance = innovation_covariance(
        np.diag(np.square(np.zeros(len(sensor.units)) if reading_deviations is None else reading_deviations)),
        *((jacobian, np.diag(np.square(given))) for jacobian, given in errors if given is not None),
    )[0]
    innovation = None if reading is None else sensor.innovation(here, there, sensor.kind.normalize(reading[None]))[0]
    known = any(given is not None for given in (reading_deviations, pose_deviations, landmark_deviations))
    nis = mahalanobis(innovation, covariance) if known and innovation is not None else None
    return Prediction(
        sensor=sensor,
        frame=frame,
        pose=pose,
        landmark=landmark,
        predicted=predicted[0],
        jacobian_pose=by_pose[0],
        jacobian_landmark=by_landmark[0],
        reading=reading,
        innovation=innovation,
        covariance=covariance if known else None,
        nis=nis,
        probability=None if nis is None else exceedance(nis, len(sensor.units)),
    )


def _require_finite(sensor: Sensor, pose: Array, landmark: Array, *parts: Array) -> None:
    """Raises ``UsageError`` where a part of a prediction is not finite."""
    if all(np.isfinite(part).all() for part in parts):
        return
    names = " and ".join(sensor.kind.components)
    if (pose[:2] == landmark).all():
        x, y = landmark.tolist()
        raise UsageError(f"the landmark is at the pose itself, ({x:g}, {y:g}): no derivative of {names} exists there")
    raise UsageError(f"{names} of a landmark at this distance are beyond the range of numbers")


def innovation_covariance(noise: Array, *terms: tuple[Array, Array]) -> Array:
    """S = Q + sum of H P H^T, (m, d, d).

    Parameters
    ----------
    noise
        (d, d) or (m, d, d) Q.
    terms
        Pairs of a Jacobian H (m, d, k) and a covariance P (k, k) or (m, k, k), independent of each other.
    """
    out = noise[None] if noise.ndim == 2 else noise
    for jacobian, covariance in terms:
        out = out + jacobian @ covariance @ jacobian.transpose(0, 2, 1)
    return 0.5 * (out + out.transpose(0, 2, 1))


def mahalanobis(innovation: Array, covariance: Array) -> float | None:
    """Squared Mahalanobis distance nu^T S^-1 nu; None where S (d, d) is singular."""
    scale = np.sqrt(np.diag(covariance))
    if not scale.all():
        return None
    correlation = covariance / np.outer(scale, scale)
    if np.linalg.eigvalsh(correlation)[0] < _SINGULAR:
        return None
    whitened = innovation / scale
    return float(whitened @ np.linalg.solve(correlation, whitened))


def exceedance(value: float, degrees_of_freedom: int) -> float:
    """Probability that a chi-square variable of 1 or 2 degrees of freedom is at least this large."""
    if degrees_of_freedom == 1:
        return math.erfc(math.sqrt(0.5 * value))
    assert degrees_of_freedom == 2
    return math.exp(-0.5 * value)
