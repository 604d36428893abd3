"""Reads a pose graph of any text dialect: variables, factors, the document for the writer and the reading report."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamcli.errors import InputError
from slamcli.formats import source
from slamcli.formats.diagnostics import SHOWN
from slamcli.formats.dialect import EdgeTag, VertexTag
from slamcli.formats.recognize import by_name, recognize
from slamcli.formats.records import Records, is_id
from slamcli.formats.scene_formats import SCENE_FORMATS
from slamcli.formats.scene_formats import recognize as recognize_scene
from slamcli.formats.tokens import TokenizedText
from slamcli.graph import Document, FactorGraph, Factors, ReadingReport, Variables
from slamcli.graph.columns import BoolArray, IdArray, IndexArray, finite_rows
from slamcli.models import VariableKind
from slamcli.models.base import Array

#: Ids, values and line numbers of the vertex records of each kind.
Vertices = dict[VariableKind, tuple[IdArray, Array, IndexArray]]


def read(path: str, *, dialect: str | None = None, lenient: bool = False) -> FactorGraph:
    """Read a pose graph.

    Parameters
    ----------
    path
        A file, or ``-`` for standard input; gzip and bzip2 are recognized by content, the format by its tags, BAL and
        Bundler by how they begin.
    dialect
        ``"g2o"``, ``"toro"``, ``"bal"``, ``"bal-pinhole"`` or ``"bundler"`` to skip recognition.
    lenient
        Skip, count and report malformed records instead of raising.

    Returns
    -------
    FactorGraph
        With its ``report`` and its ``document``. Variables that edges name without a vertex record exist, but are
        not ``known``.

    Raises
    ------
    InputError
        If the file cannot be read or is not a graph; ``ParseError`` with a diagnostic for each malformed record.
    """
    raw, data = source.read_bytes(str(path))
    return parse(str(path), raw, data, dialect=dialect, lenient=lenient)


def parse(path: str, raw: bytes, data: bytes, *, dialect: str | None = None, lenient: bool = False) -> FactorGraph:
    """The graph of a file whose bytes, as they are and decompressed, were read already (see ``read``)."""
    scene = SCENE_FORMATS.get(dialect) if dialect else recognize_scene(data)
    if scene is not None:
        return scene.parse(path, raw, data)
    text = TokenizedText(data)
    chosen = by_name(dialect) if dialect else recognize(path, _tags_in_order(text))
    return _Reader(raw, Records(path, text, chosen, lenient)).graph()


def _tags_in_order(text: TokenizedText) -> list[str]:
    """Tags in the order in which they first occur."""
    names, index = text.tags
    unique, first = np.unique(index[index >= 0], return_index=True)
    return [names[k].decode("utf-8", "replace") for k in unique[np.argsort(first)]]


class _Reader:
    """Makes a graph of records; every method is a step of ``graph``."""

    def __init__(self, raw: bytes, records: Records) -> None:
        self.raw = raw
        self.records = records
        self.dialect = records.dialect
        self.text = records.text
        self.notes: list[str] = []
        self.measured: dict[str, tuple[Array, Array]] = {}

    @property
    def edges(self) -> list[EdgeTag]:
        """The tags of which there are usable records."""
        return [record for record in self.dialect.edges if len(self.records.ids.get(record.tag, ()))]

    def graph(self) -> FactorGraph:
        parameters = self._parameters()
        defined = self._variables(self._vertices())
        self._check_parameters(parameters)
        self._decode_edges()
        created = self._missing(defined)
        self.records.settle()
        variables = self._with_missing(defined, created)
        factors = [self._factors(record, variables, parameters) for record in self.edges]
        variables = self._fix(variables)
        self.records.settle()
        if not variables:
            skipped = [line for defect in self.records.defects[:SHOWN] for line in defect.lines()]
            message = f"{self.records.path}: holds no vertex and no edge that slamcli can use"
            raise InputError(message, tuple(skipped))
        document = self._document({name: column.values for name, column in variables.items()}, factors)
        return FactorGraph(variables, factors, parameters, document, self._report(variables, factors, created))

    # -- variables -----------------------------------------------------------------------------------------------

    def _parameters(self) -> dict[int, Array]:
        """Constant parameters by id."""
        out: dict[int, Array] = {}
        for record in self.dialect.parameters:
            if record.tag not in self.records.rows:
                continue
            values = record.kind.normalize(self.records.matrix(record.tag, 1 + record.kind.size)[:, 1:])
            self._drop_zero_quaternions(record.tag, values)
            lines = self.records.rows[record.tag].lines
            values = values[finite_rows(values)]
            for k, identifier in enumerate(self.records.ids[record.tag][:, 0].tolist()):
                if identifier in out:
                    self.records.defect(int(lines[k]), None, f"parameter {identifier} is defined twice")
                else:
                    out[identifier] = values[k]
        return out

    def _vertices(self) -> Vertices:
        """Ids, values and line numbers of the vertex records, by kind."""
        parts: dict[VariableKind, list[tuple[IdArray, Array, IndexArray]]] = {}
        for record in self.dialect.vertices:
            if record.tag not in self.records.rows:
                continue
            values = record.kind.normalize(record.decode(self._vertex_numbers(record)))
            self._drop_zero_quaternions(record.tag, values)
            values = values[finite_rows(values)]
            lines = self.records.rows[record.tag].lines + 1
            parts.setdefault(record.kind, []).append((self.records.ids[record.tag][:, 0], values, lines))
        out = {}
        for kind, found in parts.items():
            ids, values, lines = (np.concatenate(column) for column in zip(*found, strict=True))
            keep = self._first_of_each(ids, lines)
            out[kind] = (ids[keep], values[keep], lines[keep])
        return out

    def _vertex_numbers(self, record: VertexTag) -> Array:
        """The numbers behind the ids, with the defaults of those that records leave out."""
        full = 1 + record.numbers
        short = self.records.rows[record.tag].counts < full
        if not short.any():
            return self.records.matrix(record.tag, full)[:, 1:]
        given = full - len(record.defaults)
        out = np.tile((0.0,) * (given - 1) + record.defaults, (len(short), 1))
        out[:, : given - 1] = self.records.matrix(record.tag, given)[:, 1:]
        out[~short] = self.records.matrix(record.tag, full, ~short)[:, 1:]
        rest = " ".join(f"{number:g}" for number in record.defaults)
        self.notes.append(f"{np.count_nonzero(short)} {record.tag} records end early: {rest} is used for the rest")
        return out

    def _drop_zero_quaternions(self, tag: str, values: Array) -> None:
        good = finite_rows(values)
        for line in self.records.rows[tag].lines[~good].tolist():
            self.records.defect(line, None, f"{tag} has a quaternion of zero length")
        self.records.drop(tag, good)

    def _first_of_each(self, ids: IdArray, lines: IndexArray) -> IndexArray:
        """Rows of the first record of each id, in the order of the file; repeats are defects."""
        order = np.lexsort((lines, ids))
        repeats = order[1:][ids[order[1:]] == ids[order[:-1]]]
        for k in np.sort(repeats).tolist():
            message = f"vertex {ids[k]} is defined twice"
            self.records.defect(int(lines[k]) - 1, None, message, "ids of vertices must be unique")
        return np.setdiff1d(np.arange(len(ids)), repeats) if len(repeats) else np.arange(len(ids))

    def _missing(self, defined: dict[str, Variables]) -> dict[VariableKind, IdArray]:
        """Ids that edges name and no vertex record defines, by kind."""
        absent: dict[VariableKind, list[IdArray]] = {}
        for record in self.edges:
            for slot, kind in enumerate(record.kind.variables):
                ids = self.records.ids[record.tag][:, slot]
                if kind.name in defined:
                    ids = ids[defined[kind.name].rows_of(ids) < 0]
                if len(ids):
                    absent.setdefault(kind, []).append(ids)
        missing = {kind: np.unique(np.concatenate(parts)) for kind, parts in absent.items()}
        for kind, ids in missing.items():
            others = [column.ids for name, column in defined.items() if name != kind.name]
            others += [theirs for other, theirs in missing.items() if other is not kind]
            clash = np.intersect1d(ids, np.concatenate(others)) if others else ids[:0]
            if len(clash):
                self._refuse_other_kind(kind, clash)
                return self._missing(defined)  # without the refused edges
        return missing

    def _refuse_other_kind(self, kind: VariableKind, clash: IdArray) -> None:
        """Edges that use a vertex of another kind than theirs."""
        for record in self.edges:
            ids = self.records.ids[record.tag]
            slots = [slot for slot, needed in enumerate(record.kind.variables) if needed is kind]
            wrong = np.isin(ids[:, slots], clash)
            any_wrong = np.asarray(wrong.any(axis=1))
            for k in np.flatnonzero(any_wrong).tolist():
                first = ids[k, slots][wrong[k]][0]
                message = f"{record.tag} needs a {kind.name} vertex, but {first} is of another kind"
                self.records.defect(int(self.records.rows[record.tag].lines[k]), None, message)
            self._drop_edges(record, ~any_wrong)

    def _variables(self, vertices: Vertices) -> dict[str, Variables]:
        """Columns of the variables that the file defines."""
        return {
            kind.name: Variables(
                kind=kind,
                ids=ids,
                values=values,
                fixed=np.zeros(len(ids), dtype=bool),
                known=np.ones(len(ids), dtype=bool),
                lines=lines,
            )
            for kind, (ids, values, lines) in vertices.items()
            if len(ids)
        }

    def _with_missing(
        self, defined: dict[str, Variables], missing: dict[VariableKind, IdArray]
    ) -> dict[str, Variables]:
        """Columns with the variables behind them that only edges name, in the order of the dialect's kinds."""
        out = dict(defined)
        for kind, ids in missing.items():
            if len(ids) == 0:
                continue
            new = Variables(
                kind=kind,
                ids=ids,
                values=np.tile(kind.identity, (len(ids), 1)),
                fixed=np.zeros(len(ids), dtype=bool),
                known=np.zeros(len(ids), dtype=bool),
                lines=np.zeros(len(ids), dtype=np.intp),
            )
            out[kind.name] = out[kind.name].followed_by(new) if kind.name in out else new
        kinds = dict.fromkeys(record.kind.name for record in self.dialect.vertices)
        return {name: out[name] for name in kinds if name in out}

    def _fix(self, variables: dict[str, Variables]) -> dict[str, Variables]:
        """Hold the variables that FIX commands name."""
        text = self.text
        fixed = {name: column.fixed.copy() for name, column in variables.items()}
        for line in self.records.lines_of(self.dialect.fix).tolist():
            first = int(text.first[line])
            for index in range(first + 1, first + int(text.counts[line])):
                token, offset = text.token(index), int(text.token_start[index])
                if not is_id(token):
                    found = token.decode("utf-8", "replace")
                    self.records.defect(line, offset, f"FIX expects ids, found {found!r}")
                    continue
                rows = {name: column.row_of(int(token)) for name, column in variables.items()}
                for name, row in rows.items():
                    if row >= 0:
                        fixed[name][row] = True
                if max(rows.values(), default=-1) < 0:
                    self.records.defect(line, offset, f"FIX names {int(token)}, which is no vertex of this graph")
        return {name: replace(column, fixed=fixed[name]) for name, column in variables.items()}

    # -- factors -------------------------------------------------------------------------------------------------

    def _check_parameters(self, parameters: dict[int, Array]) -> None:
        """Every edge's sensor offset must be defined."""
        for record in self.edges:
            if record.kind.parameter is None:
                continue
            size = record.kind.parameter.size
            named_ids = self.records.ids[record.tag][:, -1].tolist()
            good = np.array([i in parameters and len(parameters[i]) == size for i in named_ids], dtype=bool)
            wanted = next(tag for tag in self.dialect.parameters if tag.kind is record.kind.parameter)
            meaning = (
                "x y z qx qy qz qw puts the sensor on the robot"
                if size == 7
                else "f cx cy baseline gives the intrinsics"
            )
            for k in np.flatnonzero(~good).tolist():
                named = self.records.ids[record.tag][k, -1]
                other = f"which is no {wanted.tag}" if named in parameters else "which no record defines"
                message = f"{record.tag} names parameter {named}, {other}"
                hint = f"{wanted.tag} {named} {meaning}"
                self.records.defect(int(self.records.rows[record.tag].lines[k]), None, message, hint)
            self.records.drop(record.tag, good)

    def _decode_edges(self) -> None:
        """Measurements and information matrices of all edges."""
        for record in self.edges:
            measurement, information = self._measured(record)
            self.measured[record.tag] = measurement, information
            usable = finite_rows(measurement) & finite_rows(information)
            for line in self.records.rows[record.tag].lines[~usable].tolist():
                message = f"{record.tag} has a quaternion of zero length or an infinite information"
                self.records.defect(line, None, message)
            self._drop_edges(record, usable)

    def _drop_edges(self, record: EdgeTag, keep: BoolArray) -> None:
        """Leave out some edges, whose defects have been noted."""
        if not keep.all():
            self.records.drop(record.tag, keep)
            measurement, information = self.measured[record.tag]
            self.measured[record.tag] = measurement[keep], information[keep]

    def _factors(self, record: EdgeTag, variables: dict[str, Variables], parameters: dict[int, Array]) -> Factors:
        """One column of factors."""
        measurement, information = self.measured[record.tag]
        ids = self.records.ids[record.tag]
        slots = enumerate(record.kind.variables)
        offsets = parameter_ids = None
        if record.kind.parameter is not None:
            parameter_ids = ids[:, -1]
            unique, inverse = np.unique(parameter_ids, return_inverse=True)
            table = [parameters[i] for i in unique.tolist()]
            offsets = np.array(table).reshape(-1, record.kind.parameter.size)[inverse]
        return Factors(
            kind=record.kind,
            indices=np.stack([variables[kind.name].rows_of(ids[:, slot]) for slot, kind in slots], axis=1),
            measurements=measurement,
            information=information,
            parameters=offsets,
            parameter_ids=parameter_ids,
            tag=record.tag,
            lines=self.records.rows[record.tag].lines + 1,
        )

    def _measured(self, record: EdgeTag) -> tuple[Array, Array]:
        """Measurements and information matrices, as the factor kind wants them."""
        start = record.ids
        split = start + record.measurement
        full = split + record.information
        short = self.records.rows[record.tag].counts < full
        if not short.any():
            numbers = self.records.matrix(record.tag, full)
            return record.decode(record.kind, numbers[:, start:split], numbers[:, split:])
        triangle = np.eye(record.kind.dimension)[np.triu_indices(record.kind.dimension)]
        information = np.tile(triangle, (len(short), 1))
        information[~short] = self.records.matrix(record.tag, full, ~short)[:, split:]
        self.notes.append(f"{np.count_nonzero(short)} {record.tag} records have no information: the identity is used")
        return record.decode(record.kind, self.records.matrix(record.tag, split)[:, start:], information)

    # -- what else the file holds ---------------------------------------------------------------------------------

    def _document(self, values: dict[str, Array], factors: list[Factors]) -> Document:
        text, records = self.text, self.records
        none = np.empty(0, dtype=np.intp)
        parameter_lines = [records.rows[p.tag].lines for p in self.dialect.parameters if p.tag in records.rows]
        return Document(
            raw=self.raw,
            data=text.data,
            spans=text.record_spans,
            line_start=text.line_start,
            comments=np.flatnonzero(text.counts == 0) + 1,
            parameter_lines=np.sort(np.concatenate([none, *parameter_lines])) + 1,
            fix_lines=records.lines_of(self.dialect.fix) + 1,
            first_edge_line=1 + min((int(records.rows[e.tag].lines[0]) for e in self.edges), default=text.lines),
            values=values,
            factors=tuple(factors),
        )

    def _report(
        self, variables: dict[str, Variables], factors: list[Factors], created: dict[VariableKind, IdArray]
    ) -> ReadingReport:
        text, records = self.text, self.records
        names, index = text.tags
        ignored = sorted(records.ignored)
        ordered = [(r.tag, records.rows[r.tag]) for r in self.dialect.records if r.tag in records.rows]
        by_tag = {tag: int(np.count_nonzero(~np.isin(rows.lines, ignored))) for tag, rows in ordered}
        by_tag.update({column.tag: len(column) for column in factors})
        by_tag[str(self.dialect.fix)] = len(records.lines_of(self.dialect.fix))
        totals = np.bincount(index[index >= 0], minlength=len(names)).tolist()
        tags = [name.decode("utf-8", "replace") for name in names]
        used = self.dialect.tags | {self.dialect.fix}
        comments = int(np.count_nonzero(text.has_comment & (text.counts == 0)))
        poses = [column.ids for column in variables.values() if column.kind.is_pose]
        points = [column.ids for column in variables.values() if column.kind.is_point]
        if poses and points and (shared := len(np.intersect1d(np.concatenate(poses), np.concatenate(points)))):
            self.notes.append(f"{shared} ids name both a pose and a landmark; g2o would refuse them")
        return ReadingReport(
            path=records.path,
            format=self.dialect.name,
            lines=text.lines,
            comments=comments,
            blank=int(np.count_nonzero(text.counts == 0)) - comments,
            by_tag={tag: count for tag, count in by_tag.items() if count},
            reasons={tag: why for tag, why in self.dialect.unused.items() if tag in tags},
            skipped={tag: count for tag, count in zip(tags, totals, strict=True) if tag not in used and count},
            malformed=[str(defect) for defect in records.defects],
            created={kind.name: ids.tolist() for kind, ids in created.items() if len(ids)},
            notes=self.notes,
        )
