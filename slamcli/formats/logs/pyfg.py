"""PyFactorGraph text: records with time stamps and names, the truth in its vertices, covariances in its edges.

=================  ==============================================  ==================================================
record             layout                                          read as
=================  ==============================================  ==================================================
``VERTEX_SE2``     ``t name x y theta``                            true pose
``VERTEX_XY``      ``name x y``                                    true landmark
``EDGE_SE2``       ``t name name x y theta`` and 6 of covariance   odometry between neighbours
``EDGE_SE2_XY``    ``t name name x y`` and 3 of covariance         observation of a landmark
``EDGE_RANGE``     ``t name name range variance``                  range to a landmark
=================  ==============================================  ==================================================

A name is a letter and a number: A12 is pose 12 of robot A. Covariances are upper triangles, row by row.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slamcli.errors import InputError, UsageError
from slamcli.formats.diagnostics import Diagnostic, ParseError
from slamcli.formats.logs.timeline import counted, pose_ids
from slamcli.formats.tables import skipped_notes
from slamcli.formats.tokens import TokenizedText
from slamcli.geometry import se2
from slamcli.graph import FactorGraph, Factors, Variables
from slamcli.graph.columns import BoolArray, IdArray, IndexArray
from slamcli.graph.graph_log import graph_log
from slamcli.graph.sensor_log import SensorLog
from slamcli.graph.trajectory import Trajectory
from slamcli.models import POINT_OBSERVATION_2D, RANGE_2D, RELATIVE_POSE_2D, SE2, XY, FactorKind, VariableKind
from slamcli.models.base import Array
from slamcli.models.information import from_upper_triangle


@dataclass(frozen=True)
class _Tag:
    """Numbers and names behind a tag: how many, and which of them are names (from 0)."""

    size: int
    names: tuple[int, ...]
    layout: str


_TAGS = {
    "VERTEX_SE2": _Tag(5, (1,), "t name x y theta"),
    "VERTEX_XY": _Tag(3, (0,), "name x y"),
    "EDGE_SE2": _Tag(12, (1, 2), "t name name x y theta and 6 numbers of the covariance"),
    "EDGE_SE2_XY": _Tag(8, (1, 2), "t name name x y and 3 numbers of the covariance"),
    "EDGE_RANGE": _Tag(5, (1, 2), "t name name range variance"),
}
_EDGES: tuple[tuple[str, FactorKind], ...] = (
    ("EDGE_SE2", RELATIVE_POSE_2D),
    ("EDGE_SE2_XY", POINT_OBSERVATION_2D),
    ("EDGE_RANGE", RANGE_2D),
)


_NO_NAME = "expected a name, a letter and a number"
#: Metres and radians between a file's poses and its odometry, from which on the poses say more than that.
_TOLERANCE = 1e-5


@dataclass(frozen=True, eq=False)
class Rows:
    """The records of one tag: their numbers (m, size), names as numbers; the names' letters (m, k); lines from 0."""

    numbers: Array
    letters: IndexArray
    lines: IndexArray

    def select(self, keep: BoolArray) -> Rows:
        """Some of them."""
        return Rows(self.numbers[keep], self.letters[keep], self.lines[keep])


@dataclass(frozen=True, eq=False)
class PyFG:
    """The records of a file by tag, what was skipped, and how many records of other tags there are."""

    path: str
    text: TokenizedText
    rows: dict[str, Rows]
    skipped: list[str]
    others: dict[str, int]
    lenient: bool

    def ids(self, tag: str, slot: int) -> IdArray:
        """The numbers in the names of a slot."""
        return self.rows[tag].numbers[:, _TAGS[tag].names[slot]].astype(np.int64)

    def refuse(self, tag: str, bad: BoolArray, message: str, token: int) -> None:
        """Refuse records with a defect at a token behind the tag, or skip them where the reading is lenient."""
        if not bad.any():
            return
        rows = self.rows[tag]
        defects = [_defect(self.path, self.text, line, 1 + token, message) for line in rows.lines[bad].tolist()]
        if not self.lenient:
            raise ParseError(defects)
        self.skipped.extend(map(str, defects))
        self.rows[tag] = rows.select(~bad)


