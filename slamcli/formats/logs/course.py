"""The log of robot mapping courses: ``ODOMETRY rot1 trans rot2`` and ``SENSOR landmark range bearing``.

Each ODOMETRY record is a step; the SENSOR records behind it are readings at its end (rad, m, rad; m, rad). The robot
starts at the origin. A file ``world.dat`` beside the log has the true landmarks, ``id x y``.
"""

from __future__ import annotations

import os

import numpy as np

from slamcli.formats.diagnostics import Diagnostic, ParseError
from slamcli.formats.logs.columns import read_columns
from slamcli.formats.logs.timeline import counted, pose_ids
from slamcli.formats.tables import skipped_notes
from slamcli.formats.tokens import TokenizedText
from slamcli.graph.columns import IdArray, IndexArray
from slamcli.graph.sensor_log import Observations, SensorLog
from slamcli.models import RANGE_BEARING_2D
from slamcli.models.base import Array

FILE = "sensor_data.dat"
_WORLD = "world.dat"
_LAYOUTS = {b"ODOMETRY": "ODOMETRY rot1 trans rot2", b"SENSOR": "SENSOR landmark range bearing"}


def recognizes(words: list[bytes]) -> bool:
    """Whether the words of a file's first record are of this format (iSAM's ODOMETRY has more of them)."""
    return words[0] in _LAYOUTS and len(words) <= 5


def read(path: str, data: bytes, *, lenient: bool = False) -> SensorLog:
    """Read the log of a file that holds ``data``; steps are one second apart.

    Raises
    ------
    InputError
        If ``world.dat`` is malformed; ``ParseError`` with a diagnostic for each malformed record.
    """
    text = TokenizedText(data)
    records, skipped = _records(path, text, lenient)
    (controls, lines), (readings, seen) = records[b"ODOMETRY"], records[b"SENSOR"]
    steps = np.searchsorted(lines, seen)
    landmarks = readings[:, 0].astype(np.int64)
    world, notes = _world(os.path.join(os.path.dirname(path), _WORLD), lenient)
    return SensorLog(
        times=np.arange(len(controls) + 1, dtype=np.float64),
        ids=pose_ids(len(controls) + 1, landmarks),
        model="odometry",
        controls=controls,
        information=None,
        observations=[
            Observations(
                kind=RANGE_BEARING_2D,
                steps=steps,
                landmarks=landmarks,
                measurements=RANGE_BEARING_2D.normalize(readings[:, 1:]),
                information=None,
            )
        ],
        start=np.zeros(3),
        true_landmarks=world,
        source=path,
        notes=[
            *skipped_notes(path, skipped),
            "the log has no clock: steps are one second apart",
            "the start is the origin",
            *counted(np.count_nonzero(readings[:, 1] < 0.0), "ranges are negative"),
            *notes,
        ],
    )


def _records(path: str, text: TokenizedText, lenient: bool) -> tuple[dict[bytes, tuple[Array, IndexArray]], list[str]]:
    """Numbers (m, 3) and lines (from 0) of each tag, and messages of the records that were skipped."""
    defects, ignored = [], []

    def refuse(line: int, token: int, message: str, hint: str = "") -> None:
        column = text.column(line, int(text.token_start[text.first[line] + token]))
        defects.append(Diagnostic(path, line + 1, column, message, text.line(line), hint))
        ignored.append(line)

    tags, index = text.tags
    for line in np.flatnonzero(text.counts > 0)[text.counts[text.counts > 0] != 4].tolist():
        tag = tags[index[line]]
        if tag in _LAYOUTS:
            message = f"{tag.decode()} expects 3 numbers, found {int(text.counts[line]) - 1}"
            refuse(line, 0, message, f"the layout is {_LAYOUTS[tag]}")
    for k, tag in enumerate(tags):
        if tag not in _LAYOUTS:
            word = tag.decode("utf-8", "replace")
            for line in np.flatnonzero(index == k).tolist():
                refuse(line, 0, f"expected ODOMETRY or SENSOR, found {word!r}")
    while True:
        numbers, rows, bad = text.parse(set(_LAYOUTS), np.array(sorted(set(ignored)), dtype=np.intp))
        if not bad:
            break
        for token in bad:
            slot = int(np.searchsorted(text.token_start, token.offset)) - int(text.first[token.line])
            refuse(token.line, slot, f"expected a finite number, found {token.text!r}")
    out = {}
    for tag in _LAYOUTS:
        found = rows.get(tag)
        if found is None or len(found.lines) == 0:
            out[tag] = np.empty((0, 3)), np.empty(0, dtype=np.intp)
        else:
            out[tag] = numbers[found.offsets[:, None] + np.arange(3)], found.lines
    values, lines = out[b"SENSOR"]
    wrong = (values[:, 0] != np.rint(values[:, 0])) | (values[:, 0] < 0.0) | (values[:, 0] >= 2.0**53)
    for line in lines[wrong].tolist():
        refuse(line, 1, "expected the id of a landmark, a whole number from 0 to 2^53 - 1")
    out[b"SENSOR"] = values[~wrong], lines[~wrong]
    if defects and not lenient:
        raise ParseError(sorted(defects, key=lambda defect: (defect.line, defect.column)))
    return out, [str(defect) for defect in defects]


def _world(path: str, lenient: bool) -> tuple[tuple[IdArray, Array] | None, list[str]]:
    if not os.path.exists(path):
        return None, []
    table, ids = read_columns(path, "id x y", lenient).ids(0, "the id of a landmark")
    return (ids, table.numbers[:, 1:]), [*table.notes, f"true landmarks are those of {_WORLD}"]
