"""Bundler's output (``bundle.out``): BAL's cameras with colours of points and keys of features.

    # Bundle file v0.3
    cameras points
    f k1 k2 / R (3 x 3, row by row) / t                 for each camera
    x y z / r g b / n, then n times: camera key u v     for each point

(Snavely, "Bundler: Structure from Motion for Unordered Image Collections", version 0.3 of the format.) Camera model and
pixels are those of BAL. A camera that Bundler could not place is all zeros: it is no vertex of the graph, and is
written as it was. Camera k has the id k, point k the id cameras + k.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from slamcli import models
from slamcli.formats import bal, scenes
from slamcli.formats.number_stream import NumberStream
from slamcli.geometry import so3
from slamcli.graph import Document, FactorGraph, Factors
from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array

NAME = "bundler"
_HEADER = b"# Bundle file v0.3"
_GREY = 128


@dataclass(eq=False)
class BundlerDocument(Document):
    """What the graph does not hold: how many cameras the file has, colours (p, 3) of points, keys (m,) of features."""

    camera_count: int = 0
    colours: IndexArray | None = None
    keys: IndexArray | None = None


def recognize(data: bytes) -> bool:
    """Whether a text begins as Bundler's does."""
    return data.lstrip()[: len(_HEADER)] == _HEADER


def parse(path: str, raw: bytes, data: bytes) -> FactorGraph:
    """The graph of a Bundler file.

    Raises
    ------
    InputError
        With line and column, if it is not one.
    """
    start = data.find(b"\n", data.find(b"#"))
    stream = NumberStream(path, data, len(data) if start < 0 else start)
    if len(stream) < 2:
        raise stream.error(len(stream), f"expected {('the number of cameras', 'the number of points')[len(stream)]}")
    count = int(stream.whole(np.array([0]), "the number of cameras")[0])
    points = int(stream.whole(np.array([1]), "the number of points")[0])
    behind = 2 + 15 * count
    if len(stream) < behind + 7 * points:
        hint = f"{count} cameras and {points} points take at least {behind + 7 * points} numbers"
        raise stream.error(len(stream), f"expected number {len(stream) + 1}", hint)
    table = stream.values[2:behind].reshape(-1, 15)
    placed = np.flatnonzero(table[:, 3:12].any(axis=1))
    first, views = _points(stream, behind, points)
    position = stream.values[first[:, None] + np.arange(3)].reshape(-1, 3)
    colours = stream.whole((first[:, None] + np.arange(3, 6)).ravel(), "a colour", 256).reshape(-1, 3)
    owner = np.repeat(np.arange(points), views)
    entry = first[owner] + 7 + 4 * (np.arange(len(owner)) - np.repeat(np.cumsum(views) - views, views))
    row_of = np.full(count, -1, dtype=np.intp)
    row_of[placed] = np.arange(len(placed))
    camera = row_of[stream.whole(entry, "the index of a camera", count)]
    if (camera < 0).any():
        raise stream.error(int(entry[camera < 0][0]), "expected a camera that has a place", "this one is all zeros")
    rotation = table[placed, 3:12].reshape(-1, 3, 3)
    skewed = np.abs(rotation @ rotation.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2)) > 1e-3
    if skewed.any():
        at = 2 + 15 * int(placed[skewed][0]) + 3
        raise stream.error(at, "expected a rotation matrix", "the rows of this one are not orthogonal unit vectors")
    records = {"cameras": len(placed), "points": points, "observations": len(owner)}
    graph = scenes.graph(
        scenes.Source(path, NAME, raw, data, data.count(b"\n") + (not data.endswith(b"\n")), records),
        camera_ids=placed,
        cameras=bal.from_quaternions(so3.from_matrix(rotation), table[placed, 12:], table[placed, :3]),
        point_ids=count + np.arange(points),
        points=position,
        rows=np.stack([camera, owner], axis=1),
        pixels=stream.values[entry[:, None] + np.arange(2, 4)].reshape(-1, 2),
        lines=np.zeros(len(owner), dtype=np.intp),
    )
    keys = stream.whole(entry + 1, "the key of a feature")
    assert graph.document is not None
    assert graph.report is not None
    plain = {field.name: getattr(graph.document, field.name) for field in fields(Document)}
    graph.document = BundlerDocument(**plain, camera_count=count, colours=colours, keys=keys)
    if count > len(placed):
        graph.report.notes.append(f"{count - len(placed)} of {count} cameras have no place (all zeros): no vertices")
    return graph


