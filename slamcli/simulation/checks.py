"""Whether a scenario can be simulated: names that exist, numbers in their ranges."""

from __future__ import annotations

import inspect

from slamcli.errors import UsageError
from slamcli.formats.configuration import suggestion
from slamcli.simulation.scenario import CLOSURE_SOURCES, GUESSES, MOTIONS, PLANAR_SENSORS, SPATIAL_SENSORS, Scenario
from slamcli.simulation.worlds import WORLDS

#: Steps, rooms or rings that a world may be wide, and metres: what is larger does not fit into memory, or into numbers.
_MOST_STEPS, _FARTHEST = 1_000_000, 1e9
_MOST_POINTS = 10_000_000
_MOST_DECIMALS = 17


def check(scenario: Scenario, source: str) -> None:
    """Refuse what cannot be simulated.

    Raises
    ------
    UsageError
        With the key, what it may be and what it is.
    """
    _check_world(scenario, source)
    _check_choices(scenario, source)
    _check_numbers(scenario, source)


def _check_world(scenario: Scenario, source: str) -> None:
    if scenario.world not in WORLDS:
        hint = suggestion(scenario.world, WORLDS, "worlds")
        raise UsageError(f"{source}: there is no world {scenario.world!r}", (hint,))
    parameters = dict(list(inspect.signature(WORLDS[scenario.world]).parameters.items())[2:])
    for name, value in scenario.path.items():
        if name not in parameters:
            hint = suggestion(name, parameters)
            raise UsageError(f"{source}: unknown key 'path.{name}' of the world {scenario.world}", (hint,))
        whole = parameters[name].annotation == "int"
        if whole and value != int(value):
            raise UsageError(f"{source}: path.{name} must be a whole number, found {value!r}")
        most = 1 if name == "turning" else _MOST_STEPS if whole else _FARTHEST
        if not 0 < value <= most:
            raise UsageError(f"{source}: path.{name} must be positive and at most {most:g}, found {value!r}")
    if not 2 <= scenario.poses <= _MOST_POINTS:
        raise UsageError(f"{source}: poses must be from 2 to {_MOST_POINTS}, found {scenario.poses}")
    if not 0 <= (scenario.landmarks.count or 0) <= _MOST_POINTS:
        raise UsageError(
            f"{source}: landmarks.count must be from 0 to {_MOST_POINTS}, found {scenario.landmarks.count}"
        )
    if not 0 <= (scenario.decimals or 0) <= _MOST_DECIMALS:
        raise UsageError(f"{source}: decimals must be from 0 to {_MOST_DECIMALS}, found {scenario.decimals}")


def _check_choices(scenario: Scenario, source: str) -> None:
    sensors = PLANAR_SENSORS if scenario.space == 2 else SPATIAL_SENSORS
    choices = [("guess", scenario.guess, GUESSES), ("closures.by", scenario.closures.by, CLOSURE_SOURCES)]
    choices.append(("robot.model", scenario.robot.model, MOTIONS if scenario.space == 2 else MOTIONS[:1]))
    choices += [(f"sensors.{k}.kind", sensor.kind, sensors) for k, sensor in enumerate(scenario.sensors)]
    for label, value, known in choices:
        if value not in known:
            plane = "planar" if scenario.space == 2 else "spatial"
            hint = f"  in a {plane} world: {', '.join(known)}"
            raise UsageError(f"{source}: {label} cannot be {value!r}", (hint,))
    needed = {"odometry": 4, "velocity": 6}.get(scenario.robot.model)
    if needed and len(scenario.robot.alphas) not in (0, needed):
        raise UsageError(f"{source}: robot.alphas of {scenario.robot.model} are {needed} numbers")


def _check_numbers(scenario: Scenario, source: str) -> None:
    """Ranges of the numbers."""
    robot, closures, landmarks = scenario.robot, scenario.closures, scenario.landmarks
    tails = [("robot.tails", robot.tails), ("closures.tails", closures.tails)]
    shares = [("closures.probability", closures.probability)]
    positive = [("robot.baseline", robot.baseline), ("robot.period", robot.period), ("closures.gap", closures.gap)]
    positive += [("closures.per_pose", closures.per_pose), ("closures.field_of_view", closures.field_of_view)]
    least = [("robot.slip", robot.slip), ("robot.sideways", robot.sideways), ("closures.false", closures.false)]
    least += [("robot.ticks_per_metre", robot.ticks_per_metre), ("landmarks.density", landmarks.density)]
    least += [(f"robot.alphas.{k}", alpha) for k, alpha in enumerate(robot.alphas)]
    least += [("closures.count", closures.count or 0), ("seed", scenario.seed)]
    if closures.reach is not None:
        positive.append(("closures.reach", closures.reach))
    for k, sensor in enumerate(scenario.sensors):
        tails.append((f"sensors.{k}.tails", sensor.tails))
        shares.append((f"sensors.{k}.detection", sensor.detection))
        positive += [(f"sensors.{k}.{name}", getattr(sensor, name)) for name in ("range", "field_of_view", "every")]
        least.append((f"sensors.{k}.false_alarms", sensor.false_alarms))
    checks = [(n, v, v is None or v > 2.0, "more than 2 (or left out: Gaussian)") for n, v in tails]
    checks += [(n, v, 0.0 <= v <= 1.0, "from 0 to 1") for n, v in shares]
    checks += [(n, v, v > 0, "positive") for n, v in positive]
    checks += [(n, v, v >= 0, "0 or more") for n, v in least]
    for label, value, good, wanted in checks:
        if not good:
            raise UsageError(f"{source}: {label} must be {wanted}, found {value!r}")
