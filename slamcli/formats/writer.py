"""Writes graphs: unchanged records from their original bytes, everything else in shortest exact numbers.

A graph that was read from a file is written by replacing, in that file's text, the records that have changed;
comments, unknown records, order, blanks and line ends stay. Numbers are the shortest decimals that read back as the
same double, so nothing is lost by writing and reading any number of times.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from slamcli.errors import InputError, NumericalError
from slamcli.formats import pinhole_conversion, scene_conversion
from slamcli.formats.dialect import Dialect, EdgeTag, VertexTag
from slamcli.formats.recognize import DIALECTS, by_name
from slamcli.formats.scene_formats import SCENE_FORMATS, SceneFormat
from slamcli.formats.source import write_bytes
from slamcli.graph import Document, FactorGraph, Factors, Variables
from slamcli.graph.columns import BoolArray, IdArray, IndexArray, finite_rows
from slamcli.models.base import Array

_WORD = re.compile(rb"[^\t\n\v\f\r ]+")


@dataclass
class Rendered:
    """A graph as text.

    Attributes
    ----------
    data
        The text.
    losses
        What the dialect cannot express and the text therefore lacks, one sentence each.
    """

    data: bytes
    losses: list[str] = field(default_factory=list)


def write(graph: FactorGraph, path: str, *, dialect: str | None = None, comments: Sequence[str] = ()) -> list[str]:
    """Write a graph to a file (atomically) or to standard output (``-``).

    Parameters
    ----------
    graph
        The graph; variables without an estimate are not written.
    path
        Where to; ``.gz`` compresses.
    dialect
        ``"g2o"``, ``"toro"``, ``"bal"``, ``"bal-pinhole"`` or ``"bundler"``; the format that it was read from, or g2o,
        if not given.
    comments
        Lines behind a graph made in memory. (In front of it GTSAM's reader would find no edges.)

    Returns
    -------
    list of str
        What the dialect could not express.
    """
    rendered = render(graph, dialect, comments)
    write_bytes(str(path), rendered.data)
    return rendered.losses


def render(graph: FactorGraph, dialect: str | None = None, comments: Sequence[str] = ()) -> Rendered:
    """The text of a graph in a dialect (see ``write``)."""
    format = graph.report.format if graph.report is not None else None
    _refuse_not_finite(graph)
    scene = SCENE_FORMATS.get(dialect or format or _scene_of(graph))
    if scene is not None:
        turned, lost = _for_scene_format(graph, scene)
        data, losses = scene.render(turned)
        return Rendered(data, lost + losses)
    shared = pinhole_conversion.is_shared(graph)
    if shared or scene_conversion.is_bal(graph):
        if dialect == "toro":
            raise InputError("toro holds poses only, no cameras: nothing is written")
        turned, lost = (pinhole_conversion.to_sba if shared else scene_conversion.to_g2o)(graph)
        rendered = _fresh(turned, DIALECTS["g2o"], comments)
        return Rendered(rendered.data, lost + rendered.losses)
    own = DIALECTS[format] if format is not None else None
    target = by_name(dialect) if dialect else own or DIALECTS["g2o"]
    if graph.document is None:
        return _fresh(graph, target, comments)
    if target is own:
        return _edited(graph, graph.document, target)
    return _translated(graph, graph.document, target)


def _scene_of(graph: FactorGraph) -> str:
    """Name of the format of scenes that a graph made in memory is written in, if any."""
    if pinhole_conversion.is_shared(graph):
        return "bal-pinhole"
    return "bal" if scene_conversion.is_bal(graph) else ""


def _for_scene_format(graph: FactorGraph, scene: SceneFormat) -> tuple[FactorGraph, list[str]]:
    """A graph with the cameras of a format of scenes, and what it loses."""
    shared = pinhole_conversion.is_shared(graph)
    if scene.name == "bal-pinhole":
        return (graph, []) if shared else pinhole_conversion.to_shared(graph)
    turned, lost = pinhole_conversion.to_sba(graph) if shared else (graph, [])
    if scene_conversion.is_pinhole(turned):
        turned, more = scene_conversion.to_bal(turned)
        return turned, lost + more
    return scene_conversion.to_whole(turned)


def format_records(ids: IdArray, numbers: Array) -> list[str]:
    """One string ``id ... number ...`` for each record; whole numbers without a point, others shortest exact."""
    if len(ids) == 0:
        return []
    # the representation of one big list is made in C; its punctuation then becomes blanks and record ends
    text = repr(list(zip(*ids.T.tolist(), *numbers.T.tolist(), strict=True)))
    text = text[2:-2].replace(".0,", ",").replace(".0)", ")").removesuffix(".0")
    return text.replace(",", "").split(") (")


def _refuse_not_finite(graph: FactorGraph) -> None:
    for column in graph.variables.values():
        bad = column.known & ~finite_rows(column.values)
        if bad.any():
            raise NumericalError(f"vertex {column.ids[bad][0]} is not finite: nothing is written")


def _changed_vertices(graph: FactorGraph, document: Document) -> dict[int, str]:
    """New text of the vertex records whose value has changed, by line."""
    out: dict[int, str] = {}
    assert graph.report is not None
    dialect = DIALECTS[graph.report.format]
    for name, column in graph.variables.items():
        before = document.values.get(name)
        if before is None or column.values is before:
            continue
        known = slice(0, len(before))  # variables that a command added stand behind those of the source
        rows = np.flatnonzero((column.values[known] != before).any(axis=1) & (column.lines[known] > 0))
        for record in dialect.vertices:
            if record.kind is column.kind:
                tags = _original_tags(document, column.lines[rows])
                mine = rows[[tag == record.tag for tag in tags]]
                out.update(zip(column.lines[mine].tolist(), _records_of(record, column, mine), strict=True))
    return out


def _original_tags(document: Document, lines: IndexArray) -> list[str]:
    """First words of the given lines."""
    starts = document.record_spans[0][lines - 1].tolist()
    return [_WORD.match(document.data, start)[0].decode() for start in starts]  # type: ignore[index]


def _new_vertices(graph: FactorGraph, dialect: Dialect) -> list[str]:
    """Records of the variables that have an estimate but no line in the source."""
    out: list[str] = []
    for column in graph.variables.values():
        out += _vertex_records(column, np.flatnonzero(column.known & (column.lines == 0)), dialect)
    return out


def _vertex_records(column: Variables, rows: IndexArray, dialect: Dialect) -> list[str]:
    """Records of some variables, none where the dialect has no tag for them."""
    record = dialect.vertex_tag(column.kind)
    return [] if record is None else _records_of(record, column, rows)


def _records_of(record: VertexTag, column: Variables, rows: IndexArray) -> list[str]:
    return [
        f"{record.tag} {text}" for text in format_records(column.ids[rows, None], record.encode(column.values[rows]))
    ]


def _changed_edges(
    graph: FactorGraph, document: Document, dialect: Dialect
) -> tuple[dict[int, str], IndexArray, list[str]]:
    """New text of the edge records that have changed, by line; the lines that are gone; the records to append.

    Columns that the reader made and nobody replaced cost nothing.
    """
    before = {factors.tag: factors for factors in document.factors}
    kept = {factors.tag: np.zeros(len(factors), dtype=bool) for factors in document.factors}
    changed: dict[int, str] = {}
    added: list[str] = []
    for factors in graph.factors:
        original = before.get(factors.tag)
        if factors is original:
            kept[factors.tag][:] = True
            continue
        rows = _rows_with_line(factors)
        added += _new_edges(graph, factors, dialect)
        if original is None or len(rows) == 0:
            continue
        source = np.minimum(np.searchsorted(original.lines, factors.lines[rows]), len(original) - 1)
        if not np.array_equal(original.lines[source], factors.lines[rows]) or len(np.unique(source)) < len(source):
            raise ValueError(f"the lines of the {factors.tag} edges are not those of the source, once each")
        kept[factors.tag][source] = True
        rows = rows[_differ(factors, rows, original, source)]
        changed.update(
            zip(factors.lines[rows].tolist(), _edge_records(graph, factors.part(rows), dialect), strict=True)
        )
    gone = [factors.lines[~kept[factors.tag]] for factors in document.factors]
    return changed, np.concatenate([np.empty(0, dtype=np.intp), *gone]), added


def _differ(factors: Factors, rows: IndexArray, original: Factors, source: IndexArray) -> BoolArray:
    """Which of some factors say something else than the ones that they come from."""
    out = np.zeros(len(rows), dtype=bool)
    for name in ("indices", "measurements", "information", "parameter_ids"):
        now, then = getattr(factors, name), getattr(original, name)
        if now is not then:
            out |= (now[rows] != then[source]).reshape(len(rows), -1).any(axis=1)
    return out


def _rows_with_line(factors: Factors) -> IndexArray:
    """Factors that have a record in the source; columns made in memory may have no line numbers at all."""
    return np.flatnonzero(factors.lines > 0)


def _new_edges(graph: FactorGraph, factors: Factors, dialect: Dialect) -> list[str]:
    """Records of the factors that have no line in the source."""
    rows = np.setdiff1d(np.arange(len(factors)), _rows_with_line(factors), assume_unique=True)
    return _edge_records(graph, factors.part(rows), dialect) if len(rows) else []


def _record_tag(factors: Factors, dialect: Dialect) -> EdgeTag | None:
    """The tag that writes some factors: their own where the dialect has it."""
    own = (record for record in dialect.edges if record.tag == factors.tag and record.kind is factors.kind)
    return next(own, dialect.edge_tag(factors.kind))


def _edge_records(graph: FactorGraph, factors: Factors, dialect: Dialect) -> list[str]:
    record = _record_tag(factors, dialect)
    if record is None:
        return []
    ids = factors.variable_ids(graph.variables)
    if factors.parameter_ids is not None:
        ids = np.concatenate([ids, factors.parameter_ids[:, None].astype(ids.dtype)], axis=1)
    with np.errstate(all="ignore"):
        numbers = np.concatenate(record.encode(record.kind, factors.measurements, factors.information), axis=1)
    if not np.isfinite(numbers).all():
        bad = int(np.flatnonzero(~finite_rows(numbers))[0])
        raise NumericalError(f"{record.tag} {ids[bad].tolist()} is not finite in {dialect.name}: nothing is written")
    return [f"{record.tag} {text}" for text in format_records(ids, numbers)]


def _parameter_records(graph: FactorGraph, dialect: Dialect) -> list[str]:
    if not dialect.parameters or not graph.parameters:
        return []
    out = []
    for record in dialect.parameters:
        mine = {i: value for i, value in graph.parameters.items() if len(value) == record.kind.size}
        ids = np.array(list(mine), dtype=object)[:, None]
        out += [f"{record.tag} {text}" for text in format_records(ids, np.array(list(mine.values())))]
    return out


def _losses(graph: FactorGraph, dialect: Dialect) -> list[str]:
    """What a dialect cannot express."""
    out = [
        f"{len(column)} {column.kind.name} vertices: {dialect.name} has no such vertex"
        for column in graph.variables.values()
        if dialect.vertex_tag(column.kind) is None
    ]
    out += _edge_losses(graph, dialect)
    if graph.parameters and not dialect.parameters:
        out.append(f"{len(graph.parameters)} parameters: {dialect.name} has none")
    fixed = sum(int(np.count_nonzero(column.fixed)) for column in graph.variables.values())
    if fixed and dialect.fix is None:
        out.append(f"{fixed} fixed vertices: {dialect.name} cannot hold vertices fixed")
    if graph.report is not None and graph.report.format != dialect.name:
        out += [f"{n} {tag} records: not understood, left out" for tag, n in graph.report.skipped.items()]
        if graph.report.malformed:
            out.append(f"{len(graph.report.malformed)} malformed records, left out")
    return out


def _edge_losses(graph: FactorGraph, dialect: Dialect) -> list[str]:
    """Edges that a dialect has no tag for."""
    return [
        f"{len(factors)} {factors.tag or factors.kind.name} edges: {dialect.name} has no such edge"
        for factors in graph.factors
        if dialect.edge_tag(factors.kind) is None
    ]


def _fix_records(graph: FactorGraph, dialect: Dialect) -> list[str]:
    if dialect.fix is None:
        return []
    return [f"{dialect.fix} {i}" for column in graph.variables.values() for i in column.ids[column.fixed].tolist()]


def _fresh(graph: FactorGraph, dialect: Dialect, comments: Sequence[str]) -> Rendered:
    """A text from nothing: parameters, vertices, FIX, edges, comments."""
    records = _parameter_records(graph, dialect)
    for column in graph.variables.values():
        records += _vertex_records(column, np.flatnonzero(column.known), dialect)
    records += _fix_records(graph, dialect)
    for factors in graph.factors:
        records += _edge_records(graph, factors, dialect)
    records += [f"# {comment}" for comment in comments]
    return Rendered("".join(f"{record}\n" for record in records).encode(), _losses(graph, dialect))


def _edited(graph: FactorGraph, document: Document, dialect: Dialect) -> Rendered:
    """The source's text with the records that have changed, without those that are gone, with new ones."""
    changed = _changed_vertices(graph, document)
    edges, gone, added = _changed_edges(graph, document, dialect)
    text = _spliced(document, changed | edges, _new_vertices(graph, dialect), gone.tolist(), added)
    return Rendered(text, _edge_losses(graph, dialect))


def _translated(graph: FactorGraph, document: Document, dialect: Dialect) -> Rendered:
    """The source's text with every record in another dialect; comments and order stay."""
    new: dict[int, str] = {}
    for column in graph.variables.values():
        rows = np.flatnonzero(column.known & (column.lines > 0))
        new.update(zip(column.lines[rows].tolist(), _vertex_records(column, rows, dialect), strict=False))
    for factors in graph.factors:
        rows = _rows_with_line(factors)
        new.update(zip(factors.lines[rows].tolist(), _edge_records(graph, factors.part(rows), dialect), strict=False))
    if dialect.parameters:
        parameters = zip(document.parameter_lines.tolist(), _parameter_records(graph, dialect), strict=False)
        new.update(parameters)
    kept = set(document.comments.tolist())
    gone = [line for line in range(1, len(document.line_start)) if line not in new and line not in kept]
    inserted = _new_vertices(graph, dialect) + (_fix_records(graph, dialect) if len(document.fix_lines) else [])
    added = [record for factors in graph.factors for record in _new_edges(graph, factors, dialect)]
    return Rendered(_spliced(document, new, inserted, gone, added), _losses(graph, dialect))


def _spliced(
    document: Document, new: dict[int, str], inserted: list[str], gone: Sequence[int], added: list[str]
) -> bytes:
    """The source's text with some records replaced and some lines removed.

    ``inserted`` records come before the first edge, ``added`` ones behind the last record; comments at the end of
    the text stay there, since GTSAM reads no planar edge behind a comment.
    """
    if not (new or inserted or gone or added):
        return document.data
    end = b"\r\n" if b"\r\n" in document.data[:4096] else b"\n"
    edits = [
        (int(document.record_spans[0][k - 1]), int(document.record_spans[1][k - 1]), text.encode())
        for k, text in new.items()
    ]
    edits += [(int(document.line_start[k - 1]), int(document.line_start[k]), b"") for k in gone]
    behind = _behind_records(document)
    if inserted:
        at = min(int(document.line_start[document.first_edge_line - 1]), behind)
        start = end if at == len(document.data) and at > 0 and not document.data.endswith(b"\n") else b""
        edits.append((at, at, start + b"".join(text.encode() + end for text in inserted)))
    if behind < len(document.data):
        edits.append((behind, behind, b"".join(text.encode() + end for text in added)))
        added = []
    pieces: list[bytes] = []
    position = 0
    for begin, stop, text in sorted(edits, key=lambda edit: edit[:2]):
        pieces += (document.data[position:begin], text)
        position = stop
    pieces.append(document.data[position:])
    if added:
        last = next((piece for piece in reversed(pieces) if piece), end)
        pieces.append(b"" if last.endswith(b"\n") else end)
        pieces += (text.encode() + end for text in added)
    return b"".join(pieces)


def _behind_records(document: Document) -> int:
    """Offset of the first of the comments and blank lines that end the text."""
    records = np.setdiff1d(np.arange(1, len(document.line_start)), document.comments, assume_unique=True)
    return int(document.line_start[records[-1]]) if len(records) else len(document.data)
