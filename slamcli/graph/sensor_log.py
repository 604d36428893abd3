"""What a planar robot measured, step by step: the input of a filter, from graphs, simulations and real sensor logs."""

from __future__ import annotations

from dataclasses import dataclass, field

from slamcli.graph.columns import IdArray, IndexArray
from slamcli.graph.trajectory import Trajectory
from slamcli.models import FactorKind
from slamcli.models.base import Array


@dataclass(frozen=True, eq=False)
class Observations:
    """All readings of one kind of sensor.

    Attributes
    ----------
    kind
        The factor that a reading is: ``models.RANGE_BEARING_2D``, ``BEARING_2D``, ``RANGE_2D`` or
        ``POINT_OBSERVATION_2D``.
    steps
        (m,) step of each reading, ascending.
    landmarks
        (m,) id of the landmark that it is of, -1 where that is not known.
    measurements
        (m, kind.measurement_size) in metres and radians.
    information
        (m, d, d) in the order of the kind's residual, or None where the log does not say.
    """

    kind: FactorKind
    steps: IndexArray
    landmarks: IdArray
    measurements: Array
    information: Array | None

    def __len__(self) -> int:
        return len(self.steps)


@dataclass(frozen=True, eq=False)
class SensorLog:
    """Controls and readings in the order of time.

    Step 0 is the start; control k leads from step k to step k + 1; the readings of a step are made at its end.

    Attributes
    ----------
    times
        (t,) seconds, not descending.
    ids
        (t,) id of the pose at each step, for output.
    model
        What a control is, a name of ``models.motion.MOTION_MODELS``: ``body`` (x, y, theta of the next pose seen
        from this one), ``velocity`` (v, omega, gamma over the interval), ``odometry`` (rot1, trans, rot2),
        ``differential-drive`` (left, right).
    controls
        (t - 1, k).
    information
        (t - 1, 3, 3) of the displacements, in the frame of the later pose (the residual of
        ``models.RELATIVE_POSE_2D``), or None where the log does not say.
    observations
        One entry for each kind of sensor.
    start
        (3,) pose of step 0.
    true_trajectory
        The truth with the time stamps or ids of its poses, if it is known.
    true_landmarks
        Ids (k,) and positions (k, 2), if they are known.
    positions_only
        Whether the truth has positions in a frame of its own and no headings, as from a satellite receiver.
    source
        Where the log comes from.
    notes
        Assumptions and what was left out, one sentence each.
    """

    times: Array
    ids: IdArray
    model: str
    controls: Array
    information: Array | None
    observations: list[Observations]
    start: Array
    true_trajectory: Trajectory | None = None
    true_landmarks: tuple[IdArray, Array] | None = None
    positions_only: bool = False
    source: str = ""
    notes: list[str] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.times)
