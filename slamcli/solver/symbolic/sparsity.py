"""What a run reports about the sparsity of its linear system."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ReducedSystem:
    """The Schur complement that was solved with instead of H.

    Attributes
    ----------
    eliminated
        Kind of the variables that were eliminated before.
    dimension
        Its rows.
    nnz
        Nonzeros of its triangle, diagonal included (all entries of its dense blocks); None where it is not formed.
    dense
        Whether it was factorized as a dense matrix.
    solver
        ``dense`` or ``sparse`` factorization, or ``iterative``: conjugate gradients.
    """

    eliminated: str
    dimension: int
    nnz: int | None
    dense: bool
    solver: str


@dataclass(frozen=True)
class Sparsity:
    """Sparsity of the linear system.

    Attributes
    ----------
    dimension
        Rows of H.
    nnz_hessian
        Nonzeros of the lower triangle of H, diagonal included (all entries of its dense blocks).
    nnz_factor
        Nonzeros of its Cholesky factor L. None, as the next three, where conjugate gradients take its place.
    fill_in
        ``nnz_factor / nnz_hessian``: 1 where elimination creates no new entry.
    factor_flops
        Floating-point operations of the factorization, the sum of the squared column counts of L.
    ordering
        The elimination order; where ``auto`` was asked for, the one it took.
    density
        Share of the full square matrix H that is not zero.
    reduced
        The Schur complement, None where all is factorized at once.
    """

    dimension: int
    nnz_hessian: int
    nnz_factor: int | None
    fill_in: float | None
    factor_flops: float | None
    ordering: str | None
    density: float
    reduced: ReducedSystem | None = None
