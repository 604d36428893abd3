"""Chordal start: rotations from a linear relaxation, then positions from the linear problem that is left.

Carlone, Tron, Daniilidis, Dellaert, "Initialization Techniques for 3D SLAM", ICRA 2015.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamcli.graph import FactorGraph, Variables
from slamcli.graph.columns import BoolArray, Values
from slamcli.models.information import indefinite
from slamcli.solver.gauge import Held
from slamcli.solver.initialization import landmark_rotations, positions, rotations
from slamcli.solver.initialization.rotations import Rotations


def relax(graph: FactorGraph, held: Held, *, equal: bool = False) -> tuple[Values, dict[str, BoolArray], str]:
    """Chordal start of a graph.

    Parameters
    ----------
    graph
        Of its values those of the held variables count, and that of one pose of each component which nothing orients.
    held
        The gauge: these keep their values.
    equal
        Whether all edges weigh the same in the relaxation of the rotations, whatever their information. Positions are
        solved with the information in either case.

    Returns
    -------
    values
        The start; landmarks that are not placed keep what they have.
    placed
        Which variables are placed, by kind.
    words
        What was done, for the summary.

    Raises
    ------
    NotPositiveDefiniteError
        If a linear system cannot be solved even when damped.
    """
    graph, repaired = _without_negative_information(graph)
    weighted = equally_weighted(graph) if equal else graph
    values = dict(graph.values)
    placed = {name: np.zeros(len(column), dtype=bool) for name, column in graph.variables.items()}
    for space in (2, 3):
        columns = [column for column in graph.variables.values() if column.kind.space == space]
        poses = next((column for column in columns if column.kind.is_pose), None)
        points = next((column for column in columns if not column.kind.is_pose), None)
        turned = None if poses is None else _rotations(weighted, poses, points, held[poses.kind.name])
        if columns:
            found, where = positions.solve(graph, space, held, turned)
            values.update(found)
            placed.update(where)
    words = "chordal relaxation, unit weights" if equal else "chordal relaxation"
    if repaired:
        words += f"; of {repaired} indefinite information matrices the positive part"
    return values, placed, words


def equally_weighted(graph: FactorGraph) -> FactorGraph:
    """The graph with one isotropic weight on the rotation of all relative poses of a kind and of its priors.

    It is the mean of the weights, so that their ratio to those of positions stays; edges without information on
    rotation keep none. The graph itself where all weights are the same (to 1e-9).
    """
    out, changed = list(graph.factors), False
    for kind in (column.kind for column in graph.variables.values() if column.kind.is_pose):
        priors = rotations.pose_priors(graph, kind)[0]
        turning = [
            k
            for k, f in enumerate(graph.factors)
            if (f.kind.relative_pose and f.kind.variables[0] is kind) or any(f is prior for prior in priors)
        ]
        weights = [rotations.rotation_weight(graph.factors[k].information, kind.space) for k in turning]
        informed = np.concatenate([np.empty(0), *(w[w > 0.0] for w in weights)])
        if len(informed) == 0 or np.ptp(informed) <= 1e-9 * informed.max():
            continue
        changed = True
        for k, weight in zip(turning, weights, strict=True):
            information = graph.factors[k].information.copy()
            block = np.where(weight > 0.0, informed.mean(), 0.0)[:, None, None] * np.eye(information.shape[-1])
            information[:, kind.space :, kind.space :] = block[:, kind.space :, kind.space :]
            out[k] = replace(graph.factors[k], information=information)
    return replace(graph, factors=out) if changed else graph


def _rotations(graph: FactorGraph, poses: Variables, points: Variables | None, held: BoolArray) -> Rotations:
    """Rotations from relative poses alone where they are all there is, else from what is seen of points as well."""
    if points is not None and landmark_rotations.observations(graph, poses.kind):
        return landmark_rotations.relax(graph, poses, points, held)
    return rotations.relax(graph, poses, held)


def _without_negative_information(graph: FactorGraph) -> tuple[FactorGraph, int]:
    """The graph with the positive part of indefinite information matrices, and how many there are."""
    total, out = 0, []
    for factors in graph.factors:
        bad = np.flatnonzero(indefinite(factors.information))
        if len(bad):
            values, vectors = np.linalg.eigh(factors.information[bad])
            information = factors.information.copy()
            information[bad] = (vectors * np.maximum(values, 0.0)[:, None, :]) @ vectors.transpose(0, 2, 1)
            factors = replace(factors, information=information)
            total += len(bad)
        out.append(factors)
    return replace(graph, factors=out), total
