"""Landmark graphs (g2o, TORO) as logs, with the readings of unknown landmarks that g2o's front ends leave.

``DATA_FEATURE_POINTXY parameter level x y i11 i12 i22`` is a point that was seen from the vertex above it in the file,
and of which nobody has said yet which landmark it is. Such records count where a graph has no observation of its own.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamcli.errors import InputError
from slamcli.formats.diagnostics import Diagnostic, ParseError
from slamcli.formats.reader import parse
from slamcli.formats.tables import skipped_notes
from slamcli.formats.tokens import TokenizedText
from slamcli.graph import FactorGraph
from slamcli.graph.columns import IndexArray
from slamcli.graph.graph_log import graph_log
from slamcli.graph.sensor_log import Observations, SensorLog
from slamcli.models import POINT_OBSERVATION_2D, SE2
from slamcli.models.information import from_upper_triangle

_FEATURE = "DATA_FEATURE_POINTXY"
_NUMBERS = 7


def read(path: str, raw: bytes, data: bytes, *, dialect: str | None = None, lenient: bool = False) -> SensorLog:
    """Read the graph of a file, whose bytes are ``raw`` and decompressed ``data``, as a log; see ``graph_log``.

    Raises
    ------
    InputError
        If the file is not a planar graph whose edges join each pose to the next.
    """
    graph = parse(path, raw, data, dialect=dialect, lenient=lenient)
    log = graph_log(graph)
    report = graph.report
    assert report is not None
    skipped = dict(report.skipped)
    notes = [*skipped_notes(path, report.malformed), *report.notes]
    observations = log.observations
    if not observations and _FEATURE in skipped:
        found, messages = _features(path, data, graph, lenient)
        observations = [found]
        del skipped[_FEATURE]
        notes += [*messages, "which landmark a reading is of is not known (landmark -1)"]
    notes += [f"{count} {tag} records are left out" for tag, count in skipped.items()]
    return replace(log, observations=observations, notes=notes + log.notes, source=path)


def _features(path: str, data: bytes, graph: FactorGraph, lenient: bool) -> tuple[Observations, list[str]]:
    """Readings without a landmark, and what to say about records that were skipped."""
    text, tag = TokenizedText(data), _FEATURE.encode()
    poses = graph.variables[SE2.name]
    tags, index = text.tags
    lines = np.flatnonzero(index == tags.index(tag))
    above = np.searchsorted(np.sort(poses.lines[poses.lines > 0]), lines + 1) - 1
    defects = [
        _defect(path, text, line, 0, f"{_FEATURE} expects {_NUMBERS} numbers, found {int(text.counts[line]) - 1}")
        for line in lines[text.counts[lines] != 1 + _NUMBERS].tolist()
    ]
    defects += [
        _defect(path, text, line, 0, f"{_FEATURE} belongs to the vertex above it, and there is none")
        for line in lines[above < 0].tolist()
    ]
    ignored = sorted({defect.line - 1 for defect in defects})
    numbers, rows, bad = text.parse({tag}, np.array(ignored, dtype=np.intp))
    if bad:
        for token in bad:
            slot = int(np.searchsorted(text.token_start, token.offset)) - int(text.first[token.line])
            defects.append(_defect(path, text, token.line, slot, f"expected a finite number, found {token.text!r}"))
        ignored = sorted({defect.line - 1 for defect in defects})
        numbers, rows, _ = text.parse({tag}, np.array(ignored, dtype=np.intp))
    if defects and not lenient:
        raise ParseError(sorted(defects, key=lambda defect: (defect.line, defect.column)))
    if tag not in rows or len(rows[tag].lines) == 0:
        raise InputError(f"{path}: holds no usable {_FEATURE}", tuple(f"  {defect}" for defect in defects[:3]))
    values = numbers[rows[tag].offsets[:, None] + np.arange(_NUMBERS)]
    steps = _steps(graph, rows[tag].lines)
    order = np.argsort(steps, kind="stable")
    found = Observations(
        kind=POINT_OBSERVATION_2D,
        steps=steps[order],
        landmarks=np.full(len(steps), -1, dtype=np.int64),
        measurements=values[order, 2:4],
        information=from_upper_triangle(values[order, 4:], 2),
    )
    return found, skipped_notes(path, [str(defect) for defect in defects])


def _steps(graph: FactorGraph, lines: IndexArray) -> IndexArray:
    """The step of the pose above each line (from 0)."""
    poses = graph.variables[SE2.name]
    known = np.flatnonzero(poses.lines > 0)
    known = known[np.argsort(poses.lines[known])]
    return poses.rank[known[np.searchsorted(poses.lines[known], lines + 1) - 1]]


def _defect(path: str, text: TokenizedText, line: int, token: int, message: str) -> Diagnostic:
    column = text.column(line, int(text.token_start[text.first[line] + token]))
    return Diagnostic(path, line + 1, column, message, text.line(line))
