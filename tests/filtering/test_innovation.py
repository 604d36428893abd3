"""Predictions, innovations and what they are worth: worked numbers, signs, frames, and Monte Carlo."""

import math

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from numpy.testing import assert_allclose

from slamcli.errors import UsageError
from slamcli.filtering.innovation import SENSORS, Prediction, Sensor, exceedance, mahalanobis, predict
from slamcli.geometry import se2, so2

pytestmark = pytest.mark.filterwarnings("error")

POSE, LANDMARK = np.array([2.0, 1.0, np.pi / 6]), np.array([5.0, 5.0])
coordinates = st.floats(-100.0, 100.0)
each_sensor = pytest.mark.parametrize("sensor", SENSORS.values(), ids=SENSORS)


def lesson(**given: object) -> Prediction:
    reading = np.array([5.2, math.radians(21.0)])
    return predict(SENSORS["range-bearing"], POSE, LANDMARK, reading, **given)  # type: ignore[arg-type]


def test_the_worked_example() -> None:
    """Pose (2, 1, 30 deg), landmark (5, 5): h = (5 m, 23.1 deg); (5.2 m, 21 deg) is (+0.2 m, -2.1 deg) off."""
    p = lesson()
    assert p.innovation is not None
    assert_allclose(p.predicted, [5.0, math.radians(23.1301023542)], rtol=1e-11)
    assert_allclose(p.innovation, [0.2, math.radians(-2.1301023542)], rtol=1e-10)
    assert_allclose(p.jacobian_pose, [[-0.6, -0.8, 0.0], [0.16, -0.12, -1.0]], rtol=0, atol=1e-15)
    assert_allclose(p.jacobian_landmark, [[0.6, 0.8], [-0.16, 0.12]], rtol=0, atol=1e-15)
    assert p.covariance is p.nis is p.probability is None


def test_covariance_by_hand() -> None:
    """A pose sure to 5 cm and 0.1 rad gives diag(0.05^2, 0.05^2 / 25 + 0.1^2), the reading adds 0.1^2 and 0.2^2."""
    p = lesson(pose_deviations=np.array([0.05, 0.05, 0.1]), reading_deviations=np.array([0.1, 0.2]))
    assert p.covariance is not None
    assert p.innovation is not None
    variances = 0.05**2 + 0.1**2, 0.05**2 / 25.0 + 0.1**2 + 0.2**2
    assert_allclose(p.covariance, np.diag(variances), rtol=1e-14, atol=1e-17)
    nis = p.innovation[0] ** 2 / variances[0] + p.innovation[1] ** 2 / variances[1]
    assert p.nis == pytest.approx(nis, rel=1e-13)
    assert p.probability == pytest.approx(math.exp(-nis / 2.0), rel=1e-13)


@each_sensor
@given(coordinates, coordinates, st.floats(-np.pi, np.pi), coordinates, coordinates)
def test_the_predicted_reading_has_no_innovation(
    sensor: Sensor, x: float, y: float, heading: float, u: float, v: float
) -> None:
    pose, landmark = np.array([[x, y, heading]]), np.array([[u, v]])
    if math.hypot(x - u, y - v) < 1e-6:
        return
    predicted, _, _ = sensor.observe(pose, landmark)
    assert_allclose(sensor.innovation(pose, landmark, predicted), 0.0, rtol=0, atol=1e-14)
    # and an error of the reading is the innovation, whatever the sign of the factor's residual
    off = predicted + 0.01
    assert_allclose(sensor.innovation(pose, landmark, off), 0.01, rtol=0, atol=1e-12)


@pytest.mark.parametrize("turn", np.radians([179.999, -179.999, 180.0, -180.0, 90.0]))
def test_bearing_innovations_are_wrapped(turn: float) -> None:
    """A landmark straight behind, read one degree to either side of where it is."""
    for name in ("bearing", "range-bearing"):
        pose = np.array([0.0, 0.0, turn])
        landmark = 5.0 * np.array([-math.cos(turn), -math.sin(turn)])
        for degrees in (1.0, -1.0):
            bearing = float(so2.wrap(np.array(np.pi + math.radians(degrees))))
            reading = np.array([5.0, bearing][-len(SENSORS[name].units) :])
            p = predict(SENSORS[name], pose, landmark, reading)
            assert p.innovation is not None
            assert math.degrees(p.innovation[-1]) == pytest.approx(degrees, abs=1e-12)


