"""An elimination order with its name, and the table of names."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from slamcli.errors import UsageError
from slamcli.graph.columns import IndexArray
from slamcli.solver import symbolic
from slamcli.solver.ordering import (
    column_minimum_degree,
    constrained,
    minimum_degree,
    nested_dissection,
    reverse_cuthill_mckee,
)
from slamcli.solver.pattern import BlockPattern
from slamcli.solver.symbolic import SymbolicAnalysis


@dataclass(eq=False)
class FoundOrder:
    """An elimination order.

    Attributes
    ----------
    name
        How it was found; where that was left to ``auto``, the name of what it took.
    order
        (n,) position k holds the block eliminated k-th.
    """

    name: str
    order: IndexArray
    _analysis: SymbolicAnalysis | None = field(default=None, repr=False)

    def analysis(self, pattern: BlockPattern) -> SymbolicAnalysis:
        """Symbolic analysis of the pattern that the order was found for, made once."""
        if self._analysis is None:
            self._analysis = symbolic.analyze(pattern, self.order)
        return self._analysis


#: What finds the orders, but for ``natural``, that of the file, and ``auto``.
_METHODS = {
    "amd": minimum_degree.amd,
    "colamd": column_minimum_degree.colamd,
    "metis": nested_dissection.metis,
    "rcm": reverse_cuthill_mckee.rcm,
    "amd-landmarks-first": constrained.landmarks_first,
    "amd-last-pose-last": constrained.last_pose_last,
}


def named(name: str, pattern: BlockPattern) -> FoundOrder:
    """The elimination order of a name other than ``auto``.

    Raises
    ------
    UsageError
        If the name does not exist, or the library that it needs is not installed.
    """
    if name != "natural" and name not in _METHODS:
        raise UsageError(f"ordering {name!r} does not exist", (f"  one of: natural, {', '.join(_METHODS)}",))
    count = len(pattern.sizes)
    if name == "natural" or count < 2:
        return FoundOrder(name, np.arange(count))
    return FoundOrder(name, _METHODS[name](pattern))
