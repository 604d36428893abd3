"""Labels of edges: which edges of a graph file are outliers, as a CSV file or a plain list of pairs.

The CSV file has one row for each edge record of the graph file that it belongs to, in the order of that file, under the
header ``edge,tag,from,to,label``: the position of the record among the edge records (from 1), its tag, its ids (a
prior, which has one, repeats it; of a switchable edge those of its poses) and ``inlier`` or ``outlier``. Plain lists,
as other tools write them, name only the outliers: ``from to`` on each line, ``#`` starts a comment.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slamcli.errors import InputError
from slamcli.formats.diagnostics import Diagnostic
from slamcli.formats.records import is_id
from slamcli.formats.source import read_bytes, write_bytes
from slamcli.graph import FactorGraph, Factors
from slamcli.graph.columns import BoolArray, IdArray, IndexArray

HEADER = ("edge", "tag", "from", "to", "label")
_REQUIRED = ("from", "to", "label")
_LABELS = ("inlier", "outlier")
_WORD = re.compile(rb"[^\s,]+")


@dataclass(frozen=True, eq=False)
class Labels:
    """What is known about the edges of a graph file.

    Attributes
    ----------
    first, second
        (k,) ids of the edges' variables as in the graph file, int64 (uint64 where there are ids of 2^63 and more).
    outlier
        (k,) True for outliers.
    edge
        (k,) int64 position of the edge among the edge records of its file, from 1; 0 where it is not stated.
    complete
        Whether the file says of each edge that it names what it is (True), or names the outliers only (False), so that
        the edges it does not name are inliers.
    """

    first: IdArray
    second: IdArray
    outlier: BoolArray
    edge: IndexArray
    complete: bool

    def __len__(self) -> int:
        return len(self.first)


def edge_positions(graph: FactorGraph) -> list[IndexArray]:
    """Position of every edge among the edge records of the file that ``formats.write`` makes of a graph.

    Edges that have a line in the graph's document keep their order there; the others follow, column after column.

    Returns
    -------
    list of (m,) arrays
        From 1, one array for each column of factors.
    """
    sizes = [len(factors) for factors in graph.factors]
    if graph.document is None:
        key = np.zeros(sum(sizes), dtype=np.intp)
    else:
        key = np.concatenate(
            [np.empty(0, dtype=np.intp), *(_lines(factors.lines, len(factors)) for factors in graph.factors)]
        )
        key[key == 0] = np.iinfo(np.intp).max
    position = np.empty(len(key), dtype=np.intp)
    position[np.argsort(key, kind="stable")] = np.arange(1, len(key) + 1)
    return np.split(position, np.cumsum(sizes)[:-1]) if sizes else []


def labels_of(graph: FactorGraph, outliers: Sequence[BoolArray]) -> tuple[Labels, list[str]]:
    """The complete labels of a graph and the tags of their rows, for ``write_labels``.

    Parameters
    ----------
    graph
        As it is written.
    outliers
        One mask for each column of factors.
    """
    if not graph.factors:
        none = np.empty(0, dtype=np.int64)
        return Labels(none, none, none.astype(bool), none, True), []
    ids = [_ends(graph, factors) for factors in graph.factors]
    edge = np.concatenate(edge_positions(graph))
    order = np.argsort(edge)
    tags = np.repeat(
        np.array([factors.tag or factors.kind.name for factors in graph.factors], dtype=object),
        [len(factors) for factors in graph.factors],
    )
    labels = Labels(
        first=np.concatenate([pair[:, 0] for pair in ids])[order],
        second=np.concatenate([pair[:, 1] for pair in ids])[order],
        outlier=np.concatenate([np.asarray(mask, dtype=bool) for mask in outliers])[order],
        edge=edge[order],
        complete=True,
    )
    return labels, tags[order].tolist()


def outlier_masks(labels: Labels, graph: FactorGraph, path: str = "labels") -> list[BoolArray]:
    """Which edges of a graph are outliers, one mask for each column of factors.

    Rows that state a position are matched by it. The others name all edges between their two ids, in either
    direction; edges that no row names are inliers.

    Raises
    ------
    InputError
        If a row names an edge that the graph does not have: the labels belong to another file.
    """
    ids = [_ends(graph, factors) for factors in graph.factors]
    pairs = np.concatenate(ids) if ids else np.empty((0, 2), dtype=labels.first.dtype)
    positions = edge_positions(graph)
    where = np.full(len(pairs) + 1, -1, dtype=np.intp)
    if positions:
        where[np.concatenate(positions)] = np.arange(len(pairs))
    out = np.zeros(len(pairs), dtype=bool)
    stated = labels.edge > 0
    beyond = labels.edge > len(pairs)
    rows = where[np.where(beyond | ~stated, 0, labels.edge)]
    if stated.any():
        same = (
            ~beyond & (pairs[rows] == np.stack([labels.first, labels.second], axis=1)).all(axis=1)
            if len(pairs)
            else ~stated & False
        )
        wrong = stated & ~same
        if wrong.any():
            raise _other_graph(labels, int(np.flatnonzero(wrong)[0]), path)
        out[rows[stated]] = labels.outlier[stated]
    if not stated.all():
        table: dict[tuple[int, int], list[int]] = {}
        for row, (a, b) in enumerate(np.sort(pairs, axis=1).tolist()):
            table.setdefault((a, b), []).append(row)
        for k in np.flatnonzero(~stated).tolist():
            a, b = sorted((int(labels.first[k]), int(labels.second[k])))
            if (a, b) not in table:
                raise _other_graph(labels, k, path)
            out[table[a, b]] = labels.outlier[k]
    return np.split(out, np.cumsum([len(pair) for pair in ids])[:-1]) if ids else []


def write_labels(path: str, labels: Labels, tags: Sequence[str]) -> None:
    """Write labels as CSV, atomically; ``-`` is standard output, ``.gz`` compresses.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    words = np.array(_LABELS, dtype=object)[labels.outlier.astype(np.intp)].tolist()
    columns = (labels.edge.tolist(), tags, labels.first.tolist(), labels.second.tolist(), words)
    rows = [",".join(HEADER)]
    rows += [f"{edge},{tag},{i},{j},{label}" for edge, tag, i, j, label in zip(*columns, strict=True)]
    write_bytes(path, "".join(f"{row}\n" for row in rows).encode())


