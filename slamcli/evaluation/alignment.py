"""Alignment: the transformation that takes an estimate into the frame of the truth before the two are compared.

S. Umeyama, "Least-squares estimation of transformation parameters between two point patterns", IEEE PAMI 13 (1991):
the equation numbers below are his.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.errors import NumericalError, UsageError
from slamcli.geometry import se3, so3
from slamcli.models.base import Array

METHODS = ("none", "origin", "se", "sim")
#: Second singular value of the covariance, relative to the first, below which positions lie on a line.
_DEGENERATE = 1e-13


@dataclass(frozen=True, eq=False)
class Alignment:
    """A similarity transformation p -> scale * rotation p + translation.

    Attributes
    ----------
    method
        One of ``METHODS``.
    rotation
        (3, 3) rotation matrix.
    translation
        (3,) metres.
    scale
        1 except for ``"sim"``.
    """

    method: str
    rotation: Array
    translation: Array
    scale: float = 1.0

    def points(self, points: Array) -> Array:
        """Points (n, 3) in the frame of the truth."""
        return self.scale * np.matmul(points, self.rotation.T) + self.translation

    def poses(self, poses: Array) -> Array:
        """Poses (n, 7) in the frame of the truth; the scale changes positions only."""
        if self.method == "none":
            return poses
        turned = so3.compose(so3.from_matrix(self.rotation), poses[:, 3:])
        return np.concatenate([self.points(poses[:, :3]), turned], axis=1)


def align(estimate: Array, truth: Array, method: str, planar: bool = False) -> Alignment:
    """The transformation of an estimate onto the truth.

    Parameters
    ----------
    estimate, truth
        (n, 7) poses that belong together, elements of SE(3).
    method
        ``"none"``: the identity. ``"origin"``: the first poses coincide. ``"se"``: the rotation and translation,
        ``"sim"``: also the scale, that minimize the squared distances of the positions.
    planar
        Both lie in the plane z = 0, so the rotation is about z. (In space a mirrored path would be turned over.)

    Raises
    ------
    NumericalError
        If the positions do not determine the rotation: all on one line, or in one point.
    UsageError
        If there is no such method.
    """
    if method == "none":
        return Alignment(method, np.eye(3), np.zeros(3))
    if method == "origin":
        step = se3.compose(truth[0], se3.inverse(estimate[0]))
        return Alignment(method, so3.to_matrix(step[3:]), step[:3])
    if method not in METHODS:
        raise UsageError(f"unknown alignment {method!r}", (f"  one of: {', '.join(METHODS)}",))
    space = 2 if planar else 3
    rotation, translation, scale = umeyama(estimate[:, :space], truth[:, :space], with_scale=method == "sim")
    full_rotation, full_translation = np.eye(3), np.zeros(3)
    full_rotation[:space, :space], full_translation[:space] = rotation, translation
    return Alignment(method, full_rotation, full_translation, scale)


def umeyama(source: Array, target: Array, with_scale: bool) -> tuple[Array, Array, float]:
    """Rotation R, translation t and scale c that minimize the sum of |y - (c R x + t)|^2.

    Parameters
    ----------
    source, target
        (n, m) points x and y, m = 2 or 3.
    with_scale
        Whether the scale is free; else it is 1.

    Raises
    ------
    NumericalError
        If the points do not determine the rotation.
    """
    m = source.shape[1]
    mean_source, mean_target = source.mean(axis=0), target.mean(axis=0)
    x, y = source - mean_source, target - mean_target
    covariance = np.matmul(y.T, x) / len(x)  # eq. 38
    u, singular, vt = np.linalg.svd(covariance)
    if not singular[m - 2] > _DEGENERATE * singular[0]:
        where = "on one line" if m == 3 and singular[0] > 0.0 else "in one point"
        raise NumericalError(
            f"the positions of {len(x)} pairs lie {where}: they do not determine the rotation of the alignment",
            ("  --align origin takes the first pose instead, --align none takes the files as they are",),
        )
    sign = np.ones(m)
    if np.linalg.det(u) * np.linalg.det(vt) < 0.0:
        sign[-1] = -1.0  # eq. 43: a rotation, not a reflection
    rotation = np.matmul(u * sign, vt)  # eq. 40
    scale = float((singular * sign).sum() / (np.square(x).sum() / len(x))) if with_scale else 1.0  # eq. 42
    return rotation, mean_target - scale * np.matmul(rotation, mean_source), scale  # eq. 41
