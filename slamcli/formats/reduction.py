"""A graph without some of its variables: their records and those of their edges are cut out of the text.

All other lines stay as they are, byte for byte.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamcli.formats.reader import parse
from slamcli.formats.recognize import DIALECTS
from slamcli.graph import Document, FactorGraph, Variables
from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.models.base import Array


def without(graph: FactorGraph, removed: dict[str, BoolArray], offset: Array | None = None) -> tuple[FactorGraph, int]:
    """The graph without some variables and without the factors that join them.

    Parameters
    ----------
    graph
        All of whose variables have a record, if it was read from a text.
    removed
        One mask for each kind of variable.
    offset
        A constant parameter that the new graph must have, None if it need not.

    Returns
    -------
    graph
        In which variables and factors keep their order.
    parameter
        The id of ``offset`` in it, -1 if that is None.
    """
    parameter, new = _parameter(graph, offset)
    document = graph.document
    if document is None or not _as_read(graph, document):
        out = _columns(graph, removed)
        return replace(out, parameters={**graph.parameters, **new}, document=None), parameter
    assert graph.report is not None
    data = _cut(graph, document, removed)
    end = b"\r\n" if b"\r\n" in data[:4096] else b"\n"
    tags = DIALECTS[graph.report.format].parameters
    if tags:
        for number, values in new.items():
            line = f"{tags[0].tag} {number} " + " ".join(f"{value:.17g}" for value in values.tolist())
            data = line.encode() + end + data
    out = parse(graph.report.path, document.raw, data, dialect=graph.report.format, lenient=True)
    variables = {name: _at_present(column, graph, removed) for name, column in out.variables.items()}
    return replace(out, variables=variables, report=graph.report), parameter


def _as_read(graph: FactorGraph, document: Document) -> bool:
    """Whether every variable and every factor has its line in the text."""
    same = len(graph.factors) == len(document.factors)
    same = same and all(a is b for a, b in zip(graph.factors, document.factors, strict=True))
    return same and all((column.lines > 0).all() for column in graph.variables.values())


def _at_present(column: Variables, graph: FactorGraph, removed: dict[str, BoolArray]) -> Variables:
    """What was read again, with the values that the graph has now."""
    source, kept = graph.variables[column.kind.name], ~removed[column.kind.name]
    if not np.array_equal(source.ids[kept], column.ids):
        raise ValueError("the reduced text does not have the variables that are kept")
    return replace(column, values=source.values[kept], fixed=source.fixed[kept], known=source.known[kept])


def _parameter(graph: FactorGraph, offset: Array | None) -> tuple[int, dict[int, Array]]:
    """Id of a constant parameter, and a new one if no parameter has its value."""
    if offset is None:
        return -1, {}
    for number, values in graph.parameters.items():
        if np.array_equal(values, offset):
            return number, {}
    number = max(graph.parameters, default=-1) + 1
    return number, {number: offset}


def _columns(graph: FactorGraph, removed: dict[str, BoolArray]) -> FactorGraph:
    """The columns without what goes."""
    variables, place = {}, {}
    for name, column in graph.variables.items():
        kept = ~removed[name]
        place[name] = np.cumsum(kept) - 1
        fields = ("ids", "values", "fixed", "known", "lines")
        if kept.any():
            variables[name] = replace(column, **{key: getattr(column, key)[kept] for key in fields})
    factors = []
    joins = _joins(graph, removed)
    for old in graph.factors:
        kinds = old.kind.variables
        rows = np.flatnonzero(~joins[id(old)])
        if len(rows):
            part = old.part(rows)
            indices = np.stack([place[k.name][part.indices[:, s]] for s, k in enumerate(kinds)], axis=1)
            factors.append(replace(part, indices=indices))
    return replace(graph, variables=variables, factors=factors)


def _joins(graph: FactorGraph, removed: dict[str, BoolArray]) -> dict[int, BoolArray]:
    """Which factors join a removed variable, by the identity of their column."""
    out = {}
    for factors in graph.factors:
        mask = np.zeros(len(factors), dtype=bool)
        for slot, kind in enumerate(factors.kind.variables):
            mask |= removed[kind.name][factors.indices[:, slot]]
        out[id(factors)] = mask
    return out


def _cut(graph: FactorGraph, document: Document, removed: dict[str, BoolArray]) -> bytes:
    """The text without the lines of what goes."""
    joins = _joins(graph, removed)
    vertices = np.concatenate([column.lines[removed[name]] for name, column in graph.variables.items()])
    gone = [vertices, *(factors.lines[joins[id(factors)]] for factors in graph.factors)]
    known = [column.lines for column in graph.variables.values()] + [factors.lines for factors in graph.factors]
    known += [document.parameter_lines, document.fix_lines, document.comments]
    lines = np.concatenate([*gone, _data_of(vertices, np.sort(np.concatenate(known)), len(document.line_start) - 1)])
    drop = np.zeros(len(document.line_start), dtype=bool)
    drop[lines[lines > 0]] = True
    fixed = {int(i) for name, column in graph.variables.items() for i in column.ids[removed[name] & column.fixed]}
    replaced = _fix_lines(document, fixed)
    pieces = []
    for line in range(1, len(document.line_start)):
        if line in replaced:
            pieces.append(replaced[line])
        elif not drop[line]:
            pieces.append(document.data[document.line_start[line - 1] : document.line_start[line]])
    return b"".join(pieces)


def _data_of(vertices: IndexArray, known: IndexArray, count: int) -> IndexArray:
    """Lines that are no records of the graph and follow a vertex that goes: what a sensor saw there."""
    other = np.setdiff1d(np.arange(1, count + 1), known)
    before = np.searchsorted(known, other) - 1
    return other[(before >= 0) & np.isin(known[np.maximum(before, 0)], vertices)] if len(known) else other[:0]


def _fix_lines(document: Document, ids: set[int]) -> dict[int, bytes]:
    """FIX lines without the variables that go."""
    if not ids:
        return {}
    out = {}
    for line in document.fix_lines.tolist():
        text = document.data[document.line_start[line - 1] : document.line_start[line]]
        words = text.split()
        kept = [word for word in words[1:] if not (word.lstrip(b"+-").isdigit() and int(word) in ids)]
        if len(kept) < len(words) - 1:
            out[line] = b" ".join([words[0], *kept]) + text[len(text.rstrip()) :] if kept else b""
    return out
