"""Linear least squares over nodes of a few numbers each that are joined in pairs: assembled and solved at once.

The unknowns of the chordal start are such nodes: rows of rotation matrices, positions, or both. A graph of the same
structure says which nodes there are, which are held and which pairs occur; the terms bring the numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slamcli import models
from slamcli.graph import FactorGraph, Factors, Variables
from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.models.base import Array
from slamcli.solver import backends, gauge, ordering
from slamcli.solver import pattern as patterns
from slamcli.solver.backends import Factorization, NotPositiveDefiniteError
from slamcli.solver.gauge import Held

#: Damping that makes a singular system factorize, as shares of the largest diagonal entry of its matrix.
_SHIFTS = (0.0, 1e-12, 1e-9, 1e-6)


@dataclass(frozen=True, eq=False)
class Terms:
    """Second-order terms of a sum of squares: of pairs of nodes, or (without ``cross``) of single ones.

    Attributes
    ----------
    hessian
        (m, d, d) J^T W J of the last node of each term.
    gradient
        (m, d, k) J^T W e of the last node at the base point, for k right-hand sides.
    first_hessian, first_gradient, cross
        The same of the first node of a pair, and J_first^T W J_last.
    """

    hessian: Array
    gradient: Array
    first_hessian: Array | None = None
    first_gradient: Array | None = None
    cross: Array | None = None

    @classmethod
    def differences(cls, hessian: Array, gradient: Array) -> Terms:
        """Terms of a residual that depends on the difference of two nodes only."""
        return cls(hessian, gradient, hessian, -gradient, -hessian)

    @classmethod
    def pairs(cls, first: Array, last: Array, residual: Array) -> Terms:
        """Terms of weighted residuals (m, r, k) with the Jacobians (m, r, d) of both nodes."""
        first, last = first.transpose(0, 2, 1), last.transpose(0, 2, 1)
        return cls(
            last @ last.transpose(0, 2, 1),
            last @ residual,
            first @ first.transpose(0, 2, 1),
            first @ residual,
            first @ last.transpose(0, 2, 1),
        )


@dataclass(frozen=True, eq=False)
class Nodes:
    """Nodes of one size with the pairs and priors that tie them, as a graph of points, and which of them are held.

    Attributes
    ----------
    points
        The graph of points; nothing but its structure counts.
    fixed
        (n,) the nodes that were to be held.
    held
        (n,) those, and one of each component that neither holds one nor has a prior.
    """

    points: FactorGraph
    fixed: BoolArray
    held: BoolArray

    @classmethod
    def joined(cls, space: int, order: IndexArray, fixed: BoolArray, pairs: IndexArray, singles: IndexArray) -> Nodes:
        """Nodes in a plane or in space; where a component needs a held one, it is the one of the lowest ``order``."""
        kind, between, prior = (
            (models.XY, models.POINT_DIFFERENCE_2D, models.POINT_PRIOR_2D)
            if space == 2
            else (models.XYZ, models.POINT_DIFFERENCE_3D, models.POINT_PRIOR_3D)
        )
        count = len(order)
        column = Variables(kind, order, np.zeros((count, space)), fixed, np.ones(count, bool), np.zeros(count, np.intp))
        empty = Factors(between, pairs, np.empty((0, space)), np.empty((0, space, space)))
        points = FactorGraph({kind.name: column}, [empty, replace(empty, kind=prior, indices=singles)])
        return cls(points, fixed, gauge.choose(points)[1][kind.name])

    @property
    def name(self) -> str:
        """Name of their kind."""
        return next(iter(self.points.variables))

    def system(self, like: BlockSystem | None = None) -> BlockSystem:
        """Their system, or one that is there already and has the same pattern."""
        held = {self.name: self.held}
        return like if like is not None and like.fits(self.points, held) else BlockSystem(self.points, held)


class BlockSystem:
    """Normal equations over the nodes that are not held; pattern, order and symbolic factorization are made once.

    Parameters
    ----------
    structure
        Nodes as variables, and one column of factors for each of the terms to come.
    held
        Which nodes are held.
    """

    def __init__(self, structure: FactorGraph, held: Held) -> None:
        self._structure, self._held = structure, held
        self.pattern, targets = patterns.build(structure, held)
        self._targets = [slots for slots in targets if isinstance(slots, list)]  # all of them
        permutation = ordering.expand(self.pattern, ordering.order("amd", self.pattern))
        self._factorization: Factorization = backends.make("cholmod", self.pattern, permutation)

    def fits(self, structure: FactorGraph, held: Held) -> bool:
        """Whether the system of a structure with the same kinds has the same pattern."""
        return all(np.array_equal(held[name], self._held[name]) for name in held) and all(
            np.array_equal(a.indices, b.indices)
            for a, b in zip(structure.factors, self._structure.factors, strict=True)
        )

    def solve(self, terms: list[Terms]) -> dict[str, Array]:
        """The steps (n, d, k) from the base point to the minimum by kind of node, zero for held nodes.

        Directions that the terms do not determine stay at the base point.
        """
        stored, dimension, sides = self.pattern.stored, self.pattern.dimension, terms[0].gradient.shape[-1]
        total, right = np.zeros(stored + dimension + 1), np.zeros((sides, dimension + 1))
        for term, slots in zip(terms, self._targets, strict=True):
            last = term.hessian.shape[-1]
            _add(total, slots[-1][:, :, :last], term.hessian)
            _add_sides(right, slots[-1][:, :, -1] - stored, term.gradient)
            if term.cross is not None and term.first_hessian is not None and term.first_gradient is not None:
                first = term.first_hessian.shape[-1]
                _add(total, slots[0][:, :, :first], term.first_hessian)
                _add(total, slots[0][:, :, first : first + last], term.cross)
                _add_sides(right, slots[0][:, :, -1] - stored, term.first_gradient)
        self._factorize(total[:stored])
        solution = np.stack([self._factorization.solve(-side[:dimension]) for side in right], axis=1)
        steps, start = {}, 0
        for name, column in self._structure.variables.items():
            free, size = ~self._held[name], column.kind.dimension
            stop = start + int(np.count_nonzero(free)) * size
            steps[name] = np.zeros((len(column), size, sides))
            steps[name][free] = solution[start:stop].reshape(-1, size, sides)
            start = stop
        return steps

    def responses(self, rows: IndexArray, sides: int) -> Array:
        """Solutions (n, d, sides) for unit forces on the first components of some nodes, with the factor at hand.

        There is one kind of node. Held nodes do not respond.
        """
        ((name, column),) = self._structure.variables.items()
        free, size = ~self._held[name], column.kind.dimension
        first = (np.cumsum(free) - 1)[rows[free[rows]]] * size
        out = np.zeros((len(column), size, sides))
        for side in range(sides):
            force = np.zeros(self.pattern.dimension)
            force[first + side] = 1.0
            out[free, :, side] = self._factorization.solve(force).reshape(-1, size)
        return out

    def _factorize(self, hessian: Array) -> None:
        largest = float(hessian[self.pattern.diagonal].max(initial=0.0)) or 1.0
        for shift in _SHIFTS:
            damped = hessian.copy()
            damped[self.pattern.diagonal] += shift * largest
            try:
                return self._factorization.factorize(damped)
            except NotPositiveDefiniteError:
                if shift == _SHIFTS[-1]:
                    raise


def _add(total: Array, targets: IndexArray, values: Array) -> None:
    np.add.at(total, targets.ravel(), values.ravel())


def _add_sides(right: Array, targets: IndexArray, gradient: Array) -> None:
    for side, total in enumerate(right):
        _add(total, targets, gradient[:, :, side])
