"""Tangent spaces that covariances are stated in, by name: what a small error of a pose is.

With X the pose and delta = (dt, h) the step of ``VariableKind.retract`` (local frame; h the vector part of the
quaternion in space, half the rotation vector, and the angle in a plane):

=============  ===============================================  ==================================================
name           planar pose                                      spatial pose
=============  ===============================================  ==================================================
``slamcli``    x, y, theta in the frame of the pose             x, y, z, qx, qy, qz: translation and vector part of
                                                                the quaternion, both in the frame of the pose
``g2o``        x, y along the axes of the world, theta          the same as ``slamcli``
``gtsam``      the same as ``slamcli``                          rx, ry, rz, x, y, z: rotation vector first (2 h),
                                                                then translation, both in the frame of the pose
=============  ===============================================  ==================================================

These are the tangent vectors of ``VertexSE2``/``VertexSE3::oplus`` and of GTSAM's ``Pose2``/``Pose3::retract``, to
first order. Points are along the axes of the world in all of them.
"""

from __future__ import annotations

import numpy as np

from slamcli.models import SE2, SE3, VariableKind
from slamcli.models.base import Array

CONVENTIONS = ("slamcli", "g2o", "gtsam")

_GTSAM_SE3 = ("rx", "ry", "rz", "x", "y", "z")


def tangent(kind: VariableKind, convention: str) -> tuple[str, ...]:
    """Names of the tangent dimensions in order."""
    return _GTSAM_SE3 if kind is SE3 and convention == "gtsam" else kind.components


def units(kind: VariableKind, convention: str) -> tuple[str, ...]:
    """Units of the tangent dimensions: ``m``, ``rad``, ``px``, or ``1`` for parts of a quaternion and distortion."""
    return tuple(_unit(name) for name in tangent(kind, convention))


def _unit(name: str) -> str:
    if name in ("f", "fx", "fy", "cx", "cy"):
        return "px"
    return "m" if name in "xyz" else "1" if name.startswith(("q", "k")) else "rad"


def frame(kind: VariableKind, convention: str) -> str:
    """The axes of the tangent vector, in words."""
    if not kind.is_pose:
        return "axes of the world"
    if kind is SE2 and convention == "g2o":
        return "translation along the axes of the world"
    return "frame of the pose"


def change(kind: VariableKind, values: Array, convention: str) -> Array | None:
    """Matrices (n, d, d) that take tangent vectors at values (n, size) to those of a convention, None for the identity.

    A covariance C becomes T C T^T, a cross-covariance T_i C T_j^T.
    """
    if kind is SE3 and convention == "gtsam":
        out = np.zeros((len(values), 6, 6))
        for k in range(3):
            out[:, k, 3 + k] = 2.0
            out[:, 3 + k, k] = 1.0
        return out
    if kind is SE2 and convention == "g2o":
        out = np.zeros((len(values), 3, 3))
        out[:, 0, 0] = out[:, 1, 1] = np.cos(values[:, 2])
        out[:, 1, 0] = np.sin(values[:, 2])
        out[:, 0, 1] = -out[:, 1, 0]
        out[:, 2, 2] = 1.0
        return out
    return None


def changed(covariance: Array, first: Array | None, second: Array | None) -> Array:
    """Covariances (n, d, k) in another convention: T_i C T_j^T, where None is the identity."""
    if first is not None:
        covariance = first @ covariance
    return covariance if second is None else covariance @ np.swapaxes(second, -1, -2)