@each_sensor
def test_the_frame_of_the_pose_step(sensor: Sensor) -> None:
    """A world step w is the local step R^T w: the same S from the same errors, in either frame."""
    world = predict(sensor, POSE, LANDMARK, pose_deviations=np.array([0.2, 0.2, 0.1]))
    local = predict(sensor, POSE, LANDMARK, pose_deviations=np.array([0.2, 0.2, 0.1]), frame="local")
    rotation = se2.to_matrix(np.array([0.0, 0.0, POSE[2]]))
    assert_allclose(local.jacobian_pose, world.jacobian_pose @ rotation, rtol=0, atol=1e-15)
    assert world.covariance is not None
    assert_allclose(local.covariance, world.covariance, rtol=0, atol=1e-15)


@each_sensor
def test_the_covariance_is_that_of_simulated_innovations(sensor: Sensor) -> None:
    """Within three standard errors; and the NIS is chi-square: its mean is the number of readings."""
    rng, count = np.random.default_rng(1), 40_000
    deviations = np.array([0.02, 0.03, 0.01]), np.array([0.01, 0.04]), np.array([0.03, 0.02])[: len(sensor.units)]
    pose, landmark, noise = (rng.standard_normal((count, len(d))) * d for d in deviations)
    truth, _, _ = sensor.observe(POSE + pose, LANDMARK + landmark)
    at = np.tile(POSE, (count, 1)), np.tile(LANDMARK, (count, 1))
    innovations = sensor.innovation(*at, truth + noise)
    p = predict(
        sensor,
        POSE,
        LANDMARK,
        pose_deviations=deviations[0],
        landmark_deviations=deviations[1],
        reading_deviations=deviations[2],
    )
    assert p.covariance is not None
    variances = np.diag(p.covariance)
    error = np.sqrt((np.square(p.covariance) + np.outer(variances, variances)) / count)
    assert (np.abs(np.atleast_2d(np.cov(innovations.T)) - p.covariance) < 3.0 * error).all()
    nis = [mahalanobis(innovation, p.covariance) for innovation in innovations[:4000]]
    dof = len(sensor.units)
    assert np.mean(nis) == pytest.approx(dof, abs=3.0 * math.sqrt(2.0 * dof / 4000))  # type: ignore[arg-type]


def test_exceedance_against_tables() -> None:
    """The 95% points of chi-square with 1 and 2 degrees of freedom."""
    assert exceedance(3.841458820694124, 1) == pytest.approx(0.05, rel=1e-12)
    assert exceedance(5.991464547107979, 2) == pytest.approx(0.05, rel=1e-12)
    assert exceedance(0.0, 1) == exceedance(0.0, 2) == 1.0


def test_a_singular_covariance_has_no_nis() -> None:
    """An error of the heading alone makes no error of the range."""
    p = lesson(pose_deviations=np.array([0.0, 0.0, 0.1]))
    assert p.covariance is not None
    assert p.nis is p.probability is None
    assert mahalanobis(np.ones(2), np.ones((2, 2))) is None
    assert mahalanobis(np.ones(2), np.diag([1e-12, 1e12])) == pytest.approx(1e12)  # units do not make it singular


@pytest.mark.parametrize("name", ["range-bearing", "bearing", "range"])
def test_a_landmark_at_the_pose(name: str) -> None:
    with pytest.raises(UsageError, match="the landmark is at the pose itself"):
        predict(SENSORS[name], POSE, POSE[:2])


def test_a_landmark_beyond_the_range_of_numbers() -> None:
    with pytest.raises(UsageError, match="range of a landmark at this distance"):
        predict(SENSORS["range"], POSE, np.array([1e300, 0.0]))


def test_coordinates_of_a_landmark_at_the_pose() -> None:
    p = predict(SENSORS["xy"], POSE, POSE[:2], np.zeros(2))
    assert p.innovation is not None
    assert not p.innovation.any()
