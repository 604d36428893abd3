"""Regions of 95 % probability from covariances: ellipses in a plane, ellipsoids in space.

A Gaussian with mean m and covariance C lies within (x - m)^T C^-1 (x - m) <= q with a probability of 95 % if q is that
quantile of the chi-square distribution with as many degrees of freedom as x has dimensions. With C = V diag(s^2) V^T,
the boundary is m + sqrt(q) V diag(s) u over all unit vectors u.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from slamcli.errors import InputError
from slamcli.evaluation.alignment import Alignment
from slamcli.formats.covariances import Covariances, read_all_covariances
from slamcli.geometry import so3
from slamcli.graph import FactorGraph, Variables
from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array
from slamcli.reporting.plots.scene import spatial


@dataclass(frozen=True, eq=False)
class Regions:
    """Gaussians whose 95 % regions are drawn: (n, 3) means with (n, 3, 3) covariances in the world, in metres."""

    poses: Array
    pose_covariances: Array
    landmarks: Array
    landmark_covariances: Array

    def moved(self, alignment: Alignment) -> Regions:
        """In another frame."""
        turn = alignment.scale * alignment.rotation
        return Regions(
            alignment.points(self.poses),
            turn @ self.pose_covariances @ turn.T,
            alignment.points(self.landmarks),
            turn @ self.landmark_covariances @ turn.T,
        )


#: 95 % quantiles of the chi-square distribution with 2 (-2 ln 0.05) and 3 degrees of freedom.
QUANTILE = {2: 5.991464547107979, 3: 7.814727903251179}


def read_regions(paths: Sequence[str], graph: FactorGraph) -> Regions:
    """Read the covariances of variables of a graph; their means are its estimates.

    Parameters
    ----------
    paths
        Files of covariances (see ``formats.covariances``).
    graph
        The graph of the variables.

    Raises
    ------
    InputError
        If a file cannot be read, is something else, or names a variable that the graph does not have.
    """
    points: dict[bool, list[Array]] = {True: [np.empty((0, 3))], False: [np.empty((0, 3))]}
    covariances: dict[bool, list[Array]] = {True: [np.empty((0, 3, 3))], False: [np.empty((0, 3, 3))]}
    for path in paths:
        for given in read_all_covariances(path):
            for is_pose, means, matrices in _found(graph, given):
                points[is_pose].append(means)
                covariances[is_pose].append(matrices)
    return Regions(*(np.concatenate(part[is_pose]) for is_pose in (True, False) for part in (points, covariances)))


def _found(graph: FactorGraph, given: Covariances) -> Iterator[tuple[bool, Array, Array]]:
    """Whether they are poses, positions and covariances in the world, for each kind of variable with the given ids.

    Raises
    ------
    InputError
        If an id belongs to no variable with as many tangent dimensions as the covariances have.
    """
    dimension = given.covariance.shape[1]
    missing = np.ones(len(given.ids), dtype=bool)
    for column in graph.variables.values():
        if column.kind.dimension == dimension:
            rows = np.where(missing, column.rows_of(given.ids.astype(column.ids.dtype)), -1)
            taken = np.flatnonzero(rows >= 0)
            missing[taken] = False
            taken = taken[column.known[rows[taken]]]
            positions = spatial(column.values[rows[taken], : column.kind.space])
            yield column.kind.is_pose, positions, _in_world(column, rows[taken], given.covariance[taken])
    if missing.any():
        wrong = int(given.ids[np.flatnonzero(missing)[0]])
        kinds = ", ".join(f"{name} {column.kind.dimension}" for name, column in graph.variables.items())
        raise InputError(
            f"{given.path}: the graph has no variable {wrong} with {dimension} tangent dimensions",
            (f"  tangent dimensions of the kinds in the graph: {kinds}",),
        )


def _in_world(column: Variables, rows: IndexArray, matrices: Array) -> Array:
    """(n, 3, 3) covariance of the position in the world: R C R^T of the translation block for poses."""
    space = column.kind.space
    block = np.zeros((len(rows), 3, 3))
    block[:, :space, :space] = matrices[:, :space, :space]
    if not column.kind.is_pose:
        return block
    rotation = np.zeros((len(rows), 3, 3))
    if space == 2:
        angle = column.values[rows, 2]
        rotation[:, 0, 0] = rotation[:, 1, 1] = np.cos(angle)
        rotation[:, 1, 0] = np.sin(angle)
        rotation[:, 0, 1] = -rotation[:, 1, 0]
        rotation[:, 2, 2] = 1.0
    else:
        rotation[:] = so3.to_matrix(column.values[rows, 3:])
    return rotation @ block @ np.swapaxes(rotation, 1, 2)


def outlines(points: Array, covariances: Array, axes: tuple[int, ...], corners: int = 48) -> Array:
    """Outlines of the 95 % regions.

    Parameters
    ----------
    points, covariances
        (n, 3) and (n, 3, 3), in the world.
    axes
        The two axes of a plane, onto which the distribution is projected; or all three.

    Returns
    -------
    (m, corners, len(axes)) closed lines
        One ellipse for each point of a plane, three for each point of space: the ellipsoid's principal sections.
    """
    chosen = np.array(axes)
    block = covariances[:, chosen[:, None], chosen]
    values, vectors = np.linalg.eigh(block)
    half = np.sqrt(QUANTILE[len(axes)] * np.maximum(values, 0.0))
    angle = np.linspace(0.0, 2.0 * np.pi, corners)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    planes = [(0, 1)] if len(axes) == 2 else [(0, 1), (0, 2), (1, 2)]
    shape = vectors * half[:, None, :]
    loops = [np.swapaxes(shape[:, :, list(plane)] @ circle, 1, 2) for plane in planes]
    centres = points[:, chosen][:, None, :]
    return np.concatenate([loop + centres for loop in loops])
