"""Information matrices as stacks: the upper triangle of the files, definiteness, eigenvalues."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.models.base import Array

#: A pivot below this fraction of its diagonal entry counts as zero: files carry six digits, so a singular matrix
#: reads back with pivots of about 1e-6 of either sign.
RELATIVE_PIVOT_TOLERANCE = 1e-5


def from_upper_triangle(numbers: Array, dimension: int) -> Array:
    """Symmetric matrices (m, d, d) from their upper triangles, row by row, (m, d (d + 1) / 2)."""
    out = np.empty((len(numbers), dimension, dimension))
    for k, (row, column) in enumerate(zip(*np.triu_indices(dimension), strict=True)):
        out[:, row, column] = numbers[:, k]
        if row != column:
            out[:, column, row] = numbers[:, k]
    return out


def to_upper_triangle(information: Array) -> Array:
    """Upper triangles, row by row, (m, d (d + 1) / 2), of symmetric matrices (m, d, d)."""
    rows, columns = np.triu_indices(information.shape[-1])
    return np.ascontiguousarray(information[:, rows, columns])


def indefinite(information: Array) -> NDArray[np.bool_]:
    """Which matrices of the stack (m, d, d) have a clearly negative eigenvalue.

    A vectorized L D L^T without pivoting over the whole stack; where a pivot is not clearly positive (which
    includes the harmless semidefinite matrices) the eigenvalues decide.
    """
    dimension = information.shape[-1]
    rows = [[information[:, i, j].copy() for j in range(dimension)] for i in range(dimension)]
    doubtful = np.zeros(len(information), dtype=bool)
    with np.errstate(all="ignore"):
        for k in range(dimension):
            pivot = rows[k][k]
            doubtful |= ~(pivot > RELATIVE_PIVOT_TOLERANCE * np.abs(information[:, k, k]))
            for i in range(k + 1, dimension):
                factor = rows[k][i] / pivot
                for j in range(i, dimension):
                    rows[i][j] -= factor * rows[k][j]
    suspects = np.flatnonzero(doubtful)
    result = np.zeros(len(information), dtype=bool)
    if len(suspects):
        low, high = eigenvalue_range(information[suspects])
        result[suspects] = low < -RELATIVE_PIVOT_TOLERANCE * np.abs(high)
    return result


def eigenvalue_range(information: Array) -> tuple[Array, Array]:
    """Smallest and largest eigenvalue of each matrix of the stack (m, d, d)."""
    with np.errstate(all="ignore"):
        eigenvalues = np.linalg.eigvalsh(information)
    return np.asarray(eigenvalues[:, 0], np.float64), np.asarray(eigenvalues[:, -1], np.float64)
