"""Options of the commands that run the filter, and the ``EkfOptions`` they make."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import click

from slamcli.cli.inputs import INPUT
from slamcli.cli.quantities import Numbers
from slamcli.errors import UsageError

F = TypeVar("F", bound=Callable[..., Any])
_NEW_GATE = 0.9999


def log_options(function: F) -> F:
    """``INPUT --truth --robot --dialect --lenient``: the log and its truth."""
    options = [
        click.option("--truth", type=INPUT, metavar="FILE", help="Graph or trajectory with the truth."),
        click.option("--robot", type=click.IntRange(min=1), metavar="N", help="Which robot of a log of several."),
        click.option("--dialect", type=click.Choice(["g2o", "toro"]), help="INPUT is a graph of this dialect."),
        click.option("--lenient", is_flag=True, help="Skip and count malformed records instead of stopping at them."),
    ]
    return _apply(function, options)


def filter_options(function: F) -> F:
    """What ``EkfOptions`` has, as options."""
    options = [
        click.option(
            "--association",
            type=click.Choice(["known", "nearest", "jcbb"]),
            default="known",
            show_default=True,
            help="Which landmark a reading is of: its id in the log, the nearest, or joint compatibility.",
        ),
        click.option(
            "--gate",
            type=click.FloatRange(0.0, 1.0, min_open=True, max_open=True),
            default=0.99,
            show_default=True,
            help="Probability of the chi-square gate in which a reading may belong to a landmark.",
        ),
        click.option(
            "--new-gate",
            type=click.FloatRange(0.0, 1.0, min_open=True, max_open=True),
            default=_NEW_GATE,
            show_default=True,
            help="A reading outside this gate of every landmark starts a new one; in between it is ignored.",
        ),
        click.option(
            "--reject-outliers",
            is_flag=True,
            help="Gate readings of known landmarks, too: those outside of --new-gate are counted and not used.",
        ),
        click.option(
            "--motion-noise",
            metavar="N,...",
            help="Noise of odometry in a log that states none: deviations of x, y, theta for each step (body), the "
            "alphas of Thrun (velocity 6, odometry 4), baseline and slip (differential-drive).",
        ),
        click.option(
            "--noise",
            "sensor_noise",
            multiple=True,
            metavar="SENSOR=N,...",
            help="Standard deviations of a sensor in a log that states none, such as range-bearing=0.1,2deg.",
        ),
        click.option("--sensor-range", type=float, metavar="M", help="Ignore and count readings farther away."),
        click.option(
            "--start-noise",
            type=Numbers("m", "m", "rad", minimum=0.0),
            default=(0.0, 0.0, 0.0),
            metavar="X,Y,THETA",
            help="Standard deviations of the first pose.  [default: it is known]",
        ),
        click.option(
            "--jacobians",
            type=click.Choice(["standard", "first-estimates"]),
            default="standard",
            show_default=True,
            help="Where the models are linearized: at the latest estimates, or at the first ones.",
        ),
        click.option(
            "--form",
            type=click.Choice(["symmetric", "joseph"]),
            default="symmetric",
            show_default=True,
            help="Update of the covariance.",
        ),
        click.option("--compressed", is_flag=True, help="Keep only a local area of the map up to date (exact)."),
        click.option("--area-radius", type=float, metavar="M", help="Radius of that area."),
    ]
    return _apply(function, options)


def options_of(log: Any, given: dict[str, Any]) -> Any:
    """The ``EkfOptions`` for a log.

    Raises
    ------
    UsageError
        If the noise is not that of the log's robot and sensors.
    """
    from slamcli.filtering.options import EkfOptions

    gate, new_gate = given["gate"], given["new_gate"]
    if given["association"] == "known":
        gate = min(gate, new_gate)  # not used
    elif new_gate == _NEW_GATE:
        new_gate = max(gate, new_gate)
    elif new_gate < gate:
        raise UsageError(f"--new-gate {new_gate:g} is below --gate {gate:g}: a landmark would start inside of the gate")
    if given["area_radius"] is not None and not given["compressed"]:
        raise UsageError("--area-radius has no meaning without --compressed")
    return EkfOptions(
        association=given["association"],
        gate_probability=gate,
        new_probability=new_gate,
        gate_known=given["reject_outliers"],
        motion=_motion(log.model, given["motion_noise"]),
        sensor_deviations=_deviations(given["sensor_noise"]),
        sensor_range=given["sensor_range"],
        start_deviations=given["start_noise"],
        jacobians=given["jacobians"],
        form=given["form"],
        compressed=given["compressed"],
        area_radius=given["area_radius"],
    )


def unused_noise(log: Any, given: dict[str, Any]) -> list[str]:
    """Which noise was given for nothing: the log states its own, or has no such sensor."""
    out = []
    if given["motion_noise"] is not None and log.information is not None:
        out.append("--motion-noise is not used: the log states the noise of its odometry")
    for name in dict.fromkeys(setting.partition("=")[0] for setting in given["sensor_noise"]):
        from slamcli.filtering.innovation import SENSORS

        entries = [entry for entry in log.observations if entry.kind is SENSORS[name].kind]
        if all(entry.information is not None for entry in entries):
            why = "states the noise of these readings" if entries else "has no such readings"
            out.append(f"--noise {name} is not used: the log {why}")
    return out


def log_of(path: str, given: dict[str, Any]) -> Any:
    """The log of a file, or of a scenario."""
    scenario = scenario_of_input(path, given)
    if scenario is None:
        from slamcli.formats.logs import read_log

        return read_log(
            path, dialect=given["dialect"], lenient=given["lenient"], truth=given["truth"], robot=given["robot"]
        )
    from slamcli.evaluation.monte_carlo import simulated_log

    return simulated_log(scenario)


def scenario_of_input(path: str, given: dict[str, Any]) -> Any:
    """The scenario that a name or a YAML file stands for, None for a log."""
    from slamcli.simulation.settings import assign, load_scenario, scenario_of
    from slamcli.simulation.worlds import WORLDS

    if path not in WORLDS and not path.endswith((".yaml", ".yml")):
        if given["settings"]:
            raise UsageError("--set changes a scenario, and INPUT is a log")
        return None
    for name in ("truth", "robot", "dialect"):
        if given[name] is not None:
            raise UsageError(f"--{name} goes with a log, and INPUT is a scenario")
    content = load_scenario(path)
    for setting in given["settings"]:
        assign(content, setting)
    return scenario_of(content, path)


def _motion(model: str, noise: str | None) -> Any:
    """The motion model of a log with the noise that was given for it."""
    if noise is None:
        return None
    from slamcli.formats.quantities import parse_numbers
    from slamcli.models.motion import BodyMotion, DifferentialDrive, OdometryMotion, VelocityMotion

    units = {
        "body": ("m", "m", "rad"),
        "velocity": ("",) * 6,
        "odometry": ("",) * 4,
        "differential-drive": ("m", ""),
    }[model]
    try:
        numbers = parse_numbers(noise, units)
    except ValueError as error:
        raise UsageError(f"--motion-noise of a {model} robot: {error}") from None
    if model == "body":
        return BodyMotion(numbers)
    if model == "differential-drive":
        return DifferentialDrive(baseline=numbers[0], slip=numbers[1])
    return VelocityMotion(*numbers) if model == "velocity" else OdometryMotion(*numbers)


def _deviations(settings: tuple[str, ...]) -> dict[str, tuple[float, ...]]:
    """Standard deviations by sensor."""
    from slamcli.filtering.innovation import SENSORS
    from slamcli.formats.quantities import parse_numbers

    out = {}
    for setting in settings:
        name, equals, text = setting.partition("=")
        if not equals or name not in SENSORS:
            raise UsageError(f"--noise needs SENSOR=deviations, got {setting!r}", (f"  sensors: {', '.join(SENSORS)}",))
        try:
            out[name] = parse_numbers(text, SENSORS[name].units)
        except ValueError as error:
            raise UsageError(f"--noise {name}: {error}") from None
    return out


def _apply(function: F, options: list[Any]) -> F:
    """The function with the options, listed in this order."""
    for option in reversed(options):
        function = option(function)
    return function
