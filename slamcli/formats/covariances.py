"""Covariances of poses and landmarks, read: npz archives, CSV with the upper triangle of each matrix, or JSON.

An archive holds ``ids`` (n,), ``covariance`` (n, d, d) and ``frame``, the text ``local``; where it has variables of
several kinds, ``kinds`` names them, and those of the second and further kinds K are in ``K_ids`` and
``K_covariance``. A row of a CSV file is ``id,c11,c12,...,c22,...``, row by row; a header of words may stand above. A
JSON file is the document of ``slamcli covariance``. The matrices are those of the tangent vector of
``VariableKind.retract``, in the frame of the pose: (x, y, theta) in metres and radians for planar poses, the
translation and the vector part of the quaternion for spatial ones. Those of landmarks are along the world's axes.
Files in another convention say so, and are refused.
"""

from __future__ import annotations

import io
import json
import re
import zipfile
from dataclasses import dataclass

import numpy as np

from slamcli.errors import InputError
from slamcli.formats.source import read_bytes, write_bytes
from slamcli.formats.tables import TableText
from slamcli.graph.columns import IdArray
from slamcli.models.base import Array

#: Numbers of a CSV row, and the size of the matrix that it holds: an id and an upper triangle.
_SIZES = {1 + d * (d + 1) // 2: d for d in (2, 3, 6)}
_ASYMMETRY = 1e-9
#: The convention of what slamcli reads: tangent spaces of ``VariableKind.retract``.
OWN = "slamcli"
_CONVENTION = re.compile(rb"^# convention: ([\w-]+)", re.MULTILINE)


@dataclass(frozen=True, eq=False)
class Covariances:
    """Covariances of poses or landmarks.

    Attributes
    ----------
    ids
        (n,) unique ids.
    covariance
        (n, d, d) symmetric matrices in the frame of each pose (of the world for landmarks), d = 2, 3 or 6.
    path
        Where they come from, for messages.
    """

    ids: IdArray
    covariance: Array
    path: str = ""


def read_covariances(path: str) -> Covariances:
    """Read the covariances of variables: those of the first kind, where a file has several.

    Raises
    ------
    InputError
        If the file cannot be read or does not hold what it should.
    """
    return read_all_covariances(path)[0]


def read_all_covariances(path: str) -> list[Covariances]:
    """Read the covariances of variables, one entry for each kind that the file has.

    Raises
    ------
    InputError
        If the file cannot be read or does not hold what it should.
    """
    try:
        is_archive = path != "-" and zipfile.is_zipfile(path)
    except OSError:
        is_archive = False  # the reader of text says why it cannot be read
    if is_archive:
        found = _read_archive(path)
    else:
        data = read_bytes(path)[1]
        found = _read_json(path, data) if data.lstrip().startswith(b"{") else [_read_csv(path, data)]
    for one in found:
        _check(one)
    return found


def _check(found: Covariances) -> None:
    """Unique ids, finite symmetric matrices."""
    if len(np.unique(found.ids)) < len(found.ids):
        raise InputError(f"{found.path}: an id occurs twice")
    finite = np.isfinite(found.covariance).all(axis=(1, 2))
    if not finite.all():
        raise InputError(f"{found.path}: the covariance of variable {found.ids[~finite][0]} is not finite")
    size = np.abs(found.covariance).max(axis=(1, 2))
    skew = np.abs(found.covariance - found.covariance.transpose(0, 2, 1)).max(axis=(1, 2)) > _ASYMMETRY * size
    if skew.any():
        raise InputError(f"{found.path}: the covariance of variable {found.ids[skew][0]} is not symmetric")


def write_covariances(path: str, ids: IdArray, covariance: Array) -> None:
    """Write covariances (n, d, d) of variables (n,), each in its own frame, as an npz archive, atomically.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    buffer = io.BytesIO()
    np.savez(buffer, ids=ids, covariance=covariance, frame=np.array("local"))
    write_bytes(path, buffer.getvalue())


def write_correlation(path: str, landmarks: IdArray, correlation: Array) -> None:
    """Write the correlation matrix (3 + 2 k, 3 + 2 k) of a pose (x, y, theta) and k landmarks as an npz archive.

    It holds ``correlation`` and ``names``, such as ``theta`` and ``17 x``, of its rows and columns.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    names = ["x", "y", "theta", *(f"{landmark} {axis}" for landmark in landmarks.tolist() for axis in "xy")]
    buffer = io.BytesIO()
    np.savez(buffer, names=np.array(names), correlation=correlation)
    write_bytes(path, buffer.getvalue())


def _read_archive(path: str) -> list[Covariances]:
    try:
        with np.load(path, allow_pickle=False) as archive:
            content = {name: archive[name] for name in archive.files}
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: is not a readable npz archive: {error}") from None
    missing = [name for name in ("ids", "covariance", "frame") if name not in content]
    if missing:
        raise InputError(
            f"{path}: lacks {' and '.join(missing)}",
            (f"  it holds {', '.join(content) or 'nothing'}", "  expected ids (n,), covariance (n, d, d), frame"),
        )
    _require_own(path, str(content.get("convention", OWN)))
    frame = str(content["frame"])
    if frame != "local":
        raise InputError(f"{path}: the frame is {frame!r}, expected 'local' (the tangent space at each pose)")
    others = [str(kind) for kind in np.atleast_1d(content.get("kinds", []))[1:]]
    names = [("ids", "covariance"), *((f"{kind}_ids", f"{kind}_covariance") for kind in others)]
    absent = [name for pair in names for name in pair if name not in content]
    if absent:
        raise InputError(f"{path}: lacks {' and '.join(absent)}", (f"  it names the kinds {', '.join(others)}",))
    return [_checked(path, content[ids], content[covariance]) for ids, covariance in names]


def _read_json(path: str, data: bytes) -> list[Covariances]:
    try:
        document = json.loads(data)
        tables = [(table["ids"], table["covariance"]) for table in document["marginals"]]
        convention = document.get("convention", OWN)
    except (ValueError, KeyError, TypeError):
        tables, convention = [], OWN
    if not tables:
        raise InputError(f"{path}: is not the document of slamcli covariance: it has no marginals")
    _require_own(path, str(convention))
    out = []
    for ids, covariance in tables:
        try:
            out.append(_checked(path, np.array(ids), np.array(covariance, dtype=np.float64)))
        except (ValueError, TypeError):
            raise InputError(f"{path}: ids and covariance must be lists of numbers") from None
    return out


def _checked(path: str, ids: Array | IdArray, covariance: Array) -> Covariances:
    if ids.ndim != 1 or ids.dtype.kind not in "iu":
        raise InputError(f"{path}: ids must be whole numbers (n,), found {ids.dtype} {ids.shape}")
    shapes = [(len(ids), d, d) for d in _SIZES.values()]
    if covariance.dtype.kind not in "fiu" or covariance.shape not in shapes:
        raise InputError(f"{path}: covariance must be {' or '.join(map(str, shapes))}, found {covariance.shape}")
    whole = ids.astype(np.uint64 if ids.dtype == np.uint64 else np.int64)
    return Covariances(whole, covariance.astype(np.float64), path)


def _require_own(path: str, convention: str) -> None:
    if convention != OWN:
        raise InputError(
            f"{path}: holds covariances in the convention of {convention}, expected {OWN}",
            ("  slamcli covariance --convention slamcli writes those that slamcli reads",),
        )


def _read_csv(path: str, data: bytes) -> Covariances:
    text = TableText(path, data)
    if not text.is_table:
        raise InputError(f"{path}: holds no covariance, expected an npz archive or CSV rows id,c11,c12,...")
    stated = _CONVENTION.search(data)
    _require_own(path, stated[1].decode() if stated else OWN)
    if text.columns not in _SIZES:
        raise text.refuse("4, 7 or 22 numbers: an id and the upper triangle of a 2 x 2, 3 x 3 or 6 x 6 matrix", "")
    dimension = _SIZES[text.columns]
    table = text.read(text.columns, "id,c11,c12,..., the upper triangle row by row", lenient=False, header=True)
    ids = table.numbers[:, 0].astype(np.int64)
    if (ids != table.numbers[:, 0]).any():
        wrong = int(np.flatnonzero(ids != table.numbers[:, 0])[0])
        raise InputError(f"{path}:{table.lines[wrong]}:1: expected an id, found {table.numbers[wrong, 0]!r}")
    covariance = np.empty((len(ids), dimension, dimension))
    rows, columns = np.triu_indices(dimension)
    covariance[:, rows, columns] = covariance[:, columns, rows] = table.numbers[:, 1:]
    return Covariances(ids, covariance, path)
