"""The raw log of Victoria Park: a car's wheel encoder and steering, trees in laser scans, and GPS.

===========================  ========================================================================================
``aa3_DRS.csv``              ``time,speed,steering``: s, m/s of the rear left wheel, rad counterclockwise
``lasersampling.txt``        the time of each laser scan, in milliseconds
``ObservationDistance.txt``  a row for each scan: distances to trees in metres, 0 where there is no further tree
``ObservationAngle.txt``     their directions in radians: 0 to the right, pi / 2 straight ahead, pi to the left
``aa3_GPS.csv``              ``time,x,y``: s, m; with jumps and gaps; may be absent
===========================  ========================================================================================

The car (J. Guivant, E. Nebot, "Optimization of the simultaneous localization and map-building algorithm for real-time
implementation", IEEE Trans. Robotics and Automation 17, 2001): the encoder sits on the rear left wheel, the speed at
the middle of the rear axle and the rate of turn are

    v = speed / (1 - tan(steering) H / L),   omega = v tan(steering) / L

The laser is A m in front of the rear axle and B m to the left of its middle. Poses of the log are those of the laser,
so that the readings need no offset: with the offset O of the laser on the car, a displacement D of the axle is the
displacement O^-1 D O of the laser.
"""

from __future__ import annotations

import os

import numpy as np

from slamcli.errors import InputError
from slamcli.formats.logs.columns import Columns, read_columns
from slamcli.formats.logs.timeline import counted, integrate, union
from slamcli.geometry import se2, so2
from slamcli.graph.sensor_log import Observations, SensorLog
from slamcli.graph.trajectory import Trajectory
from slamcli.models import RANGE_BEARING_2D, SE2
from slamcli.models.base import Array
from slamcli.models.motion import VelocityMotion

#: Metres: wheel to middle of the rear axle, wheelbase, laser in front of the rear axle and left of its middle.
H, L, A, B = 0.76, 2.83, 3.78, 0.5

_CONTROLS, _SCANS, _GPS = "aa3_DRS.csv", "lasersampling.txt", "aa3_GPS.csv"
_DISTANCES, _ANGLES = "ObservationDistance.txt", "ObservationAngle.txt"
_FILES = (_CONTROLS, _SCANS, _DISTANCES, _ANGLES)


def recognizes(folder: str) -> bool:
    """Whether a folder holds such a log, or parts of one."""
    return sum(os.path.exists(os.path.join(folder, name)) for name in _FILES) >= 2


def is_file(name: str) -> bool:
    """Whether a file name is one of such a log."""
    return name in _FILES


def read(folder: str, *, lenient: bool = False) -> SensorLog:
    """Read the log; the steps are the laser scans, the controls displacements (x, y, theta) of the laser.

    Which tree a reading is of is not known: all landmarks are -1. The start is the origin. The true trajectory has
    the GPS positions; its headings are not known and stand as 0.

    Raises
    ------
    InputError
        If a file is missing or not what it should be.
    """
    for name in _FILES:
        if not os.path.exists(os.path.join(folder, name)):
            hint = "  (aa3_dr.mat holds the same in milliseconds, and is not read)" if name == _CONTROLS else ""
            raise InputError(f"{os.path.join(folder, name)}: is missing", (hint,) * bool(hint))
    controls = read_columns(os.path.join(folder, _CONTROLS), "time speed steering", lenient).ascending()
    # a row of the scans' three files that is skipped would shift the others
    scans = read_columns(os.path.join(folder, _SCANS), "milliseconds", lenient=False).ascending(strictly=True)
    distances, angles = _readings(folder, len(scans))
    seen = distances > 0.0
    steps, _ = np.nonzero(seen)
    measurements = np.stack([distances[seen], angles[seen] - 0.5 * np.pi], axis=1)
    times = scans.numbers[:, 0] / 1000.0
    truth, notes = _gps(folder, lenient)
    beyond = np.count_nonzero((times < controls.numbers[0, 0]) | (times > controls.numbers[-1, 0]))
    return SensorLog(
        times=times,
        ids=np.arange(len(times), dtype=np.int64),
        model="body",
        controls=_laser_displacements(controls, times),
        information=None,
        observations=[
            Observations(
                kind=RANGE_BEARING_2D,
                steps=steps,
                landmarks=np.full(len(steps), -1, dtype=np.int64),
                measurements=RANGE_BEARING_2D.normalize(measurements),
                information=None,
            )
        ],
        start=np.zeros(3),
        true_trajectory=truth,
        positions_only=True,
        source=folder,
        notes=[
            *controls.notes,
            *counted(beyond, "scans lie before or after the odometry: its nearest record holds there"),
            "poses are those of the laser; the start is the origin",
            "which tree a reading is of is not known (landmark -1)",
            *notes,
        ],
    )


def _laser_displacements(controls: Columns, scans: Array) -> Array:
    """Displacements (t - 1, 3) of the laser between scans."""
    clock, speed, steering = controls.numbers.T
    tangent = np.tan(steering)
    velocity = speed / (1.0 - tangent * H / L)
    line = union(np.union1d(clock, scans[[0, -1]]), scans)
    # the record that holds from each time on: the first one before the odometry begins, the last one behind its end
    record = np.maximum(np.searchsorted(clock, line.times[:-1], side="right") - 1, 0)
    control = so2.pack(velocity[record], (velocity * tangent / L)[record], np.zeros(len(record)))
    path = integrate(VelocityMotion().displacement(control, np.diff(line.times)))
    laser = se2.compose(path, np.tile([A, B, 0.0], (len(path), 1)))[line.steps]
    return se2.between(laser[:-1], laser[1:])


def _readings(folder: str, scans: int) -> tuple[Array, Array]:
    """Distances and angles, one row for each scan."""
    paths = [os.path.join(folder, name) for name in (_DISTANCES, _ANGLES)]
    tables = [
        read_columns(path, f"{word} to trees, a row for each scan", lenient=False, columns=0)
        for path, word in zip(paths, ("distances", "angles"), strict=True)
    ]
    for path, table in zip(paths, tables, strict=True):
        if table.numbers.shape != (scans, tables[0].numbers.shape[1]):
            rows, columns = table.numbers.shape
            raise InputError(
                f"{path}: holds {rows} rows of {columns} numbers",
                (f"  expected {scans}, one for each scan of {_SCANS}, of as many numbers as {_DISTANCES} has",),
            )
    negative = tables[0].numbers < 0.0
    tables[0].without(np.asarray(negative.any(axis=1)), "a distance is negative", column=negative.argmax(axis=1))
    return tables[0].numbers, tables[1].numbers


def _gps(folder: str, lenient: bool) -> tuple[Trajectory | None, list[str]]:
    path = os.path.join(folder, _GPS)
    if not os.path.exists(path):
        return None, [f"{_GPS} is not there: no true positions"]
    table = read_columns(path, "time x y", lenient).ascending()
    poses = np.column_stack([table.numbers[:, 1:], np.zeros(len(table))])
    notes = [
        *table.notes,
        "true positions are those of the GPS, which jumps and fails at times; true headings stand as 0",
    ]
    return Trajectory(SE2, poses, stamps=table.numbers[:, 0], source=path), notes
