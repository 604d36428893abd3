"""Block-Jacobi: what stands for the complement when conjugate gradients need it solved.

The diagonal blocks of S itself, not of A (Ceres' SCHUR_JACOBI; Agarwal, Snavely, Seitz, Szeliski, "Bundle Adjustment in
the Large", ECCV 2010, section 3.3): A's forget what the points have taken from a camera.
"""

from __future__ import annotations

import numpy as np

from slamcli.graph.columns import BoolArray
from slamcli.models.base import Array
from slamcli.solver.backends.protocol import ROUNDING, NotPositiveDefiniteError


class BlockJacobi:
    """Inverses of symmetric positive definite blocks.

    Parameters
    ----------
    blocks
        (c, width, width).
    padding
        (c, width) rows that are not there; they are zero, as are their columns.

    Raises
    ------
    NotPositiveDefiniteError
        If one is not positive definite.
    """

    def __init__(self, blocks: Array, padding: BoolArray) -> None:
        diagonal = np.diagonal(blocks, axis1=1, axis2=2)
        if not (diagonal[~padding] > 0.0).all() or not np.isfinite(blocks).all():
            raise NotPositiveDefiniteError("the diagonal of the complement is not positive")
        # units as different as radians and pixels meet in a block: scaled, its condition is its own
        scale = 1.0 / np.sqrt(np.where(padding, 1.0, diagonal))
        scaled = blocks * scale[:, :, None] * scale[:, None, :]
        scaled += padding[:, :, None] * np.eye(blocks.shape[1])
        try:
            factor = np.linalg.cholesky(scaled)
        except np.linalg.LinAlgError:
            raise NotPositiveDefiniteError("a diagonal block of the complement is not positive definite") from None
        if not (np.square(np.diagonal(factor, axis1=1, axis2=2)) > ROUNDING).all():
            raise NotPositiveDefiniteError("a diagonal block of the complement is singular")
        self._inverse = np.linalg.inv(factor)
        self._scale = scale

    def solve(self, x: Array) -> Array:
        """M^-1 x for (c, width)."""
        half = np.matvec(self._inverse, self._scale * x)
        return np.asarray(self._scale * np.vecmat(half, self._inverse))
