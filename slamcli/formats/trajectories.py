"""Reads and writes trajectories: TUM, KITTI, EuRoC, plain planar tables, and the poses of any graph.

The format is told by content: a file whose records begin with a word is a graph, one whose records are numbers is a
table, and how many numbers a record has says which.

=========  =======================================  ==================================================================
numbers    layout                                   format
=========  =======================================  ==================================================================
8          ``t x y z qx qy qz qw``                  TUM: seconds, metres, unit quaternion with w last
12         ``r11 r12 r13 x r21 ... r33 z``          KITTI: the upper three rows of the pose matrix
3          ``x y theta``                            planar poses; the position in the file, from 0, is the id
4          ``t x y theta``                          planar poses with time stamps, as in UTIAS MRCLAM
8 or 17    ``t,x,y,z,qw,qx,qy,qz,...`` with commas  EuRoC: nanoseconds, metres, quaternion with w first
=========  =======================================  ==================================================================
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from slamcli.errors import InputError, NumericalError, UsageError
from slamcli.formats import scene_formats
from slamcli.formats.diagnostics import ParseError
from slamcli.formats.reader import parse
from slamcli.formats.source import read_bytes, write_bytes
from slamcli.formats.tables import TableText, skipped_notes
from slamcli.formats.writer import format_records
from slamcli.geometry import se2, se3, so3
from slamcli.graph.columns import BoolArray, IndexArray, finite_rows
from slamcli.graph.trajectory import Trajectory, of_graph
from slamcli.models import SE2, SE3
from slamcli.models.base import Array

#: Largest deviation of R^T R from the identity that a pose matrix may have: files are written with a few digits.
ROTATION_TOLERANCE = 1e-3
#: From how far off 1 the length of a quaternion is worth a note.
_LENGTH_TOLERANCE = 1e-2
#: Whole stamps from here on are nanoseconds: as seconds they would be 30 000 years.
_NANOSECONDS = 1e12

_CAUSES = {
    1: "one number a line is a file of time stamps: --timestamps takes it",
    2: "a position without a heading is no pose",
    5: "a heading and a time stamp are t x y theta",
    6: "Euler angles? orientations are quaternions x y z w",
    7: "the time stamp is missing: TUM begins with it (a row number does if there is none)",
    9: "an index column before the time stamp? remove it",
    13: "an index or a time stamp before the matrix? KITTI has neither",
    16: "full 4 x 4 matrices, or decimal commas? KITTI leaves out the last row, 0 0 0 1",
}


@dataclass(frozen=True)
class _Layout:
    """What the numbers of a record mean: makes a trajectory of them, and says which records are no poses."""

    names: str
    columns: int
    decode: Callable[[Array], tuple[Array, Array | None, BoolArray]]
    planar: bool = False
    bad: str = ""
    bad_at: int = 0
    hint: str = ""


def read_trajectory(
    path: str,
    *,
    dialect: str | None = None,
    lenient: bool = False,
    timestamps: str | None = None,
    empty_ok: bool = False,
) -> Trajectory:
    """Read the poses of a graph or of a trajectory file.

    Parameters
    ----------
    path
        A file, or ``-`` for standard input; gzip and the format are recognized by content.
    dialect
        ``"g2o"`` or ``"toro"``: the file is a graph of this dialect.
    lenient
        Skip malformed records instead of raising; ``notes`` or the graph's report says which.
    timestamps
        A file with one time stamp in seconds a line, for the poses in the order of their ids.
    empty_ok
        Return graphs that give no pose a value, which dead reckoning can do something with.

    Returns
    -------
    Trajectory
        Poses of graphs in the order of their ids, those of other files in the order of the file. ``ids`` is None
        for TUM, KITTI and EuRoC; ``stamps`` for KITTI, for ``x y theta`` and for graphs without ``timestamps``.
        Time stamps that stand still or go back are allowed and noted.

    Raises
    ------
    InputError
        If the file cannot be read, is in no known format, or holds no pose; ``ParseError`` with a diagnostic for
        each malformed record.
    UsageError
        If time stamps are given for a file that has its own.
    """
    raw, data = read_bytes(str(path))
    text = None if dialect or scene_formats.recognize(data) else TableText(str(path), data)
    if text is not None and len(text.records) == 0:
        raise InputError(
            f"{path}: holds no record at all",
            ("  expected a graph (g2o, TORO) or a trajectory (TUM, KITTI, EuRoC, x y theta)",),
        )
    if text is None or not text.is_table:
        graph = parse(str(path), raw, data, dialect=dialect, lenient=lenient)
        out = of_graph(graph, str(path))
        if len(out) == 0 and not empty_ok:
            raise InputError(
                f"{path}: holds no pose with a value",
                ("  slamcli optimize --init odometry -o FILE places the poses that only edges name",)
                if graph.poses
                else (),
            )
    else:
        out = _of_table(text, lenient)
    return out if timestamps is None else with_stamps(out, timestamps)


def with_stamps(trajectory: Trajectory, path: str) -> Trajectory:
    """The trajectory with time stamps from a file that has one a line, in the order of the poses.

    Raises
    ------
    InputError
        If the file does not hold one number for each pose.
    UsageError
        If the trajectory has time stamps already.
    """
    if trajectory.stamps is not None:
        raise UsageError(f"{trajectory.source} has time stamps of its own: {path} is of no use")
    text = TableText(str(path), read_bytes(str(path))[1])
    if len(text.records) == 0:
        raise InputError(f"{path}: holds no time stamp")
    if text.columns != 1:
        raise text.refuse("one time stamp in seconds a line", "")
    try:
        stamps = text.read(1, "the time stamp in seconds", lenient=False).numbers[:, 0]
    except ParseError as error:  # its last line offers --lenient, which would leave poses without a stamp
        raise InputError(error.message, error.details[:-1]) from None
    if len(stamps) != len(trajectory):
        raise InputError(
            f"{path}: holds {len(stamps)} time stamps for the {len(trajectory)} poses of {trajectory.source}",
            ("  expected one for each pose, in the order of the ids",),
        )
    notes = _order_notes(str(path), stamps, np.arange(1, len(stamps) + 1))
    return replace(trajectory, stamps=stamps, notes=(*trajectory.notes, *notes))


def form_of_ending(path: str) -> str | None:
    """The format of trajectories that the ending of an output file names, if any."""
    plain = str(path).removesuffix(".gz")
    return next((form for form in ("tum", "kitti") if plain.endswith(f".{form}")), None)


def write_trajectory(trajectory: Trajectory, path: str, form: str | None = None) -> None:
    """Write a trajectory, atomically, in the shortest decimals that read back as the same numbers.

    Parameters
    ----------
    trajectory
        Planar poses are written as spatial ones in the plane z = 0.
    path
        Where to; ``-`` is standard output, ``.gz`` compresses.
    form
        ``"tum"`` or ``"kitti"``. If not given, KITTI for a path that ends in ``.kitti`` and TUM for all others.
        TUM needs time stamps: where there are none the ids take their place, and without ids the position from 0.

    Raises
    ------
    NumericalError
        If a pose is not finite.
    InputError
        If the file cannot be written.
    """
    form = form or form_of_ending(path) or "tum"
    if form not in ("tum", "kitti"):
        raise UsageError(f"unknown format of trajectories {form!r}", ("  one of: tum, kitti",))
    numbers = trajectory.matrices()[:, :3].reshape(-1, 12) if form == "kitti" else trajectory.lifted()
    finite = finite_rows(numbers)
    if not finite.all():
        raise NumericalError(f"pose {int(np.flatnonzero(~finite)[0])} of {trajectory.source} is not finite")
    if form == "kitti":
        rows = format_records(np.empty((len(numbers), 0), dtype=np.int64), numbers)
    elif trajectory.stamps is not None:
        rows = format_records(
            np.empty((len(numbers), 0), dtype=np.int64), np.column_stack([trajectory.stamps, numbers])
        )
    else:
        ids = np.arange(len(trajectory)) if trajectory.ids is None else trajectory.ids
        rows = format_records(ids[:, None], numbers)
    write_bytes(str(path), "".join(f"{row}\n" for row in rows).encode())


# -- tables ------------------------------------------------------------------------------------------------------------


def _of_table(text: TableText, lenient: bool) -> Trajectory:
    layout = _layout(text)
    table = text.read(layout.columns, layout.names, lenient)
    poses, stamps, good = layout.decode(table.numbers)
    defects = [text.defect(line, layout.bad, layout.hint, layout.bad_at) for line in table.lines[~good].tolist()]
    if defects and not lenient:
        raise ParseError(defects)
    skipped = [*table.skipped, *(str(defect) for defect in defects)]
    notes = skipped_notes(text.path, skipped)
    lines, poses = table.lines[good], poses[good]
    if len(poses) == 0:
        raise InputError(f"{text.path}: holds no usable pose", tuple(f"  {note}" for note in notes))
    if stamps is not None:
        stamps = stamps[good]
        notes += _order_notes(text.path, stamps, lines)
    if not layout.planar and layout.columns != 12:
        notes += _length_notes(text.path, table.numbers[good], lines)
    return Trajectory(
        kind=SE2 if layout.planar else SE3,
        poses=poses,
        ids=table.positions[good].astype(np.int64) if layout is _PLANAR else None,
        stamps=stamps,
        source=text.path,
        notes=tuple(notes),
    )


def _layout(text: TableText) -> _Layout:
    """What the columns mean."""
    count = text.columns
    if text.commas and count in (8, 17):
        return _euroc(text, count)
    if count in _LAYOUTS and not text.commas:
        return _LAYOUTS[count]
    if text.commas:
        expected = "8 or 17 numbers between commas (EuRoC) or 3, 4, 8 or 12 between blanks (planar, TUM, KITTI)"
        if text.decimal_commas:
            hint = "decimal commas? numbers need decimal points (write the file in the C locale)"
        elif count in _LAYOUTS:
            hint = "commas instead of blanks? TUM, KITTI and planar tables have blanks"
        else:
            hint = _CAUSES.get(count, "")
        raise text.refuse(expected, hint)
    expected = "3, 4, 8 or 12 numbers (x y theta, t x y theta, TUM, KITTI)"
    raise text.refuse(expected, _CAUSES.get(count, ""))


def _euroc(text: TableText, columns: int) -> _Layout:
    """EuRoC, where the stamps are nanoseconds; seconds between commas could be anything."""
    line = int(text.records[int(text.header)])
    stamp = text.text.token(int(text.text.first[line]))
    nanoseconds = stamp.isdigit() and (float(stamp) >= _NANOSECONDS or b"[ns]" in text.original.data[:1024])
    if not nanoseconds:
        raise text.refuse(
            "nanoseconds in the first column (EuRoC, the only format with commas)",
            "a TUM file with commas? separate its numbers by blanks",
        )
    return replace(_EUROC, columns=columns)


def _decode_tum(numbers: Array) -> tuple[Array, Array | None, BoolArray]:
    poses = se3.normalize(numbers[:, 1:])
    return poses, numbers[:, 0], finite_rows(poses)


def _decode_euroc(numbers: Array) -> tuple[Array, Array | None, BoolArray]:
    poses = se3.normalize(numbers[:, [1, 2, 3, 5, 6, 7, 4]])
    return poses, numbers[:, 0] / 1e9, finite_rows(poses)


def _decode_kitti(numbers: Array) -> tuple[Array, Array | None, BoolArray]:
    matrices = numbers.reshape(-1, 3, 4)
    rotations = matrices[:, :, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.abs(np.matmul(rotations.transpose(0, 2, 1), rotations) - np.eye(3)).max(axis=(1, 2))
        good = (off <= ROTATION_TOLERANCE) & (np.linalg.det(rotations) > 0.0)
    usable = np.where(good[:, None, None], rotations, np.eye(3))
    return np.concatenate([matrices[:, :, 3], so3.from_matrix(usable)], axis=1), None, good


def _decode_planar(numbers: Array) -> tuple[Array, Array | None, BoolArray]:
    return se2.normalize(numbers), None, np.ones(len(numbers), dtype=bool)


def _decode_planar_stamped(numbers: Array) -> tuple[Array, Array | None, BoolArray]:
    return se2.normalize(numbers[:, 1:]), numbers[:, 0], np.ones(len(numbers), dtype=bool)


_ZERO = "the quaternion has length 0 (or overflows), expected a unit quaternion"
_TUM = _Layout("t x y z qx qy qz qw", 8, _decode_tum, bad=_ZERO, bad_at=4, hint="tracking lost? leave such lines out")
_EUROC = _Layout("t,x,y,z,qw,qx,qy,qz", 8, _decode_euroc, bad=_ZERO, bad_at=4, hint=_TUM.hint)
_KITTI = _Layout(
    "r11 r12 r13 x r21 r22 r23 y r31 r32 r33 z",
    12,
    _decode_kitti,
    bad="numbers 1-3, 5-7 and 9-11 are not the rows of a rotation matrix",
    hint="KITTI goes along the rows of the pose matrix: r11 r12 r13 x r21 r22 r23 y r31 r32 r33 z",
)
_PLANAR = _Layout("x y theta", 3, _decode_planar, planar=True)
_PLANAR_STAMPED = _Layout("t x y theta", 4, _decode_planar_stamped, planar=True)
_LAYOUTS = {layout.columns: layout for layout in (_TUM, _KITTI, _PLANAR, _PLANAR_STAMPED)}


def _order_notes(path: str, stamps: Array, lines: IndexArray) -> list[str]:
    """Time stamps that do not increase: allowed, but worth knowing."""
    step = np.diff(stamps)
    out = []
    for what, where in (("go back", step < 0.0), ("stand still", step == 0.0)):
        if where.any():
            line = int(lines[int(np.flatnonzero(where)[0]) + 1])
            more = f" and {count - 1} times more" if (count := np.count_nonzero(where)) > 1 else ""
            out.append(f"{path}:{line}: time stamps {what} here{more}")
    return out


def _length_notes(path: str, numbers: Array, lines: IndexArray) -> list[str]:
    """Quaternions that are far from unit length: normalized, but the columns may be others than they seem."""
    length = np.sqrt(np.square(numbers[:, 4:8]).sum(axis=1))
    off = np.abs(length - 1.0) > _LENGTH_TOLERANCE
    if not off.any():
        return []
    first = int(np.flatnonzero(off)[0])
    return [
        f"{path}:{lines[first]}: the quaternion has length {length[first]:.4g}; {np.count_nonzero(off)} such "
        "quaternions are normalized (are the columns those of the format?)"
    ]