def recognizes(words: list[bytes]) -> bool:
    """Whether the words of a file's first record are of this format: a name where g2o has a number."""
    tag = _TAGS.get(words[0].decode("utf-8", "replace"))
    return tag is not None and len(words) > 1 + tag.names[0] and words[1 + tag.names[0]][:1].isalpha()


def parse(path: str, data: bytes, *, lenient: bool = False) -> PyFG:
    """The records of a file that holds ``data``.

    Raises
    ------
    InputError
        If it holds spatial records; ``ParseError`` with a diagnostic for each malformed record.
    """
    text = TokenizedText(data)
    tags, index = text.tags
    spatial = [tag.decode() for tag in tags if b"SE3" in tag or b"XYZ" in tag]
    if spatial:
        raise InputError(f"{path}: holds spatial records ({spatial[0]}), expected a planar log")
    plain, letters, defects = _without_letters(path, text)
    ignored = [defect.line - 1 for defect in defects]
    found, wrong = _numbers(path, text, plain, ignored)
    defects = sorted(defects + wrong, key=lambda defect: (defect.line, defect.column))
    if defects and not lenient:
        raise ParseError(defects)
    for name, rows in found.items():
        lines, codes = letters[name]
        found[name] = Rows(rows.numbers, codes[np.isin(lines, rows.lines)], rows.lines)
    totals = np.bincount(index[index >= 0], minlength=len(tags)).tolist()
    counts = {tag.decode("utf-8", "replace"): count for tag, count in zip(tags, totals, strict=True)}
    others = {tag: count for tag, count in counts.items() if tag not in _TAGS}
    out = PyFG(path, text, found, [str(defect) for defect in defects], others, lenient)
    for name in found:
        for slot, token in enumerate(_TAGS[name].names):
            number = out.rows[name].numbers[:, token]
            not_names = ~_is_letter(out.rows[name].letters[:, slot]) | (number != np.rint(number)) | (number >= 2.0**53)
            out.refuse(name, not_names, _NO_NAME, token)
    return out


def _without_letters(
    path: str, text: TokenizedText
) -> tuple[bytes, dict[str, tuple[IndexArray, IndexArray]], list[Diagnostic]]:
    """The text with 0 for the letter of each name, which makes it a number at the same place.

    Beside it the lines of each tag with the letters of their names, and what is wrong with the other lines.
    """
    plain, letters = bytearray(text.data), {}
    view = np.frombuffer(plain, dtype=np.uint8)
    tags, index = text.tags
    defects: list[Diagnostic] = []
    for name, tag in _TAGS.items():
        if name.encode() not in tags:
            continue
        lines = np.flatnonzero(index == tags.index(name.encode()))
        fits = text.counts[lines] == 1 + tag.size
        for line in lines[~fits].tolist():
            message = f"{name} expects {tag.size} words, found {int(text.counts[line]) - 1}"
            defects.append(_defect(path, text, line, 0, message, f"the layout is {tag.layout}"))
        lines = lines[fits]
        tokens = text.first[lines][:, None] + 1 + np.array(tag.names)
        short = text.token_stop[tokens] - text.token_start[tokens] < 2
        for row, slot in np.argwhere(short).tolist():
            defects.append(_defect(path, text, int(lines[row]), 1 + tag.names[slot], _NO_NAME))
        letters[name] = lines, view[text.token_start[tokens]].astype(np.intp)
        view[text.token_start[tokens]] = ord("0")
    return bytes(plain), letters, defects


