"""Motion models: how controls move a robot, and with which noise. ``MOTION_MODELS`` lists them by name."""

from slamcli.models.motion.base import MotionModel
from slamcli.models.motion.body import BodyMotion
from slamcli.models.motion.differential_drive import DifferentialDrive
from slamcli.models.motion.odometry import OdometryMotion
from slamcli.models.motion.velocity import VelocityMotion

MOTION_MODELS: dict[str, type[VelocityMotion | OdometryMotion | DifferentialDrive | BodyMotion]] = {
    model.name: model for model in (VelocityMotion, OdometryMotion, DifferentialDrive, BodyMotion)
}

__all__ = ["MOTION_MODELS", "BodyMotion", "DifferentialDrive", "MotionModel", "OdometryMotion", "VelocityMotion"]
