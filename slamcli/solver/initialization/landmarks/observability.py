"""Whether its sightings determine where a landmark is: a test of the rank of H_l, relative to the noise.

H_l is the landmark's own block of J^T Omega J, its poses given, with the eigenvalues low and high. The sightings
determine the landmark if

* what is linear in its place (points seen, priors, differences to landmarks that are determined) has a regular H_l, or
* H_l is regular, and its lines of sight cross clearly (low / high of at least ``CLEAR``: two of them at an angle of
  11 degrees) or closely enough for the noise: the standard deviation of the place along its worst direction,
  s / sqrt(low), is at most ``LARGEST`` times the distance from what sees it, and at infinity in the mean direction of
  its bearings (if they are all there is) chi2 is higher by ``FARTHER`` s^2 or more. Lines from nearly one place cross
  somewhere, for the noise alone, often next to the place itself; the last condition sees through that.

s is 1, the stated noise, or less where the sightings of all these landmarks agree better than stated (information
matrices of 1 for want of better ones).

So one bearing or one range does not determine a landmark, nor do bearings along one line, ranges from one place, or
bearings from places so close to each other that the parallax is below the noise: it may be anywhere up to infinity.
"""

from __future__ import annotations

import numpy as np

from slamcli import models
from slamcli.graph import FactorGraph, Factors
from slamcli.graph.columns import BoolArray, IndexArray, finite_rows
from slamcli.graph.topology import connected_components
from slamcli.models import VariableKind
from slamcli.models.base import Array
from slamcli.solver.initialization.landmarks.sightings import Sightings, summed
from slamcli.solver.initialization.landmarks.triangulation import AFFINE, rays

#: Kinds that join two landmarks.
DIFFERENCES = (models.POINT_DIFFERENCE_2D, models.POINT_DIFFERENCE_3D)
#: Largest standard deviation of a landmark's place along its worst direction, over its distance: less parallax than
#: three standard deviations of the noise may be noise alone.
LARGEST = 1.0 / 3.0
#: Least increase of chi2 at infinity: three standard deviations.
FARTHER = 9.0
#: In units of the distance from what sees it.
_INFINITY = 1e6
#: Least ratio of the eigenvalues of H_l that needs no look at the noise: two lines at the angle a have tan^2(a / 2).
CLEAR = 1e-2
#: A matrix is singular where its least eigenvalue is at most this share of the greatest.
_SINGULAR = 1e-13


def linearly(sightings: Sightings, group: IndexArray | None = None) -> BoolArray:
    """Which landmarks (n,) are determined by what is linear in their place (or a range with its bearing).

    With the number (n,) of a group for each, as ``joined`` has them, differences count for nothing else: groups are
    determined by what else there is of any of their landmarks.
    """
    linear = [part for part in sightings.parts if part.kind in AFFINE or part.kind is models.RANGE_BEARING_2D]
    matrix = np.zeros((sightings.count, sightings.kind.space, sightings.kind.space))
    for part in linear:  # residuals of as many dimensions as the place: regular with the information
        if group is None or part.kind not in DIFFERENCES:
            rows = part.rows if group is None else group[part.rows]
            matrix += summed(rows, part.factors.information, sightings.count)
    return _regular(matrix) if group is None else _regular(matrix)[group]


def differences(graph: FactorGraph, kind: VariableKind) -> list[Factors]:
    """The factors that join landmarks of a kind with each other."""
    return [factors for factors in graph.factors if factors.kind in DIFFERENCES and factors.kind.variables[0] is kind]


def joined(graph: FactorGraph, kind: VariableKind) -> IndexArray:
    """Group (n,) of each landmark of a kind: those that differences with a regular information matrix join."""
    pairs = [f.indices[_regular(f.information)] for f in differences(graph, kind)]
    return connected_components(
        len(graph.variables[kind.name]), np.concatenate([np.empty((0, 2), dtype=np.intp), *pairs])
    )


@np.errstate(all="ignore")  # what is not finite is not determined
def determined(sightings: Sightings, places: Array) -> BoolArray:
    """Which landmarks (n,) are determined, at places (n, d)."""
    chi2, hessian, _ = sightings.normal(places)
    hessian[~finite_rows(hessian)] = 0.0
    regular = _regular(hessian)
    low, high = np.where(regular, np.linalg.eigvalsh(hessian).T, 1.0)[[0, -1]]
    noise = _noise(sightings, np.where(regular, chi2, 0.0))
    distance = sightings.distance(places)
    with np.errstate(over="ignore"):
        close = noise / np.sqrt(low) <= LARGEST * distance
    far, has_bearing = _at_infinity(sightings, distance)
    close &= ~has_bearing | (sightings.chi2(far) - chi2 >= FARTHER * noise**2)
    return linearly(sightings) | (regular & (close | (low >= CLEAR * high)))


@np.errstate(all="ignore")
def regular(sightings: Sightings, places: Array) -> BoolArray:
    """For which landmarks (n,) H is regular, at places (n, d)."""
    _, hessian, _ = sightings.normal(places)
    hessian[~finite_rows(hessian)] = 0.0
    return _regular(hessian)


def _at_infinity(sightings: Sightings, distance: Array) -> tuple[Array, BoolArray]:
    """Places (n, d) far away in the mean direction of the bearings, and which landmarks have any."""
    towards = np.zeros((sightings.count, sightings.kind.space))
    for part in sightings.parts:
        if part.kind is models.BEARING_2D:
            towards += summed(part.rows, part.factors.information[:, 0] * rays(part)[1], sightings.count)
    length = np.sqrt(np.square(towards).sum(axis=1))
    centre, extent = sightings.centre()
    far = _INFINITY * (distance + extent) / np.where(length > 0.0, length, 1.0)
    return centre + far[:, None] * towards, length > 0.0


def _noise(sightings: Sightings, chi2: Array) -> float:
    """Noise of the sightings over the stated noise, at most 1; 1 where nothing tells."""
    residuals = np.zeros(sightings.count)
    for part in sightings.parts:
        residuals += part.kind.dimension * np.bincount(part.rows, minlength=sightings.count)
    several = residuals > sightings.kind.space
    dof = float((residuals[several] - sightings.kind.space).sum())
    return min(1.0, float(np.sqrt(chi2[several].sum() / dof))) if dof else 1.0


def _regular(matrix: Array) -> BoolArray:
    eigenvalues = np.linalg.eigvalsh(np.where(finite_rows(matrix)[:, None, None], matrix, 0.0))
    return np.asarray(eigenvalues[:, 0] > _SINGULAR * np.maximum(eigenvalues[:, -1], np.finfo(np.float64).tiny))