def read(path: str, data: bytes, *, lenient: bool = False, robot: int | None = None) -> SensorLog:
    """Read the log of one robot.

    Parameters
    ----------
    path, data
        The file and what it holds.
    lenient
        Skip malformed records instead of raising.
    robot
        Which one: 1 for the first letter among the poses, 2 for the second, and so on. The first, if not given.

    Returns
    -------
    SensorLog
        Of model ``body``; landmarks have the numbers of their names. Start and truth are those of the
        vertices; there is no true trajectory where their poses are nothing but the odometry, integrated.

    Raises
    ------
    UsageError
        If there is no such robot.
    InputError
        If the file is not what it should be; see ``parse`` and ``graph_log``.
    """
    file = parse(path, data, lenient=lenient)
    if len(_rows(file, "VERTEX_SE2").lines) == 0:
        raise InputError(f"{path}: holds no VERTEX_SE2, the poses of a log")
    codes = np.unique(file.rows["VERTEX_SE2"].letters)
    if robot is not None and not 1 <= robot <= len(codes):
        known = ", ".join(f"{k} ({chr(code)})" for k, code in enumerate(codes.tolist(), 1))
        raise UsageError(f"{path}: holds no robot {robot}", (f"  robots here: {known}",))
    letter = int(codes[(robot or 1) - 1])
    notes: list[str] = []
    if robot is None and len(codes) > 1:
        notes.append(f"robot {chr(letter)} of {len(codes)} robots: --robot takes another one")
    notes += [f"{count} {tag} records are left out" for tag, count in file.others.items()]
    graph, times = _graph(file, letter, notes)
    return _stamped(graph_log(graph), graph, times, path, skipped_notes(path, file.skipped) + notes)


def _stamped(log: SensorLog, graph: FactorGraph, times: Array, path: str, notes: list[str]) -> SensorLog:
    """The log of a file's graph with the times and the truth of its vertices."""
    notes = notes + log.notes[1:]  # (all but that a graph has no clock)
    if (np.diff(times) < 0.0).any():
        notes.append("time stamps of poses go back: the position in the order of the names takes their place")
        times = log.times
    elif times[0] == times[-1]:
        notes.append("all time stamps are the same")
    ids = pose_ids(len(log), graph.variables[XY.name].ids)
    poses, points = graph.variables[SE2.name], graph.variables[XY.name]
    truth: Trajectory | None = Trajectory(SE2, poses.values, ids, times, source=path)
    miss = se2.local(se2.between(poses.values[:-1], poses.values[1:]), log.controls)
    if len(miss) and np.abs(miss).max() < _TOLERANCE:
        truth = None
        notes.append("the poses of the vertices are the odometry, integrated: there is no true trajectory")
    return replace(
        log,
        times=times,
        ids=ids,
        source=path,
        true_trajectory=truth,
        true_landmarks=(points.ids, points.values) if len(points) else None,
        notes=[*notes, "the start is the first pose of the vertices"],
    )


def _graph(file: PyFG, letter: int, notes: list[str]) -> tuple[FactorGraph, Array]:
    """What the file says of one robot as a graph at the truth, poses in order, and their time stamps."""
    rows = file.rows["VERTEX_SE2"]
    rows = rows.select(rows.letters[:, 0] == letter)
    rows = _unique(file, rows, "VERTEX_SE2")
    points = _unique(file, _rows(file, "VERTEX_XY"), "VERTEX_XY")
    if len(np.unique(points.letters)) > 1:
        raise InputError(f"{file.path}: landmarks have names of several letters, expected one")
    variables = {
        SE2.name: _column(SE2, rows.numbers[:, 1], se2.normalize(rows.numbers[:, 2:]), rows.lines),
        XY.name: _column(XY, points.numbers[:, 0], points.numbers[:, 1:], points.lines),
    }
    own = {SE2.name: letter, XY.name: int(points.letters[0, 0]) if len(points.lines) else -1}
    factors = [_factors(file, tag, kind, variables, own, notes) for tag, kind in _EDGES if tag in file.rows]
    return FactorGraph(variables, factors), rows.numbers[:, 0]


