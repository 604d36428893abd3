"""Toy worlds with known loop closures, some of them false, for the tests of robust estimation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slamcli.graph import FactorGraph, Factors, Variables
from slamcli.models import RELATIVE_POSE_2D, RELATIVE_POSE_3D, SE2, SE3
from slamcli.models.base import Array


@dataclass(frozen=True, eq=False)
class World:
    """A graph, which of its edges are false, and the true poses."""

    graph: FactorGraph
    false: Array
    truth: Array


def world(
    seed: int = 0, *, laps: int = 3, side: int = 6, false: int = 12, sigma: float = 0.02, spatial: bool = False
) -> World:
    """Laps around a square; every pose but those of the first lap closes a loop to the lap before it."""
    rng = np.random.default_rng(seed)
    kind, factor = (SE3, RELATIVE_POSE_3D) if spatial else (SE2, RELATIVE_POSE_2D)
    lap = 4 * side
    count = laps * lap
    step = np.array(kind.identity)
    step[0] = 1.0
    turn = step.copy()
    turn[-2:] = (np.sin(np.pi / 4), np.cos(np.pi / 4)) if spatial else (0.0, np.pi / 2)
    poses = [np.array(kind.identity)]
    for k in range(count - 1):
        move = turn if (k + 1) % side == 0 else step
        poses.append(kind.normalize(kind.compose(poses[-1][None], move[None]))[0])
    truth = np.array(poses)
    odometry = np.stack([np.arange(count - 1), np.arange(1, count)], axis=1)
    closures = np.stack([np.arange(lap, count), np.arange(0, count - lap)], axis=1)
    pairs = np.concatenate([odometry, closures])
    z = kind.compose(kind.inverse(truth[pairs[:, 0]]), truth[pairs[:, 1]])
    z = kind.retract(z, sigma * rng.normal(size=(len(z), kind.dimension)))
    wrong = rng.choice(count - 3 * side, size=(false, 1), replace=False)
    bad = np.concatenate([wrong, wrong + side + 3 + rng.integers(0, side, (false, 1))], axis=1)
    claims = kind.retract(np.tile(kind.identity, (false, 1)), 0.1 * rng.normal(size=(false, kind.dimension)))
    indices = np.concatenate([pairs, bad])
    factors = Factors(
        kind=factor,
        indices=indices,
        measurements=np.concatenate([z, claims]),
        information=np.tile(np.eye(kind.dimension) / sigma**2, (len(indices), 1, 1)),
        tag="EDGE_SE3:QUAT" if spatial else "EDGE_SE2",
        lines=np.zeros(len(indices), dtype=np.intp),
    )
    variables = Variables(
        kind=kind,
        ids=np.arange(count),
        values=truth,
        fixed=np.zeros(count, dtype=bool),
        known=np.ones(count, dtype=bool),
        lines=np.zeros(count, dtype=np.intp),
    )
    mask = np.arange(len(indices)) >= len(pairs)
    return World(FactorGraph({kind.name: variables}, [factors]), mask, truth)


def reordered(graph: FactorGraph, order: Array) -> FactorGraph:
    """The same graph with its edges in another order."""
    return replace(graph, factors=[graph.factors[0].part(order)])


def renumbered(graph: FactorGraph, factor: int, offset: int) -> FactorGraph:
    """The same graph with other ids in the same order."""
    name, column = next(iter(graph.variables.items()))
    return replace(graph, variables={name: replace(column, ids=column.ids * factor + offset)})


def moved(graph: FactorGraph, by: Array) -> FactorGraph:
    """The same graph with its values moved rigidly."""
    name, column = next(iter(graph.variables.items()))
    values = column.kind.normalize(column.kind.compose(np.tile(by, (len(column), 1)), column.values))
    return replace(graph, variables={name: replace(column, values=values)})
