"""Where landmarks are by what is linear in their place: points seen, priors, and the lines of bearings.

A bearing puts the landmark on a line; its distance from the line, over its distance d from the pose, is the error of
the angle. The weights Omega / d^2 come from the solution before. (Points seen, with all their information matrices, are
linear as they are.)
"""

from __future__ import annotations

import numpy as np

from slamcli import models
from slamcli.geometry import so2
from slamcli.graph.columns import finite_rows
from slamcli.models.base import Array
from slamcli.solver.initialization.landmarks.sightings import Part, Sightings, summed

#: Kinds whose residual is affine in the landmark.
AFFINE = (
    models.POINT_OBSERVATION_2D,
    models.POINT_OBSERVATION_3D,
    models.POINT_PRIOR_2D,
    models.POINT_PRIOR_3D,
    models.POINT_DIFFERENCE_2D,
    models.POINT_DIFFERENCE_3D,
)
#: Lines meet in a point where the lesser eigenvalue of their normal matrix is more than this share of the greater.
_LEAST_CROSSING = 1e-13
_ROUNDS = 3


def rays(part: Part) -> tuple[Array, Array]:
    """Origins (m, 2) and unit directions (m, 2) of bearings; those of ranges with bearings as well."""
    assert part.others is not None
    angle = part.others[:, 2] + part.factors.measurements[:, -1]
    return part.others[:, :2], so2.pack(np.cos(angle), np.sin(angle))


def least_squares(sightings: Sightings) -> Array:
    """Places (n, d) at the linear minimum; NaN where points and lines do not determine one."""
    base, _ = sightings.centre()
    _, hessian, gradient = sightings.normal(base, [part for part in sightings.parts if part.kind in AFFINE])
    bearings = [part for part in sightings.parts if part.kind in (models.BEARING_2D, models.RANGE_BEARING_2D)]
    places = _solution(base, hessian, gradient)
    lines = [(part, *rays(part)) for part in bearings]
    for _ in range(_ROUNDS if bearings else 0):
        matrix, right = hessian.copy(), gradient.copy()
        for part, origin, ray in lines:
            away = places[part.rows] - origin
            square = np.square(away).sum(axis=1)
            square = np.where(np.isfinite(square) & (square > 0.0), square, 1.0)
            normal = so2.pack(-ray[:, 1], ray[:, 0])
            weight = part.factors.information[:, -1, -1] / square
            _add_line(matrix, right, part, normal, weight, np.vecdot(normal, base[part.rows] - origin))
            if part.kind is models.RANGE_BEARING_2D:
                distance = part.factors.measurements[:, 0]
                along = np.vecdot(ray, base[part.rows] - origin) - distance
                _add_line(matrix, right, part, ray, part.factors.information[:, 0, 0], along)
        places = _solution(base, matrix, right)
    return places


def _add_line(matrix: Array, right: Array, part: Part, normal: Array, weight: Array, offset: Array) -> None:
    """Add weight (normal . (p - base) + offset)^2 to the normal equations."""
    weighted = weight[:, None] * normal
    matrix += summed(part.rows, weighted[:, :, None] * normal[:, None, :], len(matrix))
    right += summed(part.rows, weighted * offset[:, None], len(right))


def _solution(base: Array, matrix: Array, right: Array) -> Array:
    """Where matrix (p - base) = -right, NaN where the matrix is singular."""
    out = np.full_like(base, np.nan)
    matrix = np.where(finite_rows(matrix)[:, None, None], matrix, 0.0)
    eigenvalues = np.linalg.eigvalsh(matrix)
    firm = eigenvalues[:, 0] > _LEAST_CROSSING * eigenvalues[:, -1]
    out[firm] = base[firm] - np.linalg.solve(matrix[firm], right[firm][:, :, None])[:, :, 0]
    return out
