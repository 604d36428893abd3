"""PLY files of scenes, for MeshLab, CloudCompare and Blender: points, and a pyramid for each camera or pose.

Binary, little endian. A pyramid has its tip at the place of the camera and opens where it looks: along -z for BAL's
cameras, along +z for g2o's, along +x for poses of robots. Points have the colour that Bundler gave them, else grey;
pyramids are red. (G. Turk, "The PLY Polygon File Format", 1994.)
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli import models
from slamcli.errors import InputError, NumericalError
from slamcli.formats.bundler import BundlerDocument
from slamcli.formats.source import write_bytes
from slamcli.geometry import so3
from slamcli.graph import FactorGraph, Variables
from slamcli.graph.columns import finite_rows
from slamcli.models.base import Array

_GREY, _RED = (160, 160, 160), (220, 50, 32)
#: Height of a pyramid as a share of the middle distance of everything from its middle.
_SHARE = 0.05
#: Tip and corners of a pyramid that opens along +z, in its height, and its four sides and base.
_PYRAMID = np.array([[0, 0, 0], [-0.6, -0.4, 1], [0.6, -0.4, 1], [0.6, 0.4, 1], [-0.6, 0.4, 1]])
_FACES = np.array([[0, 2, 1], [0, 3, 2], [0, 4, 3], [0, 1, 4], [1, 2, 3], [1, 3, 4]])
_VERTEX = np.dtype([("place", "<f4", 3), ("colour", "u1", 3)])
_FACE = np.dtype([("count", "u1"), ("corners", "<i4", 3)])


def write_ply(graph: FactorGraph, path: str) -> None:
    """Write the points and the poses of a graph.

    Parameters
    ----------
    graph
        Planar ones lie in z = 0; variables without an estimate are left out.
    path
        Where to, see ``source.write_bytes``.

    Raises
    ------
    InputError
        If there is nothing to write.
    NumericalError
        If a value is not finite.
    """
    write_bytes(path, render(graph))


def render(graph: FactorGraph) -> bytes:
    """The bytes of the file (see ``write_ply``)."""
    points: list[Array] = [np.empty((0, 3))]
    colours: list[NDArray[np.uint8]] = [np.empty((0, 3), dtype=np.uint8)]
    tips: list[Array] = []
    turns: list[Array] = []
    for name, column in graph.variables.items():
        known = column.known
        if not finite_rows(column.values[known]).all():
            raise NumericalError(f"a {name} is not finite: nothing is written")
        if column.kind.is_point:
            points.append(_places(column)[known])
            colours.append(_colours(graph, column)[known])
        elif column.kind.is_pose:
            tips.append(_places(column)[known])
            turns.append(_to_world(column)[known])
    if sum(len(part) for part in (*points, *tips)) == 0:
        raise InputError("the graph has no point and no pose with an estimate: nothing is written")
    everything = np.concatenate([*points, *tips])
    height = _SHARE * float(np.median(np.linalg.norm(everything - np.median(everything, axis=0), axis=1))) or 1.0
    corners = [
        (tip[:, None, :] + height * np.matmul(_PYRAMID, turn.transpose(0, 2, 1))).reshape(-1, 3)
        for tip, turn in zip(tips, turns, strict=True)
    ]
    place = np.concatenate([*points, *corners])
    colour = np.concatenate([*colours, np.tile(np.array(_RED, dtype=np.uint8), (sum(map(len, corners)), 1))])
    vertices = np.empty(len(place), dtype=_VERTEX)
    vertices["place"], vertices["colour"] = place, colour
    first = sum(map(len, points)) + len(_PYRAMID) * np.arange(sum(map(len, tips)))
    faces = np.empty(len(first) * len(_FACES), dtype=_FACE)
    faces["count"], faces["corners"] = 3, (first[:, None, None] + _FACES).reshape(-1, 3)
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment {sum(map(len, points))} points, then {len(first)} pyramids of poses",
        f"element vertex {len(vertices)}",
        *(f"property float {axis}" for axis in "xyz"),
        *(f"property uchar {colour}" for colour in ("red", "green", "blue")),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    return ("\n".join(header) + "\n").encode() + vertices.tobytes() + faces.tobytes()


def _places(column: Variables) -> Array:
    """Positions (n, 3)."""
    space = column.kind.space
    return np.concatenate([column.values[:, :space], np.zeros((len(column), 3 - space))], axis=1)


def _colours(graph: FactorGraph, column: Variables) -> NDArray[np.uint8]:
    document = graph.document
    if isinstance(document, BundlerDocument) and document.colours is not None and len(document.colours) == len(column):
        return document.colours.astype(np.uint8)
    return np.tile(np.array(_GREY, dtype=np.uint8), (len(column), 1))


def _to_world(column: Variables) -> Array:
    """Rotations (n, 3, 3) that take the pyramid's +z to where each pose looks."""
    if column.kind is models.SE2:
        half = 0.5 * column.values[:, 2]
        zero = np.zeros(len(column))
        turn = so3.to_matrix(np.stack([zero, zero, np.sin(half), np.cos(half)], axis=1))
    else:
        turn = so3.to_matrix(column.values[:, 3:7])
    if column.kind in (models.CAMERA, models.CALIBRATED_CAMERA, models.CAMERA_POSE):
        return turn * [1.0, -1.0, -1.0]
    if column.kind in (models.SBA_CAMERA, models.SE3_EXPMAP):
        return turn
    return np.asarray(turn @ np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]))
