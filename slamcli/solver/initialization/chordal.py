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

#: Of several anchors' rotations, those whose positions are solved for, too.
_KEPT = 4


def relax(graph: FactorGraph, held: Held, *, anchors: int = 1) -> tuple[Values, dict[str, BoolArray], str]:
    """Chordal start of a graph.

    Parameters
    ----------
    graph
        Of its values those of the held variables count, and that of one pose of each component which nothing orients.
    held
        The gauge: these keep their values.
    anchors
        Poses that are held in turn in the relaxation of the rotations; of the starts the one with the least chi2 is
        taken. One serves nearly always.

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
    values = dict(graph.values)
    placed = {name: np.zeros(len(column), dtype=bool) for name, column in graph.variables.items()}
    for space in (2, 3):
        columns = [column for column in graph.variables.values() if column.kind.space == space]
        poses = next((column for column in columns if column.kind.is_pose), None)
        points = next((column for column in columns if not column.kind.is_pose), None)
        if not columns:
            continue
        turned = [None] if poses is None else _rotations(graph, poses, points, held[poses.kind.name], anchors)
        found, where = _least(graph, values, placed, [positions.solve(graph, space, held, part) for part in turned])
        values.update(found)
        placed.update(where)
    words = "chordal relaxation" + (f", best of {anchors} anchors" if anchors > 1 else "")
    if repaired:
        words += f"; of {repaired} indefinite information matrices the positive part"
    return values, placed, words


def _rotations(
    graph: FactorGraph, poses: Variables, points: Variables | None, held: BoolArray, anchors: int
) -> list[Rotations]:
    """Rotations from relative poses alone where they are all there is, else from what is seen of points as well."""
    if points is not None and landmark_rotations.observations(graph, poses.kind):
        return [landmark_rotations.relax(graph, poses, points, held)]
    if anchors > 1:
        return rotations.best_of(graph, poses, held, anchors, _KEPT)
    return [rotations.relax(graph, poses, held)]


def _least(
    graph: FactorGraph,
    values: Values,
    placed: dict[str, BoolArray],
    found: list[tuple[Values, dict[str, BoolArray]]],
) -> tuple[Values, dict[str, BoolArray]]:
    """Of several solutions for the variables of a space the one with the least chi2, all landmarks placed."""
    if len(found) == 1:
        return found[0]
    for solved, where in found if graph.landmarks else ():
        from slamcli.solver.initialization import landmarks  # most graphs do without

        state, firm = {**values, **solved}, {**placed, **where}
        landmarks.place(graph, state, firm)
        solved.update({name: state[name] for name in solved})
        where.update({name: firm[name] for name in where})
    return min(found, key=lambda pair: graph.chi2({**values, **pair[0]}))


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
