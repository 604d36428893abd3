"""Residuals and analytic Jacobians of every kind of factor, in g2o's error definitions.

``VARIABLE_KINDS`` and ``FACTOR_KINDS`` are the public lists; the instances below are what graphs refer to. Files have
factors of the kinds in ``FACTOR_KINDS``; ``RELATIVE_POSE_2D_CHORDAL`` is for graphs made in memory.
"""

from slamcli.models.base import FactorKind, VariableKind
from slamcli.models.cameras import CAMERA, CAMERA_PARAMETERS, SBA_CAMERA, SE3_EXPMAP
from slamcli.models.point_observation import PointObservation2D, PointObservation3D
from slamcli.models.points import PointDifference, PointPrior
from slamcli.models.priors import PosePrior2D, PosePrior3D, PositionPrior2D, PositionPrior3D
from slamcli.models.projection import (
    BalProjection,
    ExpmapProjection,
    Projection,
    SbaProjection,
    SbaStereoProjection,
)
from slamcli.models.range_bearing import Bearing2D, Range2D, RangeBearing2D
from slamcli.models.relative_pose_2d import RelativePose2D
from slamcli.models.relative_pose_2d_chordal import RelativePose2DChordal
from slamcli.models.relative_pose_3d import RelativePose3D
from slamcli.models.shared_intrinsics import (
    BAL_INTRINSICS,
    CALIBRATED_CAMERA,
    CAMERA_POSE,
    INTRINSICS,
    PINHOLE_INTRINSICS,
    CalibratedBalProjection,
    SharedBalProjection,
    SharedPinholeProjection,
)
from slamcli.models.switchable import SwitchableRelativePose, SwitchPrior
from slamcli.models.variables import SE2, SE3, SWITCH, VARIABLE_KINDS, XY, XYZ

RELATIVE_POSE_2D = RelativePose2D()
RELATIVE_POSE_2D_CHORDAL = RelativePose2DChordal()
RELATIVE_POSE_3D = RelativePose3D()
POINT_OBSERVATION_2D = PointObservation2D()
RANGE_BEARING_2D = RangeBearing2D()
BEARING_2D = Bearing2D()
RANGE_2D = Range2D()
POINT_OBSERVATION_3D = PointObservation3D()
POSE_PRIOR_2D = PosePrior2D()
POSITION_PRIOR_2D = PositionPrior2D()
POSE_PRIOR_3D = PosePrior3D()
POSITION_PRIOR_3D = PositionPrior3D()
POINT_DIFFERENCE_2D = PointDifference(XY)
POINT_DIFFERENCE_3D = PointDifference(XYZ)
POINT_PRIOR_2D = PointPrior(XY)
POINT_PRIOR_3D = PointPrior(XYZ)
SWITCHABLE_RELATIVE_POSE_2D = SwitchableRelativePose(RELATIVE_POSE_2D)
SWITCHABLE_RELATIVE_POSE_3D = SwitchableRelativePose(RELATIVE_POSE_3D)
SWITCH_PRIOR = SwitchPrior()
BAL_PROJECTION = BalProjection()
SBA_PROJECTION = SbaProjection()
SBA_STEREO_PROJECTION = SbaStereoProjection()
EXPMAP_PROJECTION = ExpmapProjection()
CALIBRATED_BAL_PROJECTION = CalibratedBalProjection()
SHARED_BAL_PROJECTION = SharedBalProjection()
SHARED_PINHOLE_PROJECTION = SharedPinholeProjection()

#: Kinds of bundle adjustment: what a camera sees.
PROJECTION_KINDS: tuple[Projection, ...] = (
    BAL_PROJECTION,
    SBA_PROJECTION,
    SBA_STEREO_PROJECTION,
    EXPMAP_PROJECTION,
)

#: What cameras without intrinsics of their own see: constants, or a variable that they share.
SHARED_PROJECTION_KINDS: tuple[Projection, ...] = (
    CALIBRATED_BAL_PROJECTION,
    SHARED_BAL_PROJECTION,
    SHARED_PINHOLE_PROJECTION,
)

FACTOR_KINDS: tuple[FactorKind, ...] = (
    RELATIVE_POSE_2D,
    RELATIVE_POSE_3D,
    POINT_OBSERVATION_2D,
    RANGE_BEARING_2D,
    BEARING_2D,
    RANGE_2D,
    POINT_OBSERVATION_3D,
    POSE_PRIOR_2D,
    POSITION_PRIOR_2D,
    POSE_PRIOR_3D,
    POSITION_PRIOR_3D,
    POINT_DIFFERENCE_2D,
    POINT_DIFFERENCE_3D,
    POINT_PRIOR_2D,
    POINT_PRIOR_3D,
    SWITCHABLE_RELATIVE_POSE_2D,
    SWITCHABLE_RELATIVE_POSE_3D,
    SWITCH_PRIOR,
)

__all__ = [
    "BAL_INTRINSICS",
    "BAL_PROJECTION",
    "BEARING_2D",
    "CALIBRATED_BAL_PROJECTION",
    "CALIBRATED_CAMERA",
    "CAMERA",
    "CAMERA_PARAMETERS",
    "CAMERA_POSE",
    "EXPMAP_PROJECTION",
    "FACTOR_KINDS",
    "INTRINSICS",
    "PINHOLE_INTRINSICS",
    "POINT_DIFFERENCE_2D",
    "POINT_DIFFERENCE_3D",
    "POINT_OBSERVATION_2D",
    "POINT_OBSERVATION_3D",
    "POINT_PRIOR_2D",
    "POINT_PRIOR_3D",
    "POSE_PRIOR_2D",
    "POSE_PRIOR_3D",
    "POSITION_PRIOR_2D",
    "POSITION_PRIOR_3D",
    "PROJECTION_KINDS",
    "RANGE_2D",
    "RANGE_BEARING_2D",
    "RELATIVE_POSE_2D",
    "RELATIVE_POSE_2D_CHORDAL",
    "RELATIVE_POSE_3D",
    "SBA_CAMERA",
    "SBA_PROJECTION",
    "SBA_STEREO_PROJECTION",
    "SE2",
    "SE3",
    "SE3_EXPMAP",
    "SHARED_BAL_PROJECTION",
    "SHARED_PINHOLE_PROJECTION",
    "SHARED_PROJECTION_KINDS",
    "SWITCH",
    "SWITCHABLE_RELATIVE_POSE_2D",
    "SWITCHABLE_RELATIVE_POSE_3D",
    "SWITCH_PRIOR",
    "VARIABLE_KINDS",
    "XY",
    "XYZ",
    "FactorKind",
    "Projection",
    "SbaProjection",
    "SbaStereoProjection",
    "SharedPinholeProjection",
    "VariableKind",
]
