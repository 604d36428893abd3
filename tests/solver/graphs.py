"""Graphs made in memory for the tests of the solver, and dense counterparts of its sparse matrices."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from support import BUNDLED

import slamcli
from slamcli import models
from slamcli.graph import FactorGraph, Factors, Variables
from slamcli.graph.columns import Values
from slamcli.models import FactorKind, VariableKind
from slamcli.models.base import Array
from slamcli.solver import gauge
from slamcli.solver.gauge import Held
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.pattern import BlockPattern
from slamcli.solver.problem import Problem
from slamcli.solver.result import Result
from slamcli.solver.stopwatch import Stopwatch

BUNDLED_NAMES = ("manhattan_small.g2o", "sphere_small.g2o", "landmarks_small.g2o", "square_toro.graph")


def bundled(name: str) -> FactorGraph:
    """A bundled data set."""
    return slamcli.read(str(BUNDLED / name))


def from_file(graph: FactorGraph, **options: Any) -> Result:
    """Plain Gauss-Newton from the file's values, unless the options say otherwise."""
    return slamcli.optimize(graph, **{"method": "gn", "init": "file", **options})


def variables(kind: VariableKind, ids: Iterable[int], values: Array) -> Variables:
    """A column of variables with estimates."""
    column = np.array(list(ids), dtype=np.int64)
    return Variables(
        kind=kind,
        ids=column,
        values=np.asarray(values, dtype=np.float64).reshape(len(column), kind.size),
        fixed=np.zeros(len(column), dtype=bool),
        known=np.ones(len(column), dtype=bool),
        lines=np.zeros(len(column), dtype=np.intp),
    )


def points(values: list[tuple[float, float]], *factors: Factors) -> FactorGraph:
    """A graph of planar points only, with ids 0, 1, ...: a linear least-squares problem."""
    return FactorGraph({"XY": variables(models.XY, range(len(values)), np.array(values))}, list(factors))


def differences(edges: list[tuple[int, int, float, float]], weight: float = 1.0) -> Factors:
    """Measured differences (i, j, dx, dy) between points."""
    return Factors(
        kind=models.POINT_DIFFERENCE_2D,
        indices=np.array([edge[:2] for edge in edges], dtype=np.intp),
        measurements=np.array([edge[2:] for edge in edges], dtype=np.float64),
        information=np.tile(weight * np.eye(2), (len(edges), 1, 1)),
    )


def point_priors(priors: list[tuple[int, float, float]], weight: float = 1.0) -> Factors:
    """Priors (i, x, y) on points."""
    return Factors(
        kind=models.POINT_PRIOR_2D,
        indices=np.array([prior[:1] for prior in priors], dtype=np.intp),
        measurements=np.array([prior[1:] for prior in priors], dtype=np.float64),
        information=np.tile(weight * np.eye(2), (len(priors), 1, 1)),
    )


def information(rng: np.random.Generator, count: int, dimension: int) -> Array:
    """Random positive definite matrices."""
    root = rng.standard_normal((count, dimension, dimension))
    return root @ root.transpose(0, 2, 1) + 0.1 * np.eye(dimension)


def random_values(rng: np.random.Generator, kind: VariableKind, count: int) -> Array:
    """Random elements of a kind of variable, spread over some metres; switches away from 0 and 1, where steps end."""
    if kind is models.SWITCH:
        return rng.uniform(0.1, 0.7, (count, 1))
    return kind.normalize(2.0 * rng.standard_normal((count, kind.size)))


def random_factors(rng: np.random.Generator, kind: FactorKind, sizes: dict[str, int], count: int) -> Factors:
    """Random factors of one kind; self edges and parallel edges occur."""
    slots = [rng.integers(0, sizes[slot.name], count) for slot in kind.variables]
    measurements = kind.normalize(rng.standard_normal((count, kind.measurement_size)))
    parameters = None if kind.parameter is None else random_values(rng, kind.parameter, count)
    if kind is models.RELATIVE_POSE_3D or kind is models.POSE_PRIOR_3D:
        measurements = random_values(rng, models.SE3, count)
    return Factors(
        kind=kind,
        indices=np.stack(slots, axis=1).astype(np.intp),
        measurements=measurements,
        information=information(rng, count, kind.dimension),
        parameters=parameters,
    )


