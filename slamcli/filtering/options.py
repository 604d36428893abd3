"""Options of the filter: one frozen dataclass, the same keys on the command line, in YAML and in the API."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields

from slamcli.errors import UsageError
from slamcli.models.motion import MotionModel

ASSOCIATIONS = ("known", "nearest", "jcbb")
FORMS = ("symmetric", "joseph")
JACOBIANS = ("standard", "first-estimates")


@dataclass(frozen=True)
class EkfOptions:
    """Options of EKF-SLAM.

    Attributes
    ----------
    association
        Which landmark a reading is of: the id in the log (``known``), the ``nearest`` by Mahalanobis distance with
        no landmark taken twice in a step, or joint compatibility by branch and bound (``jcbb``).
    gate_probability
        Probability of the chi-square gate inside which a reading may belong to a landmark.
    new_probability
        A reading outside the gate of this larger probability of every landmark starts a new one; in between it is
        ambiguous and ignored.
    gate_known
        Whether readings with known landmarks are gated as well (by ``new_probability``), against outliers.
    motion
        Motion model whose noise is taken where the log has no information of its own; of the log's kind of control.
    sensor_deviations
        Standard deviations of the numbers of a reading, in metres and radians, by the sensor's name
        (``filtering.innovation.SENSORS``), where the log has no information of its own.
    sensor_range
        Readings farther away than this many metres are ignored and counted, None for no limit; bearings alone have
        no distance.
    start_deviations
        Standard deviations of the first pose, x and y in metres along the axes of the world, theta in radians.
    form
        Covariance update ``symmetric`` (P - V V^T, one triangle) or ``joseph`` ((I-KH) P (I-KH)^T + K Q K^T).
    jacobians
        Linearized at the latest estimates (``standard``) or at the first ones (``first-estimates``), which keeps the
        position and heading of the whole map unobservable.
    min_parallax
        Radians between two bearings of a landmark before bearings alone place it.
    min_baseline
        Metres between poses that are kept for a landmark which bearings or ranges alone have not placed yet.
    max_views
        Poses that are kept for each such landmark.
    confirm_sightings
        Sightings that confirm a landmark, where its id is not known; until then it is provisional.
    provisional_steps
        A provisional landmark that was not seen for this many steps is deleted.
    node_limit
        Nodes that joint compatibility may visit in one step before it takes the best hypothesis so far.
    compressed
        Whether only a local area of the map is kept up to date, the rest when the robot leaves it (exact).
    area_radius
        Radius of that area in metres, None for twice the farthest reading of the log; a new one starts half of it
        away from where the robot entered the old one.
    """

    association: str = "known"
    gate_probability: float = 0.99
    new_probability: float = 0.9999
    gate_known: bool = False
    motion: MotionModel | None = None
    sensor_deviations: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    sensor_range: float | None = None
    start_deviations: tuple[float, float, float] = (0.0, 0.0, 0.0)
    form: str = "symmetric"
    jacobians: str = "standard"
    min_parallax: float = math.radians(10.0)
    min_baseline: float = 0.5
    max_views: int = 8
    confirm_sightings: int = 3
    provisional_steps: int = 50
    node_limit: int = 20_000
    compressed: bool = False
    area_radius: float | None = None

    def __post_init__(self) -> None:
        for name, allowed in (("association", ASSOCIATIONS), ("form", FORMS), ("jacobians", JACOBIANS)):
            if getattr(self, name) not in allowed:
                raise UsageError(f"{name} {getattr(self, name)!r} does not exist", (f"  one of: {', '.join(allowed)}",))
        if self.compressed and self.form == "joseph":
            raise UsageError("a compressed filter has the symmetric form only, not joseph")
        if not 0.0 < self.gate_probability <= self.new_probability < 1.0:
            raise UsageError(
                "gate_probability and new_probability must be between 0 and 1, the second not below the first; "
                f"got {self.gate_probability} and {self.new_probability}"
            )
        for name in ("sensor_range", "min_parallax", "min_baseline", "area_radius"):
            value = getattr(self, name)
            if value is not None and not value > 0.0:
                raise UsageError(f"{name} must be positive, got {value}")
        for name, least in (("max_views", 3), ("confirm_sightings", 1), ("provisional_steps", 1), ("node_limit", 1)):
            if getattr(self, name) < least:
                raise UsageError(f"{name} must be at least {least}, got {getattr(self, name)}")
        if not all(0.0 <= value < math.inf for value in self.start_deviations):
            raise UsageError(f"start_deviations must not be negative, got {self.start_deviations}")

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Names of all options."""
        return tuple(entry.name for entry in fields(cls))
