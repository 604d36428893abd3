"""Rotations of all poses at once, by linear relaxation.

Over the relative poses Z_ij with isotropic weights w_ij,

    minimize  sum_ij w_ij || R_j - R_i Z_ij ||_F^2

with the R_i as unconstrained matrices, those of the held poses given. The rows of the matrices separate into
least-squares problems with one matrix; each R_i is then projected onto the nearest rotation (Martinec, Pajdla, "Robust
Rotation and Translation Estimation in Multiview Reconstruction", CVPR 2007; Carlone, Tron, Daniilidis, Dellaert,
"Initialization Techniques for 3D SLAM", ICRA 2015). In the plane one row says it all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli.geometry import so2, so3
from slamcli.graph import FactorGraph, Factors, Variables
from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.graph.topology import component_labels
from slamcli.models import VariableKind
from slamcli.models.base import Array
from slamcli.solver.initialization.block_system import BlockSystem, Nodes, Terms

#: A weight below this share of the largest is raised to it: an edge without information on rotation still connects.
_LEAST_WEIGHT = 1e-9


@dataclass(frozen=True, eq=False)
class Rotations:
    """Rotations of all poses of one kind.

    Attributes
    ----------
    matrices
        (n, d, d), body to world.
    adrift
        (n,) component number where nothing but the pose that the system held by itself orients the component, else -1.
    system
        A system whose pattern may serve again, if there is one.
    """

    matrices: Array
    adrift: IndexArray
    system: BlockSystem | None


def relax(graph: FactorGraph, poses: Variables, held: BoolArray) -> Rotations:
    """Rotations of the poses of one kind by the linear relaxation, projected."""
    kind = poses.kind
    space = kind.space
    relative = [f for f in graph.factors if f.kind.relative_pose and f.kind.variables[0] is kind]
    edges, measured, weight = _stacked(relative, [f.measurements for f in relative], kind, 2)
    priors, at_priors = pose_priors(graph, kind)
    singles, prior_values, prior_weight = _stacked(priors, at_priors, kind, 1)
    largest = max(float(weight.max(initial=0.0)), float(prior_weight.max(initial=0.0))) or 1.0
    weight, prior_weight = (np.maximum(w, _LEAST_WEIGHT * largest) for w in (weight, prior_weight))
    nodes = Nodes.joined(space, poses.rank, held, edges, singles)
    system = nodes.system()
    matrices = rotation_matrices(kind, np.where(poses.known[:, None], poses.values, kind.identity))
    rows = 1 if space == 2 else 3
    start = np.where(nodes.held[:, None, None], matrices[:, :rows].transpose(0, 2, 1), 0.0)  # rows as columns
    z = rotation_matrices(kind, measured)
    residual = start[edges[:, 1]] - z.transpose(0, 2, 1) @ start[edges[:, 0]]
    scaled, gradient = weight[:, None, None] * z, weight[:, None, None] * residual
    eye = np.eye(space)
    hessian = weight[:, None, None] * eye
    between = Terms(hessian, gradient, hessian, -scaled @ residual, -scaled)
    wanted = rotation_matrices(kind, prior_values)[:, :rows].transpose(0, 2, 1)
    prior_gradient = prior_weight[:, None, None] * (start[singles[:, 0]] - wanted)
    relaxed = start + system.solve([between, Terms(prior_weight[:, None, None] * eye, prior_gradient)])[nodes.name]
    free = ~nodes.held
    matrices[free] = projected(relaxed[free].transpose(0, 2, 1))
    label = component_labels(nodes.points)
    return Rotations(matrices, np.where(np.isin(label, label[nodes.held & ~held]), label, -1), system)


def _stacked(
    factors: list[Factors], values: list[Array], kind: VariableKind, slots: int
) -> tuple[IndexArray, Array, Array]:
    """Indices (m, slots), pose values (m, size) and rotation weights (m,) of several columns of factors."""
    return (
        np.concatenate([np.empty((0, slots), dtype=np.intp), *(f.indices for f in factors)]),
        np.concatenate([np.empty((0, kind.size)), *values]),
        np.concatenate([np.empty(0), *(rotation_weight(f.information, kind.space) for f in factors)]),
    )


def pose_priors(graph: FactorGraph, kind: VariableKind) -> tuple[list[Factors], list[Array]]:
    """Priors that determine a pose, and the poses that they want."""
    found, values = [], []
    for factors in graph.factors:
        if factors.kind.variables == (kind,):
            nothing = np.empty((len(factors), kind.size))
            value = factors.kind.place(nothing, factors.measurements, factors.parameters)
            if value is not None:
                found.append(factors)
                values.append(value)
    return found, values


def rotation_matrices(kind: VariableKind, values: Array) -> Array:
    """Rotation matrices (n, d, d) of poses (n, size)."""
    return so2.to_matrix(values[:, 2:]) if kind.space == 2 else so3.to_matrix(values[:, 3:])


def rotation_weight(information: Array, space: int) -> Array:
    """Isotropic weight (m,) with the same mean cost over all axes: the trace of Omega_R over its size."""
    return np.trace(information[:, space:, space:], axis1=1, axis2=2) / (information.shape[-1] - space)


def projected(matrices: Array) -> Array:
    """The rotations nearest to matrices, from their first row in the plane."""
    if matrices.shape[-1] == 2:
        return so2.to_matrix(np.arctan2(-matrices[:, 0, 1], matrices[:, 0, 0])[:, None])
    u, _, v = np.linalg.svd(matrices)
    u[:, :, 2] *= np.where(np.linalg.det(u @ v) < 0.0, -1.0, 1.0)[:, None]
    return u @ v
