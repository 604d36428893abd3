"""The isotropic chordal objective of a graph of relative poses, as a graph that the solver minimizes.

Rosen, Carlone, Bandeira, Leonard, "SE-Sync: A certifiably correct algorithm for synchronization over the special
Euclidean group", IJRR 2019, minimize over the poses (R_i, t_i)

    sum_ij  kappa_ij || R_j - R_i R_ij ||_F^2 + tau_ij || t_j - t_i - R_i t_ij ||^2

the maximum-likelihood estimate under isotropic Langevin noise on the rotations. Their precisions for an edge with
the information matrix Omega, whose blocks of translation and rotation are Omega_t and Omega_R, are

    plane   tau = 2 / tr(Omega_t^-1),   kappa = Omega_R
    space   tau = 3 / tr(Omega_t^-1),   kappa = 3 / (2 tr(Omega_R^-1))

Since || R - I ||_F^2 = 8 |vec(q)|^2 in space and 2 (2 sin(theta/2))^2 in the plane, this is chi2 of a graph with the
information blkdiag(tau I, 8 kappa I) in space, and blkdiag(tau I, 2 kappa) with the chord as residual in the plane.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slamcli import models
from slamcli.errors import InputError
from slamcli.graph import FactorGraph, Factors
from slamcli.graph.columns import BoolArray
from slamcli.models.base import Array

#: For each kind of relative pose the kind of the transformed factors.
_KINDS = {
    models.RELATIVE_POSE_2D: models.RELATIVE_POSE_2D_CHORDAL,
    models.RELATIVE_POSE_3D: models.RELATIVE_POSE_3D,
}
#: || R - I ||_F^2 over the squared rotation part of those kinds' residuals, in the plane and in space.
_CHORD = {2: 2.0, 3: 8.0}


@dataclass(frozen=True, eq=False)
class Precisions:
    """Isotropic precisions of a column of relative poses.

    Attributes
    ----------
    tau
        (m,) of the translations, 1/m^2.
    kappa
        (m,) of the rotations.
    """

    tau: Array
    kappa: Array

    @classmethod
    def of_file(cls, factors: Factors) -> Precisions:
        """Those that SE-Sync gives edges with the information matrices of a file; 0 where a block is singular."""
        space = factors.kind.variables[0].space
        information = factors.information
        tau = _harmonic_mean(information[:, :space, :space])
        if space == 2:
            return cls(tau, information[:, 2, 2].copy())
        return cls(tau, 0.5 * _harmonic_mean(information[:, 3:, 3:]))

    @classmethod
    def of_transformed(cls, factors: Factors) -> Precisions:
        """Those of factors that ``transform`` has made."""
        last = factors.information[:, -1, -1]
        return cls(factors.information[:, 0, 0], last / _CHORD[factors.kind.variables[0].space])


def undefined(graph: FactorGraph) -> str | None:
    """Why there is no such objective for a graph, or None where there is one."""
    if not graph.factors:
        return "the graph has no edges"
    if sum(bool(column.kind.is_pose and len(column)) for column in graph.variables.values()) > 1:
        return "the graph has both planar and spatial poses"
    others: dict[str, int] = {}
    for factors in graph.factors:
        if factors.kind not in _KINDS:
            name = factors.tag or factors.kind.name
            others[name] = others.get(name, 0) + len(factors)
    if others:
        counted = ", ".join(f"{number} {tag}" for tag, number in sorted(others.items()))
        return f"it is one of relative poses only, and the graph has other edges: {counted}"
    if graph.landmarks:
        return f"it is one of relative poses only, and the graph has {graph.landmarks} landmarks"
    for factors in graph.factors:
        precisions = Precisions.of_file(factors)
        bad = np.flatnonzero(~(_usable(precisions.tau) & _usable(precisions.kappa)))
        if len(bad):
            ids = " ".join(str(i) for i in factors.variable_ids(graph.variables)[bad[0]])
            return (
                f"{len(bad)} of the {factors.tag} edges have no isotropic precision that is finite and not negative; "
                f"the first: {factors.tag} {ids}"
            )
    return None


def transform(graph: FactorGraph) -> FactorGraph:
    """The graph whose chi2 is the isotropic chordal objective; variables, tags and lines stay as they are.

    Raises
    ------
    InputError
        If the objective is not defined for the graph.
    """
    reason = undefined(graph)
    if reason is not None:
        raise InputError("the isotropic chordal objective is not defined for this graph", (f"  {reason}",))
    return replace(graph, factors=[_transformed(factors) for factors in graph.factors])


def _transformed(factors: Factors) -> Factors:
    kind = _KINDS[factors.kind]
    precisions = Precisions.of_file(factors)
    space = kind.variables[0].space
    information = np.zeros((len(factors), kind.dimension, kind.dimension))
    for k in range(kind.dimension):
        information[:, k, k] = precisions.tau if k < space else _CHORD[space] * precisions.kappa
    return replace(factors, kind=kind, information=information)


def _harmonic_mean(blocks: Array) -> Array:
    """Size over trace of the inverse, d / tr(B^-1) = d det(B) / tr(adj(B)), of blocks (m, d, d); 0 where B = 0."""
    with np.errstate(all="ignore"):
        if blocks.shape[-1] == 2:
            minors = blocks[:, 0, 0] + blocks[:, 1, 1]
            determinant = blocks[:, 0, 0] * blocks[:, 1, 1] - blocks[:, 0, 1] * blocks[:, 1, 0]
        else:  # the cross products of rows are the columns of det(B) B^-1
            a, b, c = (np.cross(blocks[:, i], blocks[:, j]) for i, j in ((1, 2), (2, 0), (0, 1)))
            minors = a[:, 0] + b[:, 1] + c[:, 2]
            determinant = np.vecdot(blocks[:, 0], a)
        return np.where(minors == 0.0, 0.0, blocks.shape[-1] * determinant / np.where(minors == 0.0, 1.0, minors))


def _usable(weight: Array) -> BoolArray:
    return np.isfinite(weight) & (weight >= 0.0)
