"""Noise of a stated covariance, Gaussian or with heavy tails."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from slamcli.models.base import Array

#: Written where nothing random happens, since an information matrix cannot be infinite: metres, radians.
LEAST_SIGMA = 1e-3


@dataclass(frozen=True, eq=False)
class Noise:
    """Zero-mean noise on a residual of d numbers.

    Attributes
    ----------
    covariance
        (d, d) symmetric, positive semidefinite, in the order and frame of the residual.
    tails
        Degrees of freedom of Student's t (more than 2), or None for a Gaussian. The covariance is the stated one
        in both cases.
    """

    covariance: Array
    tails: float | None = None

    @property
    def dimension(self) -> int:
        """Numbers of the residual."""
        return len(self.covariance)

    @cached_property
    def root(self) -> Array:
        """(d, d) lower triangle L with L L^T = covariance; zero columns where nothing is left (semidefinite)."""
        return np.array(_cholesky(self.covariance.tolist()))

    @cached_property
    def information(self) -> Array:
        """(d, d) inverse of the covariance, in which what is exactly known counts as known to LEAST_SIGMA."""
        covariance = self.covariance.copy()
        if (np.diag(self.root) == 0.0).any():
            covariance += LEAST_SIGMA**2 * np.diag((np.diag(self.root) == 0.0).astype(float))
        return rounded(np.array(_inverse(covariance.tolist())), digits=12)

    def draw(self, rng: np.random.Generator, count: int) -> Array:
        """(count, d) independent samples."""
        normal = standard(rng, (count, self.dimension), self.tails)
        out = np.zeros((count, self.dimension))
        for k in range(self.dimension):
            out += normal[:, k : k + 1] * self.root[:, k]
        return out


def standard(rng: np.random.Generator, shape: tuple[int, int], tails: float | None) -> Array:
    """Samples (count, d) of unit covariance: Gaussian, or multivariate t of ``tails`` degrees of freedom."""
    normal = rng.standard_normal(shape)
    if tails is None:
        return normal
    # t = normal / sqrt(chisquare / nu) has covariance nu / (nu - 2)
    scale = np.sqrt((tails - 2.0) / rng.chisquare(tails, shape[0]))
    return normal * scale[:, None]


def rounded(values: Array, *, digits: int) -> Array:
    """Values rounded to significant decimal digits, so that 1 / 0.05^2 reads 400."""
    text = [f"{value:.{digits}g}" for value in np.ravel(values).tolist()]
    return np.array([float(t) for t in text]).reshape(np.shape(values))


def _cholesky(matrix: list[list[float]]) -> list[list[float]]:
    """Scalar arithmetic in a fixed order: LAPACK's last digits depend on the machine."""
    size = len(matrix)
    root = [[0.0] * size for _ in range(size)]
    for j in range(size):
        pivot = matrix[j][j] - sum(root[j][k] * root[j][k] for k in range(j))
        if pivot < -1e-12 * abs(matrix[j][j]):
            raise ValueError("the covariance is not positive semidefinite")
        if pivot <= 1e-15 * matrix[j][j]:
            continue
        root[j][j] = math.sqrt(pivot)
        for i in range(j + 1, size):
            root[i][j] = (matrix[i][j] - sum(root[i][k] * root[j][k] for k in range(j))) / root[j][j]
    return root


def _inverse(matrix: list[list[float]]) -> list[list[float]]:
    """Inverse of a positive definite matrix by Gauss and Jordan, in a fixed order."""
    size = len(matrix)
    rows = [[*row, *(float(i == j) for j in range(size))] for i, row in enumerate(matrix)]
    for k in range(size):
        pivot = rows[k][k]
        rows[k] = [value / pivot for value in rows[k]]
        for i in range(size):
            if i != k and rows[i][k] != 0.0:
                factor = rows[i][k]
                rows[i] = [a - factor * b for a, b in zip(rows[i], rows[k], strict=True)]
    inverse = [row[size:] for row in rows]
    return [[0.5 * (inverse[i][j] + inverse[j][i]) for j in range(size)] for i in range(size)]
