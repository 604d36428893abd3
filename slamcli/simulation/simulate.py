"""From a scenario to a graph: drive, close loops, observe, and write down what the robot would know."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from slamcli.errors import UsageError
from slamcli.formats.g2o import G2O
from slamcli.graph import FactorGraph, Factors, Variables
from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.models import RELATIVE_POSE_2D, RELATIVE_POSE_3D, SE3, XY, XYZ
from slamcli.models.base import Array
from slamcli.simulation.closing import LoopClosures, close_loops
from slamcli.simulation.guess import guess
from slamcli.simulation.portable import portable
from slamcli.simulation.robots import Odometry, drive, pose_kind
from slamcli.simulation.scenario import Scenario, Sensor
from slamcli.simulation.sensing import Readings, scatter, sense
from slamcli.simulation.worlds import WORLDS

#: What observes landmarks where a scenario has some and names no sensor.
_DEFAULT_SENSORS = {2: Sensor(kind="xy"), 3: Sensor(kind="point")}


@dataclass(frozen=True, eq=False)
class Simulation:
    """A simulated data set.

    Attributes
    ----------
    scenario
        What was asked for.
    graph
        What the robot knows: measurements, and as values the guess.
    truth
        The same variables at their true values, without factors.
    outliers
        For each column of factors of the graph, which of them are not true.
    odometry, closures, readings
        What the graph was made of, for a log.
    path_length
        True length of the path in metres.
    notes
        Assumptions, one sentence each.
    """

    scenario: Scenario
    graph: FactorGraph
    truth: FactorGraph
    outliers: list[BoolArray]
    odometry: Odometry
    closures: LoopClosures
    readings: list[Readings]
    path_length: float
    notes: list[str] = field(default_factory=list)

    def chi2_at_truth(self) -> float:
        """chi2 of the measurements at the true values, false ones left out."""
        values = self.truth.values
        return float(
            sum(f.chi2(values)[~wrong].sum() for f, wrong in zip(self.graph.factors, self.outliers, strict=True))
        )

    def measured_dimensions(self) -> int:
        """Residual dimensions of the true measurements: the expectation of ``chi2_at_truth``."""
        columns = zip(self.graph.factors, self.outliers, strict=True)
        return sum(f.kind.dimension * int(np.count_nonzero(~wrong)) for f, wrong in columns)


def simulate(scenario: Scenario) -> Simulation:
    """Simulate a scenario. The same scenario gives the same numbers on every machine.

    Every part draws from its own stream of the seed, so that another sensor does not change the path.

    Raises
    ------
    UsageError
        If the scenario asks for what its world cannot give, or for more than numbers can hold.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        simulation = _simulation(scenario)
    columns = [column.values for column in simulation.graph.variables.values()]
    for factors in simulation.graph.factors:
        columns += [factors.measurements, factors.information]
    if not all(np.isfinite(numbers).all() for numbers in columns):
        raise UsageError(
            "the numbers of this scenario are beyond the range of numbers",
            ("  a smaller noise, smaller robot.alphas or a longer robot.period keep them finite",),
        )
    return simulation


def _simulation(scenario: Scenario) -> Simulation:
    """See ``simulate``."""
    streams = [np.random.Generator(np.random.PCG64(s)) for s in np.random.SeedSequence(scenario.seed).spawn(4)]
    sensors, notes = _sensors(scenario)
    sensor_streams = np.random.SeedSequence((scenario.seed, 1)).spawn(len(sensors))
    path = WORLDS[scenario.world](scenario.poses, streams[0], **scenario.path)
    odometry = drive(path, scenario.robot, streams[1])
    closures = close_loops(path, scenario.closures, scenario.robot.noise, streams[2])
    reach = max((sensor.range for sensor in sensors if sensor.kind != "gps"), default=0.0)
    landmarks = scatter(path, scenario.landmarks, reach, streams[3]) if reach else portable(np.empty((0, path.space)))
    readings = [
        sense(path, landmarks, sensor, f"sensors.{k}", np.random.Generator(np.random.PCG64(sensor_streams[k])))
        for k, sensor in enumerate(sensors)
    ]
    landmarks, readings, unseen = _only_seen(landmarks, readings)
    if unseen:
        notes.append(f"{unseen} landmarks were not seen often enough to be placed and are left out")
    odometry, closures, readings = _rounded(scenario.decimals, odometry, closures, readings)
    factors, outliers = _factors(path.space, odometry, closures, readings)
    truth = _graph(path.poses, landmarks, [], scenario.decimals)
    start, assumed = guess(scenario.guess, path, landmarks, odometry, readings)
    graph = _graph(*start, factors, scenario.decimals)
    if scenario.guess == "none":
        graph = _unknown(graph)
    length = float(path.steps().sum())
    return Simulation(scenario, graph, truth, outliers, odometry, closures, readings, length, notes + assumed)


def _sensors(scenario: Scenario) -> tuple[list[Sensor], list[str]]:
    """The sensors of a scenario, and what is assumed about them."""
    sensors = list(scenario.sensors)
    wants_landmarks = bool(scenario.landmarks.count or scenario.landmarks.density)
    if wants_landmarks and all(sensor.kind == "gps" for sensor in sensors):
        default = _DEFAULT_SENSORS[scenario.space]
        sensors.append(default)
        return sensors, [f"no sensor for the landmarks is named: {default.kind}, range {default.range:g} m"]
    return sensors, []


