"""The variable kinds of bundle adjustment: cameras with their intrinsics, and the constants that cameras share.

A camera's value begins with its pose in the world, as that of SE3: position x y z in metres (in the unit of the scene
where nothing measures it), quaternion qx qy qz qw that turns from the camera's frame to the world's. The pose is moved
in its own frame (see ``geometry.se3.retract``), intrinsics are added to. Ceres' ``bundle_adjuster`` adds to the
rotation vector and to the translation of the world instead; a step there turns a camera about the origin of the world,
here about its own centre. Optima are the same.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamcli.geometry import se3
from slamcli.models.base import Array, VariableKind
from slamcli.models.variables import SE3

_POSE, _STEP = 7, 6  # numbers of a pose, and of its tangent step


def _joined(pose: Array, rest: Array) -> Array:
    return np.concatenate([pose, rest], axis=1)


def _moved(values: Array, delta: Array) -> Array:
    """Pose in its own frame, intrinsics by addition."""
    return _joined(se3.retract(values[:, :_POSE], delta[:, :_STEP]), values[:, _POSE:] + delta[:, _STEP:])


def _pose_moved(values: Array, delta: Array) -> Array:
    """Pose in its own frame; the intrinsics stay."""
    return _joined(se3.retract(values[:, :_POSE], delta), values[:, _POSE:])


def _normalized(values: Array) -> Array:
    return _joined(se3.normalize(values[:, :_POSE]), values[:, _POSE:])


def _composed(x: Array, y: Array) -> Array:
    """Poses composed, intrinsics added."""
    return _joined(se3.compose(x[:, :_POSE], y[:, :_POSE]), x[:, _POSE:] + y[:, _POSE:])


def _inverted(x: Array) -> Array:
    return _joined(se3.inverse(x[:, :_POSE]), -x[:, _POSE:])


#: BAL's and Bundler's camera: pose, focal length f in pixels, radial distortion k1, k2. It looks along its -z axis.
CAMERA = VariableKind(
    name="CAMERA",
    size=10,
    components=(*SE3.components, "f", "k1", "k2"),
    is_pose=True,
    space=3,
    identity=(*SE3.identity, 1.0, 0.0, 0.0),
    retract=_moved,
    normalize=_normalized,
    compose=_composed,
    inverse=_inverted,
)

#: g2o's VERTEX_CAM: pose, then fx fy cx cy in pixels and the baseline in metres, which are constants of the camera. It
#: looks along its +z axis.
SBA_CAMERA = VariableKind(
    name="SBA_CAMERA",
    size=12,
    components=SE3.components,
    is_pose=True,
    space=3,
    identity=(*SE3.identity, 1.0, 1.0, 0.0, 0.0, 0.0),
    retract=_pose_moved,
    normalize=_normalized,
    compose=_composed,
    inverse=_inverted,
)

#: g2o's VERTEX_SE3:EXPMAP: a pose of a camera whose intrinsics are a parameter of its edges. The value is that of SE3,
#: the camera in the world; g2o computes with its inverse, so tangent steps differ and optima do not.
SE3_EXPMAP = replace(SE3, name="SE3_EXPMAP")

#: g2o's PARAMS_CAMERAPARAMETERS: focal length f, principal point cx cy in pixels, baseline in metres.
CAMERA_PARAMETERS = VariableKind(
    name="CAMERA_PARAMETERS",
    size=4,
    components=("f", "cx", "cy", "baseline"),
    is_pose=False,
    space=0,
    identity=(1.0, 0.0, 0.0, 0.0),
    retract=np.add,
    normalize=np.asarray,
    compose=np.add,
    inverse=np.negative,
)
