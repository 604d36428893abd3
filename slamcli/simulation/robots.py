"""What the odometry of a robot says about its true path."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from slamcli.errors import UsageError
from slamcli.formats.quantities import parse_numbers
from slamcli.geometry import se2, se3
from slamcli.models import SE2, SE3, VariableKind, motion
from slamcli.models.base import Array
from slamcli.simulation.noise import LEAST_SIGMA, Noise, standard
from slamcli.simulation.portable import portable
from slamcli.simulation.scenario import Robot
from slamcli.simulation.worlds import Path

#: Standard deviations of a robot that nothing is said about: metres, radians.
DEFAULT_NOISE = (0.05, 0.01)
#: Deviation or covariance: what is larger has no square.
_LARGEST = 1e100
DEFAULT_ALPHAS = {
    "odometry": (0.01, 0.0004, 0.002, 0.0004),
    "velocity": (0.002, 0.0004, 0.0004, 0.0004, 0.0004, 0.0004),
}


@dataclass(frozen=True, eq=False)
class Odometry:
    """Measured steps of a robot.

    Attributes
    ----------
    measurements
        (n - 1, size) relative poses.
    information
        (n - 1, d, d) in the residual's order and frame.
    controls
        (n - 1, k) what the robot's own instruments say: relative poses, rotations and translations, velocities,
        or wheel paths.
    control
        Name of the kind of control.
    """

    measurements: Array
    information: Array
    controls: Array
    control: str


def pose_kind(space: int) -> VariableKind:
    """SE2 or SE3."""
    return SE2 if space == 2 else SE3


def relative_poses(poses: Array, first: Any, second: Any) -> Array:
    """True poses of the second rows seen from the first ones."""
    group = se2 if poses.shape[1] == 3 else se3
    return portable(group.between(poses[first], poses[second]))


def spoiled(exact: Array, error: Array) -> Array:
    """Measured relative poses z for which the residual z^-1 h of g2o is exactly the given error (m, d)."""
    kind = pose_kind(2 if exact.shape[1] == 3 else 3)
    identity = portable(np.tile(kind.identity, (len(exact), 1)))
    wrong = portable(kind.retract(identity, portable(error)))
    return portable(kind.normalize(portable(kind.compose(exact, portable(kind.inverse(wrong))))))


def relative_covariance(noise: Any, space: int, source: str) -> Array:
    """Covariance of a relative pose from what a scenario says (see ``Robot.noise``).

    Rotations in space are stated as rotation vectors; the residual's are half of them (the quaternion's vector part).
    """
    dimension = 3 if space == 2 else 6
    given = numbers_of(DEFAULT_NOISE if noise is None else noise, source)
    turns = dimension - space
    if given.ndim == 1 and len(given) == 2:
        given = np.array([given[0]] * space + [given[1]] * turns)
    covariance = covariance_of(given, dimension, source)
    scale = np.ones(dimension)
    if space == 3:
        scale[3:] = 0.5
    return covariance * scale[:, None] * scale


def numbers_of(value: Any, source: str) -> Array:
    """A list or matrix of numbers, which may have units, as an array."""
    try:
        if isinstance(value, (list, tuple)):
            rows = [numbers_of(item, source) for item in value]
            return np.array([row.item() if row.ndim == 0 else row for row in rows], dtype=np.float64)
        if isinstance(value, str):
            numbers = parse_numbers(value)
            return np.array(numbers[0] if len(numbers) == 1 else numbers)
        if isinstance(value, bool) or not math.isfinite(value):
            raise ValueError(f"found {value!r}")
        return np.array(float(value))
    except (TypeError, ValueError) as error:
        raise UsageError(f"{source}: expected numbers, {error}") from None


def covariance_of(given: Array, dimension: int, source: str) -> Array:
    """Covariance (d, d) of standard deviations (one for all, or d) or of a matrix."""
    if not (np.abs(given) <= _LARGEST).all():
        raise UsageError(f"{source}: expected numbers of at most {_LARGEST:g}")
    if given.ndim == 0:
        given = np.full(dimension, float(given))
    if given.shape == (dimension,) and (given >= 0.0).all():
        return np.diag(np.square(given))
    if given.shape == (dimension, dimension) and (given == given.T).all():
        try:
            _ = Noise(given).root
        except ValueError as error:
            raise UsageError(f"{source}: {error}") from None
        return given
    raise UsageError(
        f"{source}: expected {dimension} standard deviations of 0 or more, or a symmetric covariance matrix",
    )


def drive(path: Path, robot: Robot, rng: np.random.Generator) -> Odometry:
    """Odometry of a robot along its true path."""
    exact = relative_poses(path.poses, slice(None, -1), slice(1, None))
    distance = path.steps()
    if robot.model == "body":
        noise = Noise(relative_covariance(robot.noise, path.space, "robot.noise"), robot.tails)
        measured = spoiled(exact, noise.draw(rng, len(exact)))
        information = np.broadcast_to(noise.information, (len(exact), noise.dimension, noise.dimension)).copy()
        controls, name = measured, "relative-pose"
    else:
        measured, information, controls = _driven(exact, robot, rng)
        name = robot.model
    if robot.turn_bias:
        measured = _turned(measured, robot.turn_bias * distance)
        controls = measured if name == "relative-pose" else controls
    return Odometry(np.asarray(measured), information, np.asarray(controls), name)


def _driven(exact: Array, robot: Robot, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Planar steps measured through a motion model: the noise is in the controls."""
    model = _motion_model(robot)
    control = portable(model.control(exact, robot.period))
    rest = portable(model.remainder(exact, robot.period))  # what the model cannot do, such as moving sideways
    sigma = np.sqrt(portable(model.variances(control, robot.period)))
    measured_control = control + sigma * standard(rng, control.shape, robot.tails)
    if robot.model == "differential" and robot.ticks_per_metre:
        measured_control = np.rint(measured_control * robot.ticks_per_metre) / robot.ticks_per_metre
    covariance = _carried(np.asarray(model.covariance(control, robot.period)), rest)
    measured = se2.compose(portable(model.displacement(portable(measured_control), robot.period)), rest)
    if robot.model == "differential":
        wheels = np.abs(control)
        lateral = robot.sideways * robot.slip * np.sqrt(0.5 * (wheels[:, 0] + wheels[:, 1]))
        error = np.zeros((len(exact), 3))
        error[:, 1] = np.asarray(lateral) * standard(rng, (len(exact), 1), robot.tails)[:, 0]
        measured = spoiled(portable(measured), error)
        covariance[:, 1, 1] += np.square(np.asarray(lateral))
    return portable(measured), _inverse(covariance), measured_control


