"""The Riemannian staircase: from a critical point that is no minimum of the relaxation down to one that is.

Where the certificate matrix S of a critical point X has a negative eigenvalue with eigenvector v, the point is a saddle
once X has a row more: along the new row v^T the cost falls by |lambda| |v|^2 to second order. Descend from there, and
so on with one row more each time. A critical point whose S is positive semidefinite is a minimum of the semidefinite
relaxation, and if rounding it to poses costs nothing, it is the optimum (Boumal, "A Riemannian low-rank method for
optimization over semidefinite matrices with block-diagonal constraints", 2015; Rosen, Carlone, Bandeira, Leonard 2019,
algorithm 1).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from slamcli.geometry import so2
from slamcli.models.base import Array
from slamcli.solver.certificate import manifold
from slamcli.solver.certificate.dual import CertificateMatrix, Eigenpair
from slamcli.solver.certificate.manifold import Descent

#: The first step along the eigenvector moves rotations by this much (root mean square), then by halves of it.
_FIRST_STEP, _HALVINGS = 1.0, 30


def climb(matrix: CertificateMatrix, x: Array, escape: Eigenpair, interrupted: Callable[[], bool]) -> Descent:
    """Add a row to X (n, r, d + 1), leave the saddle along the eigenvector, and descend."""
    lifted = np.concatenate([x, np.zeros_like(x[:, :1])], axis=1)
    direction = np.zeros_like(lifted)
    direction[:, -1] = escape.vector * math.sqrt(matrix.connection.count)
    cost = matrix.connection.cost(lifted)
    length = _FIRST_STEP
    best, least = lifted, cost
    for _ in range(_HALVINGS):
        candidate = manifold.retract(lifted, length * direction)
        there = matrix.connection.cost(candidate)
        if there < least:
            best, least = candidate, there
        elif least < cost:
            break
        length *= 0.5
    return manifold.descend(matrix, best, interrupted)


def rounded(matrix: CertificateMatrix, x: Array, anchor: Array) -> Array:
    """Poses [R | t], (n, d, d + 1), nearest to a point with more rows.

    The rotations together, an r x nd matrix, are projected onto the left singular vectors of its d largest singular
    values, then each onto the nearest rotation. Each component is moved so that its pinned pose is where ``anchor``
    has it.
    """
    connection, d = matrix.connection, matrix.connection.space
    rotations = x[:, :, :d]
    gram = (rotations @ rotations.transpose(0, 2, 1)).sum(axis=0)
    basis = np.linalg.eigh(gram)[1][:, ::-1][:, :d]
    out = basis.T @ x
    if np.count_nonzero(np.linalg.det(out[:, :, :d]) < 0.0) > 0.5 * connection.count:
        out[:, -1] *= -1.0
    out[:, :, :d] = nearest_rotations(out[:, :, :d])
    pins = connection.pins[connection.component]
    turn = anchor[pins][:, :, :d] @ out[pins][:, :, :d].transpose(0, 2, 1)
    shift = anchor[pins][:, :, d:] - turn @ out[pins][:, :, d:]
    out = turn @ out
    out[:, :, d:] += shift
    return out


def nearest_rotations(matrices: Array) -> Array:
    """The rotations nearest to d x d matrices (n, d, d)."""
    if matrices.shape[-1] == 2:
        return so2.to_matrix(so2.from_matrix(matrices))
    u, _, v = np.linalg.svd(matrices)
    u[:, :, -1] *= np.where(np.linalg.det(u @ v) < 0.0, -1.0, 1.0)[:, None]
    return u @ v
