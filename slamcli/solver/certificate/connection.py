"""The quadratic form of the isotropic chordal objective: cost = tr(X M X^T).

With X_i = [R_i | t_i], T_ij = [[R_ij, t_ij], [0, 1]] and W_ij = diag(kappa_ij, ..., kappa_ij, tau_ij),

    cost = sum_ij tr((X_j - X_i T_ij) W_ij (X_j - X_i T_ij)^T) = tr(X M X^T),   X = [X_1 ... X_n]

where an edge adds to the symmetric connection matrix M the blocks M_ii += T W T^T, M_jj += W, M_ij -= T W and
M_ji -= W T^T (Rosen, Carlone, Bandeira, Leonard 2019, section 4; here rotation and translation of a pose stand
together). X has d rows; on the higher steps of the Riemannian staircase it has more, and everything here allows for it.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from slamcli.geometry import so2, so3
from slamcli.graph import FactorGraph
from slamcli.graph.columns import IndexArray, Values
from slamcli.graph.topology import component_labels
from slamcli.models import VariableKind
from slamcli.models.base import Array, dot
from slamcli.solver import gauge
from slamcli.solver.certificate.isotropic import Precisions


class Connection:
    """The objective of a transformed graph as a quadratic form on X, (n, r, d + 1).

    Edges from a pose to itself are constant and left out of it.

    Parameters
    ----------
    graph
        What ``isotropic.transform`` returned.

    Attributes
    ----------
    kind
        SE2 or SE3.
    count, space
        Number n of poses, and d.
    constant
        What the edges from a pose to itself add to the cost.
    first, second
        (m,) poses i and j of each edge.
    transforms
        (m, d + 1, d + 1) T_ij.
    weights
        (m, 1, d + 1) diagonal of W_ij.
    component
        (n,) number of each pose's component.
    pins
        (c,) of each component the pose that stays at its place where the freedom of translation has to go.
    """

    def __init__(self, graph: FactorGraph) -> None:
        column = next(column for column in graph.variables.values() if len(column))
        self.kind: VariableKind = column.kind
        self.count, self.space = len(column), column.kind.space
        d = self.space
        ends = np.concatenate([factors.indices for factors in graph.factors])
        precisions = [Precisions.of_transformed(factors) for factors in graph.factors]
        proper = ends[:, 0] != ends[:, 1]
        self.first, self.second = ends[proper, 0], ends[proper, 1]
        own = [f.part(np.flatnonzero(f.indices[:, 0] == f.indices[:, 1])) for f in graph.factors]
        self.constant = float(sum(factors.chi2(graph.values).sum() for factors in own))
        measured = np.concatenate([factors.measurements for factors in graph.factors])[proper]
        self.transforms = np.zeros((len(measured), d + 1, d + 1))
        self.transforms[:, :d] = matrices(self.kind, measured)
        self.transforms[:, d, d] = 1.0
        self.weights = np.empty((len(measured), 1, d + 1))
        self.weights[:, 0, :d] = np.concatenate([p.kappa for p in precisions])[proper, None]
        self.weights[:, 0, d] = np.concatenate([p.tau for p in precisions])[proper]
        self.component: IndexArray = component_labels(graph)
        held = np.flatnonzero(gauge.choose(graph)[1][self.kind.name])
        self.pins = held[np.unique(self.component[held], return_index=True)[1]]
        self._places: dict[int, tuple[IndexArray, IndexArray]] = {}

    @cached_property
    def scaled(self) -> Array:
        """(m, d + 1, d + 1) T W."""
        return self.transforms * self.weights

    def product(self, x: Array) -> Array:
        """X M, (n, r, d + 1); half the Euclidean gradient of the cost."""
        residual = x[self.second] - x[self.first] @ self.transforms
        at_second = residual * self.weights
        at_first = residual @ self.scaled.transpose(0, 2, 1)
        first, second = self._flat(x.shape[1])
        out = np.zeros(x.size)
        np.add.at(out, second, at_second.ravel())
        np.subtract.at(out, first, at_first.ravel())
        return out.reshape(x.shape)

    def cost(self, x: Array) -> float:
        """tr(X M X^T), as a sum of squares."""
        residual = x[self.second] - x[self.first] @ self.transforms
        return dot(residual * self.weights, residual)

    def _flat(self, rows: int) -> tuple[IndexArray, IndexArray]:
        """Where the entries of both poses of each edge are in an array (n, rows, d + 1), flattened."""
        if rows not in self._places:
            width = rows * (self.space + 1)
            within = np.arange(width)
            first, second = ((poses[:, None] * width + within).ravel() for poses in (self.first, self.second))
            self._places[rows] = first, second
        return self._places[rows]


def matrices(kind: VariableKind, values: Array) -> Array:
    """[R | t], (n, d, d + 1), of poses (n, kind.size)."""
    d = kind.space
    out = np.empty((len(values), d, d + 1))
    out[:, :, :d] = so2.to_matrix(values[:, 2:]) if d == 2 else so3.to_matrix(values[:, 3:])
    out[:, :, d] = values[:, :d]
    return out


def poses(kind: VariableKind, x: Array) -> Array:
    """Poses (n, kind.size) of [R | t], (n, d, d + 1)."""
    d = kind.space
    rotation = so2.from_matrix(x[:, :, :d]) if d == 2 else so3.from_matrix(x[:, :, :d])
    return kind.normalize(np.concatenate([x[:, :, d], rotation], axis=1))


def state(connection: Connection, values: Values) -> Array:
    """X of a graph's values."""
    return matrices(connection.kind, values[connection.kind.name])