def exact_graph(kind: VariableKind, relative: FactorKind, count: int, seed: int, extra: int = 10) -> FactorGraph:
    """Random poses and edges without noise, some of them from the later to the earlier pose; the truth as values."""
    rng = np.random.default_rng(seed)
    truth = random_values(rng, kind, count)
    order = rng.permutation(count)
    pairs = [(order[k], order[k + 1]) for k in range(count - 1)]
    pairs += [tuple(rng.choice(count, 2, replace=False)) for _ in range(extra)]
    pairs = [pair if rng.random() < 0.5 else pair[::-1] for pair in pairs]
    indices = np.array(pairs, dtype=np.intp)
    measured = kind.normalize(kind.compose(kind.inverse(truth[indices[:, 0]]), truth[indices[:, 1]]))
    weights = information(rng, len(pairs), relative.dimension)
    return FactorGraph(
        {kind.name: variables(kind, range(count), truth)}, [Factors(relative, indices, measured, weights)]
    )


def mixed_graph(seed: int, count: int = 6) -> tuple[FactorGraph, Held]:
    """Every kind of variable and of factor in one graph, with a few variables held at random."""
    rng = np.random.default_rng(seed)
    sizes = {kind.name: int(rng.integers(2, 5)) for kind in models.VARIABLE_KINDS}
    columns, start = {}, 0
    for kind in models.VARIABLE_KINDS:
        size = sizes[kind.name]
        columns[kind.name] = variables(kind, range(start, start + size), random_values(rng, kind, size))
        start += size
    factors = [random_factors(rng, kind, sizes, count) for kind in models.FACTOR_KINDS]
    held = {name: rng.random(size) < 0.3 for name, size in sizes.items()}
    return FactorGraph(columns, factors), held


def make_problem(graph: FactorGraph, **options: object) -> Problem:
    """The linear problem of a graph under its own gauge."""
    return Problem(graph, gauge.choose(graph)[1], OptimizeOptions(**options), Stopwatch())  # type: ignore[arg-type]


def dense(pattern: BlockPattern, values: Array) -> Array:
    """The full symmetric matrix of a pattern's stored values."""
    upper = np.zeros((pattern.dimension, pattern.dimension))
    upper[pattern.scalar_rows, pattern.scalar_columns] = values
    on_diagonal = np.repeat(np.arange(len(pattern.sizes)), pattern.sizes)
    same = on_diagonal[:, None] == on_diagonal[None, :]
    return np.where(same, upper, upper + upper.T)


def dense_assembly(graph: FactorGraph, held: Held, values: Values) -> tuple[Array, Array, float]:
    """H, gradient and chi2 factor by factor from the Jacobians, with no sparsity in sight."""
    first, dimension = {}, 0
    for name, column in graph.variables.items():
        width = column.kind.dimension
        free = ~held[name]
        first[name] = np.where(free, dimension + width * (np.cumsum(free) - 1), -1)
        dimension += width * int(free.sum())
    hessian, gradient, chi2 = np.zeros((dimension, dimension)), np.zeros(dimension), 0.0
    for factors in graph.factors:
        residual, jacobians = factors.linearize(values)
        for m in range(len(factors)):
            row = np.zeros((factors.kind.dimension, dimension))
            for slot, kind in enumerate(factors.kind.variables):
                start = int(first[kind.name][factors.indices[m, slot]])
                if start >= 0:
                    row[:, start : start + kind.dimension] += jacobians[slot][m]
            weight = factors.information[m]
            hessian += row.T @ weight @ row
            gradient += row.T @ weight @ residual[m]
            chi2 += float(residual[m] @ weight @ residual[m])
    return hessian, gradient, chi2


def reordered(factors: Factors, order: Array) -> Factors:
    """The same factors in another order."""
    return replace(
        factors,
        indices=factors.indices[order],
        measurements=factors.measurements[order],
        information=factors.information[order],
        parameters=None if factors.parameters is None else factors.parameters[order],
        parameter_ids=None if factors.parameter_ids is None else factors.parameter_ids[order],
        lines=factors.lines[order] if len(factors.lines) else factors.lines,
    )
