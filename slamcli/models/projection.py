"""Projection factors: a camera sees a point at a place of its image; residuals are in pixels.

With the camera at C, turned by R (camera to world), the point X is at

    P = R^T (X - C) = (x, y, z)

in the frame of the camera. Of a tangent step of the camera (see ``geometry.se3.retract``) and of the point,

    dP = [-I, 2 [P]x] d_camera + R^T d_point,

so that with A = d(u, v)/dP the Jacobians are [-A, 2 A [P]x] and A R^T: everything that depends on the kind of camera is
in A. Arithmetic runs on contiguous components, since there are many more observations than cameras.

A point in the plane z = 0 of the camera has no image: the residual is infinite or NaN, and the solver names the edge. A
point behind the camera has one in the formulas of all these tools, mirrored; ``depth`` tells.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from slamcli.geometry import quaternion
from slamcli.geometry.quaternion import Components
from slamcli.models.base import Array, FactorKind, VariableKind, components
from slamcli.models.cameras import CAMERA, CAMERA_PARAMETERS, SBA_CAMERA, SE3_EXPMAP
from slamcli.models.variables import XYZ

#: Rows of A, the derivatives of each component of the residual by P.
Gradients = list[Components]


class Projection(FactorKind):
    """What all cameras have in common.

    Attributes
    ----------
    camera, point
        Slots of the two variables.
    forward
        The sign of z of points in front of the camera.
    """

    components: tuple[str, ...] = ("u", "v")
    measurement_size = 2
    camera: ClassVar[int] = 0
    point: ClassVar[int] = 1
    forward: ClassVar[float] = 1.0

    def depth(self, x: tuple[Array, ...]) -> Array:
        """Distance (m,) of the points in front of their camera, along its axis; negative behind it."""
        local, _ = _in_camera(components(x[self.camera]), components(x[self.point]))
        return self.forward * local[2]

    def residual(self, x: tuple[Array, ...], measurement: Array, parameter: Array | None) -> Array:
        """Residuals (m, dimension) in pixels."""
        camera = components(x[self.camera])
        local, _ = _in_camera(camera, components(x[self.point]))
        residual = np.empty((self.dimension, len(measurement))).T
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            self._image(residual, local, _intrinsics(camera, parameter), measurement)
        return residual

    def linearize_into(
        self,
        residual: Array,
        jacobians: tuple[Array, ...],
        x: tuple[Array, ...],
        measurement: Array,
        parameter: Array | None,
    ) -> None:
        """Residuals and Jacobians; see the base class."""
        camera = components(x[self.camera])
        local, rotation = _in_camera(camera, components(x[self.point]))
        of_camera, of_point = jacobians[self.camera], jacobians[self.point]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            rows = self._gradients(residual, of_camera, local, _intrinsics(camera, parameter), measurement)
            doubled = [2.0 * k for k in local]
            for row, gradient in enumerate(rows):
                # a row times a skew matrix is the cross product of the row with its vector
                for column, (along, turn) in enumerate(zip(gradient, quaternion.cross(gradient, doubled), strict=True)):
                    np.negative(along, out=of_camera[:, row, column])
                    of_camera[:, row, 3 + column] = turn
                a, b, c = gradient
                for column in range(3):
                    entry = a * rotation[0][column]
                    entry += b * rotation[1][column]
                    entry += c * rotation[2][column]
                    of_point[:, row, column] = entry

    def _image(self, residual: Array, local: Components, intrinsics: Components, measurement: Array) -> None:
        """Write the residual."""
        raise NotImplementedError

    def _gradients(
        self, residual: Array, of_camera: Array, local: Components, intrinsics: Components, measurement: Array
    ) -> Gradients:
        """Write the residual and the Jacobian by the intrinsics, if these are free; return the rows of A."""
        raise NotImplementedError


class BalProjection(Projection):
    """BAL's and Bundler's camera: e = f r(p) p - z with p = -(x, y) / z and r(p) = 1 + k1 |p|^2 + k2 |p|^4.

    Agarwal, Snavely, Seitz, Szeliski, "Bundle Adjustment in the Large", ECCV 2010. The camera looks along -z; the
    origin of the image is its centre, v points up.
    """

    name = "bal_projection"
    variables: tuple[VariableKind, ...] = (CAMERA, XYZ)
    forward = -1.0

    def _image(self, residual: Array, local: Components, intrinsics: Components, measurement: Array) -> None:
        x, y, z = local
        f, k1, k2 = intrinsics
        inverse = -1.0 / z
        u, v = x * inverse, y * inverse
        square = u * u + v * v
        scale = f * (1.0 + square * (k1 + k2 * square))
        np.subtract(scale * u, measurement[:, 0], out=residual[:, 0])
        np.subtract(scale * v, measurement[:, 1], out=residual[:, 1])

    def _gradients(
        self, residual: Array, of_camera: Array, local: Components, intrinsics: Components, measurement: Array
    ) -> Gradients:
        x, y, z = local
        f, k1, k2 = intrinsics
        inverse = -1.0 / z
        u, v = x * inverse, y * inverse
        uu, vv = u * u, v * v
        square = uu + vv
        distortion = 1.0 + square * (k1 + k2 * square)
        scale = f * distortion
        np.subtract(scale * u, measurement[:, 0], out=residual[:, 0])
        np.subtract(scale * v, measurement[:, 1], out=residual[:, 1])
        f_square = f * square
        for row, place in enumerate((u, v)):
            np.multiply(distortion, place, out=of_camera[:, row, 6])
            by_k1 = f_square * place
            of_camera[:, row, 7] = by_k1
            np.multiply(by_k1, square, out=of_camera[:, row, 8])
        slope = 2.0 * f * (k1 + 2.0 * k2 * square)  # of the scale, by half of |p|^2
        uu_part, uv_part, vv_part = scale + slope * uu, slope * (u * v), scale + slope * vv
        return [
            (inverse * uu_part, inverse * uv_part, inverse * (u * uu_part + v * uv_part)),
            (inverse * uv_part, inverse * vv_part, inverse * (u * uv_part + v * vv_part)),
        ]


class SbaProjection(Projection):
    """e = (fx x / z + cx, fy y / z + cy) - z of a camera with fixed intrinsics of its own: g2o's EDGE_PROJECT_P2MC."""

    name = "sba_projection"
    variables: tuple[VariableKind, ...] = (XYZ, SBA_CAMERA)
    camera, point = 1, 0
    #: What the residual is: 1 for prediction minus measurement, -1 for the opposite.
    sign: ClassVar[float] = 1.0

    def _pinhole(self, intrinsics: Components) -> tuple[Array, Array, Array, Array]:
        """fx, fy, cx, cy."""
        fx, fy, cx, cy, _ = intrinsics
        return fx, fy, cx, cy

    def _image(self, residual: Array, local: Components, intrinsics: Components, measurement: Array) -> None:
        x, y, z = local
        fx, fy, cx, cy = self._pinhole(intrinsics)
        residual[:, 0] = self.sign * (fx * x / z + cx - measurement[:, 0])
        residual[:, 1] = self.sign * (fy * y / z + cy - measurement[:, 1])

    def _gradients(
        self, residual: Array, of_camera: Array, local: Components, intrinsics: Components, measurement: Array
    ) -> Gradients:
        self._image(residual, local, intrinsics, measurement)
        x, y, z = local
        fx, fy, _, _ = self._pinhole(intrinsics)
        inverse = self.sign / z
        nothing = np.zeros_like(z)
        along_u, along_v = fx * inverse, fy * inverse
        return [(along_u, nothing, -along_u * x / z), (nothing, along_v, -along_v * y / z)]


