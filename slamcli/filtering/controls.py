"""Displacements of a log and their noise, all steps at once.

In the frame of the later pose the noise does not depend on the state: a prediction only has to turn it.
"""

from __future__ import annotations

import numpy as np

from slamcli.errors import InputError, UsageError
from slamcli.filtering.options import EkfOptions
from slamcli.graph.columns import IndexArray
from slamcli.graph.sensor_log import SensorLog
from slamcli.models.base import Array
from slamcli.models.motion import MOTION_MODELS


def displacements(log: SensorLog, options: EkfOptions) -> tuple[Array, Array]:
    """What moves the robot from step to step.

    Returns
    -------
    displacement
        (t - 1, 3) each pose seen from the one before.
    covariance
        (t - 1, 3, 3) of their errors, in the frame of the later pose.

    Raises
    ------
    UsageError
        If neither log nor options have the noise, or the options have that of another kind of control.
    InputError
        If an information matrix has no inverse.
    """
    if log.model not in MOTION_MODELS:
        raise UsageError(f"there is no motion model {log.model!r}", (f"  one of: {', '.join(MOTION_MODELS)}",))
    given = options.motion
    if given is not None and given.name != log.model:
        raise UsageError(f"the controls are those of the motion model {log.model!r}, the noise of {given.name!r}")
    intervals = np.diff(log.times)
    if log.information is None and given is None:
        raise UsageError(
            f"{log.source or 'the log'} does not say how precise its odometry is",
            (f"  give the noise of the motion model {log.model!r} (--motion-noise)",),
        )
    model = MOTION_MODELS[log.model]() if given is None else given
    displacement = model.displacement(log.controls, intervals)
    if log.information is None:
        return displacement, model.covariance(log.controls, intervals)
    return displacement, inverses(log.information, "the odometry of step", np.arange(1, len(log)))


def inverses(information: Array, what: str, numbers: IndexArray) -> Array:
    """Covariances (m, d, d) of information matrices; an error names the first that is not positive definite."""
    if len(information) == 0:
        return np.empty(information.shape)
    smallest = np.linalg.eigvalsh(information)[:, 0]
    bad = np.flatnonzero(~(smallest > 0.0))
    if len(bad):
        raise InputError(f"{what} {numbers[bad[0]]} has an information matrix that is not positive definite")
    inverse = np.linalg.inv(information)
    return 0.5 * (inverse + inverse.transpose(0, 2, 1))
