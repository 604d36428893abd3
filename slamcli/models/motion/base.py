"""What a motion model has to say: which control makes which motion, with which noise.

A control u moves a robot by a *displacement*, the pose at the end of a step seen from the pose at its beginning. Noise
is drawn on the control, independently for each of its numbers, and reaches the displacement through the Jacobian J:

    displacement(perturb(u, e)) = retract(displacement(u), J e + O(e^2))
    covariance = J diag(variances) J^T

in the frame of the pose at the end of the step. That is the frame and the tangent space of g2o's relative-pose
edges at zero residual: the inverse covariance is the information of an edge that measures the displacement.

Everything but ``propagate`` applies elementwise ufuncs alone to its input, sines and arc tangents before anything
else, so that a subclass of ndarray with sines of its own goes through it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from slamcli.errors import UsageError
from slamcli.geometry import se2, se3, so2
from slamcli.models.base import Array, VariableKind
from slamcli.models.variables import SE2

#: Metres. A shorter way has no direction, only rounding errors: it counts as a turn on the spot.
SHORTEST_WAY = 1e-9

#: A partial derivative of a displacement: of its x, its y and its turn, as seen from the pose at the beginning.
Partial = tuple[Array | float, Array | float, Array | float]


class MotionModel(Protocol):
    """A motion model, on m steps at once. ``dt`` is the duration of a step in seconds, a number or (m,).

    Attributes
    ----------
    name
        As configuration files name the model.
    kind
        SE2 or SE3, of displacements and poses.
    components
        Names of the numbers in which a control can be perturbed, k of them.
    """

    name: ClassVar[str]

    @property
    def kind(self) -> VariableKind:
        """See the class."""

    @property
    def components(self) -> tuple[str, ...]:
        """See the class."""

    def control(self, relative: Array, dt: Array | float) -> Array:
        """Controls that make displacements (m, kind.size), but for ``remainder``."""

    def remainder(self, relative: Array, dt: Array | float) -> Array:
        """What the robot cannot do of displacements: displacement(control(relative)) compose remainder = relative."""

    def displacement(self, control: Array, dt: Array | float) -> Array:
        """Displacements (m, kind.size)."""

    def perturb(self, control: Array, noise: Array) -> Array:
        """Controls with noise (m, k) on them."""

    def jacobian(self, control: Array, dt: Array | float) -> Array:
        """J (m, d, k) of the displacement, with d = kind.dimension."""

    def variances(self, control: Array, dt: Array | float) -> Array:
        """Variances (m, k) of the noise on controls."""

    def covariance(self, control: Array, dt: Array | float) -> Array:
        """Covariance (m, d, d) of the displacement, to first order. It is singular where the model has no noise."""

    def propagate(self, pose: Array, control: Array, dt: Array | float) -> tuple[Array, Array, Array]:
        """Poses after the step, with their Jacobians by the poses before it (m, d, d) and by the controls (m, d, k).

        Steps of both poses are local ones (``retract``). The covariance after the step is F P F^T + G M G^T, with M
        the diagonal matrix of ``variances``.
        """


class Path(NamedTuple):
    """A planar displacement: end point in metres, and the turn in radians, not wrapped."""

    x: Array
    y: Array
    turn: Array


class PlanarMotion(ABC):
    """What planar models share: they say where a control leads and its partial derivatives."""

    name: ClassVar[str]
    kind: ClassVar[VariableKind] = SE2
    components: ClassVar[tuple[str, ...]]

    @abstractmethod
    def control(self, relative: Array, dt: Array | float) -> Array:
        """See ``MotionModel``."""

    @abstractmethod
    def variances(self, control: Array, dt: Array | float) -> Array:
        """See ``MotionModel``."""

    @abstractmethod
    def _path(self, control: Array, dt: Array | float) -> Path:
        """Where controls lead."""

    @abstractmethod
    def _partials(self, control: Array, dt: Array | float) -> tuple[Partial, ...]:
        """One for each component of the control."""

    def remainder(self, relative: Array, dt: Array | float) -> Array:
        """Nothing: every displacement is possible."""
        return np.zeros(np.shape(relative))

    def displacement(self, control: Array, dt: Array | float) -> Array:
        """See ``MotionModel``; (m, 3)."""
        path = self._path(control, dt)
        return so2.pack(path.x, path.y, so2.wrap(path.turn))

    def perturb(self, control: Array, noise: Array) -> Array:
        """The sum of both."""
        return control + noise

    def jacobian(self, control: Array, dt: Array | float) -> Array:
        """See ``MotionModel``; (m, 3, k)."""
        turn = self._path(control, dt).turn
        cosine, sine = np.cos(turn), np.sin(turn)
        out = np.empty((len(turn), 3, len(self.components)))
        for k, (dx, dy, dturn) in enumerate(self._partials(control, dt)):
            out[:, 0, k] = cosine * dx + sine * dy
            out[:, 1, k] = cosine * dy - sine * dx
            out[:, 2, k] = dturn
        return out

    def covariance(self, control: Array, dt: Array | float) -> Array:
        """See ``MotionModel``; (m, 3, 3)."""
        jacobian, variances = self.jacobian(control, dt), self.variances(control, dt)
        out = np.zeros((len(jacobian), 3, 3))
        for row in range(3):
            for column in range(row + 1):
                for k in range(len(self.components)):
                    out[:, row, column] += jacobian[:, row, k] * variances[:, k] * jacobian[:, column, k]
                out[:, column, row] = out[:, row, column]
        return out

    def propagate(self, pose: Array, control: Array, dt: Array | float) -> tuple[Array, Array, Array]:
        """See ``MotionModel``."""
        relative = self.displacement(control, dt)
        return se2.compose(pose, relative), carried(SE2, relative), self.jacobian(control, dt)


def carried(kind: VariableKind, relative: Array) -> Array:
    """Jacobian (m, d, d) of X compose ``relative`` by X, both with local steps: the adjoint of the inverse.

    The adjoint of SE(3) is that of rotation vectors, which are twice the vector parts in which SE3.retract steps.
    """
    if kind is SE2:
        return se2.adjoint(se2.inverse(relative))
    adjoint = se3.adjoint(se3.inverse(relative))
    adjoint[:, :3, 3:] *= 2.0
    return adjoint


def way(relative: Array) -> tuple[Array, Array]:
    """Signed distance (m,) to a displacement's end point, and the direction to it, (m,) in [-pi/2, pi/2].

    What lies behind is reached in reverse, at a negative distance: the shortest way without turning round first.
    """
    x, y = relative[:, 0], relative[:, 1]
    sign = np.copysign(1.0, x)
    distance = np.sqrt(x * x + y * y)
    somewhere = distance > SHORTEST_WAY  # a factor instead of a condition: np.where would drop a subclass
    return sign * distance * somewhere, np.arctan2(sign * y, np.absolute(x)) * somewhere


def require_not_negative(model: object, *names: str) -> None:
    """Refuse parameters of a model that are negative or not finite.

    Raises
    ------
    UsageError
        Naming the parameter.
    """
    for name in names:
        value = getattr(model, name)
        if not 0.0 <= value < np.inf:
            raise UsageError(f"{name} of the motion model must be a number that is not negative, got {value!r}")
