"""What people read off a covariance: standard deviations, and the region that holds a variable with a probability.

A Gaussian lies within (x - m)^T C^-1 (x - m) <= q with the probability whose chi-square quantile q is (2 degrees of
freedom in a plane, 3 in space). With C = V diag(s^2) V^T the semi-axes are sqrt(q) s along the columns of V.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.geometry import so2, so3
from slamcli.models import VariableKind
from slamcli.models.base import Array


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Standard deviations and regions of n variables of a kind.

    Attributes
    ----------
    position
        (n, space) standard deviations in metres, along the axes of the pose (of the world for points).
    rotation
        (n, 1 or 3) standard deviations in degrees, about the axes of the pose; (n, 0) for points.
    semi_axes
        (n, space) semi-axes of the region in metres, the longest first.
    directions
        (n, space, space) unit vectors along them in the world, as columns.
    """

    position: Array
    rotation: Array
    semi_axes: Array
    directions: Array

    @property
    def total(self) -> Array:
        """(n,) root of the summed variances of the position, in metres."""
        return np.sqrt(np.square(self.position).sum(axis=1))

    @property
    def angle(self) -> Array:
        """(n,) direction of the longest semi-axis in a plane, degrees from the x axis of the world, in [-90, 90)."""
        major = self.directions[:, :, 0]
        return (np.degrees(np.arctan2(major[:, 1], major[:, 0])) + 90.0) % 180.0 - 90.0


def uncertainty(kind: VariableKind, values: Array, covariance: Array, quantile: float) -> Uncertainty:
    """Standard deviations and regions.

    Parameters
    ----------
    kind
        Of the variables.
    values
        (n, size).
    covariance
        (n, d, d) in the tangent space of ``VariableKind.retract``.
    quantile
        Of the chi-square distribution with ``kind.space`` degrees of freedom.
    """
    space = kind.space
    deviation = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0))
    # the vector part of a quaternion is half the rotation vector
    rotation = np.degrees(deviation[:, space : space + 3] * (2.0 if space == 3 else 1.0))
    axes = _axes(kind, values)
    square, vectors = np.linalg.eigh(covariance[:, :space, :space])
    semi_axes = np.sqrt(quantile * np.maximum(square[:, ::-1], 0.0))
    return Uncertainty(deviation[:, :space], rotation, semi_axes, axes @ vectors[:, :, ::-1])


def _axes(kind: VariableKind, values: Array) -> Array:
    """Axes of the positions' tangent vectors in the world, (n, space, space) as columns."""
    if not kind.is_pose:
        return np.tile(np.eye(kind.space), (len(values), 1, 1))
    return so2.to_matrix(values[:, 2:3]) if kind.space == 2 else so3.to_matrix(values[:, 3:7])