def _only_seen(landmarks: Array, readings: list[Readings]) -> tuple[Array, list[Readings], int]:
    """Landmarks that the readings can determine, renumbered; and how many they cannot.

    A point of the plane takes two numbers: one xy reading, or two bearings, or two ranges.
    """
    numbers = np.zeros(len(landmarks), dtype=np.intp)
    for reading in readings:
        true = reading.landmarks[~reading.false[: len(reading.landmarks)]]
        numbers += np.bincount(true, minlength=len(landmarks)) * reading.kind.dimension
    kept = numbers >= landmarks.shape[1]
    place = np.cumsum(kept) - 1
    return landmarks[kept], [_renumbered(r, kept, place) for r in readings], int((~kept).sum())


def _renumbered(reading: Readings, kept: BoolArray, place: IndexArray) -> Readings:
    """Readings of the landmarks that are kept."""
    if len(reading.landmarks) == 0:
        return reading
    rows = kept[reading.landmarks]
    return replace(
        reading,
        poses=reading.poses[rows],
        landmarks=place[reading.landmarks[rows]],
        measurements=reading.measurements[rows],
        false=reading.false[rows],
    )


def _rounded(
    decimals: int | None, odometry: Odometry, closures: LoopClosures, readings: list[Readings]
) -> tuple[Odometry, LoopClosures, list[Readings]]:
    """Everything measured, rounded as it will be written."""
    if decimals is None:
        return odometry, closures, readings
    odometry = replace(
        odometry,
        measurements=_round(odometry.measurements, decimals),
        controls=_round(odometry.controls, decimals),
    )
    closures = replace(closures, measurements=_round(closures.measurements, decimals))
    return odometry, closures, [replace(r, measurements=_round(r.measurements, decimals)) for r in readings]


def _round(values: Array, decimals: int | None) -> Array:
    if decimals is None:
        return values
    return np.asarray(np.round(np.asarray(values), decimals) + 0.0, dtype=np.float64)  # -0 becomes 0


def _factors(
    space: int, odometry: Odometry, closures: LoopClosures, readings: list[Readings]
) -> tuple[list[Factors], list[BoolArray]]:
    """Columns of factors in the order of time, and which of their rows are false."""
    kind = RELATIVE_POSE_2D if space == 2 else RELATIVE_POSE_3D
    steps = len(odometry.measurements)
    pairs = np.concatenate([np.stack([np.arange(steps), np.arange(1, steps + 1)], axis=1), closures.pairs])
    false = np.concatenate([np.zeros(steps, dtype=bool), closures.false])
    order = np.argsort(pairs[:, 1], kind="stable")  # odometry first, then the loops that this pose closes
    repeated = np.broadcast_to(closures.information, (len(closures.pairs), *closures.information.shape))
    relative = Factors(
        kind,
        pairs[order],
        np.concatenate([odometry.measurements, closures.measurements])[order],
        np.concatenate([odometry.information, repeated])[order],
        tag=_tag(kind),
    )
    columns, outliers = [relative], [false[order]]
    for reading in readings:
        if len(reading.poses) == 0:
            continue
        slots = [reading.poses, reading.landmarks] if len(reading.landmarks) else [reading.poses]
        count = len(reading.poses)
        spatial = reading.kind.parameter is not None
        columns.append(
            Factors(
                reading.kind,
                np.stack(slots, axis=1),
                reading.measurements,
                np.broadcast_to(reading.information, (count, *reading.information.shape)).copy(),
                parameters=np.tile(SE3.identity, (count, 1)) if spatial else None,
                parameter_ids=np.zeros(count, dtype=np.int64) if spatial else None,
                tag=_tag(reading.kind),
            )
        )
        outliers.append(reading.false)
    return columns, outliers


def _tag(kind: object) -> str:
    return next(record.tag for record in G2O.edges if record.kind is kind)


def _graph(poses: Array, landmarks: Array, factors: list[Factors], decimals: int | None) -> FactorGraph:
    """A graph at some values: poses 0 to n - 1, landmarks n and up."""
    space = 2 if poses.shape[1] == 3 else 3
    variables = {}
    first = 0
    for kind, values in ((pose_kind(space), poses), (XY if space == 2 else XYZ, landmarks)):
        count = len(values)
        if count == 0:
            continue
        ids = np.arange(first, first + count)
        variables[kind.name] = Variables.made(kind, ids, _round(np.asarray(values), decimals))
        first += count
    needs_offset = any(column.kind.parameter is not None for column in factors)
    return FactorGraph(variables, factors, {0: np.array(SE3.identity)} if needs_offset else {})


def _unknown(graph: FactorGraph) -> FactorGraph:
    """The graph without an estimate of anything but the first pose."""
    columns = {}
    for name, column in graph.variables.items():
        known = np.zeros(len(column), dtype=bool)
        known[0] = column.kind.is_pose
        columns[name] = replace(column, known=known)
    return replace(graph, variables=columns)
