"""What the formats of bundle adjustment have in common: a graph of cameras, points and what the cameras see."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slamcli import models
from slamcli.errors import InputError
from slamcli.graph import Document, FactorGraph, Factors, ReadingReport, Variables
from slamcli.graph.columns import IdArray, IndexArray
from slamcli.graph.depths import depths
from slamcli.models.base import Array


@dataclass(frozen=True)
class Source:
    """Where a scene was read from: file, format, bytes as they are and decompressed, lines, records by sort."""

    path: str
    format: str
    raw: bytes
    data: bytes
    lines: int
    records: dict[str, int]


def graph(
    source: Source,
    *,
    camera_ids: IdArray,
    cameras: Array,
    point_ids: IdArray,
    points: Array,
    rows: IndexArray,
    pixels: Array,
    lines: IndexArray,
) -> FactorGraph:
    """The graph of a scene.

    Parameters
    ----------
    source
        Where it is from.
    camera_ids, cameras
        (n,) and (n, 10) values of ``models.CAMERA``.
    point_ids, points
        (p,) and (p, 3).
    rows
        (m, 2) rows of camera and point of each observation.
    pixels
        (m, 2) from the centre of the image, v up.
    lines
        (m,) line of each observation, 0 where it has none.

    Raises
    ------
    InputError
        If there is neither a camera nor a point.
    """
    if len(cameras) + len(points) == 0:
        raise InputError(f"{source.path}: holds no camera and no point")
    columns = {
        kind.name: Variables.made(kind, ids, values)
        for kind, ids, values in ((models.CAMERA, camera_ids, cameras), (models.XYZ, point_ids, points))
        if len(ids)
    }
    information = np.broadcast_to(np.eye(2), (len(rows), 2, 2))
    factors = [Factors(models.BAL_PROJECTION, rows, pixels, information, tag=source.format, lines=lines)]
    return of_columns(source, columns, factors if len(rows) else [])


def of_columns(source: Source, columns: dict[str, Variables], factors: list[Factors]) -> FactorGraph:
    """The graph of the variables and the observations of a scene, with its document and report."""
    none = np.empty(0, dtype=np.intp)
    document = Document(
        raw=source.raw,
        data=source.data,
        spans=lambda: (none, none),
        line_start=np.array([0, len(source.data)]),
        comments=none,
        parameter_lines=none,
        fix_lines=none,
        first_edge_line=1,
        values={name: column.values for name, column in columns.items()},
        factors=tuple(factors),
    )
    report = ReadingReport(source.path, source.format, lines=source.lines, by_tag=source.records)
    out = FactorGraph(columns, factors, {}, document, report)
    report.notes += _oddities(out)
    return out


def _oddities(scene: FactorGraph) -> list[str]:
    """What a user should know about the views of a scene, one sentence each."""
    if not scene.factors:
        return []
    factors, out = scene.factors[0], []
    depth = depths(factors, scene.values)
    if behind := int(np.count_nonzero(depth <= 0.0)):
        out.append(f"{behind} of {len(depth)} observations are of points behind their camera")
    views = np.bincount(factors.indices[:, 1], minlength=scene.landmarks)
    if few := int(np.count_nonzero(views < 2)):
        what = "1 point is seen fewer than twice: its" if few == 1 else f"{few} points are seen fewer than twice: their"
        out.append(f"{what} distance is not determined")
    pair = factors.indices[:, 0] * (scene.landmarks + 1) + factors.indices[:, 1]
    if repeated := len(pair) - len(np.unique(pair)):
        what = "1 observation repeats" if repeated == 1 else f"{repeated} observations repeat"
        out.append(f"{what} an earlier one of the same camera and point: each counts")
    if idle := scene.poses - len(np.unique(factors.indices[:, 0])):
        out.append(f"{idle} camera{'s see' if idle > 1 else ' sees'} nothing")
    return out


def unchanged(scene: FactorGraph) -> bool:
    """Whether a graph that was read is as it was in its file."""
    document = scene.document
    if document is None or document.values.keys() != scene.variables.keys():
        return False
    same = (scene.variables[name].values is values for name, values in document.values.items())
    return all(same) and len(scene.factors) == len(document.factors) and all(map(_is, scene.factors, document.factors))


def _is(one: Factors, other: Factors) -> bool:
    return one is other


def require(scene: FactorGraph, name: str, projection: models.Projection) -> None:
    """Refuse what a format of one kind of camera, that of a projection, cannot express.

    Raises
    ------
    InputError
        Naming it.
    """
    kinds = [kind.name for kind in projection.variables]
    bad = [f"{len(c)} {k} vertices" for k, c in scene.variables.items() if k not in kinds]
    bad += [f"{len(f)} {f.tag or f.kind.name} edges" for f in scene.factors if f.kind is not projection]
    if bad:
        raise InputError(
            f"{name} holds cameras, points and their observations only, not {', '.join(bad)}: nothing is written"
        )


def losses(scene: FactorGraph, name: str) -> list[str]:
    """What a graph of cameras and points loses in a format of scenes, one sentence each."""
    out = []
    if weighted := sum(int((f.information != np.eye(2)).any(axis=(1, 2)).sum()) for f in scene.factors):
        out.append(f"the information of {weighted} observations: {name} has none, all count the same")
    if fixed := sum(int(c.fixed.sum()) for c in scene.variables.values() if c.kind not in models.INTRINSICS):
        out.append(f"{fixed} fixed vertices: {name} cannot hold vertices fixed")
    return out


def columns(scene: FactorGraph) -> tuple[Array, Array, IndexArray, Array]:
    """Cameras (n, 10), points (p, 3), rows (m, 2) and pixels (m, 2) of a scene."""
    cameras = scene.variables[models.CAMERA.name].values if models.CAMERA.name in scene.variables else np.empty((0, 10))
    points = scene.variables["XYZ"].values if "XYZ" in scene.variables else np.empty((0, 3))
    rows = np.concatenate([np.empty((0, 2), dtype=np.intp), *(factors.indices for factors in scene.factors)])
    pixels = np.concatenate([np.empty((0, 2)), *(factors.measurements for factors in scene.factors)])
    return cameras, points, rows, pixels