def read_labels(path: str) -> Labels:
    """Read labels: CSV with a header, or a plain list of the outliers' pairs of ids.

    Raises
    ------
    InputError
        If the file cannot be read or a line is not what it should be, with file, line and column.
    """
    data = read_bytes(path)[1].removeprefix(b"\xef\xbb\xbf")
    lines = [(k, line) for k, line in enumerate(data.splitlines(), 1) if line.partition(b"#")[0].strip()]
    if lines and b"," in lines[0][1]:
        return _read_table(path, lines)
    rows = []
    for number, line in lines:
        words = _WORD.findall(line.partition(b"#")[0])
        if len(words) != 2:
            expected = "expected the two ids of an outlier, or the header edge,tag,from,to,label"
            raise _defect(path, number, line, 0, f"{expected}, found {len(words)} words")
        rows.append([_whole(path, number, line, slot, word) for slot, word in enumerate(words)])
    first, second = _id_columns(path, rows)
    return Labels(first, second, np.ones(len(rows), dtype=bool), np.zeros(len(rows), dtype=np.intp), False)


def _read_table(path: str, lines: list[tuple[int, bytes]]) -> Labels:
    """The CSV file; ``lines`` are numbered and not blank."""
    number, head = lines[0]
    names = [name.strip().decode("utf-8", "replace") for name in head.split(b",")]
    for slot, name in enumerate(names):
        if name not in HEADER or name in names[:slot]:
            raise _defect(path, number, head, slot, f"expected a header of {','.join(HEADER)}, found {name!r}")
    for name in _REQUIRED:
        if name not in names:
            raise _defect(path, number, head, 0, f"the header lacks {name!r}")
    cells = []
    for number, line in lines[1:]:
        words = [word.strip() for word in line.split(b",")]
        if len(words) != len(names):
            raise _defect(path, number, line, 0, f"expected {len(names)} columns, found {len(words)}")
        cells.append(words)
    columns = dict(zip(names, zip(*cells, strict=True) if cells else [()] * len(names), strict=True))
    outlier = np.array([word == b"outlier" for word in columns["label"]], dtype=bool)
    for k, word in enumerate(columns["label"]):
        if not outlier[k] and word != b"inlier":
            number, line = lines[1 + k]
            found = word.decode("utf-8", "replace")
            raise _defect(path, number, line, names.index("label"), f"expected inlier or outlier, found {found!r}")
    whole = {
        name: [_whole(path, *lines[1 + k], names.index(name), word) for k, word in enumerate(columns[name])]
        for name in ("from", "to", "edge")
        if name in names
    }
    edge = whole.get("edge", [0] * len(cells))
    seen: set[int] = set()
    for k, position in enumerate(edge):
        if "edge" in names and (position < 1 or position in seen):
            message = f"positions count from 1, found {position}" if position < 1 else f"edge {position} is named twice"
            raise _defect(path, *lines[1 + k], names.index("edge"), message)
        seen.add(position)
    first, second = _id_columns(path, list(zip(whole["from"], whole["to"], strict=True)))
    return Labels(first, second, outlier, np.array(edge, dtype=np.intp), True)


