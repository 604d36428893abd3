"""Residuals and analytic Jacobians of every kind of factor, in g2o's error definitions.

``VARIABLE_KINDS`` and ``FACTOR_KINDS`` are the public lists; the instances below are what graphs refer to.
"""

from slamcli.models.base import FactorKind, VariableKind
from slamcli.models.point_observation import PointObservation2D, PointObservation3D
from slamcli.models.points import PointDifference, PointPrior
from slamcli.models.priors import PosePrior2D, PosePrior3D, PositionPrior2D, PositionPrior3D
from slamcli.models.range_bearing import Bearing2D, Range2D, RangeBearing2D
from slamcli.models.relative_pose_2d import RelativePose2D
from slamcli.models.relative_pose_3d import RelativePose3D
from slamcli.models.variables import SE2, SE3, VARIABLE_KINDS, XY, XYZ

RELATIVE_POSE_2D = RelativePose2D()
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
)

__all__ = [
    "BEARING_2D",
    "FACTOR_KINDS",
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
    "RANGE_2D",
    "RANGE_BEARING_2D",
    "RELATIVE_POSE_2D",
    "RELATIVE_POSE_3D",
    "SE2",
    "SE3",
    "VARIABLE_KINDS",
    "XY",
    "XYZ",
    "FactorKind",
    "VariableKind",
]
