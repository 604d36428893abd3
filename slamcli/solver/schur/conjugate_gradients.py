"""Preconditioned conjugate gradients, exact or as far as an inexact Newton step asks for.

(Hestenes, Stiefel, "Methods of Conjugate Gradients for Solving Linear Systems", 1952; Nocedal, Wright, "Numerical
Optimization", 2006, algorithm 5.3.) From x = 0, iterates minimize the quadratic model over growing subspaces: it falls
in every iteration, and x_k is orthogonal to its residual, so that x_k^T S x_k = x_k^T b as for the solution itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from slamcli.models.base import Array, dot
from slamcli.solver.backends.protocol import NotPositiveDefiniteError

#: Forcing term of inexact steps, Ceres' default ``eta``.
ETA = 0.1
#: Iterations after which an inexact step is taken as it is, as in Ceres (``max_linear_solver_iterations``).
INEXACT_LIMIT = 500
#: Residual of an exact solution over that of x = 0, in the norm of the preconditioner.
TOLERANCE = 1e-12
#: Rounding keeps ill-conditioned systems from that; this is accepted where the residual does not fall any more.
ATTAINED = 1e-7
#: Iterations after which an exact solution is given up, and one to a tolerance that is larger.
EXACT_LIMIT, ROUGH_LIMIT = 10_000, 2000
#: The residual is computed anew after so many iterations: the one that is updated drifts.
_RENEWED = 50

Operator = Callable[[Array], Array]


class NotSolvedError(NotPositiveDefiniteError):
    """Conjugate gradients did not come to a solution.

    To every method that is as if the matrix were not positive definite: more damping helps.
    """


@dataclass(frozen=True, eq=False)
class Iterated:
    """What conjugate gradients came to.

    Attributes
    ----------
    x
        Of the shape of the right-hand side.
    iterations
        Products with the matrix that moved x.
    residual
        Its norm over that of the right-hand side, both in the norm of the preconditioner.
    reached
        Whether it ended by its own criterion, not at the limit.
    """

    x: Array
    iterations: int
    residual: float
    reached: bool


def inexact(product: Operator, precondition: Operator, rhs: Array, eta: float = ETA) -> Iterated:
    """A step that is as good as its share of the way is worth.

    It ends at the k-th iteration if k (Q_k - Q_{k-1}) <= eta Q_k, with Q_k the decrease of the quadratic model: where
    an iteration gains less than eta times what one gained on average (Nash, Sofer, "Assessing a Search
    Direction within a Truncated-Newton Method", Operations Research Letters 1990). Other than a test of the residual
    it does not depend on units, and asks for more where the model is still falling.

    Raises
    ------
    NotPositiveDefiniteError
        If a direction has no positive curvature.
    """
    return _iterate(product, precondition, rhs, eta, 0.0, INEXACT_LIMIT)


def exact(product: Operator, precondition: Operator, rhs: Array, tolerance: float = TOLERANCE) -> Iterated:
    """The solution to a relative residual, as far as rounding allows.

    Raises
    ------
    NotPositiveDefiniteError
        If a direction has no positive curvature.
    NotSolvedError
        If the residual is not small in the end.
    """
    limit = EXACT_LIMIT if tolerance <= TOLERANCE else ROUGH_LIMIT
    out = _iterate(product, precondition, rhs, 0.0, tolerance, limit)
    if not (out.reached or out.residual <= ATTAINED):
        raise NotSolvedError(
            f"conjugate gradients came to a relative residual of {out.residual:.1e} in {out.iterations} iterations"
        )
    return out


def _iterate(
    product: Operator, precondition: Operator, rhs: Array, eta: float, tolerance: float, limit: int
) -> Iterated:
    x, residual = np.zeros_like(rhs), rhs.copy()
    direction, restarted = np.zeros_like(rhs), True
    z = precondition(residual)
    rho = dot(residual.ravel(), z.ravel())
    initial, before, lowest = rho, rho, np.inf
    gained, k = 0.0, 0
    while rho > 0.0 and k < limit:
        direction = z.copy() if restarted else z + (rho / before) * direction
        image = product(direction)
        curvature = dot(direction.ravel(), image.ravel())
        if not curvature > 0.0:
            raise NotPositiveDefiniteError(f"a direction of conjugate gradients has the curvature {curvature:.1e}")
        k += 1
        alpha = rho / curvature
        x += alpha * direction
        gain = alpha * rho
        gained += gain
        if k * gain <= eta * gained:
            return Iterated(x, k, _relative(rho, initial), reached=True)
        residual -= alpha * image
        before, restarted = rho, False
        z = precondition(residual)
        rho = dot(residual.ravel(), z.ravel())
        small = rho <= tolerance**2 * initial
        if small or k % _RENEWED == 0:
            residual = rhs - product(x)
            z = precondition(residual)
            rho = dot(residual.ravel(), z.ravel())
            if rho <= tolerance**2 * initial:
                break
            if small:  # in vain: the true residual is larger than the updated one
                if rho >= 0.25 * lowest:
                    return Iterated(x, k, _relative(rho, initial), reached=False)
                lowest, restarted = rho, True
    return Iterated(x, k, _relative(rho, initial), reached=rho <= tolerance**2 * initial)


def _relative(rho: float, initial: float) -> float:
    return float(np.sqrt(max(rho, 0.0) / initial)) if initial > 0.0 else 0.0