class SbaStereoProjection(SbaProjection):
    """As ``SbaProjection``, and u of the right camera, a baseline b along x: fx (x - b) / z + cx.

    g2o's EDGE_PROJECT_P2SC.
    """

    name = "sba_stereo_projection"
    components = ("u", "v", "u_right")
    measurement_size = 3

    def _image(self, residual: Array, local: Components, intrinsics: Components, measurement: Array) -> None:
        super()._image(residual, local, intrinsics, measurement)
        x, _, z = local
        fx, _, cx, _, baseline = intrinsics
        residual[:, 2] = fx * (x - baseline) / z + cx - measurement[:, 2]

    def _gradients(
        self, residual: Array, of_camera: Array, local: Components, intrinsics: Components, measurement: Array
    ) -> Gradients:
        rows = super()._gradients(residual, of_camera, local, intrinsics, measurement)
        x, _, z = local
        along, nothing, _ = rows[0]
        return [*rows, (along, nothing, -along * (x - intrinsics[4]) / z)]


class ExpmapProjection(SbaProjection):
    """e = z - (f x / z + cx, f y / z + cy), intrinsics from a parameter: g2o's EDGE_PROJECT_XYZ2UV:EXPMAP."""

    name = "expmap_projection"
    variables: tuple[VariableKind, ...] = (XYZ, SE3_EXPMAP)
    parameter = CAMERA_PARAMETERS
    sign = -1.0

    def _pinhole(self, intrinsics: Components) -> tuple[Array, Array, Array, Array]:
        f, cx, cy, _ = intrinsics
        return f, f, cx, cy


def _in_camera(camera: Components, point: Components) -> tuple[Components, tuple[Components, ...]]:
    """The points in the frames of their cameras, and the rows of R^T."""
    rows = quaternion.matrix_rows(quaternion.conjugate(camera[3:7]))
    a, b, c = (point[k] - camera[k] for k in range(3))
    local = []
    for row in rows:
        entry = row[0] * a
        entry += row[1] * b
        entry += row[2] * c
        local.append(entry)
    return local, rows


def _intrinsics(camera: Components, parameter: Array | None) -> Components:
    """The intrinsics' components: those of the parameter, where there is one, else the camera's own."""
    return camera[7:] if parameter is None else components(parameter)
