"""What an evaluation asks for and what comes of it: everything that text, JSON and CSV show."""

from __future__ import annotations

from dataclasses import dataclass, field

from slamcli.errors import UsageError
from slamcli.evaluation.alignment import METHODS as ALIGNMENTS
from slamcli.evaluation.alignment import Alignment
from slamcli.evaluation.association import MAX_TIME_DIFFERENCE, Association
from slamcli.evaluation.closures import GATE, ClosureScores
from slamcli.evaluation.consistency import Consistency
from slamcli.evaluation.drift import Gap
from slamcli.evaluation.errors import DELTA_UNITS, PoseErrors, Statistics
from slamcli.evaluation.landmarks import LandmarkErrors
from slamcli.graph.columns import IdArray
from slamcli.graph.trajectory import Trajectory
from slamcli.models.base import Array


@dataclass(frozen=True)
class EvaluateOptions:
    """How estimates are compared with the truth.

    Attributes
    ----------
    align
        ``none``, ``origin``, ``se`` or ``sim``, see ``alignment.align``.
    associate
        ``auto``, ``id``, ``time`` or ``index``, see ``association.associate``.
    max_time_difference
        Seconds.
    deltas
        Distances of the pairs of relative errors, in ``delta_unit``.
    delta_unit
        ``frames``, ``m``, ``deg`` or ``rad``.
    all_pairs
        Whether every pose starts a pair.
    gate
        Probability with which a correct loop closure is accepted.
    """

    align: str = "se"
    associate: str = "auto"
    max_time_difference: float = MAX_TIME_DIFFERENCE
    deltas: tuple[float, ...] = (1.0,)
    delta_unit: str = "frames"
    all_pairs: bool = False
    gate: float = GATE

    def __post_init__(self) -> None:
        for name, known in (("align", ALIGNMENTS), ("delta_unit", DELTA_UNITS)):
            if getattr(self, name) not in known:
                raise UsageError(f"{name} {getattr(self, name)!r} does not exist", (f"  one of: {', '.join(known)}",))
        if not 0.0 < self.gate < 1.0:
            raise UsageError(f"the gate is a probability between 0 and 1, got {self.gate:g}")


@dataclass(frozen=True, eq=False)
class RelativeErrors:
    """Relative errors over one distance.

    Attributes
    ----------
    delta, unit, all_pairs
        How the pairs were chosen.
    pairs
        How many there are.
    statistics
        Of ``translation`` (m), ``rotation`` (deg) and ``full``; None if there is no pair.
    """

    delta: float
    unit: str
    all_pairs: bool
    pairs: int
    statistics: dict[str, Statistics] | None


@dataclass(frozen=True, eq=False)
class PoseTable:
    """The associated poses of an estimate, one row each.

    Attributes
    ----------
    ids, stamps
        (k,) of the estimate, None where it has none.
    distance
        (k,) metres travelled along the truth.
    positions
        (k, 3) metres, of the aligned estimate.
    errors
        Absolute errors.
    """

    ids: IdArray | None
    stamps: Array | None
    distance: Array
    positions: Array
    errors: PoseErrors


@dataclass(frozen=True, eq=False)
class EstimateResult:
    """One estimate; what could not be computed is None.

    Attributes
    ----------
    name
        The file, or ``dead reckoning of`` it.
    poses, length
        Their number and the length of the path in metres.
    kind
        ``SE2`` or ``SE3``.
    gap
        End of the path.
    association, alignment, absolute, relative, table
        Comparison with the truth; ``absolute`` holds statistics of ``translation``, ``rotation`` and ``full``.
    landmarks, consistency, closures
        Where landmarks, covariances and labels are at hand.
    """

    name: str
    poses: int
    length: float
    kind: str
    gap: Gap
    association: Association | None = None
    alignment: Alignment | None = None
    absolute: dict[str, Statistics] | None = None
    relative: list[RelativeErrors] = field(default_factory=list)
    table: PoseTable | None = None
    landmarks: LandmarkErrors | None = None
    consistency: Consistency | None = None
    closures: ClosureScores | None = None

    @property
    def pairs(self) -> int:
        """Number of associated poses."""
        return 0 if self.association is None else len(self.association)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The results of all estimates against one truth.

    Attributes
    ----------
    options
        As in effect.
    truth
        The truth, or None.
    estimates
        In the order in which they were given.
    notes
        What a reader of the figures should know, one sentence each.
    """

    options: EvaluateOptions
    truth: Trajectory | None
    estimates: list[EstimateResult]
    notes: list[str]
