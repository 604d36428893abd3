"""BAL's layout with pinhole cameras that share their intrinsics, as files of Gaussian belief propagation have it.

    # comments
    cameras points observations
    fx fy cx cy
    camera point u v                  one line for each observation, pixels from the corner of the image, v down
    ...                               6 numbers for each camera: translation, rotation vector
    ...                               3 numbers for each point

(J. Ortiz, M. Pupilli, S. Leutenegger, A. Davison, "Bundle adjustment on a graph processor", CVPR 2020, and its data
sets.) A camera's rotation and translation take the world into its frame, in which it looks along +z. The intrinsics are
those of a calibrated camera: one variable of the graph that is held unless an option frees it. Camera k has the id k,
point k the id cameras + k, the intrinsics the id cameras + points; every observation has unit information, a standard
deviation of one pixel.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, fields, replace

import numpy as np

from slamcli import models
from slamcli.formats import bal, scenes
from slamcli.formats.number_stream import NumberStream
from slamcli.geometry import so3
from slamcli.graph import Document, FactorGraph, Factors, Variables

NAME = "bal-pinhole"

_HEAD = 16384  # bytes that are looked at
_WHOLE = re.compile(rb"\d+\Z")
_COMMENTS = re.compile(rb"(?:[ \t]*(?:#[^\n]*)?\r?\n)*")
_COUNTS, _INTRINSICS, _CAMERA = 3, 4, 6


@dataclass(eq=False)
class PinholeDocument(Document):
    """The comments in front of the numbers, which are written again."""

    header: bytes = b""


def recognize(data: bytes) -> bool:
    """Whether a text begins as this format does, behind comments: three counts, four numbers, an observation.

    Where the four numbers could be an observation of BAL, it is for the number of all numbers to say.
    """
    head = data[:_HEAD].removeprefix(bal.BOM)
    head = head[_header_end(head) :]
    lines = [line.split() for line in head.splitlines() if line.strip()][:3]
    if len(lines) < 2 or len(lines[0]) != _COUNTS or not all(map(_WHOLE.match, lines[0])) or len(lines[1]) != 4:
        return False
    cameras, points, count = map(int, lines[0])
    if count == 0:
        return len(lines) == 2 or len(lines[2]) == 1
    if len(lines) < 3 or len(lines[2]) < 4 or not _is_index_pair(lines[2]):
        return False
    if not _is_index_pair(lines[1]):
        return True
    if int(lines[1][0]) == 0 or int(lines[1][1]) == 0:
        return False
    start = len(data) - len(data.removeprefix(bal.BOM))
    numbers = len(data[start + _header_end(data[start:]) :].split())
    return numbers == _COUNTS + _INTRINSICS + 4 * count + _CAMERA * cameras + 3 * points


def _is_index_pair(tokens: list[bytes]) -> bool:
    return all(map(_WHOLE.match, tokens[:2]))


def _header_end(data: bytes) -> int:
    found = _COMMENTS.match(data)
    return found.end() if found else 0


def parse(path: str, raw: bytes, data: bytes) -> FactorGraph:
    """The graph of a file.

    Raises
    ------
    InputError
        With line and column, if it is not one.
    """
    start = len(bal.BOM) if data.startswith(bal.BOM) else 0
    header = _header_end(data[start:])
    stream = NumberStream(path, data, start + header)
    names = ("the number of cameras", "the number of points", "the number of observations")
    if len(stream) < _COUNTS:
        raise stream.error(len(stream), f"expected {names[len(stream)]}")
    cameras, points, count = (int(stream.whole(np.array([k]), name)[0]) for k, name in enumerate(names))
    first = _COUNTS + _INTRINSICS
    behind = first + 4 * count
    expected = behind + _CAMERA * cameras + 3 * points
    counts = f"{cameras} cameras, {points} points, {count} observations and fx fy cx cy make {expected} numbers"
    if len(stream) < expected:
        raise stream.error(len(stream), f"expected number {len(stream) + 1} of {expected}", counts)
    if len(stream) > expected:
        raise stream.error(expected, "expected the end of the file", counts)
    for index in (_COUNTS, _COUNTS + 1):
        if not stream.values[index] > 0.0:
            raise stream.error(index, "expected a focal length (a number above 0)")
    at = first + 4 * np.arange(count)
    owners = (stream.whole(at, "the index of a camera", cameras), stream.whole(at + 1, "the index of a point", points))
    motion = stream.values[behind : behind + _CAMERA * cameras].reshape(-1, _CAMERA)
    columns = {
        models.SE3_EXPMAP.name: Variables.made(
            models.SE3_EXPMAP,
            np.arange(cameras),
            bal.values_of(motion[:, 3:], motion[:, :3], np.empty((cameras, 0))),
        ),
        models.XYZ.name: Variables.made(
            models.XYZ,
            cameras + np.arange(points),
            stream.values[behind + _CAMERA * cameras :].reshape(-1, 3).copy(),
        ),
        models.PINHOLE_INTRINSICS.name: replace(
            Variables.made(
                models.PINHOLE_INTRINSICS, np.array([cameras + points]), stream.values[None, _COUNTS:first].copy()
            ),
            fixed=np.array([True]),
        ),
    }
    columns = {name: column for name, column in columns.items() if len(column)}
    rows = np.stack([*owners, np.zeros(count, dtype=np.intp)], axis=1)
    information = np.broadcast_to(np.eye(2), (count, 2, 2))
    lines = data.count(b"\n") + (not data.endswith(b"\n"))
    above = data[: start + header].count(b"\n")
    one_a_line = len(data.rstrip().splitlines()) - above == 2 + count + _CAMERA * cameras + 3 * points
    factors = Factors(
        models.SHARED_PINHOLE_PROJECTION,
        rows,
        stream.values[first:behind].reshape(-1, 4)[:, 2:].copy(),
        information,
        tag=NAME,
        lines=above + 3 + np.arange(count) if one_a_line else np.zeros(count, dtype=np.intp),
    )
    records = {"observations": count, "cameras": cameras, "points": points}
    source = scenes.Source(path, NAME, raw, data, lines, records)
    graph = scenes.of_columns(source, columns, [factors] if count else [])
    assert graph.document is not None
    assert graph.report is not None
    above_lines = data[start : start + header].splitlines()
    graph.report.blank = sum(not line.strip() for line in above_lines)
    graph.report.comments = len(above_lines) - graph.report.blank
    plain = {field.name: getattr(graph.document, field.name) for field in fields(Document)}
    graph.document = PinholeDocument(**plain, header=data[start : start + header])
    return graph


def render(graph: FactorGraph) -> bytes:
    """The text of a graph of cameras with one set of pinhole intrinsics; numbers are the shortest exact ones."""
    cameras = graph.variables[models.SE3_EXPMAP.name].values
    points = graph.variables["XYZ"].values if "XYZ" in graph.variables else np.empty((0, 3))
    rows = np.concatenate([np.empty((0, 2), dtype=np.intp), *(one.indices[:, :2] for one in graph.factors)])
    pixels = np.concatenate([np.empty((0, 2)), *(one.measurements for one in graph.factors)])
    header = graph.document.header if isinstance(graph.document, PinholeDocument) else b""
    parts = [f"{len(cameras)} {len(points)} {len(rows)}"]
    parts.append(" ".join(map(repr, graph.variables[models.PINHOLE_INTRINSICS.name].values[0].tolist())))
    parts += [
        f"{a} {b} {u!r} {v!r}"
        for a, b, u, v in zip(rows[:, 0].tolist(), rows[:, 1].tolist(), *pixels.T.tolist(), strict=True)
    ]
    turn, translation = bal.world_to_camera(cameras)
    for block in (np.concatenate([translation, so3.log(turn)], axis=1), points):
        parts += map(repr, block.ravel().tolist())
    return header + ("\n".join(parts) + "\n").encode()
