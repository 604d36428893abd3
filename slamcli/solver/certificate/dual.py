"""The certificate matrix of a critical point, and whether it is positive semidefinite.

At a critical point X of the cost tr(X M X^T) over orthonormal R_i the multipliers of R_i^T R_i = I are
Lambda_i = sym(R_i^T (X M)_i), with (X M)_i the columns of rotation i, and S = M - blockdiag(Lambda_i, 0) has X S = 0.
For any symmetric Lambda_i whatsoever, and any orthonormal R_i, minimizing over the translations gives

    cost >= tr(R Q R^T) = sum tr(Lambda_i) + tr(R (Q - Lambda) R^T),    Q = M_RR - M_Rt M_tt^+ M_tR

so that Q - Lambda + eta I >= 0 implies, by tr(R R^T) = n d,

    optimum >= sum tr(Lambda_i) - eta n d

At a critical point cost = sum tr(Lambda_i), and what can be left to gain is at most eta n d. Q - Lambda is the Schur
complement in S of the translations. M_tt is the Laplacian of the graph; with one translation of each component
pinned it is positive definite, and the Schur complement is the same, because a common translation costs nothing.
Hence one sparse Cholesky factorization of S + eta blockdiag(I, 0) with those translations pinned decides. Components
are blocks of S, so one test is right for several of them, too. The decision is good to the rounding of Cholesky.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array, dot, norm
from slamcli.solver import backends, ordering
from slamcli.solver.certificate.connection import Connection
from slamcli.solver.pattern import BlockPattern

#: Lanczos: steps at most, and the residual over the eigenvalue of the inverse at which an eigenvalue counts as found.
_STEPS, _ACCURACY = 100, 1e-6


class CertificateMatrix:
    """S of one graph: pattern, order and symbolic factorization are made once, multipliers can change.

    Rows of a pose's block are those of its rotation, then the one of its translation.
    """

    def __init__(self, connection: Connection) -> None:
        self.connection = connection
        d, n = connection.space, connection.count
        first, second = connection.first, connection.second
        low, high = np.minimum(first, second), np.maximum(first, second)
        keys = np.concatenate([high * n + low, np.arange(n) * (n + 1)])
        unique, inverse = np.unique(keys, return_inverse=True)
        columns, rows = np.divmod(unique, n)
        self.pattern = BlockPattern(np.full(n, d + 1, dtype=np.intp), rows, columns)
        blocks = self._blocks(inverse[: len(first)], inverse[len(first) :], len(unique))
        within = np.arange(d + 1)
        height = self.pattern.heights[columns]
        places = self.pattern.base[:, None, None] + within[:, None] + height[:, None, None] * within
        #: Stored values of M, with the pinned translations' rows and columns those of a multiple of the identity.
        self.values = np.empty(self.pattern.stored)
        self.values[places] = blocks
        on_diagonal = inverse[len(first) :]
        #: Largest diagonal entry of M among the rotations: the scale for eta.
        self.scale = float(blocks[on_diagonal][:, within[:d], within[:d]].max(initial=0.0)) or 1.0
        self._rotations = places[on_diagonal][:, :d, :d]
        self._diagonal = self._rotations[:, within[:d], within[:d]].ravel()
        self.factorized_shift = np.nan

    def _blocks(self, of_edge: IndexArray, of_pose: IndexArray, count: int) -> Array:
        """The upper blocks (count, d + 1, d + 1) of M."""
        connection, size = self.connection, self.connection.space + 1
        scaled = connection.scaled
        out = np.zeros((count, size, size))
        flat = out.reshape(-1)
        within = np.arange(size * size)

        def add(entries: IndexArray, values: Array) -> None:
            np.add.at(flat, (entries[:, None] * size * size + within).ravel(), values.ravel())

        backward = (connection.first > connection.second)[:, None, None]
        add(of_edge, -np.where(backward, scaled.transpose(0, 2, 1), scaled))
        add(of_pose[connection.first], scaled @ connection.transforms.transpose(0, 2, 1))
        add(of_pose[connection.second], connection.weights * np.eye(size))
        pinned = np.zeros(connection.count, dtype=bool)
        pinned[connection.pins] = True
        mean = float(out[of_pose, -1, -1].mean()) or 1.0
        out[pinned[self.pattern.rows], -1, :] = 0.0
        out[pinned[self.pattern.columns], :, -1] = 0.0
        out[of_pose[pinned], -1, -1] = mean
        return out

    @cached_property
    def _factorization(self) -> backends.Factorization:
        permutation = ordering.expand(self.pattern, ordering.order("amd", self.pattern))
        return backends.make("cholmod", self.pattern, permutation)

    def factorize(self, multipliers: Array, shift: float) -> bool:
        """Factorize M - blockdiag(Lambda_i - shift I, 0) for Lambda (n, d, d); whether it is positive definite."""
        values = self.values.copy()
        values[self._rotations] -= multipliers
        values[self._diagonal] += shift
        self.factorized_shift = np.nan
        try:
            self._factorization.factorize(values)
        except backends.NotPositiveDefiniteError:
            return False
        self.factorized_shift = shift
        return True

    def solve(self, right: Array) -> Array:
        """Solution for one right-hand side (n, d + 1) with what was factorized last."""
        return self._factorization.solve(right.ravel()).reshape(right.shape)


@dataclass(frozen=True, eq=False)
class Multipliers:
    """The Lagrange multipliers of a point, and how far from critical it is.

    Attributes
    ----------
    blocks
        (n, d, d) Lambda_i.
    residual
        (n, r, d + 1) X S, half the Riemannian gradient: zero at a critical point.
    """

    blocks: Array
    residual: Array

    @classmethod
    def of(cls, connection: Connection, x: Array) -> Multipliers:
        """Of a point X (n, r, d + 1) with orthonormal rotations."""
        d = connection.space
        rotations, product = x[:, :, :d], connection.product(x)
        blocks = rotations.transpose(0, 2, 1) @ product[:, :, :d]
        blocks = 0.5 * (blocks + blocks.transpose(0, 2, 1))
        product[:, :, :d] -= rotations @ blocks
        return cls(blocks, product)

    @property
    def trace(self) -> float:
        """Sum of tr(Lambda_i): the dual value."""
        return float(np.trace(self.blocks, axis1=1, axis2=2).sum())


@dataclass(frozen=True, eq=False)
class Eigenpair:
    """An eigenvalue of Q - Lambda, the Schur complement of the translations.

    Attributes
    ----------
    value
        The eigenvalue.
    error
        It is within this of a true one.
    vector
        (n, d + 1) unit in the rotation part, with the translations that follow it.
    """

    value: float
    error: float
    vector: Array


def smallest_eigenpair(matrix: CertificateMatrix, deflated: Array | None = None) -> Eigenpair:
    """Smallest eigenvalue of Q - Lambda by Lanczos' method on the inverse of what is factorized.

    Parameters
    ----------
    matrix
        Factorized at a shift.
    deflated
        (n, r, d) rotations, whose rows (component by component) are orthogonal to the eigenvector wanted.
    """
    connection, d = matrix.connection, matrix.connection.space
    members = np.bincount(connection.component)

    def projected(vector: Array) -> Array:
        if deflated is None:
            return vector
        share = np.zeros((len(members), deflated.shape[1]))
        np.add.at(share, connection.component, (deflated @ vector[:, :, None])[:, :, 0])
        share /= members[:, None]
        return vector - (share[connection.component][:, None] @ deflated)[:, 0]

    def inverse(vector: Array) -> Array:
        right = np.zeros((connection.count, d + 1))
        right[:, :d] = vector
        return matrix.solve(right)

    start = projected(np.random.default_rng(0).standard_normal((connection.count, d)))
    basis = [start / norm(start)]
    diagonal: list[float] = []
    beside: list[float] = []
    limit = min(_STEPS, connection.count * d - (0 if deflated is None else deflated.shape[1] * len(members)))
    while True:
        image = projected(inverse(basis[-1])[:, :d])
        diagonal.append(dot(image, basis[-1]))
        stacked = np.array(basis).reshape(len(basis), -1)
        for _ in range(2):  # full orthogonalization, twice
            image = image - (stacked.T @ (stacked @ image.ravel())).reshape(image.shape)
        values, vectors = np.linalg.eigh(np.diag(diagonal) + np.diag(beside, 1) + np.diag(beside, -1))
        beta = norm(image)
        error = beta * abs(float(vectors[-1, -1]))
        if error <= _ACCURACY * values[-1] or len(basis) >= limit:
            break
        beside.append(beta)
        basis.append(image / beta)
    vector = (stacked.T @ vectors[:, -1]).reshape(start.shape)
    top = float(values[-1])
    whole = inverse(vector)
    whole /= norm(whole[:, :d])
    # 1 / top is an eigenvalue plus the shift; an error of the inverse's eigenvalue counts 1 / top^2
    return Eigenpair(1.0 / top - matrix.factorized_shift, error / top**2, whole)
