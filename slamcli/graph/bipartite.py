"""The factor graph as what it is drawn as: variables, factors, and which factor joins which variables.

Small graphs only: here variables and factors are objects.

Eliminating a variable takes all factors that join it away and puts one on its other neighbours, its separator, in their
place; pairs of the separator that no factor joined before are fill-in (F. Dellaert and M. Kaess, "Factor Graphs for
Robot Perception", 2017, chapter 3). Online SLAM is the factor graph whose past poses are eliminated.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from slamcli.graph.columns import BoolArray
from slamcli.graph.factor_graph import FactorGraph
from slamcli.graph.topology import is_loop_closure
from slamcli.models import SWITCH
from slamcli.models.base import Array

#: Roles of factors.
ODOMETRY, CLOSURE, OBSERVATION, PRIOR, MARGINAL = "odometry", "loop closure", "observation", "prior", "marginal"


@dataclass(frozen=True)
class Variable:
    """A variable: ``key`` numbers it within the graph, ``id`` is the file's."""

    key: int
    id: int
    kind: str
    is_pose: bool
    fixed: bool

    @property
    def is_switch(self) -> bool:
        """Whether it weighs a loop closure, and is nowhere."""
        return self.kind == SWITCH.name

    @property
    def label(self) -> str:
        """``x7`` for a pose, ``l7`` for a landmark, ``s7`` for a switch."""
        return f"{'s' if self.is_switch else 'x' if self.is_pose else 'l'}{self.id}"


@dataclass(frozen=True)
class Factor:
    """A factor: the keys of the variables that it joins, its role and its tag (empty for marginals)."""

    variables: tuple[int, ...]
    role: str
    tag: str = ""


@dataclass(frozen=True, eq=False)
class Bipartite:
    """Variables and factors.

    Attributes
    ----------
    variables
        By key, in the order of the file.
    factors
        In the order of the file; marginals at the end.
    positions
        Estimates of the variables' positions in metres by key, (x, y); absent where there is none.
    """

    variables: dict[int, Variable]
    factors: list[Factor]
    positions: dict[int, tuple[float, float]]

    def pairs(self) -> set[tuple[int, int]]:
        """Pairs of variables that some factor joins."""
        return {pair for factor in self.factors for pair in combinations(sorted(set(factor.variables)), 2)}


@dataclass(frozen=True, eq=False)
class Step:
    """The elimination of one variable.

    Attributes
    ----------
    variable
        That goes.
    separator
        Its neighbours, which the new factor joins.
    absorbed
        The factors that went with it.
    fill_in
        Pairs of the separator that nothing joined before.
    graph
        What is left.
    """

    variable: Variable
    separator: tuple[Variable, ...]
    absorbed: tuple[Factor, ...]
    fill_in: tuple[tuple[Variable, Variable], ...]
    graph: Bipartite


def bipartite(graph: FactorGraph, chosen: dict[str, BoolArray] | None = None) -> tuple[Bipartite, int]:
    """The variables (all, or those of a mask for each kind) with the factors that join no others.

    Returns
    -------
    Bipartite
        The graph or its part.
    int
        Factors that join a chosen variable with one that is not.
    """
    variables: dict[int, Variable] = {}
    positions: dict[int, tuple[float, float]] = {}
    keys: dict[str, list[int]] = {}
    for name, column in graph.variables.items():
        mask = np.ones(len(column), dtype=bool) if chosen is None else chosen[name]
        keys[name] = [-1] * len(column)
        for row in np.flatnonzero(mask).tolist():
            key = len(variables)
            keys[name][row] = key
            pose, fixed = column.kind.is_pose, bool(column.fixed[row])
            variables[key] = Variable(key, int(column.ids[row]), name, pose, fixed)
            if column.kind.space == 0 or not column.known[row]:
                continue  # a switch is nowhere
            x, y = column.values[row, :2].tolist()
            if np.isfinite(x + y):
                positions[key] = (x, y)
    factors, cut = [], 0
    for columns in graph.factors:
        kinds = columns.kind.variables
        closures = is_loop_closure(graph, columns).tolist()
        for row, joined in enumerate(columns.indices.tolist()):
            members = tuple(keys[kind.name][index] for kind, index in zip(kinds, joined, strict=True))
            if min(members) < 0:
                cut += max(members) >= 0
                continue
            if len(kinds) == 1:
                role = PRIOR
            elif SWITCH in kinds:
                role = CLOSURE  # with a switch
            elif columns.kind.relative_pose:
                role = CLOSURE if closures[row] else ODOMETRY
            else:
                role = OBSERVATION
            factors.append(Factor(members, role, columns.tag or columns.kind.name))
    return Bipartite(variables, factors, positions), cut


