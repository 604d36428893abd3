"""How long a factorization takes: measured, and predicted from nonzeros and flops with what this machine does now."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array
from slamcli.solver.backends.cholmod import Cholmod
from slamcli.solver.ordering.found import FoundOrder
from slamcli.solver.pattern import BlockPattern
from slamcli.solver.symbolic import SymbolicAnalysis

#: Rows of the dense matrix that tells the rate. The simplicial code takes twenty times as long for it.
_DENSE = {True: 1500, False: 400}
_REPEATS = 3
#: What is added to the diagonal of the Laplacian: enough to make it regular, too little for its factor to fade out
#: (numbers below 1e-308 would slow the factorization down).
_REGULAR = 1e-6


@dataclass(frozen=True)
class Calibration:
    """A model of the time of a factorization: flops / rate + nnz(L) * per_nonzero.

    Attributes
    ----------
    rate
        Flops per second of the dense Cholesky factorization by the same code.
    per_nonzero
        Seconds for each nonzero of L on top of that, such that the reference is met.
    reference
        The order whose factorization was measured for it.
    supernodal
        Whether CHOLMOD's supernodal code is at work, or the simplicial one (for very sparse graphs).
    """

    rate: float
    per_nonzero: float
    reference: str
    supernodal: bool

    def predict(self, analysis: SymbolicAnalysis) -> float:
        """Seconds that a factorization of this structure takes."""
        return analysis.flops / self.rate + analysis.nnz_factor * self.per_nonzero


def calibrate(pattern: BlockPattern, reference: FoundOrder, measured: float, supernodal: bool) -> Calibration:
    """Calibrate on a dense matrix and on a factorization of the pattern that took ``measured`` seconds."""
    rows = _DENSE[supernodal]
    whole = BlockPattern(np.array([rows]), np.array([0]), np.array([0]))
    factorization = Cholmod(whole, np.arange(rows), supernodal=supernodal)
    dense = np.ones((rows, rows)) + rows * np.eye(rows)
    rate = rows * (rows + 1) * (2 * rows + 1) / 6 / _best(factorization, dense.ravel(), _REPEATS)
    analysis = reference.analysis(pattern)
    per_nonzero = max(0.0, measured - analysis.flops / rate) / max(analysis.nnz_factor, 1)
    return Calibration(rate, per_nonzero, reference.name, supernodal)


def factorization_time(pattern: BlockPattern, permutation: IndexArray, repeats: int = _REPEATS) -> tuple[float, bool]:
    """Seconds of CHOLMOD's numeric factorization, the least of some tries, and whether its supernodal code did it.

    The matrix is the Laplacian of the block graph, which has the pattern of H: the time does not depend on the values.

    Parameters
    ----------
    pattern
        Of the matrix.
    permutation
        Elimination order of its scalar rows.
    repeats
        Number of tries.
    """
    factorization = Cholmod(pattern, permutation)
    return _best(factorization, laplacian(pattern), repeats), factorization.supernodal


def laplacian(pattern: BlockPattern) -> Array:
    """Stored values of D - A + small I: A joins the rows of neighbouring blocks one to one, D their degrees."""
    values = np.zeros(pattern.stored)
    off = np.flatnonzero(pattern.rows != pattern.columns)
    rows, columns = pattern.rows[off], pattern.columns[off]
    common = np.minimum(pattern.sizes[rows], pattern.sizes[columns])
    degree = np.full(pattern.dimension, _REGULAR)
    for k in range(int(common.max(initial=0))):
        there = common > k
        values[(pattern.base[off] + k * (pattern.heights[columns] + 1))[there]] = -1.0
        for ends in (rows, columns):
            degree += np.bincount((pattern.offsets[ends] + k)[there], minlength=pattern.dimension)
    values[pattern.diagonal] = degree
    return values


def _best(factorization: Cholmod, values: Array, repeats: int) -> float:
    taken = []
    for _ in range(repeats):
        start = time.perf_counter()
        factorization.factorize(values)
        taken.append(time.perf_counter() - start)
    return min(taken)
