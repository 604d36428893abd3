"""From pieces on one or two variables to factors with measurement and information.

A relative pose with error e at the estimate has the Jacobian A(e) J_0, where J_0 is the one without error. Its
contributions to H and the gradient are J_0^T X J_0 and J_0^T X r if

    A(e)^-1 e = r,    Omega = A^-T X A^-1,

so that both are exactly those of the piece. In the plane, with e = (e_t, e_theta), A = diag(R(e_theta), 1); in space,
with e_R = v the vector part of the quaternion (v, w), A = diag(R_E, w I + [v]x), and since [v]x v = 0

    e_t = R_E r_t,    e_theta = r_theta    or    v = r_R / sqrt(1 + r_R^2).

All other kinds are linear in the measurement: A = I, e = r.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

import numpy as np

from slamcli.formats import DIALECTS
from slamcli.geometry import se2, se3, so3
from slamcli.graph import Factors
from slamcli.models import SE2, SE3, FactorKind, VariableKind
from slamcli.models.base import Array
from slamcli.solver.marginalization.links import kind_of, measure, no_offset
from slamcli.solver.marginalization.nodes import Nodes
from slamcli.solver.marginalization.quadratics import Piece

#: Information below this share of the largest of its kind is rounding: the factor is left out.
_NOTHING = 1e-14
#: Radians: what next to no information pulls further than this is no rotation that a measurement could have.
_LARGEST_TURN = 1.0


def factors_of(nodes: Nodes, pieces: Iterable[Piece], dialect: str) -> list[Factors]:
    """Columns of factors that say what the pieces say; pieces on the same variables become one factor.

    Parameters
    ----------
    nodes
        Of the graph.
    pieces
        On one or two variables each.
    dialect
        Of which the tags are.
    """
    sums: dict[tuple[int, ...], list[Array]] = {}
    for piece in pieces:
        if piece.nodes in sums:
            sums[piece.nodes][0] = sums[piece.nodes][0] + piece.information
            sums[piece.nodes][1] = sums[piece.nodes][1] + piece.gradient
        else:
            sums[piece.nodes] = [piece.information, piece.gradient]
    by_kind: dict[tuple[int, ...], list[tuple[tuple[int, ...], Array, Array]]] = defaultdict(list)
    for members, (information, gradient) in sorted(sums.items(), key=lambda item: item[0]):
        ordered, block, slope = _last(nodes, members, information, gradient)
        by_kind[tuple(int(nodes.kind[node]) for node in ordered)].append((ordered, block, slope))
    columns = []
    for kinds, rows in sorted(by_kind.items()):
        kind = kind_of([nodes.kinds[k] for k in kinds])
        assert kind is not None
        column = _column(nodes, kind, *zip(*rows, strict=True), dialect=dialect)
        if len(column):
            columns.append(column)
    return columns


def _last(
    nodes: Nodes, members: tuple[int, ...], information: Array, gradient: Array
) -> tuple[tuple[int, ...], Array, Array]:
    """The variables in the order of the factor, poses before points, and the diagonal block of the last one.

    What is relative is known from that block alone.
    """
    size = int(nodes.dimension[members[0]])
    if len(members) == 2 and not nodes.is_pose[members[0]] and nodes.is_pose[members[1]]:
        return (members[1], members[0]), information[:size, :size], gradient[:size]
    start = size if len(members) == 2 else 0
    return members, information[start:, start:], gradient[start:]


def _column(
    nodes: Nodes,
    kind: FactorKind,
    members: tuple[tuple[int, ...], ...],
    blocks: tuple[Array, ...],
    slopes: tuple[Array, ...],
    *,
    dialect: str,
) -> Factors:
    """Factors of one kind, from the blocks and gradients of their last variables."""
    joined, information, gradient = np.array(members), np.array(blocks), np.array(slopes)
    size = np.trace(information, axis1=1, axis2=2)
    kept = size > _NOTHING * size.max(initial=0.0)
    joined, information, gradient = joined[kept], information[kept], gradient[kept]
    x = tuple(nodes.values(joined[:, slot]) for slot in range(joined.shape[1]))
    there = measure(kind, x)
    last = kind.linearize(x, there, no_offset(kind, len(there)))[1][-1]
    back = np.linalg.inv(last)
    information = back.transpose(0, 2, 1) @ information @ back
    residual = _solve_each(information, np.matvec(back.transpose(0, 2, 1), gradient))
    measurement, across = _displaced(kind, there, residual)
    information = across.transpose(0, 2, 1) @ information @ across
    tag = DIALECTS[dialect].edge_tag(kind) or DIALECTS["g2o"].edge_tag(kind)
    assert tag is not None
    return Factors(
        kind=kind,
        indices=np.stack([nodes.rows(joined[:, slot]) for slot in range(joined.shape[1])], axis=1),
        measurements=measurement,
        information=_semidefinite(information),
        parameters=no_offset(kind, len(there)),
        tag=tag.tag,
        lines=np.zeros(len(joined), dtype=np.intp),
    )


def _solve_each(information: Array, rhs: Array) -> Array:
    """Solutions r of X r = y, (m, d), without the directions that X says nothing of."""
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(information, axis1=1, axis2=2), np.finfo(float).tiny))
    eigenvalues, vectors = np.linalg.eigh(scale[:, :, None] * information * scale[:, None, :])
    inverse = np.where(eigenvalues > 1e-12 * eigenvalues[:, -1:], 1.0 / np.maximum(eigenvalues, 1e-300), 0.0)
    return scale * np.matvec(vectors, inverse * np.matvec(vectors.transpose(0, 2, 1), scale * rhs))


def _displaced(kind: FactorKind, there: Array, residual: Array) -> tuple[Array, Array]:
    """The measurements with which A^-1 e = r, and A^-1, (m, d, d)."""
    pose = _pose_kind(kind)
    if pose is not None:
        turn = np.sqrt(np.square(residual[:, pose.space :]).sum(axis=1))
        residual = residual * np.minimum(1.0, _LARGEST_TURN / np.maximum(turn, _LARGEST_TURN))[:, None]
    if pose is SE2:
        turned = residual.copy()
        turned[:, :2] = se2.act(_turn_2d(residual[:, 2]), residual[:, :2])
        error = turned
        across = se2.to_matrix(_turn_2d(-residual[:, 2]))
        return se2.normalize(se2.compose(there, se2.inverse(error))), across
    if pose is SE3:
        length = np.sqrt(1.0 + np.square(residual[:, 3:]).sum(axis=1))
        rotation = np.concatenate([residual[:, 3:], np.ones((len(residual), 1))], axis=1) / length[:, None]
        error = np.concatenate([so3.act(rotation, residual[:, :3]), rotation], axis=1)
        across = np.zeros((len(residual), 6, 6))
        across[:, :3, :3] = so3.to_matrix(so3.inverse(rotation))
        across[:, 3:, 3:] = np.linalg.inv(so3.skew(rotation[:, :3]) + rotation[:, 3, None, None] * np.eye(3))
        return kind.normalize(se3.compose(there, se3.inverse(error))), across
    return there - residual, np.broadcast_to(np.eye(kind.dimension), (len(there), kind.dimension, kind.dimension))


def _pose_kind(kind: FactorKind) -> VariableKind | None:
    """The group that the measurement is an element of, None for points."""
    return kind.variables[0] if kind.dimension == kind.variables[0].dimension and kind.variables[-1].is_pose else None


def _turn_2d(angle: Array) -> Array:
    """Poses at the origin with these headings."""
    return np.stack([np.zeros_like(angle), np.zeros_like(angle), angle], axis=1)


def _semidefinite(information: Array) -> Array:
    """Symmetric to the last bit, and without the negative eigenvalues that rounding makes."""
    information = 0.5 * (information + information.transpose(0, 2, 1))
    eigenvalues, vectors = np.linalg.eigh(information)
    bad = eigenvalues[:, 0] < 0.0
    if bad.any():
        fixed = (vectors[bad] * np.maximum(eigenvalues[bad], 0.0)[:, None, :]) @ vectors[bad].transpose(0, 2, 1)
        information = information.copy()
        information[bad] = 0.5 * (fixed + fixed.transpose(0, 2, 1))
    return information
