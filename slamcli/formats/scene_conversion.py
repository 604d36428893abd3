"""Scenes between BAL's cameras and g2o's EDGE_PROJECT_XYZ2UV:EXPMAP.

BAL's camera looks along -z with v up, g2o's along +z with v down: half a turn about x takes one to the other. BAL has
radial distortion and no principal point, g2o has a principal point, no distortion, and intrinsics that are constants.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamcli import models
from slamcli.errors import InputError
from slamcli.geometry import so3
from slamcli.graph import FactorGraph, Factors, Variables, camera_intrinsics
from slamcli.models import VariableKind
from slamcli.models.base import Array

_HALF_TURN = np.array([1.0, 0.0, 0.0, 0.0])
_PINHOLES = (models.SE3_EXPMAP.name, models.SBA_CAMERA.name)


def is_bal(graph: FactorGraph) -> bool:
    """Whether a graph has BAL's cameras, with their intrinsics or beside them."""
    return camera_intrinsics.camera_name(graph) is not None


def is_pinhole(graph: FactorGraph) -> bool:
    """Whether a graph has g2o's cameras."""
    return any(name in graph.variables for name in _PINHOLES) and models.PINHOLE_INTRINSICS.name not in graph.variables


def to_whole(graph: FactorGraph) -> tuple[FactorGraph, list[str]]:
    """A scene with intrinsics in every one of its BAL cameras, and what it loses."""
    name = camera_intrinsics.camera_name(graph)
    if name in (None, models.CAMERA.name):
        return graph, []
    whole = camera_intrinsics.whole(graph)
    if graph.report is not None and graph.report.format != "bal-pinhole":
        return whole, []  # they had their own before an option said otherwise
    count = len(graph.variables[str(name)])
    what = "one set of intrinsics for" if name == models.CAMERA_POSE.name else "constant intrinsics of"
    return whole, [f"{what} {count} cameras: each has its own, as unknowns"]


def to_g2o(graph: FactorGraph) -> tuple[FactorGraph, list[str]]:
    """A scene of BAL's cameras as one of g2o's, and what it loses.

    Raises
    ------
    InputError
        If a camera has distortion.
    """
    graph = camera_intrinsics.whole(graph)
    cameras = graph.variables[models.CAMERA.name]
    distorted = (cameras.values[:, 8:] != 0.0).any(axis=1)
    if distorted.any():
        raise InputError(
            f"g2o's EDGE_PROJECT_XYZ2UV:EXPMAP knows no distortion, and {int(distorted.sum())} of {len(cameras)} "
            "cameras have some: nothing is written",
            ("  bal and bundler hold such cameras",),
        )
    focal, which = np.unique(cameras.values[:, 7], return_inverse=True)
    parameters = {k: np.array([f, 0.0, 0.0, 0.0]) for k, f in enumerate(focal.tolist())}
    table = np.array(list(parameters.values())).reshape(-1, 4)
    columns = {models.SE3_EXPMAP.name: _turned(cameras, models.SE3_EXPMAP, np.empty((len(cameras), 0)))}
    columns |= {name: column for name, column in graph.variables.items() if name != models.CAMERA.name}
    factors = []
    for one in graph.factors:
        if one.kind is not models.BAL_PROJECTION:
            factors.append(one)
            continue
        parameter = which[one.indices[:, 0]]
        factors.append(
            Factors(
                kind=models.EXPMAP_PROJECTION,
                indices=one.indices[:, ::-1],
                measurements=one.measurements * [1.0, -1.0],
                information=_flipped(one.information),
                parameters=table[parameter],
                parameter_ids=parameter,
                tag="EDGE_PROJECT_XYZ2UV:EXPMAP",
            )
        )
    loss = [f"that the focal lengths of {len(cameras)} cameras are unknown: in g2o they are constants"]
    return FactorGraph(columns, factors, parameters), loss


def to_bal(graph: FactorGraph) -> tuple[FactorGraph, list[str]]:
    """A scene of g2o's cameras as one of BAL's, and what it loses.

    Raises
    ------
    InputError
        If a camera has two sets of intrinsics or two focal lengths.
    """
    present = [name for name in _PINHOLES if name in graph.variables]
    if len(present) > 1:
        raise InputError(f"{' and '.join(present)} vertices together cannot be written as BAL's cameras")
    cameras = graph.variables[present[0]]
    intrinsics = _intrinsics(graph, cameras)
    rest = np.concatenate([intrinsics[:, :1], np.zeros((len(cameras), 2))], axis=1)
    columns = {models.CAMERA.name: _turned(cameras, models.CAMERA, rest)}
    columns |= {name: column for name, column in graph.variables.items() if name not in _PINHOLES}
    factors = []
    for one in graph.factors:
        if one.kind not in (models.EXPMAP_PROJECTION, models.SBA_PROJECTION):
            factors.append(one)
            continue
        pixels = (one.measurements - intrinsics[one.indices[:, 1], 1:]) * [1.0, -1.0]
        information = _flipped(one.information)
        factors.append(Factors(models.BAL_PROJECTION, one.indices[:, ::-1], pixels, information, tag="bal"))
    loss = [f"that the intrinsics of {len(cameras)} cameras are constants: in BAL they are unknowns"]
    return FactorGraph(columns, factors), loss


def _intrinsics(graph: FactorGraph, cameras: Variables) -> Array:
    """f, cx, cy (n, 3) of g2o's cameras; zeros for cameras that see nothing."""
    if cameras.kind is models.SBA_CAMERA:
        if not np.array_equal(cameras.values[:, 7], cameras.values[:, 8]):
            raise InputError("a camera has two focal lengths, fx and fy, which BAL's cameras have not")
        return cameras.values[:, [7, 9, 10]]
    out, seen = np.zeros((len(cameras), 3)), np.zeros(len(cameras), dtype=bool)
    for one in graph.factors:
        if one.kind is models.EXPMAP_PROJECTION:
            assert one.parameters is not None
            rows = one.indices[:, 1]
            fresh = ~seen[rows]
            out[rows[fresh]] = one.parameters[fresh, :3]
            seen[rows] = True
            if not np.array_equal(out[rows], one.parameters[:, :3]):
                bad = int(np.flatnonzero((out[rows] != one.parameters[:, :3]).any(axis=1))[0])
                raise InputError(f"camera {cameras.ids[rows[bad]]} has two sets of intrinsics, which BAL cannot hold")
    return out


def _turned(cameras: Variables, kind: VariableKind, rest: Array) -> Variables:
    """Cameras as another kind, looking along the other direction of their axis."""
    turn = so3.compose(cameras.values[:, 3:7], np.broadcast_to(_HALF_TURN, (len(cameras), 4)))
    return replace(cameras, kind=kind, values=np.concatenate([cameras.values[:, :3], turn, rest], axis=1))


def _flipped(information: Array) -> Array:
    """Information of (u, -v)."""
    return information * np.array([[1.0, -1.0], [-1.0, 1.0]])
