"""Scenes with one set of pinhole intrinsics for all cameras: from other cameras, and to g2o's VERTEX_CAM.

g2o's cameras look along +z with v down, as these do, so values and pixels stay; BAL's are turned (see
``scene_conversion``).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamcli import models
from slamcli.errors import InputError
from slamcli.formats import scene_conversion
from slamcli.graph import FactorGraph, Factors, Variables, camera_intrinsics
from slamcli.models.base import Array


def is_shared(graph: FactorGraph) -> bool:
    """Whether a graph has shared pinhole intrinsics."""
    return models.PINHOLE_INTRINSICS.name in graph.variables


def to_sba(graph: FactorGraph) -> tuple[FactorGraph, list[str]]:
    """A scene with shared pinhole intrinsics as one of g2o's VERTEX_CAM, and what it loses."""
    own = camera_intrinsics.pinhole_table(graph) if models.SE3_EXPMAP.name in graph.variables else np.empty((0, 4))
    columns: dict[str, Variables] = {}
    for name, column in graph.variables.items():
        if name == models.SE3_EXPMAP.name:
            values = np.concatenate([column.values, own, np.zeros((len(column), 1))], axis=1)
            columns[models.SBA_CAMERA.name] = replace(column, kind=models.SBA_CAMERA, values=values)
        elif name != models.PINHOLE_INTRINSICS.name:
            columns[name] = column
    factors = [
        Factors(
            models.SBA_PROJECTION,
            one.indices[:, 1::-1],
            one.measurements,
            one.information,
            tag="EDGE_PROJECT_P2MC",
        )
        if one.kind is models.SHARED_PINHOLE_PROJECTION
        else one
        for one in graph.factors
    ]
    return FactorGraph(columns, factors), ["one set of intrinsics for all cameras: each has a copy"]


def to_shared(graph: FactorGraph) -> tuple[FactorGraph, list[str]]:
    """A scene of g2o's or BAL's cameras as one with shared pinhole intrinsics, and what it loses.

    Raises
    ------
    InputError
        If the cameras' intrinsics differ, or are more than those of a pinhole.
    """
    lost: list[str] = []
    if scene_conversion.is_bal(graph):
        graph, lost = scene_conversion.to_g2o(graph)
    present = [n for n in (models.SE3_EXPMAP.name, models.SBA_CAMERA.name) if n in graph.variables]
    if len(present) != 1:
        raise InputError("bal-pinhole holds cameras, points and their observations, of one kind of camera each")
    cameras = graph.variables[present[0]]
    intrinsics = _one_set(graph, cameras)
    poses = replace(cameras, kind=models.SE3_EXPMAP, values=cameras.values[:, :7].copy())
    columns = {models.SE3_EXPMAP.name: poses}
    columns |= {name: column for name, column in graph.variables.items() if name != present[0]}
    top = max(int(column.ids.max()) for column in columns.values() if len(column))
    ids = np.array([top + 1], dtype=cameras.ids.dtype)
    made = Variables.made(models.PINHOLE_INTRINSICS, ids, intrinsics)
    columns[models.PINHOLE_INTRINSICS.name] = replace(made, fixed=np.array([True]))
    factors = []
    for one in graph.factors:
        if one.kind in (models.EXPMAP_PROJECTION, models.SBA_PROJECTION):
            rows = np.insert(one.indices[:, ::-1], 2, 0, axis=1)
            factors.append(
                Factors(models.SHARED_PINHOLE_PROJECTION, rows, one.measurements, one.information, tag="bal-pinhole")
            )
        else:
            factors.append(one)
    return FactorGraph(columns, factors), lost


def _one_set(graph: FactorGraph, cameras: Variables) -> Array:
    """The intrinsics (1, 4) that all cameras have.

    Raises
    ------
    InputError
        If there are several, or none.
    """
    if cameras.kind is models.SBA_CAMERA:
        table = cameras.values[:, 7:11]
    else:
        found = [one.parameters for one in graph.factors if one.parameters is not None]
        table = np.concatenate([np.empty((0, 4)), *(p[:, [0, 0, 1, 2]] for p in found)])
    different = np.unique(table, axis=0)
    if len(different) != 1:
        raise InputError(
            f"bal-pinhole holds one set of intrinsics, and the cameras of this graph have {len(different)}: "
            "nothing is written"
        )
    return different
