"""What a kind of variable and a kind of factor have to say about themselves.

A *variable kind* is a manifold: how many numbers store one value, how many tangent dimensions it has and how a
tangent step is applied. A *factor kind* is a residual with its analytic Jacobians, evaluated on all factors of
that kind at once. Adding a kind of factor is adding one class here and one line in the tag table of ``formats``.

All Jacobians are taken with respect to the local tangent step ``delta`` of ``VariableKind.retract``, so that
``residual(retract(x, delta)) = residual(x) + J delta + O(delta^2)``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def dot(a: Array, b: Array) -> float:
    """Inner product, without BLAS: waking its threads takes longer than the sum and slows CHOLMOD's down."""
    return float((a * b).sum())


def norm(vector: Array) -> float:
    """Euclidean norm (see ``dot``)."""
    return float(np.sqrt(np.square(vector).sum()))


def components(values: Array) -> list[Array]:
    """The columns of (m, k) values, each contiguous: what runs over components runs twice as fast on them."""
    return list(np.ascontiguousarray(values.T))


@dataclass(frozen=True)
class VariableKind:
    """A kind of variable: SE2 and SE3 poses, XY and XYZ points, switches.

    Attributes
    ----------
    name
        ``"SE2"``, ``"SE3"``, ``"XY"``, ``"XYZ"`` or ``"SWITCH"``; the key of the graph's columns.
    size
        Numbers that store one value (7 for SE3: x y z qx qy qz qw).
    components
        Names of the tangent dimensions in order, as diagnoses print them.
    is_pose
        Whether it has an orientation (poses are counted apart from landmarks and carry the gauge).
    space
        2 or 3: the first ``space`` numbers of a value are its position in metres. 0 for switches, which are nowhere.
    identity
        The neutral value.
    retract
        ``(values (n, size), delta (n, dimension)) -> values``; local frame for poses.
    normalize
        Puts values onto the manifold: unit quaternions, angles in [-pi, pi).
    compose, inverse
        The group's product and inverse, (n, size) arrays; addition and negation for points.
    """

    name: str
    size: int
    components: tuple[str, ...]
    is_pose: bool
    space: int
    identity: tuple[float, ...]
    retract: Callable[[Array, Array], Array]
    normalize: Callable[[Array], Array]
    compose: Callable[[Array, Array], Array]
    inverse: Callable[[Array], Array]

    @property
    def dimension(self) -> int:
        """Tangent dimensions of one variable."""
        return len(self.components)

    @property
    def is_point(self) -> bool:
        """Whether it is a place without an orientation: a landmark."""
        return self.space > 0 and not self.is_pose


class FactorKind(ABC):
    """A kind of factor: a residual e(x; z) of ``dimension`` numbers, weighted by an information matrix.

    Attributes
    ----------
    name
        Name of the kind, independent of any file format.
    variables
        Kind of each variable that the factor joins, in the order of the file's ids.
    components
        Names of the residual's numbers in order, which is also the order of the information matrix.
    measurement_size
        Numbers of the measurement z.
    parameter
        Kind of the constant parameter that the factor refers to (a sensor offset), or None.
    """

    name: str
    variables: tuple[VariableKind, ...]
    components: tuple[str, ...]
    measurement_size: int
    parameter: VariableKind | None = None

    @property
    def dimension(self) -> int:
        """Numbers of the residual."""
        return len(self.components)

    @property
    def relative_pose(self) -> bool:
        """Whether the measurement is the second slot's pose seen from the first's, as an element of their group."""
        return False

    def normalize(self, measurement: Array) -> Array:
        """Put measurements ``(m, measurement_size)`` onto their manifold; most need nothing."""
        return measurement

    def place(self, first: Array, measurement: Array, parameter: Array | None) -> Array | None:
        """Value of the last variable at which the residual vanishes, or None where one factor cannot tell."""
        return None

    @abstractmethod
    def residual(self, x: tuple[Array, ...], measurement: Array, parameter: Array | None) -> Array:
        """Residuals ``(m, dimension)`` at the variables ``x``, one ``(m, size)`` array for each slot."""

    def linearize(
        self, x: tuple[Array, ...], measurement: Array, parameter: Array | None
    ) -> tuple[Array, tuple[Array, ...]]:
        """Residuals and their Jacobians ``(m, dimension, k)``, one for each slot of tangent dimension k."""
        shape = (len(measurement), self.dimension)
        residual = np.empty(shape)
        jacobians = tuple(np.zeros((*shape, kind.dimension)) for kind in self.variables)
        self.linearize_into(residual, jacobians, x, measurement, parameter)
        return residual, jacobians

    @abstractmethod
    def linearize_into(
        self,
        residual: Array,
        jacobians: tuple[Array, ...],
        x: tuple[Array, ...],
        measurement: Array,
        parameter: Array | None,
    ) -> None:
        """``linearize`` into given arrays (any strides), so that a solver can reuse its buffers.

        The Jacobians come with zeros, or with what an earlier call for the same kind has written: an
        implementation writes all entries that can be nonzero and leaves the others alone.
        """

    def __repr__(self) -> str:
        return f"<factor kind {self.name}>"
