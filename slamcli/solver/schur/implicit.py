"""The Schur complement as a product, solved by conjugate gradients and never formed.

With Z_ip = W_ip L_p^-T as in ``complement``, S x = A x - Z (Z^T x): work and memory are in proportion to the
observations, while the complement itself has a block for each two cameras that see a point in common, and its factor
more. (Agarwal, Snavely, Seitz, Szeliski, "Bundle Adjustment in the Large", ECCV 2010, section 3.)
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from slamcli.models.base import Array
from slamcli.solver.backends.protocol import ROUNDING, NotPositiveDefiniteError
from slamcli.solver.schur.conjugate_gradients import ETA, TOLERANCE, Iterated, Operator, exact, inexact
from slamcli.solver.schur.links import Links
from slamcli.solver.schur.preconditioner import BlockJacobi


class ImplicitSchur:
    """Solves with matrices of a pattern; in the place of a factorization.

    Parameters
    ----------
    links
        What is eliminated.

    Attributes
    ----------
    iterations
        Of conjugate gradients, in all so far.
    unfinished
        Solutions that did not come to their criterion: inexact ones at the limit of iterations, exact ones that
        rounding stopped before.
    """

    def __init__(self, links: Links) -> None:
        self.links = links
        self.iterations = 0
        self.unfinished = 0
        self._z = np.empty((len(links), links.size, links.width))
        self._by_link = np.empty((len(links), links.size))
        self._inverse = np.empty(links.points.shape)
        self._own, self._inner = np.empty(links.own.shape), np.empty(links.inner.shape)

    def factorize(self, values: Array) -> None:
        """Take a matrix: divide by the points' factors, make the preconditioner; raises NotPositiveDefiniteError."""
        links = self.links
        source = np.append(values, 0.0)
        self._inverse = _inverse_factors(source[links.points])
        links.divided(source, self._inverse, self._z)
        self._own, self._inner = source[links.own], source[links.inner]
        self._preconditioner = BlockJacobi(self.diagonal_blocks(), links.padding)

    def solve(self, rhs: Array, tolerance: float = TOLERANCE) -> Array:
        """Solution of H x = rhs; raises NotPositiveDefiniteError, or NotSolvedError where it is not found."""
        return self._solved(rhs, partial(exact, tolerance=tolerance))

    def solve_inexactly(self, rhs: Array, eta: float = ETA) -> Array:
        """A step towards it, see ``conjugate_gradients.inexact``; raises NotPositiveDefiniteError."""
        return self._solved(rhs, partial(inexact, eta=eta))

    def product(self, x: Array) -> Array:
        """S x for (c, width)."""
        links = self.links
        out = np.einsum("cij,cj->ci", self._own, x)
        if len(links.inner):
            width, total = np.arange(links.width), out.size
            for blocks, into, of in (
                (self._inner, links.upper, links.lower),
                (self._inner.transpose(0, 2, 1), links.lower, links.upper),
            ):
                added = np.einsum("eij,ej->ei", blocks, x[of])
                target = (into[:, None] * links.width + width).ravel()
                out += np.bincount(target, added.ravel(), minlength=total).reshape(out.shape)
        self._subtract(out, self._to_points(x))
        return out

    def diagonal_blocks(self) -> Array:
        """(c, width, width) diagonal blocks of S."""
        links, z = self.links, self._z
        out = self._own.copy()
        for camera, begin, end in links.long:
            own = z[begin:end].reshape(-1, links.width)
            out[camera] -= own.T @ own
        cameras, starts = links.short_runs
        if len(cameras):
            few = z[links.short :]
            out[cameras] -= np.add.reduceat(np.matmul(few.transpose(0, 2, 1), few), starts, axis=0)
        return out

    def _to_points(self, x: Array) -> Array:
        """Z^T x: (p, size) for (c, width)."""
        links, z, by_link = self.links, self._z, self._by_link
        for camera, begin, end in links.long:
            np.dot(z[begin:end].reshape(-1, links.width), x[camera], out=by_link[begin:end].reshape(-1))
        few = slice(links.short, None)
        np.einsum("mij,mj->mi", z[few], x[links.camera[few]], out=by_link[few])
        count = len(links.gone)
        columns = [np.bincount(links.point, column, minlength=count) for column in by_link.T]
        return np.stack(columns, axis=1, dtype=np.float64)  # (without a link, bincount counts in integers)

    def _subtract(self, out: Array, inner: Array) -> None:
        """Subtract Z y from (c, width) for y (p, size)."""
        links, z, by_link = self.links, self._z, self._by_link
        np.take(inner, links.point, axis=0, out=by_link)
        for camera, begin, end in links.long:
            out[camera] -= by_link[begin:end].reshape(-1) @ z[begin:end].reshape(-1, links.width)
        cameras, starts = links.short_runs
        if len(cameras):
            few = slice(links.short, None)
            out[cameras] -= np.add.reduceat(np.einsum("mij,mi->mj", z[few], by_link[few]), starts, axis=0)

    def _solved(self, rhs: Array, method: Callable[[Operator, Operator, Array], Iterated]) -> Array:
        """The points are eliminated, the cameras solved for, and the points placed exactly for these cameras."""
        links = self.links
        inner = np.einsum("pij,pj->pi", self._inverse, rhs[links.point_rows])
        side = np.append(rhs, 0.0)[links.rows]
        self._subtract(side, inner)
        found = method(self.product, self._preconditioner.solve, side)
        self.iterations += found.iterations
        self.unfinished += not found.reached
        inner -= self._to_points(found.x)
        out = np.empty(len(rhs) + 1)
        out[links.rows] = found.x
        out[links.point_rows] = np.einsum("pij,pi->pj", self._inverse, inner)
        return out[:-1]


def _inverse_factors(blocks: Array) -> Array:
    """L^-1 of the Cholesky factors L of small blocks, (p, size, size), entry by entry for all of them at once.

    Raises
    ------
    NotPositiveDefiniteError
        If a pivot is not clearly positive beside the diagonal entry that it comes from.
    """
    size = blocks.shape[1]
    lower, out = np.zeros_like(blocks), np.zeros_like(blocks)
    for k in range(size):
        for j in range(k):
            entry = blocks[:, k, j] - np.vecdot(lower[:, k, :j], lower[:, j, :j])
            lower[:, k, j] = entry * out[:, j, j]
        diagonal = blocks[:, k, k]
        pivot = diagonal - np.square(lower[:, k, :k]).sum(axis=1)
        if not (pivot > ROUNDING * diagonal).all():
            raise NotPositiveDefiniteError("a block that is to be eliminated is not positive definite")
        out[:, k, k] = 1.0 / np.sqrt(pivot)
        for j in range(k):
            out[:, k, j] = -out[:, k, k] * np.vecdot(lower[:, k, j:k], out[:, j:k, j])
    return out
