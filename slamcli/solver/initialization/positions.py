"""Positions of poses and points for given rotations: one linear least-squares problem.

With the rotations held, every residual but those of ranges and bearings is affine in the positions: e = A (p_j - p_i)
+ b for two variables, e = A p_i + b for one. Their minimum under the full information matrices is one linear system. A
range with a bearing counts as the point where it ends; points seen by bearings or ranges alone are placed afterwards
(see ``landmarks``).

A part of the graph whose orientation shows only in positions (priors on positions, fixed points) is first solved by
itself and turned onto them (Kabsch, "A solution for the best rotation to relate two sets of vectors", 1976).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slamcli import models
from slamcli.geometry import so2, so3
from slamcli.graph import FactorGraph, Factors, Variables
from slamcli.graph.columns import BoolArray, IndexArray, Values
from slamcli.graph.topology import component_labels
from slamcli.models.base import Array
from slamcli.solver.gauge import Held
from slamcli.solver.initialization.block_system import Nodes, Terms
from slamcli.solver.initialization.rotations import Rotations

_NOT_AFFINE = (models.BEARING_2D, models.RANGE_2D)


def solve(
    graph: FactorGraph, space: int, held: Held, rotations: Rotations | None
) -> tuple[Values, dict[str, BoolArray]]:
    """Values of the variables of the plane or of space at the best positions, and which of them are placed."""
    layout = _Layout.of(graph, space, held)
    matrices = np.empty((0, space, space)) if rotations is None else rotations.matrices
    if rotations is not None and (rotations.adrift >= 0).any():
        matrices = _turned(layout, rotations)
    positions, nodes = _minimum(layout, matrices, layout.factors, layout.fixed, rotations)
    values, placed = {}, {}
    reached = _reached(layout, nodes)
    for column in layout.columns:
        rows = layout.rows(column)
        moving, value = ~(held[column.kind.name] & column.known), column.values.copy()
        if column.kind.is_pose:
            value[moving] = _with(matrices[moving], positions[rows][moving])
        else:
            moving = moving & reached[rows]
            value[moving] = positions[rows][moving]
        values[column.kind.name], placed[column.kind.name] = value, reached[rows] | column.kind.is_pose
    return values, placed


@dataclass(frozen=True, eq=False)
class _Layout:
    """Nodes of one space: its poses, then its points.

    Attributes
    ----------
    columns
        Of poses and of points; either may be missing.
    factors
        Those that are affine in positions.
    fixed, known
        (n,) nodes that are held, and those with a value.
    base
        (n, d) positions where known, else those of the origin.
    """

    space: int
    columns: list[Variables]
    factors: list[Factors]
    fixed: BoolArray
    known: BoolArray
    base: Array

    @classmethod
    def of(cls, graph: FactorGraph, space: int, held: Held) -> _Layout:
        columns = sorted(
            (c for c in graph.variables.values() if c.kind.space == space), key=lambda column: not column.kind.is_pose
        )
        factors = [
            as_points(f) if f.kind is models.RANGE_BEARING_2D else f
            for f in graph.factors
            if f.kind.variables[0].space == space and f.kind not in _NOT_AFFINE
        ]
        known = np.concatenate([column.known for column in columns])
        base = np.concatenate([column.values[:, :space] for column in columns])
        fixed = np.concatenate([held[column.kind.name] for column in columns])
        return cls(space, columns, factors, fixed, known, np.where(known[:, None], base, 0.0))

    @property
    def poses(self) -> int:
        """How many nodes are poses: the first ones."""
        return sum(len(column) for column in self.columns if column.kind.is_pose)

    @property
    def order(self) -> IndexArray:
        """(n,) by which the node to hold is chosen: poses by id, then points by id."""
        return np.concatenate([column.rank + (0 if column.kind.is_pose else self.poses) for column in self.columns])

    def rows(self, column: Variables) -> slice:
        """The nodes of a column."""
        start = 0 if column.kind.is_pose else self.poses
        return slice(start, start + len(column))

    def nodes(self, factors: Factors) -> IndexArray:
        """(m, slots) nodes that factors join."""
        return factors.indices + np.array([0 if k.is_pose else self.poses for k in factors.kind.variables])


def _minimum(
    layout: _Layout, matrices: Array, factors: list[Factors], fixed: BoolArray, rotations: Rotations | None
) -> tuple[Array, Nodes]:
    """Positions (n, d) of all nodes at the minimum over some of the factors, and the nodes with what was held."""
    pairs = [f for f in factors if len(f.kind.variables) == 2]
    singles = [f for f in factors if len(f.kind.variables) == 1]
    none = np.empty((0, 2), dtype=np.intp)
    joined = [np.concatenate([none[:, :k], *(layout.nodes(f) for f in part)]) for k, part in ((2, pairs), (1, singles))]
    nodes = Nodes.joined(layout.space, layout.order, fixed, *joined)
    system = nodes.system(None if rotations is None else rotations.system)
    anchor = layout.base[nodes.held][:1].sum(axis=0)  # away from there numbers would be large for nothing
    start = np.where(nodes.held[:, None], layout.base, anchor)
    state = {
        column.kind.name: _with(matrices, start[layout.rows(column)])
        if column.kind.is_pose
        else start[layout.rows(column)]
        for column in layout.columns
    }
    terms = []
    for part in (pairs, singles):
        blocks = [_affine(f, state, matrices) for f in part]
        hessian = np.concatenate([np.empty((0, layout.space, layout.space)), *(h for h, _ in blocks)])
        gradient = np.concatenate([np.empty((0, layout.space, 1)), *(g for _, g in blocks)])
        terms.append(Terms.differences(hessian, gradient) if part is pairs else Terms(hessian, gradient))
    return start + system.solve(terms)[nodes.name][:, :, 0], nodes


def _affine(factors: Factors, state: Values, matrices: Array) -> tuple[Array, Array]:
    """A^T Omega A (m, d, d) and A^T Omega e (m, d, 1) at a state, for e = A (position of the last variable) + ..."""
    residual, jacobians = factors.linearize(state)
    last = factors.kind.variables[-1]
    jacobian = jacobians[-1][:, :, : last.space]
    if last.is_pose:  # its positions move in the frame of the pose
        jacobian = jacobian @ matrices[factors.indices[:, -1]].transpose(0, 2, 1)
    weighted = factors.information @ jacobian
    return jacobian.transpose(0, 2, 1) @ weighted, weighted.transpose(0, 2, 1) @ residual[:, :, None]


def _reached(layout: _Layout, nodes: Nodes) -> BoolArray:
    """Which nodes hang together with a pose, with something held, or with a prior."""
    label = component_labels(nodes.points)
    firm = nodes.fixed | (nodes.held & layout.known & np.isin(label, label[nodes.points.factors[0].indices.ravel()]))
    firm[: layout.poses] = True
    firm[nodes.points.factors[1].indices[:, 0]] = True
    return np.isin(label, label[firm])


def _with(matrices: Array, positions: Array) -> Array:
    """Values of poses (n, size) from rotation matrices and positions."""
    if matrices.shape[-1] == 2:
        return np.column_stack([positions, so2.wrap(np.arctan2(matrices[:, 1, 0], matrices[:, 0, 0]))])
    return np.column_stack([positions, so3.from_matrix(matrices)])


def as_points(factors: Factors) -> Factors:
    """Ranges with bearings as observed points, with the information carried over to first order."""
    distance, bearing = factors.measurements[:, 0], factors.measurements[:, 1]
    cosine, sine = np.cos(bearing), np.sin(bearing)
    divisor = np.where(distance == 0.0, 1.0, distance)
    polar = np.stack([cosine, sine, -sine / divisor, cosine / divisor], axis=1).reshape(-1, 2, 2)
    return replace(
        factors,
        kind=models.POINT_OBSERVATION_2D,
        measurements=distance[:, None] * so2.pack(cosine, sine),
        information=polar.transpose(0, 2, 1) @ factors.information @ polar,
    )


def _turned(layout: _Layout, rotations: Rotations) -> Array:
    """The rotations, with what drifts turned to where its positions are known absolutely."""
    singles = [f for f in layout.factors if len(f.kind.variables) == 1]
    node = np.concatenate([np.flatnonzero(layout.fixed), *(layout.nodes(f)[:, 0] for f in singles)])
    matrices = rotations.matrices.copy()
    if len(node) < 2:
        return matrices
    wanted = np.concatenate([layout.base[layout.fixed], *(_wanted(f, layout.space) for f in singles)])
    free = [f for f in layout.factors if len(f.kind.variables) == 2]
    alone, nodes = _minimum(layout, matrices, free, np.zeros_like(layout.fixed), None)
    label = component_labels(nodes.points)
    for component in np.unique(rotations.adrift[rotations.adrift >= 0]):
        members = np.flatnonzero(rotations.adrift == component)
        use = np.isin(label[node], label[members])
        local, world = alone[node[use]], wanted[use]
        if len(local) < 2:
            continue
        u, _, v = np.linalg.svd((world - world.mean(axis=0)).T @ (local - local.mean(axis=0)))
        u[:, -1] *= np.sign(np.linalg.det(u @ v))
        matrices[members] = (u @ v) @ matrices[members]
    return matrices


def _wanted(factors: Factors, space: int) -> Array:
    """Positions that priors want."""
    return factors.measurements[:, :space]
