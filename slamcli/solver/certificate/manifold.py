"""Descent of the cost over poses whose rotations are orthonormal frames in r >= d dimensions.

A point X (n, r, d + 1) holds R_i with orthonormal columns, an element of the Stiefel manifold St(d, r), and a
translation in R^r. The metric is that of the space around it. Gradient and Hessian are half of those of the cost:

    gradient = X S,    Hessian[V] = projection of V S,    S = M - blockdiag(Lambda_i, 0)

(Rosen, Carlone, Bandeira, Leonard 2019, section 4.2). Steps are truncated Newton steps in a trust region (Steihaug
1983; Absil, Baker, Gallivan, "Trust-Region Methods on Riemannian Manifolds", 2007), preconditioned by the factor of S
itself plus a multiple of the identity on the rotations, the least of some that makes it positive definite.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from slamcli.models.base import Array, dot
from slamcli.solver.certificate.dual import CertificateMatrix, Multipliers

#: Steps of the trust region, and of conjugate gradients within one of them.
_STEPS, _INNER = 200, 200
#: Converged where the preconditioned gradient promises a decrease below this share of the cost.
_TOLERANCE = 1e-12
#: Shifts of the preconditioner over the scale of S: where the search begins, and the least.
_FIRST_SHIFT, _LEAST_SHIFT = 1e-4, 1e-6
#: Conjugate gradients stop at this share of the first residual.
_FORCING = 0.01


@dataclass(frozen=True, eq=False)
class Descent:
    """Where a descent ended.

    Attributes
    ----------
    x
        (n, r, d + 1) the point.
    multipliers
        There.
    cost
        There.
    steps
        Of the trust region that were tried.
    """

    x: Array
    multipliers: Multipliers
    cost: float
    steps: int


def retract(x: Array, step: Array) -> Array:
    """The point that a tangent step leads to: rotations by the polar factor, translations by addition."""
    d = x.shape[2] - 1
    out = x + step
    moved = out[:, :, :d]
    values, vectors = np.linalg.eigh(moved.transpose(0, 2, 1) @ moved)
    out[:, :, :d] = moved @ ((vectors / np.sqrt(values)[:, None, :]) @ vectors.transpose(0, 2, 1))
    return out


def tangent(x: Array, direction: Array) -> Array:
    """Projection of a direction onto the tangent space."""
    d = x.shape[2] - 1
    rotations = x[:, :, :d]
    product = rotations.transpose(0, 2, 1) @ direction[:, :, :d]
    out = direction.copy()
    out[:, :, :d] -= rotations @ (0.5 * (product + product.transpose(0, 2, 1)))
    return out


def descend(matrix: CertificateMatrix, x: Array, interrupted: Callable[[], bool]) -> Descent:
    """Descend from a point to a critical one, or until interrupted; the cost never rises."""
    connection = matrix.connection
    cost = connection.cost(x)
    multipliers = Multipliers.of(connection, x)
    shift = _factorized(matrix, multipliers, _FIRST_SHIFT * matrix.scale)
    radius, steps, fresh = 0.0, 0, True
    while steps < _STEPS and not interrupted():
        gradient = multipliers.residual
        if not fresh:
            shift = _factorized(matrix, multipliers, 0.1 * shift)
        promised = dot(gradient, _preconditioned(matrix, x, gradient))
        if promised <= _TOLERANCE * cost:
            break
        radius = radius or 10.0 * math.sqrt(promised)
        steps += 1
        step, image, length = _truncated_newton(matrix, x, multipliers, radius)
        predicted = -2.0 * dot(gradient, step) - dot(step, image)
        candidate = retract(x, step)
        decrease = cost - (cost_there := connection.cost(candidate))
        rho = decrease / predicted if predicted > 0.0 else -1.0
        if rho < 0.25:
            radius *= 0.25
        elif rho > 0.75 and length > 0.99 * radius:
            radius *= 2.0
        fresh = rho <= 0.1
        if rho > 0.1:
            x, cost = candidate, cost_there
            multipliers = Multipliers.of(connection, x)
        elif abs(predicted) <= _TOLERANCE * cost:
            break
    return Descent(x, multipliers, cost, steps)


def _factorized(matrix: CertificateMatrix, multipliers: Multipliers, shift: float) -> float:
    """Factorize S of a point plus a shift that makes it positive definite; the shift."""
    shift = max(shift, _LEAST_SHIFT * matrix.scale)
    while not matrix.factorize(multipliers.blocks, shift):
        shift *= 4.0
    return shift


def _preconditioned(matrix: CertificateMatrix, x: Array, direction: Array) -> Array:
    """P^-1 of each row of a tangent direction, projected."""
    rows = [matrix.solve(np.ascontiguousarray(direction[:, k])) for k in range(direction.shape[1])]
    return tangent(x, np.stack(rows, axis=1))


def _truncated_newton(
    matrix: CertificateMatrix, x: Array, multipliers: Multipliers, radius: float
) -> tuple[Array, Array, float]:
    """Steihaug's conjugate gradients: the step, the Hessian times it, and its length in the norm of P."""
    connection, d = matrix.connection, matrix.connection.space

    def hessian(direction: Array) -> Array:
        image = connection.product(direction)
        image[:, :, :d] -= direction[:, :, :d] @ multipliers.blocks
        return tangent(x, image)

    residual = multipliers.residual.copy()
    step, image = np.zeros_like(residual), np.zeros_like(residual)
    first = math.sqrt(dot(residual, residual))
    preconditioned = _preconditioned(matrix, x, residual)
    product = dot(preconditioned, residual)
    direction = -preconditioned
    # squares in the norm of P, kept up by recurrence: of the step, of step and direction, of the direction
    step_square, mixed, direction_square = 0.0, 0.0, product
    for _ in range(_INNER):
        along = hessian(direction)
        curvature = dot(direction, along)
        alpha = product / curvature if curvature > 0.0 else math.inf
        longer = step_square + 2.0 * alpha * mixed + alpha * alpha * direction_square
        if curvature <= 0.0 or longer >= radius * radius:
            room = direction_square * (radius * radius - step_square)
            alpha = (math.sqrt(mixed * mixed + room) - mixed) / direction_square
            return step + alpha * direction, image + alpha * along, radius
        step += alpha * direction
        image += alpha * along
        residual += alpha * along
        left = math.sqrt(dot(residual, residual))
        if left <= _FORCING * first:
            step_square = longer
            break
        preconditioned = _preconditioned(matrix, x, residual)
        product, before = dot(preconditioned, residual), product
        beta = product / before
        direction = beta * direction - preconditioned
        mixed = beta * (mixed + alpha * direction_square)
        direction_square = product + beta * beta * direction_square
        step_square = longer
    return step, image, math.sqrt(step_square)
