"""The columns of a factor graph: all variables of one kind, all factors of one kind and tag.

Columns are values: nothing changes them in place, ``dataclasses.replace`` makes changed copies. There is no
Python object per pose or per edge.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.models import FactorKind, VariableKind
from slamcli.models.base import Array

IdArray = NDArray[np.integer[Any]]  # int64 or uint64
IndexArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]

#: A state: the values of all variables, by the name of their kind.
Values = dict[str, Array]


def finite_rows(values: Array) -> BoolArray:
    """Which entries along the first axis hold only finite numbers."""
    return np.asarray(np.isfinite(values).all(axis=tuple(range(1, values.ndim))))


@dataclass(frozen=True, eq=False)
class Variables:
    """All variables of one kind.

    Attributes
    ----------
    kind
        Their kind.
    ids
        (n,) unique ids, int64 (uint64 where a file has ids of 2^63 and more), in the order of the file.
    values
        (n, kind.size) estimates.
    fixed
        (n,) True where a FIX line or an option holds the variable.
    known
        (n,) False where the file gave no estimate and none has been made yet.
    lines
        (n,) line numbers in the source, 0 for variables that have no line.
    """

    kind: VariableKind
    ids: IdArray
    values: Array
    fixed: BoolArray
    known: BoolArray
    lines: IndexArray

    @classmethod
    def made(cls, kind: VariableKind, ids: IdArray, values: Array) -> Variables:
        """A column of variables that come from no file, none of them held."""
        count = len(ids)
        free, known = np.zeros(count, dtype=bool), np.ones(count, dtype=bool)
        return cls(kind, ids, values, free, known, np.zeros(count, dtype=np.intp))

    def __len__(self) -> int:
        return len(self.ids)

    def followed_by(self, other: Variables) -> Variables:
        """The column with another one of its kind behind it."""
        names = ("ids", "values", "fixed", "known", "lines")
        return Variables(self.kind, *(np.concatenate([getattr(self, n), getattr(other, n)]) for n in names))

    @cached_property
    def _order(self) -> tuple[IndexArray, IdArray]:
        order = np.argsort(self.ids, kind="stable")
        return order, self.ids[order]

    @cached_property
    def rank(self) -> IndexArray:
        """(n,) position of each variable when the ids are sorted."""
        rank = np.empty(len(self), dtype=np.intp)
        rank[self._order[0]] = np.arange(len(self))
        return rank

    def row_of(self, wanted: int) -> int:
        """Row of one id, whatever its size, -1 if there is no such variable."""
        limits = np.iinfo(self.ids.dtype)
        if not limits.min <= wanted <= limits.max:
            return -1
        return int(self.rows_of(np.array([wanted], dtype=self.ids.dtype))[0])

    def rows_of(self, ids: IdArray) -> IndexArray:
        """Rows of the given ids (of the same dtype as the column's), -1 where there is no such variable."""
        if len(self) == 0:
            return np.full(np.shape(ids), -1, dtype=np.intp)
        order, sorted_ids = self._order
        first = sorted_ids[0]
        if int(sorted_ids[-1]) - int(first) == len(self) - 1:  # no gaps: subtract instead of searching
            position = (ids - first).astype(np.intp)
            inside = (ids >= first) & (ids <= sorted_ids[-1])
            if inside.all():
                return order[position]
            return np.where(inside, order[np.where(inside, position, 0)], -1)
        position = np.minimum(np.searchsorted(sorted_ids, ids), len(self) - 1)
        return np.where(sorted_ids[position] == ids, order[position], -1)


@dataclass(frozen=True, eq=False)
class Factors:
    """All factors of one kind that one file tag brought.

    Attributes
    ----------
    kind
        Their kind: residual, Jacobians, dimension.
    indices
        (m, slots) rows of the variables they join, each in the column of the slot's kind.
    measurements
        (m, kind.measurement_size).
    information
        (m, d, d) symmetric matrices, in the order and frame of the kind's residual.
    parameters
        (m, kind.parameter.size) constant parameters (sensor offsets), or None.
    parameter_ids
        (m,) ids of those parameters, or None.
    tag
        The file's tag, for reports and for the writer.
    lines
        (m,) line numbers in the source, 0 for factors that have no line.
    """

    kind: FactorKind
    indices: IndexArray
    measurements: Array
    information: Array
    parameters: Array | None = None
    parameter_ids: IdArray | None = None
    tag: str = ""
    lines: IndexArray = field(default_factory=lambda: np.empty(0, dtype=np.intp))

    def __len__(self) -> int:
        return len(self.indices)

    def part(self, rows: slice | IndexArray) -> Factors:
        """Some of the factors; the arrays of a slice are views."""
        return replace(
            self,
            indices=self.indices[rows],
            measurements=self.measurements[rows],
            information=self.information[rows],
            parameters=None if self.parameters is None else self.parameters[rows],
            parameter_ids=None if self.parameter_ids is None else self.parameter_ids[rows],
            lines=self.lines[rows] if len(self.lines) else self.lines,
        )

    def gather(self, values: Values) -> tuple[Array, ...]:
        """Values of the joined variables, one (m, size) array for each slot."""
        return tuple(
            np.take(values[kind.name], self.indices[:, slot], axis=0) for slot, kind in enumerate(self.kind.variables)
        )

    def residual(self, values: Values) -> Array:
        """Residuals (m, d) at a state."""
        return self.kind.residual(self.gather(values), self.measurements, self.parameters)

    def linearize(self, values: Values) -> tuple[Array, tuple[Array, ...]]:
        """Residuals (m, d) and Jacobians, one (m, d, k) for each slot, at a state."""
        return self.kind.linearize(self.gather(values), self.measurements, self.parameters)

    def chi2(self, values: Values) -> Array:
        """Weighted squared residual e^T Omega e of each factor, (m,)."""
        with np.errstate(all="ignore"):  # a chi2 that is not finite is for the caller to report
            residual = self.residual(values)
            return np.vecdot(residual, np.matvec(self.information, residual))

    def variable_ids(self, variables: dict[str, Variables]) -> IdArray:
        """Ids of the joined variables, (m, slots)."""
        return np.stack(
            [variables[kind.name].ids[self.indices[:, slot]] for slot, kind in enumerate(self.kind.variables)],
            axis=1,
        )
