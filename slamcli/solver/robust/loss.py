"""What the squared residuals of factors count: the one place where robustness enters the linear system.

With s = e^T Omega e of a factor and a loss rho(s), the cost is sum rho(s) and its Gauss-Newton model is that of
weighted least squares with the weight rho'(s), as in g2o (``BaseEdge::robustInformation``) and in every
iteratively reweighted scheme; second derivatives of rho are left out, so that H stays positive semidefinite.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array


class Loss(Protocol):
    """Loss of one column of factors."""

    def evaluate(self, squared: Array, rows: slice | IndexArray) -> tuple[Array, Array]:
        """Cost rho(s) and weight rho'(s), each (m,), of the factors ``rows`` of the column with s (m,)."""


#: One for each column of factors, None where the squares count as they are.
Losses = Sequence[Loss | None]


@dataclass(eq=False)
class Weights:
    """Given weights: rho(s) = w s.

    Attributes
    ----------
    weight
        (n,) of all factors of the column; may be changed between linearizations.
    """

    weight: Array

    def evaluate(self, squared: Array, rows: slice | IndexArray) -> tuple[Array, Array]:
        """See ``Loss``."""
        weight = self.weight[rows]
        return np.where(weight > 0.0, weight * squared, 0.0), weight
