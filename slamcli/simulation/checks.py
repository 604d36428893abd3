"""Whether a scenario can be simulated: names that exist, numbers in their ranges."""

from __future__ import annotations

import inspect

from slamcli.errors import UsageError
from slamcli.formats.configuration import suggestion
from slamcli.simulation.scenario import CLOSURE_SOURCES, GUESSES, MOTIONS, PLANAR_SENSORS, SPATIAL_SENSORS, Scenario
from slamcli.simulation.worlds import WORLDS


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
    parameters = list(inspect.signature(WORLDS[scenario.world]).parameters)[2:]
    for name, value in scenario.path.items():
        if name not in parameters:
            hint = suggestion(name, parameters)
            raise UsageError(f"{source}: unknown key 'path.{name}' of the world {scenario.world}", (hint,))
        if value is None or isinstance(value, (str, bool)) or not value > 0:
            raise UsageError(f"{source}: path.{name} must be positive, found {value!r}")
    if not 2 <= scenario.poses <= 10_000_000:
        raise UsageError(f"{source}: poses must be from 2 to 10000000, found {scenario.poses}")


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
    least += [(n, v) for n, v in (("landmarks.count", landmarks.count), ("closures.count", closures.count)) if v]
    least += [("seed", scenario.seed), ("decimals", scenario.decimals or 0)]
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
