"""What is known of each landmark with everything else given: its sightings, and their chi2 as a function of its place.

With poses (and landmarks that are placed already) given, landmarks do not depend on each other. Each has a small
least-squares problem of its own, of 2 or 3 unknowns, and all of these are evaluated at once:

    chi2_l(p) = sum e^T Omega e,    H_l = sum J^T Omega J,    g_l = sum J^T Omega e

over the factors of the landmark l, with J the Jacobian by its place p.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slamcli.graph import FactorGraph, Factors
from slamcli.graph.columns import BoolArray, IndexArray, Values
from slamcli.models import FactorKind, Projection, VariableKind
from slamcli.models.base import Array


def summed(rows: IndexArray, quantity: Array, count: int) -> Array:
    """Sums (count, ...) of a quantity (m, ...) by row; several times as fast as ``numpy.add.at``."""
    columns = quantity.reshape(len(rows), -1).T
    sums = [np.bincount(rows, column, minlength=count) for column in columns]
    return np.asarray(np.stack(sums, axis=1).reshape(count, *quantity.shape[1:]), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Part:
    """Sightings of one kind.

    Attributes
    ----------
    factors
        The factors.
    slot
        Which of a factor's variables the landmark is.
    others
        Values of the other one, (m, size); None for priors on landmarks.
    order
        (m,) rank of its id.
    """

    factors: Factors
    slot: int
    others: Array | None
    order: IndexArray

    @property
    def kind(self) -> FactorKind:
        """Kind of the factors."""
        return self.factors.kind

    @property
    def rows(self) -> IndexArray:
        """(m,) rows of the landmarks."""
        return self.factors.indices[:, self.slot]

    def joined(self, places: Array) -> tuple[Array, ...]:
        """Values of the factors' variables, the landmarks at ``places`` (n, d)."""
        place = places[self.rows]
        if self.others is None:
            return (place,)
        return (place, self.others) if self.slot == 0 else (self.others, place)

    def linearized(self, places: Array) -> tuple[Array, Array]:
        """Residuals (m, r) and their Jacobians (m, r, d) by the places of the landmarks."""
        f = self.factors
        residual, jacobians = f.kind.linearize(self.joined(places), f.measurements, f.parameters)
        return residual, jacobians[self.slot]

    def of(self, wanted: BoolArray) -> Part:
        """The sightings of some of the landmarks."""
        rows = np.flatnonzero(wanted[self.rows])
        if len(rows) == len(self.factors):
            return self
        others = None if self.others is None else self.others[rows]
        return replace(self, factors=self.factors.part(rows), others=others, order=self.order[rows])


@dataclass(frozen=True, eq=False)
class Sightings:
    """Sightings of landmarks of one kind.

    Attributes
    ----------
    kind
        Of the landmarks.
    count
        Number n of landmarks in their column, whether they are seen or not.
    parts
        By kind of factor.
    """

    kind: VariableKind
    count: int
    parts: list[Part]

    @classmethod
    def of_graph(
        cls, graph: FactorGraph, kind: VariableKind, values: Values, placed: dict[str, BoolArray], wanted: BoolArray
    ) -> Sightings:
        """Sightings of the wanted landmarks (n,) in factors whose other variable is placed.

        What cameras see is left to bundle adjustment.
        """
        parts = []
        for factors in graph.factors:
            kinds = factors.kind.variables
            if isinstance(factors.kind, Projection) or len(kinds) > 2 or not len(factors):
                continue
            for slot in [slot for slot, other in enumerate(kinds) if other is kind]:
                use = wanted[factors.indices[:, slot]]
                if len(kinds) == 2:
                    other = kinds[1 - slot].name
                    use = use & placed[other][factors.indices[:, 1 - slot]]
                    if kinds[0] is kinds[1]:
                        use &= factors.indices[:, 0] != factors.indices[:, 1]
                rows = np.flatnonzero(use)
                if len(rows) == 0:
                    continue
                part = factors.part(rows)
                other_rows = part.indices[:, 1 - slot if len(kinds) == 2 else slot]
                column = graph.variables[kinds[1 - slot if len(kinds) == 2 else slot].name]
                others = values[column.kind.name][other_rows] if len(kinds) == 2 else None
                parts.append(Part(part, slot, others, column.rank[other_rows]))
        return cls(kind, len(graph.variables[kind.name]), parts)

    @property
    def seen(self) -> IndexArray:
        """(n,) number of sightings of each landmark."""
        return sum((np.bincount(part.rows, minlength=self.count) for part in self.parts), np.zeros(self.count, np.intp))

    def of(self, wanted: BoolArray) -> Sightings:
        """Those of some of the landmarks."""
        parts = [part.of(wanted) for part in self.parts]
        return replace(self, parts=[part for part in parts if len(part.factors)])

    def normal(self, places: Array, parts: list[Part] | None = None) -> tuple[Array, Array, Array]:
        """chi2 (n,), H (n, d, d) and g (n, d) of every landmark at its place."""
        space = places.shape[1]
        chi2, gradient = np.zeros(self.count), np.zeros((self.count, space))
        hessian = np.zeros((self.count, space, space))
        with np.errstate(all="ignore"):
            for part in self.parts if parts is None else parts:
                residual, jacobian = part.linearized(places)
                weighted = part.factors.information @ np.concatenate([jacobian, residual[:, :, None]], axis=2)
                product = jacobian.transpose(0, 2, 1) @ weighted
                hessian += summed(part.rows, product[:, :, :-1], self.count)
                gradient += summed(part.rows, product[:, :, -1], self.count)
                chi2 += summed(part.rows, np.vecdot(residual, weighted[:, :, -1]), self.count)
        return chi2, hessian, gradient

    def chi2(self, places: Array) -> Array:
        """chi2 (n,) of every landmark at its place."""
        out = np.zeros(self.count)
        with np.errstate(all="ignore"):
            for part in self.parts:
                f = part.factors
                residual = f.kind.residual(part.joined(places), f.measurements, f.parameters)
                out += summed(part.rows, np.vecdot(residual, np.matvec(f.information, residual)), self.count)
        return out

    def centre(self) -> tuple[Array, Array]:
        """Mean (n, d) of the positions that each landmark is seen from, and root mean square distance (n,) from it."""
        seers = [(part.rows, part.others[:, : self.kind.space]) for part in self.parts if part.others is not None]
        mean, square = np.zeros((self.count, self.kind.space)), np.zeros(self.count)
        total = np.maximum(sum((np.bincount(rows, minlength=self.count) for rows, _ in seers), np.zeros(self.count)), 1)
        for rows, position in seers:
            mean += summed(rows, position / total[rows, None], self.count)
        for rows, position in seers:
            square += summed(rows, np.square(position - mean[rows]).sum(axis=1) / total[rows], self.count)
        return mean, np.sqrt(square)

    def distance(self, places: Array) -> Array:
        """Root mean square distance (n,) of each landmark from what sees it; 0 where nothing does."""
        square, total = np.zeros(self.count), np.zeros(self.count)
        for part in self.parts:
            if part.others is not None:
                away = places[part.rows] - part.others[:, : self.kind.space]
                square += summed(part.rows, np.square(away).sum(axis=1), self.count)
                total += np.bincount(part.rows, minlength=self.count)
        return np.sqrt(square / np.maximum(total, 1.0))
