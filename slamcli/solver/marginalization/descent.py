"""Descent over the information matrices of links, one at a time (see ``recovery``)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.models.base import Array
from slamcli.solver.marginalization.links import Links

#: A sweep that lowers 2 KLD by less than this is the last; so is one that goes beyond so many operations in all.
_TOLERANCE = 1e-4
_SWEEPS = 25
_OPERATIONS = 2e10
#: A link that gains less than this share of the best one waits for the next full sweep.
_IDLE = 0.03
#: Smallest eigenvalue of a correlation matrix by its largest one.
_ROUNDING = 1e-14


def total(links: list[Links], information: list[Array], size: int) -> Array:
    """S, the sum of J^T X J over all links, (size, size)."""
    out = np.zeros((size, size))
    for part, matrices in zip(links, information, strict=True):
        used = np.flatnonzero(matrices.any(axis=(1, 2)))
        jacobian = part.jacobian[used]
        products = jacobian.transpose(0, 2, 1) @ matrices[used] @ jacobian
        columns = part.columns[used]
        np.add.at(out, (columns[:, :, None], columns[:, None, :]), products)
    return out


def padded_inverse(matrix: Array, free: IndexArray) -> Array:
    """Inverse of the free rows and columns, zero elsewhere."""
    out = np.zeros_like(matrix)
    index = np.ix_(free, free)
    inverse = np.linalg.inv(matrix[index])
    out[index] = 0.5 * (inverse + inverse.T)
    return out


def descend(
    links: list[Links],
    covariances: list[Array],
    start: list[Array],
    chosen: list[BoolArray],
    free: IndexArray,
    context: Array,
) -> list[Array]:
    """The information matrices of least divergence.

    Parameters
    ----------
    links
        All that a blanket may have.
    covariances
        T_i of each.
    start
        X_i >= 0 to start from, with a positive definite S.
    chosen
        Which links may have one.
    free
        Columns of the blanket that are not held.
    context
        Information over the blanket that comes on top of S, and is in the T_i.
    """
    square_roots = [roots(covariance) for covariance in covariances]
    # in units of the marginal's own uncertainty, where T_i is the identity
    links = [
        replace(part, jacobian=inverse @ part.jacobian) for part, (_, inverse) in zip(links, square_roots, strict=True)
    ]
    out = [root.transpose(0, 2, 1) @ x @ root for x, (root, _) in zip(start, square_roots, strict=True)]
    steps = [(k, int(row)) for k, mask in enumerate(chosen) for row in np.flatnonzero(mask)]
    budget = int(min(_SWEEPS * len(steps), _OPERATIONS / max(1.0, 12.0 * len(free) ** 2)))
    active = steps
    while budget > 0:
        sigma = padded_inverse(context + total(links, out, len(context)), free)  # anew: no rounding adds up
        gains = [_step(links[k].jacobian[row], links[k].columns[row], out[k][row], sigma) for k, row in active]
        budget -= len(active)
        if sum(gains) < _TOLERANCE:
            if len(active) == len(steps):
                break
            active = steps
        else:  # where next to nothing is gained any more, only now and then
            active = [link for link, gain in zip(active, gains, strict=True) if gain > _IDLE * max(gains)]
    return [inverse.transpose(0, 2, 1) @ x @ inverse for x, (_, inverse) in zip(out, square_roots, strict=True)]


def roots(covariance: Array) -> tuple[Array, Array]:
    """Square roots R of covariances (m, d, d), T = R R^T, and their inverses, whatever the rounding."""
    size = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), np.finfo(float).tiny))
    eigenvalues, vectors = np.linalg.eigh(covariance / size[:, :, None] / size[:, None, :])
    length = np.sqrt(np.maximum(eigenvalues, _ROUNDING * eigenvalues[:, -1:]))[:, None, :]
    root = size[:, :, None] * vectors * length
    inverse = (vectors / length).transpose(0, 2, 1) / size[:, None, :]
    return root, inverse


def _step(jacobian: Array, columns: IndexArray, information: Array, sigma: Array) -> float:
    """The best X of one link, with T = I; X and S^-1 in place (Woodbury). Returns by how much 2 KLD falls."""
    across = sigma[:, columns] @ jacobian.T
    here = jacobian @ across[columns]
    values, vectors = np.linalg.eigh(np.linalg.inv(here) - information)
    change = (vectors * np.maximum(1.0 - values, 0.0)) @ vectors.T - information
    gained = float(np.log(np.maximum(values, 1.0)).sum() + np.linalg.slogdet(here)[1] - change.trace())
    if gained <= 1e-14:
        return 0.0
    information += change
    gain = np.linalg.solve(np.eye(len(change)) + change @ here, change)
    sigma -= across @ (0.5 * (gain + gain.T)) @ across.T
    return gained