def neighbourhood(graph: FactorGraph, chosen: dict[str, BoolArray], hops: int) -> dict[str, BoolArray]:
    """A choice of variables grown along factors."""
    for _ in range(hops):
        grown = {name: mask.copy() for name, mask in chosen.items()}
        for factors in graph.factors:
            kinds = factors.kind.variables
            touched = np.zeros(len(factors), dtype=bool)
            for slot, kind in enumerate(kinds):
                touched |= chosen[kind.name][factors.indices[:, slot]]
            for slot, kind in enumerate(kinds):
                grown[kind.name][factors.indices[touched, slot]] = True
        chosen = grown
    return chosen


def eliminate(graph: Bipartite, key: int) -> Step:
    """Eliminate one variable."""
    absorbed = tuple(factor for factor in graph.factors if key in factor.variables)
    separator = sorted({other for factor in absorbed for other in factor.variables} - {key})
    before = graph.pairs()
    fill_in = [pair for pair in combinations(separator, 2) if pair not in before]
    factors = [factor for factor in graph.factors if key not in factor.variables]
    if separator:
        factors.append(Factor(tuple(separator), MARGINAL))
    variables = {other: variable for other, variable in graph.variables.items() if other != key}
    return Step(
        graph.variables[key],
        tuple(graph.variables[other] for other in separator),
        absorbed,
        tuple((graph.variables[a], graph.variables[b]) for a, b in fill_in),
        replace(graph, variables=variables, factors=factors),
    )


def eliminate_all(graph: Bipartite, order: Iterable[int]) -> list[Step]:
    """Eliminate variables one after the other."""
    steps: list[Step] = []
    for key in order:
        steps.append(eliminate(steps[-1].graph if steps else graph, key))
    return steps


def online(graph: Bipartite) -> Bipartite:
    """Online SLAM: all poses but the last one (the highest id of each kind) eliminated."""
    latest = {v.kind: v.key for v in sorted(graph.variables.values(), key=lambda v: v.id) if v.is_pose}
    past = [v.key for v in graph.variables.values() if v.is_pose and v.key != latest[v.kind]]
    steps = eliminate_all(graph, past)
    return steps[-1].graph if steps else graph


def least_degree(graph: Bipartite) -> list[int]:
    """Keys in the order of minimum degree: always the variable with the fewest neighbours next, ties by id."""
    order = []
    while graph.variables:
        pairs = graph.pairs()
        degree = dict.fromkeys(graph.variables, 0)
        for pair in pairs:
            for key in pair:
                degree[key] += 1
        key = min(graph.variables, key=lambda k: (degree[k], graph.variables[k].id))
        order.append(key)
        graph = eliminate(graph, key).graph
    return order


def spring_layout(graph: Bipartite, steps: int = 400) -> dict[int, tuple[float, float]]:
    """Positions by attraction along factors and repulsion between all (Fruchterman and Reingold 1991)."""
    keys = list(graph.variables)
    count = len(keys)
    row = {key: k for k, key in enumerate(keys)}
    angle = 2.0 * np.pi * np.arange(count) / max(count, 1)
    place: Array = np.stack([np.cos(angle), np.sin(angle)], axis=1) * np.sqrt(count)
    ends = np.array([(row[a], row[b]) for a, b in sorted(graph.pairs())], dtype=np.intp).reshape(-1, 2)
    for k in range(steps):
        apart = place[:, None] - place[None]
        distance = np.sqrt(np.square(apart).sum(axis=2)) + 1e-9
        force = (apart / np.square(distance)[:, :, None]).sum(axis=1)
        pull = place[ends[:, 0]] - place[ends[:, 1]]
        pull = pull * np.sqrt(np.square(pull).sum(axis=1))[:, None]
        np.add.at(force, ends[:, 0], -pull)
        np.add.at(force, ends[:, 1], pull)
        force -= 0.02 * place  # parts that nothing joins stay near
        length = np.sqrt(np.square(force).sum(axis=1))[:, None] + 1e-12
        heat = 0.3 * np.sqrt(max(count, 1)) * (1.0 - k / steps)
        place = place + force / length * np.minimum(length, heat)
    return {key: (float(x), float(y)) for key, (x, y) in zip(keys, place, strict=True)}


def order_of(graph: Bipartite, ids: Sequence[int]) -> list[int]:
    """Keys of ids, -1 where there is none."""
    known = {variable.id: key for key, variable in graph.variables.items()}
    return [known.get(identifier, -1) for identifier in ids]
