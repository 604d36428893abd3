"""What is simulated: a world, a robot, its sensors. ``settings`` makes a scenario of a configuration file."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from slamcli.simulation.worlds import PLANAR

MOTIONS = ("body", "odometry", "velocity", "differential")
PLANAR_SENSORS = ("xy", "range-bearing", "bearing", "range", "gps")
SPATIAL_SENSORS = ("point", "gps")
GUESSES = ("odometry", "truth", "none")
CLOSURE_SOURCES = ("auto", "place", "topology", "none")


@dataclass(frozen=True)
class Robot:
    """How the robot moves, and what its odometry says about it.

    Attributes
    ----------
    model
        ``body`` adds noise to the relative pose; ``odometry`` and ``velocity`` are the motion models of Thrun, Burgard
        and Fox with ``alphas``; ``differential`` counts the ticks of two wheels that slip. The last three are planar.
    noise
        Of ``body``: standard deviations of x y theta (x y z and three rotations in space), or of position and rotation,
        or a covariance matrix, in the frame of the later pose; metres and radians.
    alphas
        Of ``odometry`` (4) and ``velocity`` (6).
    slip
        Of ``differential``: standard deviation of a wheel's path over one metre of it, in metres (it grows with the
        square root of the path); sideways ``sideways`` times as much.
    sideways
        See ``slip``.
    baseline
        Of ``differential``: distance between the wheels in metres.
    ticks_per_metre
        Of ``differential``: the wheel paths are rounded to ticks; 0 for none.
    turn_bias
        Systematic turn error in radians per metre, which no covariance knows of.
    tails
        Degrees of freedom of Student's t instead of a Gaussian (more than 2), with the same covariance.
    period
        Seconds from pose to pose.
    """

    model: str = "body"
    noise: Any = None
    alphas: tuple[float, ...] = ()
    slip: float = 0.0
    sideways: float = 0.3
    baseline: float = 0.5
    ticks_per_metre: float = 0.0
    turn_bias: float = 0.0
    tails: float | None = None
    period: float = 1.0


@dataclass(frozen=True)
class Closures:
    """Which earlier poses are recognized.

    Attributes
    ----------
    by
        ``place``: poses within ``reach``; ``topology``: the world's own neighbours; ``auto``: topology where the world
        has one; ``none``.
    reach
        In metres. By default 1.5 steps.
    probability
        That a pair that could be closed is.
    count
        Exactly so many of the pairs, picked at random, instead of a probability.
    gap
        Least number of steps in between.
    per_pose
        How many earlier poses a pose looks at, at most; places only.
    field_of_view
        Only poses whose headings differ by no more than half of it, in radians.
    noise
        As the robot's; in the frame of the later pose. By default that of ``body`` odometry.
    tails
        As the robot's.
    false
        So many false closures more, as a share of the true ones: random pairs said to be near each other.
    """

    by: str = "auto"
    reach: float | None = None
    probability: float = 0.2
    count: int | None = None
    gap: int = 10
    per_pose: int = 30
    field_of_view: float = 7.0
    noise: Any = None
    tails: float | None = None
    false: float = 0.0


@dataclass(frozen=True)
class Landmarks:
    """Points to observe.

    Attributes
    ----------
    count
        Number of points near the path, if given.
    density
        Else their number for each square metre (cubic metre) around the path.
    """

    count: int | None = None
    density: float = 0.0


@dataclass(frozen=True)
class Sensor:
    """One sensor.

    Attributes
    ----------
    kind
        Planar: ``xy``, ``range-bearing``, ``bearing``, ``range``; spatial: ``point``; both: ``gps``, the position.
    range
        Farthest distance in metres.
    field_of_view
        Full angle about the forward axis, in radians.
    noise
        Standard deviations of the reading, or a covariance matrix; metres, radians.
    tails
        As the robot's.
    detection
        Probability that a landmark in view is seen.
    false_alarms
        Expected readings for each pose that come from nothing, and that are taken for some landmark in view.
    every
        Only at each so manieth pose.
    """

    kind: str = "xy"
    range: float = 8.0
    field_of_view: float = 7.0
    noise: Any = None
    tails: float | None = None
    detection: float = 1.0
    false_alarms: float = 0.0
    every: int = 1


@dataclass(frozen=True)
class Scenario:
    """A world, a robot in it, and what it senses.

    Attributes
    ----------
    world
        Name of the world.
    poses
        Number of poses, the first one included.
    seed
        Of all random numbers.
    path
        Parameters of the world.
    robot, closures, landmarks, sensors
        See there.
    guess
        Values of the vertices written: ``odometry``, ``truth``, or ``none`` (no vertex but the first).
    decimals
        Measurements and guess are rounded to so many decimals, in metres and radians; null: exact numbers.
    """

    world: str = "manhattan"
    poses: int = 1000
    seed: int = 0
    path: dict[str, Any] = field(default_factory=dict)
    robot: Robot = field(default_factory=Robot)
    closures: Closures = field(default_factory=Closures)
    landmarks: Landmarks = field(default_factory=Landmarks)
    sensors: tuple[Sensor, ...] = ()
    guess: str = "odometry"
    decimals: int | None = 9

    @property
    def space(self) -> int:
        """2 or 3."""
        return 2 if self.world in PLANAR else 3

    def document(self) -> dict[str, Any]:
        """As a configuration file would have it."""
        return asdict(self)
