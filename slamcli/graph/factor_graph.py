"""The factor graph: columns of variables by kind and of factors by kind."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from slamcli.errors import UsageError
from slamcli.graph.columns import BoolArray, Factors, Values, Variables
from slamcli.graph.document import Document, ReadingReport
from slamcli.models import SWITCH
from slamcli.models.base import Array


@dataclass(eq=False)
class FactorGraph:
    """Variables and factors as columns.

    Attributes
    ----------
    variables
        One column for each kind of variable that occurs, by the kind's name.
    factors
        One column for each kind of factor and file tag.
    parameters
        Constant parameters (sensor offsets) by id, as the files name them.
    document
        The text it was read from, None for graphs made in memory.
    report
        What the reader found, None for graphs made in memory.
    """

    variables: dict[str, Variables]
    factors: list[Factors]
    parameters: dict[int, Array] = field(default_factory=dict)
    document: Document | None = None
    report: ReadingReport | None = None

    @property
    def values(self) -> Values:
        """The state: values of all variables by kind. Do not write into the arrays."""
        return {name: column.values for name, column in self.variables.items()}

    @property
    def poses(self) -> int:
        """Number of poses."""
        return sum(len(column) for column in self.variables.values() if column.kind.is_pose)

    @property
    def landmarks(self) -> int:
        """Number of points."""
        return sum(len(column) for column in self.variables.values() if column.kind.is_point)

    @property
    def switches(self) -> int:
        """Number of switches of loop closures."""
        return len(self.variables[SWITCH.name]) if SWITCH.name in self.variables else 0

    @property
    def edges(self) -> int:
        """Number of factors, priors included."""
        return sum(len(column) for column in self.factors)

    @property
    def space(self) -> int:
        """2 for planar graphs, 3 for spatial ones (and for mixtures)."""
        return max((column.kind.space for column in self.variables.values() if len(column)), default=0) or 2

    def chi2(self, values: Values | None = None) -> float:
        """Sum of e^T Omega e over all factors (no factor of one half), at the graph's values or another state."""
        state = self.values if values is None else values
        return math.fsum(float(factors.chi2(state).sum()) for factors in self.factors)

    def edge_chi2(self, values: Values | None = None) -> list[Array]:
        """e^T Omega e of every factor, one array for each column of factors."""
        state = self.values if values is None else values
        return [factors.chi2(state) for factors in self.factors]

    def degrees_of_freedom(self, held: dict[str, BoolArray] | None = None) -> int:
        """Residual dimensions minus tangent dimensions of the variables that are not held."""
        rows = sum(len(factors) * factors.kind.dimension for factors in self.factors)
        free = sum(
            (len(column) - int(np.count_nonzero(held[name] if held else column.fixed))) * column.kind.dimension
            for name, column in self.variables.items()
        )
        return rows - free

    def with_values(self, values: Values) -> FactorGraph:
        """A copy at another state; every variable of it then has an estimate."""
        columns = {
            name: replace(column, values=values[name], known=np.ones(len(column), dtype=bool))
            for name, column in self.variables.items()
        }
        return replace(self, variables=columns)

    def with_fixed(self, ids: Iterable[int]) -> FactorGraph:
        """A copy in which the variables of these ids are held as well.

        Raises
        ------
        UsageError
            If an id does not exist.
        """
        columns = dict(self.variables)
        for wanted in ids:
            found = False
            for name, column in columns.items():
                row = column.row_of(wanted)
                if row >= 0:
                    fixed = column.fixed.copy()
                    fixed[row] = True
                    columns[name] = replace(column, fixed=fixed)
                    found = True
            if not found:
                raise UsageError(f"no variable has the id {wanted}", (self._id_ranges(),))
        return replace(self, variables=columns)

    def _id_ranges(self) -> str:
        ranges = (
            f"{name} {column.ids.min()} to {column.ids.max()}" for name, column in self.variables.items() if len(column)
        )
        return "  ids in this graph: " + ", ".join(ranges)
