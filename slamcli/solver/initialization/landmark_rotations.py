"""Rotations of poses that observe points, by a linear relaxation of everything at once.

What is seen of points from several poses tells their rotations, too; where the loops of a graph close only through
points, there is no other way. So the positions join the relaxation: with isotropic weights,

    minimize  sum w || R_j - R_i Z_ij ||_F^2 + sum tau || t_j - t_i - R_i d_ij ||^2 + sum tau || l - t_i - R_i z ||^2

over unconstrained matrices R_i, positions t_i and points l. In space the three rows separate, each with nodes (row of
R_i, coordinate of t_i) and (coordinate of l); in the plane the nodes are (cosine, sine, x, y) and (x, y). Of the
solution only the projected rotations count: ``positions`` follows, as ever. Priors on positions and fixed points do not
take part; they turn the result afterwards.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from slamcli import models
from slamcli.geometry import se3
from slamcli.graph import FactorGraph, Factors, Variables
from slamcli.graph.columns import BoolArray
from slamcli.graph.topology import component_labels
from slamcli.models import FactorKind, VariableKind
from slamcli.models.base import Array
from slamcli.solver import gauge
from slamcli.solver.initialization.block_system import BlockSystem, Terms
from slamcli.solver.initialization.positions import as_points
from slamcli.solver.initialization.rotations import (
    Rotations,
    pose_priors,
    projected,
    rotation_matrices,
    rotation_weight,
)

#: A weight below this share of the largest of its kind is raised to it.
_LEAST_WEIGHT = 1e-9


def observations(graph: FactorGraph, kind: VariableKind) -> list[Factors]:
    """Where points are seen in the frames of poses of a kind."""
    seen = [as_points(f) if f.kind is models.RANGE_BEARING_2D else f for f in graph.factors]
    wanted = (models.POINT_OBSERVATION_2D, models.POINT_OBSERVATION_3D)
    return [f for f in seen if f.kind in wanted and f.kind.variables[0] is kind and len(f)]


def relax(graph: FactorGraph, poses: Variables, points: Variables, held: BoolArray) -> Rotations:
    """Rotations of the poses of one kind by the linear relaxation of poses and points, projected."""
    kind, space = poses.kind, poses.kind.space
    relative = [f for f in graph.factors if f.kind.relative_pose and f.kind.variables[0] is kind]
    seen = observations(graph, kind)
    priors, wanted = pose_priors(graph, kind)
    structure = _structure(poses, points, held, (relative, seen, priors))
    chosen = gauge.choose(structure)[1]
    known = np.where(poses.known[:, None], poses.values, kind.identity)
    pose, point = _nodes(kind, known), _point_nodes(np.where(points.known[:, None], points.values, 0.0), space)
    weights = _floored([rotation_weight(f.information, space) for f in (*relative, *priors)])
    precisions = _floored([_least_precise(f.information[:, :space, :space]) for f in (*relative, *seen, *priors)])
    terms = []
    for factors in relative:
        w, tau = next(weights), next(precisions)
        first = -_scaled(_seen_from(kind, factors.measurements), space, w, tau)
        last = _scaled(np.tile(np.eye(first.shape[-1]), (len(factors), 1, 1)), space, w, tau)
        residual = first @ pose[factors.indices[:, 0]] + last @ pose[factors.indices[:, 1]]
        terms.append(Terms.pairs(first, last, residual))
    for factors in seen:
        tau = np.sqrt(next(precisions))[:, None, None]
        first = -tau * _position_of(_in_pose_frame(factors), space)
        last = tau * np.eye(first.shape[1])
        residual = first @ pose[factors.indices[:, 0]] + last @ point[factors.indices[:, 1]]
        terms.append(Terms.pairs(first, last, residual))
    for factors, value in zip(priors, wanted, strict=True):
        jacobian = _scaled(np.tile(np.eye(pose.shape[1]), (len(factors), 1, 1)), space, next(weights), next(precisions))
        residual = jacobian @ (pose[factors.indices[:, 0]] - _nodes(kind, value))
        terms.append(Terms(jacobian @ jacobian, jacobian @ residual))
    relaxed = pose + BlockSystem(structure, chosen).solve(terms)[kind.name]
    matrices, free = rotation_matrices(kind, known), ~chosen[kind.name]
    rows = relaxed[free, :space].transpose(0, 2, 1)
    matrices[free] = projected(rows if space == 3 else rows * [1.0, -1.0])  # the first row is (cosine, -sine)
    label = component_labels(structure)[: len(poses)]
    adrift = np.isin(label, label[chosen[kind.name] & ~held])
    return Rotations(matrices, np.where(adrift, label, -1), None)


class _Coupling(FactorKind):
    """Which kinds of nodes a term joins; nothing else is asked of it."""

    def __init__(self, *variables: VariableKind) -> None:
        self.name, self.variables, self.components, self.measurement_size = "coupling", variables, ("any",), 0

    def residual(self, x: tuple[Array, ...], measurement: Array, parameter: Array | None) -> Array:
        raise NotImplementedError

    def linearize_into(
        self,
        residual: Array,
        jacobians: tuple[Array, ...],
        x: tuple[Array, ...],
        measurement: Array,
        parameter: Array | None,
    ) -> None:
        raise NotImplementedError


def _structure(
    poses: Variables, points: Variables, held: BoolArray, factors: tuple[list[Factors], list[Factors], list[Factors]]
) -> FactorGraph:
    """Nodes and terms as a graph."""
    pose = replace(poses.kind, components=("r1", "r2", "r3", "t") if poses.kind.space == 3 else ("c", "s", "x", "y"))
    point = replace(points.kind, components=("l",) if points.kind.space == 3 else ("x", "y"))
    variables = {
        pose.name: replace(poses, kind=pose, fixed=held),
        point.name: replace(points, kind=point, fixed=np.zeros(len(points), dtype=bool)),
    }
    kinds = (_Coupling(pose, pose), _Coupling(pose, point), _Coupling(pose))
    columns = [replace(f, kind=kind) for kind, part in zip(kinds, factors, strict=True) for f in part]
    return FactorGraph(variables, columns)


def _nodes(kind: VariableKind, values: Array) -> Array:
    """Nodes (n, 4, k) of poses: in space a column for each row of (R t), in the plane one column."""
    if kind.space == 2:
        return np.stack([np.cos(values[:, 2]), np.sin(values[:, 2]), values[:, 0], values[:, 1]], axis=1)[:, :, None]
    return np.concatenate([rotation_matrices(kind, values).transpose(0, 2, 1), values[:, None, :3]], axis=1)


def _point_nodes(values: Array, space: int) -> Array:
    """Nodes (n, 1, 3) of points in space, (n, 2, 1) in the plane."""
    return values[:, :, None] if space == 2 else values[:, None, :]


def _position_of(local: Array, space: int) -> Array:
    """The map (m, 1 or 2, 4) from the node of a pose to the position of a point (m, d) in its frame."""
    if space == 3:
        return np.concatenate([local, np.ones((len(local), 1))], axis=1)[:, None, :]
    x, y = local.T
    zero, one = np.zeros(len(local)), np.ones(len(local))
    return np.stack([x, -y, one, zero, y, x, zero, one], axis=1).reshape(-1, 2, 4)


def _seen_from(kind: VariableKind, relative: Array) -> Array:
    """The map (m, 4, 4) from the node of a pose to that of another one at a relative pose."""
    space = kind.space
    rotation = rotation_matrices(kind, relative)
    out = np.zeros((len(relative), 4, 4))
    out[:, :space, :space] = rotation if space == 2 else rotation.transpose(0, 2, 1)
    out[:, space:] = _position_of(relative[:, :space], space)
    return out


def _scaled(jacobian: Array, space: int, weight: Array, precision: Array) -> Array:
    """Rows of a Jacobian (m, 4, 4) times the roots of the weights of rotation and position."""
    root = np.empty((len(jacobian), 4, 1))
    root[:, :space], root[:, space:] = np.sqrt(weight)[:, None, None], np.sqrt(precision)[:, None, None]
    return root * jacobian


def _least_precise(information: Array) -> Array:
    """Isotropic weight (m,) with the same sum of variances, d / tr(Omega^-1)."""
    eigenvalues = np.linalg.eigvalsh(information)
    eigenvalues = np.maximum(eigenvalues, np.maximum(_LEAST_WEIGHT * eigenvalues[:, -1:], np.finfo(np.float64).tiny))
    return information.shape[-1] / (1.0 / eigenvalues).sum(axis=1)


def _floored(weights: list[Array]) -> Iterator[Array]:
    """The weights of several columns, those that are (almost) nothing raised."""
    largest = max((float(w.max(initial=0.0)) for w in weights), default=0.0) or 1.0
    return iter([np.maximum(w, _LEAST_WEIGHT * largest) for w in weights])


def _in_pose_frame(factors: Factors) -> Array:
    """Observed points in the frame of the pose, whatever the sensor's offset."""
    if factors.parameters is None:
        return factors.measurements
    return se3.act(factors.parameters, factors.measurements)