def _factors(
    file: PyFG, tag: str, kind: FactorKind, variables: dict[str, Variables], own: dict[str, int], notes: list[str]
) -> Factors:
    """The edges of one tag that join variables of the robot."""
    wanted = np.array([own[variable.name] for variable in kind.variables])
    mine = np.asarray((file.rows[tag].letters == wanted).all(axis=1))
    notes += counted(np.count_nonzero(~mine), f"{tag} records of other robots are left out")
    file.rows[tag] = file.rows[tag].select(mine)
    for slot, variable in enumerate(kind.variables):
        unknown = variables[variable.name].rows_of(file.ids(tag, slot)) < 0
        file.refuse(tag, unknown, "names what no vertex defines", _TAGS[tag].names[slot])
    start = 3 + kind.measurement_size
    covariance = from_upper_triangle(file.rows[tag].numbers[:, start:], kind.dimension)
    singular = np.linalg.eigvalsh(covariance)[:, 0] <= 0.0
    file.refuse(tag, singular, "the covariance is not positive definite", start)
    indices = [variables[v.name].rows_of(file.ids(tag, slot)) for slot, v in enumerate(kind.variables)]
    return Factors(
        kind=kind,
        indices=np.stack(indices, axis=1),
        measurements=kind.normalize(file.rows[tag].numbers[:, 3:start]),
        information=np.asarray(np.linalg.inv(covariance[~singular]), dtype=np.float64),
        tag=tag,
        lines=file.rows[tag].lines + 1,
    )


def _rows(file: PyFG, tag: str) -> Rows:
    none = np.empty((0, len(_TAGS[tag].names)), dtype=np.intp)
    return file.rows.get(tag, Rows(np.empty((0, _TAGS[tag].size)), none, np.empty(0, dtype=np.intp)))


def _unique(file: PyFG, rows: Rows, tag: str) -> Rows:
    """The rows in the order of their numbers; the second of two with one number is a defect."""
    number = rows.numbers[:, _TAGS[tag].names[0]]
    order = np.lexsort((rows.lines, number))
    twice = np.flatnonzero(np.diff(number[order]) == 0.0) + 1
    if len(twice):
        line = int(rows.lines[order[twice[0]]])
        raise ParseError([_defect(file.path, file.text, line, 1 + _TAGS[tag].names[0], "this name is defined twice")])
    return Rows(rows.numbers[order], rows.letters[order], rows.lines[order])


def _column(kind: VariableKind, ids: Array, values: Array, lines: IndexArray) -> Variables:
    none = np.zeros(len(ids), dtype=bool)
    return Variables(kind, ids.astype(np.int64), values, none, ~none, lines + 1)


def _is_letter(code: IndexArray) -> BoolArray:
    lower = code | 32
    return np.asarray((lower >= ord("a")) & (lower <= ord("z")))


def _numbers(
    path: str, text: TokenizedText, plain: bytes, ignored: list[int]
) -> tuple[dict[str, Rows], list[Diagnostic]]:
    """All numbers by tag; ``plain`` is the text with numbers for names."""
    tokens, wanted = TokenizedText(plain), {name.encode() for name in _TAGS}
    defects: list[Diagnostic] = []
    while True:
        numbers, rows, bad = tokens.parse(wanted, np.array(sorted(set(ignored)), dtype=np.intp))
        if not bad:
            break
        for token in bad:
            ignored.append(token.line)
            slot = int(np.searchsorted(text.token_start, token.offset)) - int(text.first[token.line])
            word = text.token(int(text.first[token.line]) + slot).decode("utf-8", "replace")
            defects.append(_defect(path, text, token.line, slot, f"expected a finite number or a name, found {word!r}"))
    out = {}
    for name, found in rows.items():
        size = _TAGS[name.decode()].size
        out[name.decode()] = Rows(
            numbers[found.offsets[:, None] + np.arange(size)] if len(found.lines) else np.empty((0, size)),
            np.empty((len(found.lines), 0), dtype=np.intp),
            found.lines,
        )
    return out, defects


def _defect(path: str, text: TokenizedText, line: int, token: int, message: str, hint: str = "") -> Diagnostic:
    """A defect at a token (from 0, the tag) of a line (from 0)."""
    column = text.column(line, int(text.token_start[text.first[line] + token]))
    return Diagnostic(path, line + 1, column, message, text.line(line), hint)
