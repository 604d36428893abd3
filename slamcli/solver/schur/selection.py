"""Which blocks of H a Schur complement eliminates, and whether that pays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.errors import UsageError
from slamcli.graph import FactorGraph
from slamcli.graph.columns import BoolArray
from slamcli.solver import backends, ordering
from slamcli.solver.backends import Factorization
from slamcli.solver.backends.dense import Dense
from slamcli.solver.bundle import has_projections
from slamcli.solver.gauge import Held
from slamcli.solver.ordering import FoundOrder
from slamcli.solver.pattern import BlockPattern
from slamcli.solver.schur.complement import SchurFactorization
from slamcli.solver.schur.implicit import ImplicitSchur
from slamcli.solver.schur.links import Links
from slamcli.solver.schur.structure import Structure
from slamcli.solver.symbolic import ReducedSystem

#: Largest dimension of a complement that is factorized densely whatever its density: 5 ms.
_SMALL = 600
#: Density from which on LAPACK beats a sparse factorization.
_DENSE = 0.3
#: With fewer links than this for each block of the complement a general sparse factorization may be faster (measured:
#: it is by far on landmark sets, Victoria Park with 0.03 and world-2000 with 0.2; it is not on Ladybug-49 with 32).
_LINKS = 8.0
#: Seconds that a product of two links takes when the complement is formed, and a link in a product with the complement
#: that is not formed; operations of a factorization in a second. (Measured on one core.)
_PAIR, _LINK, _RATE = 1e-7, 6e-8, 1e10
#: Iterations of conjugate gradients in a step, for want of knowledge: 3 to 20 were measured on scenes where cameras see
#: each other's points all over, hundreds on long chains of cameras.
_ITERATIONS = 50
#: So much longer must a factorization take: it is exact, and its time is no guess.
_MARGIN = 2.0


@dataclass(frozen=True, eq=False)
class Selection:
    """What is eliminated, and how the rest is factorized.

    Attributes
    ----------
    kind
        Name of the kind of variable that is eliminated.
    structure
        The complement.
    dense
        Whether it is factorized as a dense matrix.
    order
        Elimination order of the complement.
    """

    kind: str
    structure: Structure
    dense: bool
    order: FoundOrder

    @property
    def elimination(self) -> FoundOrder:
        """The order of all blocks: those that are eliminated, then the rest."""
        structure = self.structure
        blocks = np.concatenate([structure.gone, structure.kept[self.order.order]])
        return FoundOrder(f"Schur complement of {self.kind}, {self.order.name}", blocks)

    @property
    def flops(self) -> float:
        """Floating-point operations of the factorization of the complement."""
        reduced = self.structure.reduced
        return float(reduced.dimension) ** 3 / 3.0 if self.dense else self.order.analysis(reduced).flops

    @property
    def reduced_system(self) -> ReducedSystem:
        """The complement, for reports."""
        reduced = self.structure.reduced
        solver = "dense" if self.dense else "sparse"
        return ReducedSystem(self.kind, reduced.dimension, reduced.nnz, self.dense, solver)

    def factorization(self, linear_solver: str) -> Factorization:
        """What factorizes matrices of the whole pattern."""
        reduced = self.structure.reduced
        if self.dense:
            return SchurFactorization(self.structure, Dense(reduced))
        permutation = ordering.expand(reduced, self.order.order)
        return SchurFactorization(self.structure, backends.make(linear_solver, reduced, permutation))


@dataclass(frozen=True, eq=False)
class ImplicitSelection:
    """What is eliminated where the rest is solved by conjugate gradients.

    Attributes
    ----------
    kind
        Name of the kind of variable that is eliminated.
    links
        What multiplies with the complement.
    """

    kind: str
    links: Links

    @property
    def reduced_system(self) -> ReducedSystem:
        """The complement, for reports."""
        return ReducedSystem(self.kind, self.links.dimension, None, False, "iterative")

    def factorization(self) -> ImplicitSchur:
        """What solves with matrices of the whole pattern."""
        return ImplicitSchur(self.links)


def select(
    elimination: str, solver: str, ordering_name: str, graph: FactorGraph, held: Held, pattern: BlockPattern
) -> Selection | ImplicitSelection | None:
    """What to eliminate, None for nothing.

    Parameters
    ----------
    elimination
        ``none``, ``schur`` (points, or a usage error), or ``auto``: where it pays, and always where cameras see the
        points, since pivots of such systems differ by more orders of magnitude than a factorization of all at once
        can tell from rounding. (Here points are judged by their own blocks, and the complement is scaled.)
    solver
        Of the complement: ``dense``, ``sparse``, ``iterative``, ``auto`` (what is likely to be faster), or
        ``factorized`` (``dense`` or ``sparse``). Who asks for one of the first three asks for the complement.
    ordering_name
        How the complement is ordered.
    graph, held
        The variables.
    pattern
        Of H.

    Raises
    ------
    UsageError
        If a complement was asked for and no kind of point is an independent set.
    """
    if elimination == "none":
        return None
    wanted = elimination == "schur" or solver not in ("auto", "factorized")
    for name, mask in _points(graph, held):
        if not mask.any() or mask.all() or _joined(pattern, mask):
            continue
        if not (wanted or has_projections(graph) or _pays(pattern, mask)):
            continue
        forming, iterating = _seconds(pattern, mask)
        if solver == "iterative" or (solver == "auto" and forming > _MARGIN * iterating):
            return ImplicitSelection(name, Links.of(pattern, mask))
        found = _factorized(name, Structure.of(pattern, mask), solver, ordering_name)
        if solver == "auto" and forming + found.flops / _RATE > _MARGIN * iterating:
            return ImplicitSelection(name, Links.of(pattern, mask))
        return found
    if wanted:
        asked = "elimination 'schur'" if elimination == "schur" else f"reduced solver {solver!r}"
        raise UsageError(
            f"{asked} needs points that no edge joins with each other, besides poses or cameras",
            ("  --elimination auto uses it where there are such points and it saves time",),
        )
    return None


def _factorized(name: str, structure: Structure, solver: str, ordering_name: str) -> Selection:
    """The complement as a matrix."""
    reduced = structure.reduced
    density = 2.0 * reduced.nnz / max(float(reduced.dimension) ** 2, 1.0)
    dense = reduced.dimension <= _SMALL or density >= _DENSE if solver in ("auto", "factorized") else solver == "dense"
    return Selection(name, structure, dense, ordering.find("natural" if dense else ordering_name, reduced))


def _seconds(pattern: BlockPattern, mask: BoolArray) -> tuple[float, float]:
    """What it takes to form a complement, and to solve with one that is not formed, in rough figures.

    Both grow with the points; their ratio is what counts, and grows with the cameras that see a point.
    """
    row_gone, column_gone = mask[pattern.rows], mask[pattern.columns]
    crossing = row_gone != column_gone
    point = np.where(row_gone, pattern.rows, pattern.columns)[crossing]
    seen = np.bincount(point).astype(np.float64)
    return _PAIR * float((seen * (seen - 1.0)).sum()) / 2.0, _ITERATIONS * _LINK * len(point)


def _points(graph: FactorGraph, held: Held) -> list[tuple[str, BoolArray]]:
    """The kinds of points, most first, each with the mask of its blocks."""
    counts = {name: int((~held[name]).sum()) for name in graph.variables}
    start, out = 0, []
    total = sum(counts.values())
    for name, column in graph.variables.items():
        if column.kind.is_point:
            mask = np.zeros(total, dtype=bool)
            mask[start : start + counts[name]] = True
            out.append((name, mask))
        start += counts[name]
    return sorted(out, key=lambda pair: -int(pair[1].sum()))


def _joined(pattern: BlockPattern, mask: BoolArray) -> bool:
    """Whether two of the blocks have a block of H in common."""
    return bool((mask[pattern.rows] & mask[pattern.columns] & (pattern.rows != pattern.columns)).any())


def _pays(pattern: BlockPattern, mask: BoolArray) -> bool:
    """Whether eliminating some blocks is faster than a general sparse factorization.

    It is where many links go to few blocks of the complement. Of these there are at most as many as pairs of cameras,
    which is the number that counts where it is reached.
    """
    row_gone, column_gone = mask[pattern.rows], mask[pattern.columns]
    crossing = row_gone != column_gone
    cameras = np.where(row_gone, pattern.columns, pattern.rows)[crossing]
    seen = len(np.unique(cameras))
    return int(crossing.sum()) >= _LINKS * 0.5 * seen * (seen + 1) or (
        int(crossing.sum()) >= 4 * _LINKS * seen and int(mask.sum()) >= 4 * int((~mask).sum())
    )