def _id_columns(path: str, rows: Sequence[Sequence[int]]) -> tuple[IdArray, IdArray]:
    """Two columns of ids, int64 where they fit and uint64 otherwise."""
    low = min((min(row) for row in rows), default=0)
    high = max((max(row) for row in rows), default=0)
    if low < 0 and high >= 2**63:
        raise InputError(f"{path}: holds negative ids and ids of 2^63 and more; 64 bits cannot tell both apart")
    ids = np.array(rows, dtype=np.uint64 if high >= 2**63 else np.int64).reshape(-1, 2)
    return ids[:, 0], ids[:, 1]


def _whole(path: str, number: int, line: bytes, slot: int, word: bytes) -> int:
    """A whole number of 64 bits."""
    if not is_id(word):
        found = word.decode("utf-8", "replace")
        raise _defect(path, number, line, slot, f"expected a whole number, found {found!r}")
    return int(word)


def _ends(graph: FactorGraph, factors: Factors) -> IdArray:
    """The ids (m, 2) that name edges: those of the first two variables; a prior's twice."""
    ids = factors.variable_ids(graph.variables)
    return ids[:, [0, min(1, ids.shape[1] - 1)]]


def _lines(lines: IndexArray, count: int) -> IndexArray:
    """Line numbers of a column; columns made in memory may have none."""
    return lines if len(lines) == count else np.zeros(count, dtype=np.intp)


def _defect(path: str, number: int, line: bytes, slot: int, message: str) -> InputError:
    """An error at the column where cell or word ``slot`` of a line begins."""
    if b"," in line:
        column = 1 + sum(len(cell) + 1 for cell in line.split(b",")[:slot])
    else:
        column = 1 + [match.start() for match in _WORD.finditer(line)][slot]
    shown = Diagnostic(path, number, column, message, line.decode("utf-8", "replace")).lines()
    return InputError(shown[0], tuple(shown[1:]))


def _other_graph(labels: Labels, row: int, path: str) -> InputError:
    named = f"edge {labels.edge[row]} " if labels.edge[row] else "an edge "
    return InputError(
        f"{path}: names {named}from {labels.first[row]} to {labels.second[row]}, which the graph does not have",
        ("  the labels belong to another file, or edges were added or removed since",),
    )
