"""Scenes of BAL's cameras with intrinsics of their own, as constants, or as one variable that all cameras share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamcli import models
from slamcli.graph.columns import BoolArray, IndexArray, Variables
from slamcli.graph.factor_graph import FactorGraph
from slamcli.models import VariableKind
from slamcli.models.base import Array

_POSE = 7  # numbers of a pose

#: Where a scene has intrinsics in its cameras, or beside them.
BAL_CAMERAS = (models.CAMERA.name, models.CALIBRATED_CAMERA.name, models.CAMERA_POSE.name)


def camera_name(graph: FactorGraph) -> str | None:
    """Name of the kind of a graph's BAL cameras, None if it has none."""
    return next((name for name in BAL_CAMERAS if name in graph.variables), None)


def shared_names(graph: FactorGraph) -> list[str]:
    """Names of the kinds of shared intrinsics that a graph has."""
    return [kind.name for kind in models.INTRINSICS if kind.name in graph.variables]


def calibrated(graph: FactorGraph) -> FactorGraph:
    """The scene with the intrinsics of its cameras as constants."""
    graph = whole(graph)
    return _with_cameras(graph, models.CALIBRATED_CAMERA, models.CALIBRATED_BAL_PROJECTION)


def whole(graph: FactorGraph) -> FactorGraph:
    """The scene with cameras that have intrinsics of their own, as unknowns."""
    if models.CALIBRATED_CAMERA.name in graph.variables:
        return _with_cameras(graph, models.CAMERA, models.BAL_PROJECTION)
    if models.CAMERA_POSE.name not in graph.variables:
        return graph
    own = intrinsics_rows(graph)
    table = graph.variables[models.BAL_INTRINSICS.name].values
    cameras = graph.variables[models.CAMERA_POSE.name]
    values = np.concatenate([cameras.values, table[own]], axis=1)
    columns = {
        models.CAMERA.name if name == cameras.kind.name else name: replace(column, kind=models.CAMERA, values=values)
        if column is cameras
        else column
        for name, column in graph.variables.items()
        if name != models.BAL_INTRINSICS.name
    }
    factors = [
        replace(one, kind=models.BAL_PROJECTION, indices=one.indices[:, :2])
        if one.kind is models.SHARED_BAL_PROJECTION
        else one
        for one in graph.factors
    ]
    return replace(graph, variables=columns, factors=factors)


def shared(graph: FactorGraph) -> FactorGraph:
    """The scene with one set of intrinsics for all cameras, an unknown: their mean over the observations to begin with.

    Its id is the next one behind all others.
    """
    graph = whole(graph)
    cameras = graph.variables[models.CAMERA.name]
    seen = [one.indices[:, 0] for one in graph.factors if one.kind is models.BAL_PROJECTION]
    own = cameras.values[:, _POSE:]
    with np.errstate(over="ignore"):
        mean = own[np.concatenate(seen)].mean(axis=0) if seen else own.mean(axis=0)
    identifier = max(int(column.ids.max()) for column in graph.variables.values() if len(column)) + 1
    columns: dict[str, Variables] = {}
    for name, column in graph.variables.items():
        if column is cameras:
            kind = models.CAMERA_POSE
            columns[kind.name] = replace(column, kind=kind, values=column.values[:, :_POSE].copy())
        else:
            columns[name] = column
    ids = np.array([identifier], dtype=cameras.ids.dtype)
    columns[models.BAL_INTRINSICS.name] = Variables.made(models.BAL_INTRINSICS, ids, mean[None])
    factors = [
        replace(one, kind=models.SHARED_BAL_PROJECTION, indices=np.insert(one.indices, 2, 0, axis=1))
        if one.kind is models.BAL_PROJECTION
        else one
        for one in graph.factors
    ]
    return replace(graph, variables=columns, factors=factors)


def intrinsics_rows(graph: FactorGraph) -> IndexArray:
    """Row (n,) of the shared intrinsics of each camera, 0 for cameras that see nothing.

    Raises
    ------
    ValueError
        If a camera has two, which no reader makes.
    """
    kinds = (models.SHARED_BAL_PROJECTION, models.SHARED_PINHOLE_PROJECTION)
    factors = [one for one in graph.factors if one.kind in kinds]
    name = models.CAMERA_POSE.name if models.CAMERA_POSE.name in graph.variables else models.SE3_EXPMAP.name
    out = np.zeros(len(graph.variables[name]), dtype=np.intp)
    for one in factors:
        out[one.indices[:, 0]] = one.indices[:, 2]
    if any((out[one.indices[:, 0]] != one.indices[:, 2]).any() for one in factors):
        raise ValueError("a camera has two sets of intrinsics")
    return out


def with_intrinsics_held(graph: FactorGraph, hold: bool) -> FactorGraph:
    """The scene with its shared intrinsics held, or not."""
    columns = dict(graph.variables)
    for name in shared_names(graph):
        mask: BoolArray = np.full(len(columns[name]), hold)
        columns[name] = replace(columns[name], fixed=mask)
    return replace(graph, variables=columns)


def _with_cameras(graph: FactorGraph, kind: VariableKind, projection: models.Projection) -> FactorGraph:
    """The scene with another kind of camera of the same values."""
    columns, before = {}, camera_name(graph)
    for name, column in graph.variables.items():
        columns[kind.name if name == before else name] = replace(column, kind=kind) if name == before else column
    kinds = (models.BAL_PROJECTION, models.CALIBRATED_BAL_PROJECTION)
    factors = [replace(one, kind=projection) if one.kind in kinds else one for one in graph.factors]
    return replace(graph, variables=columns, factors=factors)


def pinhole_table(graph: FactorGraph) -> Array:
    """The intrinsics (n, 4), fx fy cx cy, of the cameras of a scene with shared pinhole intrinsics."""
    table: Array = graph.variables[models.PINHOLE_INTRINSICS.name].values
    return table[intrinsics_rows(graph)]
