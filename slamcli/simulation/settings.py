"""Scenarios from YAML files and ``key=value`` settings: unknown keys and wrong types are errors with a suggestion."""

from __future__ import annotations

import copy
import os
from dataclasses import fields, is_dataclass
from typing import Any

import yaml

from slamcli.errors import UsageError
from slamcli.formats.configuration import load_mapping, suggestion
from slamcli.formats.quantities import parse_numbers
from slamcli.simulation.camera_scenes import CAMERA_WORLDS, CameraScene
from slamcli.simulation.checks import check
from slamcli.simulation.scenario import Scenario, Sensor
from slamcli.simulation.worlds import WORLDS


def load_scenario(source: str) -> dict[str, Any]:
    """Content of a configuration: of a YAML file, or of nothing but the name of a world.

    Raises
    ------
    UsageError
        If there is neither such a world nor such a file, or the file is not a mapping in YAML.
    """
    if source in WORLDS or source in CAMERA_WORLDS:
        return {"world": source}
    if not source.endswith((".yaml", ".yml")) and not os.path.exists(source):
        worlds = (*WORLDS, *CAMERA_WORLDS)
        raise UsageError(f"there is no world and no file {source!r}", (suggestion(source, worlds, "worlds"),))
    content = load_mapping(source)
    if not content:
        raise UsageError(f"{source}: holds no key", (f"  a world is enough, such as world: {next(iter(WORLDS))}",))
    return content


def sweep_of(
    content: dict[str, Any], sweep: str, runs: int, source: str
) -> tuple[str, list[tuple[object, list[Scenario]]]]:
    """Key, and for each of its values the scenarios of ``runs`` seeds, of ``key=value,value,...``.

    Raises
    ------
    UsageError
        If it is not of that form.
    """
    key, equals, text = sweep.partition("=")
    values = [value.strip() for value in text.split(",") if value.strip()]
    if not equals or not key or not values:
        raise UsageError(f"--sweep needs key=value,value,..., got {sweep!r}", ("  such as robot.slip=0,0.01,0.02",))
    first = scenario_of(content, source).seed
    out: list[tuple[object, list[Scenario]]] = []
    for value in values:
        changed = copy.deepcopy(content)
        assign(changed, f"{key}={value}")
        seeds = [first] if key == "seed" else range(first, first + runs)
        scenarios = [scenario_of(changed | ({} if key == "seed" else {"seed": seed}), source) for seed in seeds]
        out.append((value, scenarios))
    return key, out


def scenario_of(content: dict[str, Any], source: str) -> Scenario:
    """A checked scenario of the content of a configuration file.

    Raises
    ------
    UsageError
        If a key is unknown or a value impossible; the message names both.
    """
    out: Scenario = _build(Scenario, content, source, "")
    check(out, source)
    return out


def camera_scene_of(content: dict[str, Any], source: str) -> CameraScene:
    """A checked scene of cameras of the content of a configuration file.

    Raises
    ------
    UsageError
        If a key is unknown or a value impossible.
    """
    out: CameraScene = _build(CameraScene, content, source, "")
    return out


def assign(content: dict[str, Any], setting: str) -> None:
    """Apply ``key=value`` to the content of a configuration; the key may have dots, the value is YAML.

    Raises
    ------
    UsageError
        If it is not of that form.
    """
    key, equals, text = setting.partition("=")
    if not equals or not key:
        raise UsageError(f"--set needs key=value, got {setting!r}", ("  such as --set robot.slip=0.02",))
    try:
        value = yaml.safe_load(text)
    except yaml.YAMLError:
        raise UsageError(f"--set {setting}: the value is not valid YAML") from None
    place: Any = content
    *parents, last = key.replace("-", "_").split(".")
    for name in parents:
        if isinstance(place, list):
            place = _item(place, name, setting)
        else:
            place = place.setdefault(name, [] if name == "sensors" else {})
    if isinstance(place, list):
        _item(place, last, setting)
        place[int(last)] = value
    elif isinstance(place, dict):
        place[last] = value
    else:
        raise UsageError(f"--set {setting}: {'.'.join(parents)} holds a value, not options")


def _item(items: list[Any], name: str, setting: str) -> Any:
    if not name.isdecimal() or int(name) > len(items):
        raise UsageError(f"--set {setting}: expected a number up to {len(items)} for the sensor, found {name!r}")
    if int(name) == len(items):
        items.append({})
    return items[int(name)]


def _build(kind: Any, content: Any, source: str, where: str) -> Any:
    """A dataclass of a mapping, its sections included."""
    if not isinstance(content, dict):
        raise UsageError(f"{source}: {where or 'a scenario'} needs options with values, found {content!r}")
    known = {f.name: f for f in fields(kind)}
    values = {}
    for key, value in content.items():
        name = str(key).replace("-", "_")
        label = f"{where}.{name}" if where else name
        if name not in known:
            raise UsageError(f"{source}: unknown key {label!r}", (suggestion(name, known),))
        default = getattr(kind(), name)
        if name == "sensors":
            if not isinstance(value, list):
                raise UsageError(f"{source}: sensors needs a list, found {value!r}")
            values[name] = tuple(_build(Sensor, item, source, f"sensors.{k}") for k, item in enumerate(value))
        elif is_dataclass(default):
            values[name] = _build(type(default), value if value is not None else {}, source, label)
        else:
            values[name] = _value(value, str(known[name].type), source, label)
    return kind(**values)


def _value(value: Any, kind: str, source: str, label: str) -> Any:
    """A value of the declared type; numbers may have units."""
    if kind == "Any" or (value is None and "None" in kind):
        return value
    if kind.startswith("tuple"):
        items = value if isinstance(value, list) else [value]
        return tuple(_number(item, source, f"{label}.{k}") for k, item in enumerate(items))
    if kind.startswith("dict"):
        if value is None or isinstance(value, dict):
            numbers = {str(k).replace("-", "_"): v for k, v in (value or {}).items()}
            return {name: _exact(_number(v, source, f"{label}.{name}")) for name, v in numbers.items()}
        raise UsageError(f"{source}: {label} needs options with values, found {value!r}")
    if kind.startswith("str"):
        if isinstance(value, str):
            return value
        raise UsageError(f"{source}: {label} must be a word, found {value!r}")
    number = _number(value, source, label)
    if kind.startswith("int"):
        if number != int(number):
            raise UsageError(f"{source}: {label} must be a whole number, found {value!r}")
        return int(number)
    return number


def _exact(number: float) -> float:
    """Whole numbers as such, so that 1e3 counts as well as 1000."""
    return int(number) if number == int(number) else number


def _number(value: Any, source: str, label: str) -> float:
    if isinstance(value, str):
        try:
            numbers = parse_numbers(value)
        except ValueError as error:
            raise UsageError(f"{source}: {label}: {error}") from None
        if len(numbers) > 1:
            raise UsageError(f"{source}: {label} must be one number, found {value!r}")
        return numbers[0]
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) < 1e300:
        raise UsageError(f"{source}: {label} must be a finite number, found {value!r}")
    return value
