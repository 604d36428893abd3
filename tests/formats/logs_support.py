"""What the tests of sensor logs share: writing small logs, and what a log says when its controls are integrated."""

from pathlib import Path

import numpy as np

from slamcli.formats.logs.timeline import integrate, interpolate
from slamcli.graph.sensor_log import SensorLog
from slamcli.models.motion import MOTION_MODELS


def write_folder(folder: Path, **files: str) -> Path:
    """A folder with text files, named by the keys, in which two underscores stand for a dot."""
    folder.mkdir(exist_ok=True)
    for name, text in files.items():
        (folder / name.replace("__", ".")).write_text(text)
    return folder


def displacements(log: SensorLog) -> np.ndarray:
    """What the controls of a log move, (t - 1, 3)."""
    return MOTION_MODELS[log.model]().displacement(log.controls, np.diff(log.times))


def dead_reckoning(log: SensorLog) -> np.ndarray:
    """The poses of a log by its controls alone, (t, 3)."""
    return integrate(displacements(log), log.start)


def true_poses(log: SensorLog, times: np.ndarray) -> np.ndarray:
    """The true poses at given times."""
    truth = log.true_trajectory
    assert truth is not None and truth.stamps is not None
    return interpolate(truth.stamps, truth.poses, times)


def innovations(log: SensorLog, poses: np.ndarray) -> np.ndarray:
    """z - h of the readings of a log's first sensor, at given poses (one for each reading) and true landmarks."""
    readings = log.observations[0]
    assert log.true_landmarks is not None
    ids, positions = log.true_landmarks
    order = np.argsort(ids)
    points = positions[order][np.searchsorted(ids[order], readings.landmarks)]
    return readings.kind.residual((poses, points), readings.measurements, None)


def check_invariants(log: SensorLog) -> None:
    """What holds for every log."""
    assert log.times.shape == (len(log),) and log.ids.shape == (len(log),)
    assert (np.diff(log.times) >= 0.0).all() and len(np.unique(log.ids)) == len(log)
    assert log.controls.shape == (len(log) - 1, len(MOTION_MODELS[log.model]().components))
    assert log.information is None or log.information.shape == (len(log) - 1, 3, 3)
    assert log.start.shape == (3,) and np.isfinite(log.controls).all()
    for readings in log.observations:
        count = len(readings)
        assert readings.measurements.shape == (count, readings.kind.measurement_size)
        assert readings.landmarks.dtype == np.int64 and (readings.landmarks >= -1).all()
        assert (np.diff(readings.steps) >= 0).all() and readings.steps.min() >= 0 and readings.steps.max() < len(log)
        d = readings.kind.dimension
        assert readings.information is None or readings.information.shape == (count, d, d)
        assert not np.isin(log.ids, readings.landmarks).any()
