"""Answers a request: finds the variables, recovers their covariances, states them in a convention and scale."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations

import numpy as np

from slamcli.errors import NumericalError, UsageError
from slamcli.graph import FactorGraph
from slamcli.graph.columns import IndexArray
from slamcli.models import INTRINSICS
from slamcli.models.base import Array
from slamcli.solver.covariance import conventions
from slamcli.solver.covariance.recovery import CovarianceRecovery, Member
from slamcli.solver.covariance.relative import relative
from slamcli.solver.covariance.result import CovarianceRequest, CovarianceResult, Cross, Joint, Marginals, Relative


def find(graph: FactorGraph, identifier: int, *, intrinsics: bool = False) -> Member:
    """The pose or point of an id, or also the intrinsics that cameras share.

    Raises
    ------
    UsageError
        If there is none.
    """
    others = INTRINSICS if intrinsics else ()
    columns = {name: c for name, c in graph.variables.items() if (c.kind.space or c.kind in others) and len(c)}
    for name, column in columns.items():
        row = column.row_of(identifier)
        if row >= 0:
            return name, row
    ranges = (f"{name} {column.ids.min()} to {column.ids.max()}" for name, column in columns.items())
    raise UsageError(f"no variable has the id {identifier}", (f"  ids in this graph: {', '.join(ranges)}",))


def recover(recovery: CovarianceRecovery, request: CovarianceRequest) -> CovarianceResult:
    """Recover what was asked for.

    Raises
    ------
    UsageError
        If an id does not exist, or nothing is to be recovered.
    NumericalError
        If H is singular or indefinite, what was asked for is not determined by its edges, or there are no degrees of
        freedom to take a scale from.
    """
    graph = recovery.graph
    _require_determined(recovery, request)
    chosen = _chosen(graph, request)
    joint = [find(graph, identifier, intrinsics=True) for identifier in request.joint]
    pairs = [(find(graph, i), find(graph, j)) for i, j in request.relative]
    if len(set(joint)) < len(joint):
        raise UsageError("an id occurs twice in --joint")
    decrease = recovery.predicted_decrease
    factor = _factor(recovery, request.scale)
    return CovarianceResult(
        graph=graph,
        request=request,
        gauge=recovery.gauge,
        factor=factor,
        chi2=recovery.chi2,
        dof=recovery.dof,
        predicted_decrease=decrease,
        marginals=_marginals(recovery, chosen, request.convention, factor),
        cross=_cross(recovery, chosen, request.convention, factor) if request.cross else [],
        joint=_joint(recovery, joint, request, factor) if joint else None,
        relative=[
            _relative(recovery, pair, ids, request.convention, factor)
            for pair, ids in zip(pairs, request.relative, strict=True)
        ],
        under_observed=recovery.under_observed,
        edges_left_out=recovery.edges_left_out,
    )


def _require_determined(recovery: CovarianceRecovery, request: CovarianceRequest) -> None:
    """Refuse landmarks that were left out where they were asked for by their ids."""
    asked = {*request.ids, *request.joint, *(identifier for pair in request.relative for identifier in pair)}
    lost = [landmark for landmark in recovery.under_observed if landmark.id in asked]
    if lost:
        raise NumericalError(
            f"no covariance: the edges of landmark {lost[0].id} do not determine it",
            tuple(f"  {landmark.id}: {landmark.reason}" for landmark in lost),
        )


def _chosen(graph: FactorGraph, request: CovarianceRequest) -> dict[str, IndexArray]:
    """Rows of the chosen variables, by the name of their kind."""
    if request.ids:
        rows: dict[str, list[int]] = {}
        for identifier in dict.fromkeys(request.ids):
            name, row = find(graph, identifier)
            rows.setdefault(name, []).append(row)
        return {name: np.array(rows[name], dtype=np.intp) for name in graph.variables if name in rows}
    poses = {"all": (True, False), "poses": (True,), "landmarks": (False,)}[request.of]
    columns = {name: c for name, c in graph.variables.items() if c.kind.space and len(c)}
    found = {name: np.arange(len(c)) for name, c in columns.items() if c.kind.is_pose in poses}
    if not found:
        raise UsageError(f"the graph has no {request.of}")
    return found


def _factor(recovery: CovarianceRecovery, scale: str) -> float:
    if scale == "none":
        return 1.0
    if recovery.dof <= 0:
        raise NumericalError(
            f"no posterior scale: chi2 has {recovery.dof} degrees of freedom",
            ("  with no more residuals than unknowns, chi2 says nothing about the size of the noise",),
        )
    if recovery.chi2 == 0.0:
        raise NumericalError(
            "no posterior scale: chi2 is 0",
            ("  measurements that fit without any error say nothing about the size of the noise",),
        )
    return recovery.chi2 / recovery.dof


def _change(graph: FactorGraph, name: str, rows: IndexArray, convention: str) -> Array | None:
    column = graph.variables[name]
    return conventions.change(column.kind, column.values[rows], convention)


def _marginals(
    recovery: CovarianceRecovery, chosen: dict[str, IndexArray], convention: str, factor: float
) -> list[Marginals]:
    out, found = [], recovery.marginals()
    for name, rows in chosen.items():
        column = recovery.graph.variables[name]
        local = factor * found[name][rows]
        change = _change(recovery.graph, name, rows, convention)
        covariance = conventions.changed(local, change, change)
        held = recovery.held[name][rows]
        out.append(Marginals(column.kind, column.ids[rows], column.values[rows], held, covariance, local))
    return out


def _cross(recovery: CovarianceRecovery, chosen: dict[str, IndexArray], convention: str, factor: float) -> list[Cross]:
    graph = recovery.graph
    wanted = {name: np.isin(np.arange(len(column)), chosen.get(name, [])) for name, column in graph.variables.items()}
    pairs: dict[tuple[str, str], list[IndexArray]] = {}
    for factors in graph.factors:
        names = [kind.name for kind in factors.kind.variables]
        for s, t in combinations(range(len(names)), 2):
            rows = factors.indices[:, [s, t]]
            use = wanted[names[s]][rows[:, 0]] & wanted[names[t]][rows[:, 1]]
            if names[s] == names[t]:
                use &= rows[:, 0] != rows[:, 1]
                rows = np.sort(rows, axis=1)
            pairs.setdefault((names[s], names[t]), []).append(rows[use])
    out = []
    for kinds, parts in pairs.items():
        rows = np.unique(np.concatenate(parts), axis=0)
        columns = [graph.variables[name] for name in kinds]
        ids = np.stack([column.ids[rows[:, slot]] for slot, column in enumerate(columns)], axis=1)
        changes = [_change(graph, name, rows[:, slot], convention) for slot, name in enumerate(kinds)]
        covariance = conventions.changed(factor * recovery.cross(kinds, rows), changes[0], changes[1])
        out.append(Cross((columns[0].kind, columns[1].kind), ids, covariance))
    return out


def _joint(recovery: CovarianceRecovery, members: list[Member], request: CovarianceRequest, factor: float) -> Joint:
    graph = recovery.graph
    names = tuple(
        f"{identifier} {component}"
        for identifier, (name, _) in zip(request.joint, members, strict=True)
        for component in conventions.tangent(graph.variables[name].kind, request.convention)
    )
    covariance = factor * recovery.joint(members)
    blocks = []
    for name, row in members:
        change = _change(graph, name, np.array([row]), request.convention)
        blocks.append(np.eye(graph.variables[name].kind.dimension) if change is None else change[0])
    turn = _block_diagonal(blocks)
    return Joint(request.joint, names, turn @ covariance @ turn.T)


def _block_diagonal(blocks: Iterable[Array]) -> Array:
    parts = list(blocks)
    out = np.zeros((sum(len(part) for part in parts),) * 2)
    start = 0
    for part in parts:
        out[start : start + len(part), start : start + len(part)] = part
        start += len(part)
    return out


def _relative(
    recovery: CovarianceRecovery, pair: tuple[Member, Member], ids: tuple[int, int], convention: str, factor: float
) -> Relative:
    kind, value, covariance = relative(recovery, *pair)
    local = factor * covariance
    change = conventions.change(kind, value[None], convention)
    turned = conventions.changed(local[None], change, change)[0]
    return Relative(ids, kind, value, turned, local)
