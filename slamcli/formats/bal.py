"""Bundle Adjustment in the Large: cameras, points and observations as one stream of numbers.

    cameras points observations
    camera point u v                  one line for each observation, pixels from the centre of the image, v up
    ...                               9 numbers for each camera: rotation vector, translation, f, k1, k2
    ...                               3 numbers for each point

(Agarwal, Snavely, Seitz, Szeliski, "Bundle Adjustment in the Large", ECCV 2010; the data sets of that name.) A camera's
rotation and translation take the world into its frame; the graph has its pose in the world (see ``models.cameras``).
Camera k has the id k, point k the id cameras + k, so that ids are unique; every observation has unit information, a
standard deviation of one pixel.
"""

from __future__ import annotations

import re

import numpy as np

from slamcli.formats import scenes
from slamcli.formats.number_stream import NumberStream
from slamcli.geometry import so3
from slamcli.graph import FactorGraph
from slamcli.models.base import Array

NAME = "bal"

BOM = b"\xef\xbb\xbf"

_HEAD = 4096  # bytes that are looked at
_WHOLE = re.compile(rb"\d+\Z")


def recognize(data: bytes) -> bool:
    """Whether a text begins as BAL does: a line of three counts, then an observation (or one number, if there is none).

    (A trajectory may begin with three whole numbers, but then has three in its next line.)
    """
    lines = [line.split() for line in data[:_HEAD].removeprefix(BOM).splitlines() if line.strip()][:2]
    if len(lines) < 2 or len(lines[0]) != 3 or not all(map(_WHOLE.match, lines[0])):
        return False
    if int(lines[0][2]) == 0:
        return len(lines[1]) == 1
    return len(lines[1]) >= 4 and all(map(_WHOLE.match, lines[1][:2]))


def parse(path: str, raw: bytes, data: bytes) -> FactorGraph:
    """The graph of a BAL file.

    Raises
    ------
    InputError
        With line and column, if it is not one.
    """
    stream = NumberStream(path, data, len(BOM) if data.startswith(BOM) else 0)
    names = ("the number of cameras", "the number of points", "the number of observations")
    if len(stream) < 3:
        raise stream.error(len(stream), f"expected {names[len(stream)]}")
    cameras, points, count = (int(stream.whole(np.array([k]), name)[0]) for k, name in enumerate(names))
    behind = 3 + 4 * count
    expected = behind + 9 * cameras + 3 * points
    counts = f"{cameras} cameras, {points} points and {count} observations make {expected} numbers"
    if len(stream) < expected:
        raise stream.error(len(stream), f"expected number {len(stream) + 1} of {expected}", counts)
    if len(stream) > expected:
        raise stream.error(expected, "expected the end of the file", counts)
    first = 3 + 4 * np.arange(count)
    rows = np.stack(
        [
            stream.whole(first, "the index of a camera", cameras),
            stream.whole(first + 1, "the index of a point", points),
        ],
        axis=1,
    )
    numbers = stream.values[behind : behind + 9 * cameras].reshape(-1, 9)
    lines = data.count(b"\n") + (not data.endswith(b"\n"))
    one_a_line = lines - len(data[len(data.rstrip()) :].splitlines()[1:]) == 1 + count + 9 * cameras + 3 * points
    line = np.arange(2, 2 + count) if one_a_line else np.zeros(count, dtype=np.intp)
    return scenes.graph(
        scenes.Source(path, NAME, raw, data, lines, {"observations": count, "cameras": cameras, "points": points}),
        camera_ids=np.arange(cameras),
        cameras=values_of(numbers[:, :3], numbers[:, 3:6], numbers[:, 6:]),
        point_ids=cameras + np.arange(points),
        points=stream.values[behind + 9 * cameras :].reshape(-1, 3).copy(),
        rows=rows,
        pixels=stream.values[3:behind].reshape(-1, 4)[:, 2:].copy(),
        lines=line,
    )


def render(graph: FactorGraph) -> bytes:
    """The BAL text of a graph of BAL's cameras (see ``scenes.require``); numbers are the shortest exact ones."""
    cameras, points, rows, pixels = scenes.columns(graph)
    parts = [f"{len(cameras)} {len(points)} {len(rows)}"]
    parts += [
        f"{a} {b} {u!r} {v!r}"
        for a, b, u, v in zip(rows[:, 0].tolist(), rows[:, 1].tolist(), *pixels.T.tolist(), strict=True)
    ]
    turn, translation = world_to_camera(cameras)
    for block in (np.concatenate([so3.log(turn), translation, cameras[:, 7:]], axis=1), points):
        parts += map(repr, block.ravel().tolist())
    return ("\n".join(parts) + "\n").encode()


def values_of(rotation_vector: Array, translation: Array, intrinsics: Array) -> Array:
    """Values (n, 10) of cameras from the rotation vector (n, 3) and translation that take the world into its frame."""
    return from_quaternions(so3.exp(rotation_vector), translation, intrinsics)


def from_quaternions(turn: Array, translation: Array, intrinsics: Array) -> Array:
    """As ``values_of``, from quaternions (n, 4)."""
    back = so3.inverse(turn)
    return np.concatenate([-so3.act(back, translation), back, intrinsics], axis=1)


def world_to_camera(cameras: Array) -> tuple[Array, Array]:
    """Quaternions (n, 4) and translations (n, 3) that take the world into the frames of cameras (n, >= 7)."""
    turn = so3.inverse(cameras[:, 3:7])
    return turn, -so3.act(turn, cameras[:, :3])
