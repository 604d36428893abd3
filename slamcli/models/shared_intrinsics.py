"""Cameras whose intrinsics are not their own unknowns: constants, or one variable that many cameras share.

``CALIBRATED_CAMERA`` is BAL's camera with f, k1, k2 as constants of its value. The shared sort takes the intrinsics out
of the camera: the factor joins a pose, a point and the intrinsics, and where the intrinsics are held, their Jacobian
goes nowhere. The residuals are those of ``projection``, whose functions are called with cameras put together again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from slamcli.models.base import Array, VariableKind
from slamcli.models.cameras import CAMERA, SE3_EXPMAP
from slamcli.models.projection import BalProjection, Projection, SbaProjection
from slamcli.models.variables import SE3, XYZ

_POSE = 7  # numbers of a pose
_STEP = 6  # of its tangent step


def _kind(name: str, components: tuple[str, ...], identity: tuple[float, ...]) -> VariableKind:
    """Numbers that are added to, and are nowhere."""
    return VariableKind(
        name=name,
        size=len(components),
        components=components,
        is_pose=False,
        space=0,
        identity=identity,
        retract=np.add,
        normalize=np.asarray,
        compose=np.add,
        inverse=np.negative,
    )


def _pose_only(retract: Callable[[Array, Array], Array]) -> Callable[[Array, Array], Array]:
    """A step of the pose; the intrinsics stay."""

    def moved(values: Array, delta: Array) -> Array:
        out = np.concatenate([values[:, :_POSE], values[:, _POSE:]], axis=1)
        out[:, :_POSE] = retract(values[:, :_POSE], delta)
        return out

    return moved


#: As ``CAMERA``, its intrinsics constants.
CALIBRATED_CAMERA = replace(
    CAMERA, name="CALIBRATED_CAMERA", components=SE3.components, retract=_pose_only(SE3.retract)
)

#: The pose of a camera that looks along -z, as BAL's; its intrinsics are another variable.
CAMERA_POSE = replace(SE3, name="CAMERA_POSE")

#: BAL's focal length in pixels and radial distortion.
BAL_INTRINSICS = _kind("BAL_INTRINSICS", ("f", "k1", "k2"), (1.0, 0.0, 0.0))

#: Focal lengths and principal point of a pinhole camera, in pixels.
PINHOLE_INTRINSICS = _kind("PINHOLE_INTRINSICS", ("fx", "fy", "cx", "cy"), (1.0, 1.0, 0.0, 0.0))

#: The kinds of variables that are intrinsics.
INTRINSICS = (BAL_INTRINSICS, PINHOLE_INTRINSICS)


class CalibratedBalProjection(BalProjection):
    """``BalProjection`` with constant f, k1, k2."""

    name = "calibrated_bal_projection"
    variables = (CALIBRATED_CAMERA, XYZ)

    def linearize_into(
        self,
        residual: Array,
        jacobians: tuple[Array, ...],
        x: tuple[Array, ...],
        measurement: Array,
        parameter: Array | None,
    ) -> None:
        """Residuals and Jacobians; those by the intrinsics are thrown away."""
        whole = _zeros_like(jacobians[0], CAMERA.dimension)
        super().linearize_into(residual, (whole, jacobians[1]), x, measurement, parameter)
        jacobians[0][:] = whole[:, :, :_STEP]


class SharedBalProjection(Projection):
    """``BalProjection`` with f, k1, k2 in a variable that cameras share."""

    name = "shared_bal_projection"
    variables: tuple[VariableKind, ...] = (CAMERA_POSE, XYZ, BAL_INTRINSICS)
    forward = -1.0
    _whole = BalProjection()

    def residual(self, x: tuple[Array, ...], measurement: Array, parameter: Array | None) -> Array:
        """Residuals (m, 2) in pixels."""
        return self._whole.residual((_joined(x[0], x[2]), x[1]), measurement, None)

    def linearize_into(
        self,
        residual: Array,
        jacobians: tuple[Array, ...],
        x: tuple[Array, ...],
        measurement: Array,
        parameter: Array | None,
    ) -> None:
        """Residuals and Jacobians; see the base class."""
        whole = _zeros_like(jacobians[0], CAMERA.dimension)
        camera = _joined(x[0], x[2])
        self._whole.linearize_into(residual, (whole, jacobians[1]), (camera, x[1]), measurement, None)
        jacobians[0][:] = whole[:, :, :_STEP]
        jacobians[2][:] = whole[:, :, _STEP:]


class SharedPinholeProjection(Projection):
    """e = (fx x / z + cx, fy y / z + cy) - z, the intrinsics a variable that cameras share; looks along +z.

    All comes from the image (x / z, y / z) of a camera with fx = fy = 1 and cx = cy = 0, since the rest is linear.
    """

    name = "shared_pinhole_projection"
    variables: tuple[VariableKind, ...] = (SE3_EXPMAP, XYZ, PINHOLE_INTRINSICS)
    _unit = SbaProjection()

    def residual(self, x: tuple[Array, ...], measurement: Array, parameter: Array | None) -> Array:
        """Residuals (m, 2) in pixels."""
        place = self._unit.residual((x[1], _unit_camera(x[0])), np.zeros_like(measurement), None)
        with np.errstate(invalid="ignore", over="ignore"):
            return np.asarray(place * x[2][:, :2] + x[2][:, 2:] - measurement)

    def linearize_into(
        self,
        residual: Array,
        jacobians: tuple[Array, ...],
        x: tuple[Array, ...],
        measurement: Array,
        parameter: Array | None,
    ) -> None:
        """Residuals and Jacobians; see the base class."""
        camera = _unit_camera(x[0])
        of_both = jacobians[1], jacobians[0]
        self._unit.linearize_into(residual, of_both, (x[1], camera), np.zeros_like(measurement), None)
        focal, centre, of_intrinsics = x[2][:, :2], x[2][:, 2:], jacobians[2]
        with np.errstate(invalid="ignore", over="ignore"):
            for row in (0, 1):
                of_intrinsics[:, row, row] = residual[:, row]
                of_intrinsics[:, row, 2 + row] = 1.0
            residual *= focal
            residual += centre - measurement
            for jacobian in of_both:
                jacobian *= focal[:, :, None]


def _joined(pose: Array, intrinsics: Array) -> Array:
    return np.concatenate([pose, intrinsics], axis=1)


def _unit_camera(pose: Array) -> Array:
    """Values of ``SBA_CAMERA``."""
    return _joined(pose, np.broadcast_to([1.0, 1.0, 0.0, 0.0, 0.0], (len(pose), 5)))


def _zeros_like(jacobian: Array, width: int) -> Array:
    """Room for a wider Jacobian, one long row for each entry as the solver's batches have it."""
    return np.zeros((jacobian.shape[1], width, len(jacobian))).transpose(2, 0, 1)
