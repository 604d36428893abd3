"""Graphs for the tests of the certificate: rings with a wound-up guess, noisy poses, dense counterparts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from graphs import exact_graph, variables

from slamcli import models
from slamcli.graph import FactorGraph, Factors
from slamcli.models.base import Array
from slamcli.solver.certificate.connection import Connection

SPACES = {2: (models.SE2, models.RELATIVE_POSE_2D), 3: (models.SE3, models.RELATIVE_POSE_3D)}


def ring(count: int, turns: int = 0, kappa: float = 1.0, noise: float = 0.0) -> FactorGraph:
    """Planar poses on a ring, each one step ahead of the last and turned like it, information kappa on angles.

    The guess winds up the headings by whole turns on the way round: with few of them that is a local minimum, in which
    every edge is off by the same angle.
    """
    rng = np.random.default_rng(5)
    indices = np.stack([np.arange(count), (np.arange(count) + 1) % count], axis=1)
    measured = np.zeros((count, 3)) + noise * rng.standard_normal((count, 3))
    weights = np.tile(np.diag([1.0, 1.0, kappa]), (count, 1, 1))
    guess = np.zeros((count, 3))
    guess[:, 2] = 2.0 * np.pi * turns * np.arange(count) / count
    column = variables(models.SE2, range(count), models.SE2.normalize(guess))
    return FactorGraph({"SE2": column}, [Factors(models.RELATIVE_POSE_2D, indices, measured, weights, tag="EDGE_SE2")])


def noisy(space: int, count: int = 12, seed: int = 0, noise: float = 0.1, extra: int = 14) -> FactorGraph:
    """Random poses, and measurements between them with noise; edges run in both directions and repeat."""
    graph = exact_graph(*SPACES[space], count, seed, extra)
    rng = np.random.default_rng(seed + 100)
    (factors,) = graph.factors
    kind = factors.kind.variables[0]
    moved = kind.retract(factors.measurements, noise * rng.standard_normal((len(factors), kind.dimension)))
    indices = factors.indices.copy()
    indices[-1] = indices[0]  # parallel edges
    moved[-1] = moved[0]
    return replace(graph, factors=[replace(factors, measurements=moved, indices=indices, tag="EDGE")])


def moved_rigidly(graph: FactorGraph, seed: int = 3) -> FactorGraph:
    """The graph with all poses in another frame."""
    (column,) = graph.variables.values()
    rng = np.random.default_rng(seed)
    frame = column.kind.normalize(rng.standard_normal((1, column.kind.size)))
    values = column.kind.compose(np.repeat(frame, len(column), axis=0), column.values)
    return graph.with_values({column.kind.name: column.kind.normalize(values)})


def dense_connection(connection: Connection) -> Array:
    """M, edge by edge."""
    size = connection.space + 1
    out = np.zeros((connection.count * size, connection.count * size))
    for i, j, transform, weight in zip(
        connection.first, connection.second, connection.transforms, connection.weights[:, 0], strict=True
    ):
        row = np.zeros((size, connection.count * size))
        row[:, j * size : (j + 1) * size] = np.eye(size)
        row[:, i * size : (i + 1) * size] = -transform.T
        out += row.T @ np.diag(weight) @ row
    return out


def reduced(connection: Connection, multipliers: Array) -> Array:
    """Q - Lambda: M with the translations eliminated by a pseudoinverse, minus the multipliers."""
    size, d = connection.space + 1, connection.space
    matrix = dense_connection(connection)
    for k, block in enumerate(multipliers):
        matrix[k * size : k * size + d, k * size : k * size + d] -= block
    translation = np.arange(len(matrix)) % size == d
    turn, mixed = matrix[np.ix_(~translation, ~translation)], matrix[np.ix_(~translation, translation)]
    return turn - mixed @ np.linalg.pinv(matrix[np.ix_(translation, translation)]) @ mixed.T