def _motion_model(robot: Robot) -> motion.MotionModel:
    alphas = robot.alphas or DEFAULT_ALPHAS.get(robot.model, ())
    if robot.model == "odometry":
        return motion.OdometryMotion(*alphas)
    if robot.model == "velocity":
        return motion.VelocityMotion(*alphas)
    return motion.DifferentialDrive(baseline=robot.baseline, slip=robot.slip)


def _turned(measured: Array, angle: Array) -> Array:
    """Relative poses followed by a turn about the body's z axis."""
    planar = measured.shape[1] == 3
    turn = np.zeros(measured.shape)
    if planar:
        turn[:, 2] = angle
        return portable(se2.compose(measured, portable(turn)))
    half = portable(0.5 * angle)
    turn[:, 5], turn[:, 6] = np.sin(half), np.cos(half)
    return portable(se3.normalize(portable(se3.compose(measured, portable(turn)))))


def _carried(covariance: Array, by: Array) -> Array:
    """Covariances (m, 3, 3) of poses, of the poses a further step away: A C A^T with A the adjoint of the way back."""
    a = np.asarray(se2.adjoint(portable(se2.inverse(portable(by)))))
    return _product(_product(a, covariance), a.transpose(0, 2, 1))


def _product(a: Array, b: Array) -> Array:
    """Matrix products (m, 3, 3), summed in a fixed order."""
    out = a[:, :, 0, None] * b[:, 0, None, :]
    for k in (1, 2):
        out = out + a[:, :, k, None] * b[:, k, None, :]
    return np.asarray(out)


def _inverse(covariance: Array) -> Array:
    """Inverses (m, 3, 3) by cofactors; directions without noise count as known to LEAST_SIGMA."""
    c = covariance + 0.0
    product = c[:, 0, 0] * c[:, 1, 1] * c[:, 2, 2]
    degenerate = _determinant(c) <= 1e-9 * product
    c[degenerate] += LEAST_SIGMA**2 * np.eye(3)
    out = np.empty_like(c)
    for i in range(3):
        for j in range(3):
            a, b, d, e = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            out[:, j, i] = c[:, a, d] * c[:, b, e] - c[:, a, e] * c[:, b, d]
    out /= _determinant(c)[:, None, None]
    return 0.5 * (out + out.transpose(0, 2, 1))


def _determinant(c: Array) -> Array:
    first = c[:, 0, 0] * (c[:, 1, 1] * c[:, 2, 2] - c[:, 1, 2] * c[:, 2, 1])
    second = c[:, 0, 1] * (c[:, 1, 0] * c[:, 2, 2] - c[:, 1, 2] * c[:, 2, 0])
    return first - second + c[:, 0, 2] * (c[:, 1, 0] * c[:, 2, 1] - c[:, 1, 1] * c[:, 2, 0])
