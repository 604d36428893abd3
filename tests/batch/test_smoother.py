"""The smoother beside the filter: the same data, equal where everything is linear."""

from dataclasses import replace

import numpy as np
import pytest
from loops import LOOP, loop

from slamcli.batch.smoother import smooth
from slamcli.errors import NumericalError
from slamcli.filtering.chain import integrated
from slamcli.filtering.options import EkfOptions
from slamcli.filtering.run import run
from slamcli.filtering.smoother_graph import smoother_graph
from slamcli.geometry import se2
from slamcli.graph import FactorGraph
from slamcli.models import POINT_OBSERVATION_2D, SE2, XY
from slamcli.models.motion import BodyMotion
from slamcli.solver.optimize import optimize

OPTIONS = EkfOptions(start_deviations=(0.2, 0.1, 0.05))


def exact(log):
    """The log as it would be without any noise, but with the covariances of the noise."""
    poses, (ids, points) = log.true_trajectory.poses, log.true_landmarks
    entries = []
    for entry in log.observations:
        rows = np.searchsorted(ids, entry.landmarks)
        nothing = np.zeros(entry.measurements.shape)
        sign = 1.0 if entry.kind is POINT_OBSERVATION_2D else -1.0  # its residual is h - z, that of the others z - h
        readings = sign * entry.kind.residual((poses[entry.steps], points[rows]), nothing, None)
        entries.append(replace(entry, measurements=entry.kind.normalize(readings)))
    return replace(log, controls=se2.between(poses[:-1], poses[1:]), observations=entries)


def small(log, factor):
    """The log with all noise so many times smaller."""
    clean = exact(log)
    entries = []
    for noisy, true in zip(log.observations, clean.observations, strict=True):
        noise = noisy.kind.normalize(noisy.measurements - true.measurements)
        information = noisy.information / factor**2
        entries.append(replace(true, measurements=true.measurements + factor * noise, information=information))
    error = se2.local(clean.controls, log.controls)
    controls = se2.retract(clean.controls, factor * error)
    return replace(log, controls=controls, information=log.information / factor**2, observations=entries)


@pytest.mark.parametrize("options", [EkfOptions(), OPTIONS], ids=["start known", "start uncertain"])
def test_covariances_are_the_filters_where_all_errors_are_zero(options):
    """Then both linearize at the truth, and the filter's covariance is the smoother's marginal."""
    log = exact(loop())
    result = run(log, options)
    smoothed = smooth(log, options, result)
    pose, landmarks = smoothed.covariances(np.array([len(log) - 1]))
    assert smoothed.result.final_chi2 < 1e-12
    assert pose[0] == pytest.approx(result.covariances[-1], abs=1e-9)
    assert landmarks == pytest.approx(result.landmarks.covariances, abs=1e-9)


@pytest.mark.parametrize("sensor", ["range-bearing", "xy"])
def test_last_states_are_equal_where_everything_is_linear(sensor):
    """With errors of millionths of a metre and of a radian the models are linear to 1e-11."""
    noise = [0.15, 0.02] if sensor == "range-bearing" else [0.15, 0.1]
    log = loop(sensors=[{"kind": sensor, "range": 6.0, "noise": noise}])
    log = small(log, 1e-5)
    result = run(log, EkfOptions())
    smoothed = smooth(log, EkfOptions(), result)
    assert smoothed.poses[-1] == pytest.approx(result.poses[-1], abs=1e-9)
    assert smoothed.landmarks == pytest.approx(result.landmarks.positions, abs=1e-9)
    assert np.abs(smoothed.poses - result.poses).max() > 1e-6  # earlier poses are not equal: the filter never returns
    assert 0.7 < smoothed.result.final_chi2 / smoothed.result.dof < 1.4


def test_graph_holds_what_the_filter_used():
    log = loop()
    result = run(log, EkfOptions(sensor_range=4.0))
    built = smoother_graph(log, EkfOptions(sensor_range=4.0), result)
    odometry, readings = built.graph.factors
    assert (odometry.measurements == log.controls).all()
    assert odometry.information == pytest.approx(log.information, rel=1e-9)
    assert len(readings) == result.counts["used"] + result.counts["initialized"] < len(log.observations[0])
    assert (readings.measurements[:, 0] <= 4.0).all()
    assert built.graph.variables[SE2.name].fixed.nonzero()[0].tolist() == [0]
    assert len(built.graph.variables[XY.name]) == len(result.landmarks)
    assert (built.softened, built.deleted) == (0, 0)