def _points(stream: NumberStream, start: int, count: int) -> tuple[IndexArray, IndexArray]:
    """Position (count,) of the first number of each point, and how many views it has."""
    first, views = np.empty(count, dtype=np.intp), np.empty(count, dtype=np.intp)
    at, numbers = start, stream.values
    for k in range(count):
        if at + 7 > len(stream):
            raise stream.error(len(stream), f"expected number {len(stream) + 1}", f"point {k} of {count} is cut off")
        seen = numbers[at + 6]
        if seen != seen // 1 or seen < 0:
            raise stream.error(at + 6, f"expected the number of views of point {k} (a whole number from 0)")
        first[k], views[k] = at, int(seen)
        at += 7 + 4 * int(seen)
    if at > len(stream):
        raise stream.error(len(stream), f"expected number {len(stream) + 1}", "the views of the last point are cut off")
    if at < len(stream):
        raise stream.error(at, "expected the end of the file", f"{count} points end before it")
    return first, views


def render(graph: FactorGraph) -> bytes:
    """The Bundler text of a graph of BAL's cameras (see ``scenes.require``).

    Colours and keys are those of the file that the graph was read from; else points are grey, and keys count the
    observations of each camera.
    """
    cameras, points, rows, pixels = scenes.columns(graph)
    count, ids, keys = len(cameras), np.arange(len(cameras)), None
    colours: IndexArray = np.full((len(points), 3), _GREY)
    document = graph.document
    if isinstance(document, BundlerDocument) and len(document.values.get("XYZ", ())) == len(points):
        assert document.colours is not None
        count, colours = document.camera_count, document.colours
        ids = graph.variables[models.CAMERA.name].ids.astype(np.intp)
        same = len(graph.factors) == len(document.factors) and all(map(_same_rows, graph.factors, document.factors))
        keys = document.keys if same else None
    out = [_HEADER.decode(), f"{count} {len(points)}"]
    turn, translation = bal.world_to_camera(cameras)
    matrices = so3.to_matrix(turn)
    row_of = dict(zip(ids.tolist(), range(len(ids)), strict=True))
    for k in range(count):
        row = row_of.get(k)
        out += ["0 0 0"] * 5 if row is None else _camera(cameras[row, 7:], matrices[row], translation[row])
    out += _point_lines(points, colours, ids[rows[:, 0]] if len(rows) else rows[:, 0], rows, pixels, keys)
    return ("\n".join(out) + "\n").encode()


def _same_rows(one: Factors, other: Factors) -> bool:
    return one.indices is other.indices or np.array_equal(one.indices, other.indices)


def _camera(intrinsics: Array, rotation: Array, translation: Array) -> list[str]:
    return [" ".join(map(repr, row.tolist())) for row in (intrinsics, *rotation, translation)]


def _point_lines(
    points: Array, colours: IndexArray, camera: IndexArray, rows: IndexArray, pixels: Array, keys: IndexArray | None
) -> list[str]:
    """Position, colour and views of each point."""
    if keys is None:  # the number of each observation among those of its camera
        order = np.argsort(camera, kind="stable")
        ranked = camera[order]
        start = np.searchsorted(ranked, ranked)
        counted = np.empty(len(order), dtype=np.intp)
        counted[order] = np.arange(len(order)) - start
        keys = counted
    order = np.argsort(rows[:, 1], kind="stable")
    views = [
        f"{c} {k} {u!r} {v!r}"
        for c, k, u, v in zip(camera[order].tolist(), keys[order].tolist(), *pixels[order].T.tolist(), strict=True)
    ]
    ends = np.searchsorted(rows[order, 1], np.arange(len(points)), side="right").tolist()
    out, begin = [], 0
    for position, colour, end in zip(points.tolist(), colours.tolist(), ends, strict=True):
        out.append(" ".join(map(repr, position)))
        out.append(" ".join(map(str, colour)))
        out.append(" ".join([str(end - begin), *views[begin:end]]))
        begin = end
    return out