def test_readings_of_deleted_landmarks_are_counted():
    """Two readings from nowhere start landmarks that nothing confirms."""
    log = loop()
    entry = log.observations[0]
    far = np.array([[60.0, 1.0], [70.0, -1.0]])
    steps = np.concatenate([entry.steps, [5, 9]])
    order = np.argsort(steps, kind="stable")
    columns = {
        "steps": steps[order],
        "landmarks": np.concatenate([entry.landmarks, [-1, -1]])[order],
        "measurements": np.concatenate([entry.measurements, far])[order],
        "information": np.concatenate([entry.information, entry.information[:2]])[order],
    }
    cluttered = replace(log, observations=[replace(entry, **columns)])
    options = EkfOptions(association="nearest", provisional_steps=20)
    result = run(cluttered, options)
    assert result.association.deleted >= 2
    built = smoother_graph(cluttered, options, result)
    used = result.counts["used"] + result.counts["initialized"]
    assert built.deleted >= 2
    assert len(built.graph.factors[1]) == used - built.deleted


def test_thinned_smoother_is_the_full_one_to_first_order():
    log = small(loop(sensors=[LOOP["sensors"][0] | {"every": 5}]), 1e-3)
    result = run(log, EkfOptions())
    full = smooth(log, EkfOptions(), result)
    built = smoother_graph(log, EkfOptions(), result, most=50)
    assert len(built.kept) < 30
    found = optimize(built.graph, tolerance=1e-12)
    assert found.final_chi2 == pytest.approx(full.result.final_chi2, rel=1e-4)
    kept = found.graph.variables[SE2.name].values
    assert kept == pytest.approx(full.poses[built.kept], abs=1e-6)
    assert np.abs(kept - integrated(log.start, log.controls)[built.kept]).max() > 1e-3


def test_standing_still_is_taken_as_such():
    """Steps without motion and noise: the filter can, an information matrix cannot."""
    log = loop(landmarks={"count": 150})  # so many that every step has a reading
    log = replace(log, information=None, controls=log.controls.copy())
    log.controls[40:43] = 0.0
    deviations = np.tile([0.05, 0.05, 0.01], (len(log) - 1, 1))
    deviations[40:43] = 0.0

    class Motion(BodyMotion):
        def covariance(self, control, dt):
            return np.square(deviations[: len(control)])[:, :, None] * np.eye(3)

    options = EkfOptions(motion=Motion((0.05, 0.05, 0.01)))
    smoothed = smooth(log, options, run(log, options))
    assert smoothed.built.softened == 3 and 0.0 < smoothed.built.softening < 1e-5
    assert smoothed.poses[43] == pytest.approx(smoothed.poses[40], abs=1e-4)


def test_start_values_do_not_decide_the_optimum():
    """From dead reckoning, with the landmarks hung off it, as from the filter's poses."""
    log = loop(seed=3)
    result = run(log, EkfOptions())
    smoothed = smooth(log, EkfOptions(), result)
    again = optimize(smoothed.built.graph, method="lm", init="odometry", tolerance=1e-12)
    assert again.start == "integrated odometry"
    assert again.final_chi2 == pytest.approx(smoothed.result.final_chi2, rel=1e-9)


def test_no_covariance_where_the_graph_is_singular():
    log = loop()
    smoothed = smooth(log, EkfOptions(), run(log, EkfOptions()))
    odometry, readings = smoothed.result.graph.factors
    ranges = replace(readings.part(slice(0, 1)), information=np.diag([1.0, 0.0])[None])  # one range places nothing
    broken = replace(
        smoothed,
        result=replace(
            smoothed.result, graph=FactorGraph(smoothed.result.graph.variables, [odometry, ranges]), problem=None
        ),
    )
    with pytest.raises(NumericalError, match="no covariances: the Hessian is not positive definite"):
        broken.covariances(np.array([0]))
