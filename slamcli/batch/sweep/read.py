"""Sweep files: YAML, strictly. Every key that does not exist is an error that names the nearest one that does."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from slamcli.batch.datasets.search import checked, find, suggestions
from slamcli.batch.metrics import METRICS
from slamcli.batch.pipeline import Case
from slamcli.batch.sweep.plan import FILES, SCALARS, SECTIONS, Axis, Level, SummaryOptions, Sweep, text
from slamcli.errors import InputError, UsageError
from slamcli.formats.configuration import line_of, load_mapping, suggestion
from slamcli.simulation.camera_scenes import CAMERA_WORLDS
from slamcli.simulation.worlds import WORLDS

_KEYS = ("name", "seed", "seeds", "case", "axes", "metrics", "summary")
_CASE = (*SCALARS, *SECTIONS, "time_limit")
_SUMMARY = ("by", "statistic", "confidence", "compare")
STATISTICS = ("mean", "median")
#: Columns that the table has anyway.
COLUMNS = ("task", "seed", "exit_code", "failed", "message")
#: Options that a sweep sets itself: files of its steps, and what they print.
OWN = {
    "simulation": ("output", "truth", "json"),
    "inject": ("output", "labels", "json"),
    "options": ("output", "labels-out", "json"),
    "evaluate": ("truth", "labels", "estimated-labels", "json"),
}
#: Seconds, some ten years; what a timer takes ends not far above.
_LONGEST_LIMIT = 3e8
#: What depends on the machine and on what else it does.
_UNSTEADY = frozenset({"memory", *(metric.name for metric in METRICS.values() if getattr(metric, "timed", False))})
_SCALAR = (str, int, float, bool)


def read_sweep(path: str) -> Sweep:
    """The sweep that a file describes (``docs/sweep.md``); files in it are relative to its folder.

    Raises
    ------
    UsageError
        If it is no valid sweep.
    InputError
        If a data set that it names is not here.
    """
    reader = _Reader(path)
    content = reader.section(load_mapping(path), "", _KEYS)
    reader.check_texts(content, "")
    if "case" not in content or "metrics" not in content:
        missing = "case" if "case" not in content else "metrics"
        raise UsageError(f"{path}: the key {missing} is missing", ("  docs/sweep.md has an example",))
    name = content.get("name", Path(path).name.removesuffix(".yaml").removesuffix(".yml"))
    if not isinstance(name, str) or not name or "/" in name:
        raise reader.error("name", f"expected text without a slash, found {name!r}")
    case = reader.case(content["case"], name)
    axes = reader.axes(content.get("axes", {}))
    seeds = reader.count(content, "seeds", 1)
    seed = reader.count(content, "seed", 0)
    if seed is not None and seeds is None:
        raise reader.error("seed", "is the first of several seeds", "  seeds: says how many there are")
    sweep = Sweep(
        name=name,
        source=path,
        case=case,
        axes=axes,
        metrics=reader.metrics(content["metrics"], [axis.name for axis in axes]),
        summary=reader.summary(content.get("summary", {}), axes),
        seed=seed or 0,
        seeds=seeds,
    )
    reader.check(sweep)
    return sweep


class _Reader:
    """Reads values; its messages begin with the file, the line and the key."""

    def __init__(self, path: str) -> None:
        self.path = path
        self.folder = Path(path).resolve().parent

    def section(self, content: Any, where: str, known: Iterable[str] | None = None) -> dict[str, Any]:
        """A mapping whose keys are text, with underscores; unknown ones are errors."""
        if not isinstance(content, Mapping):
            raise self.error(where, f"expected keys with values, found {_shown(content)}")
        out: dict[str, Any] = {}
        for key, value in content.items():
            if not isinstance(key, str):
                raise self.error(where, f"expected text for a key, found {key!r}")
            name = key if known is None else key.replace("-", "_")
            if known is not None and name not in known:
                at = f"{where}.{key}" if where else key
                raise self.error(where, f"unknown key {key!r}", suggestion(name, known), at=at)
            out[name] = value
        return out

    def check_texts(self, content: Any, where: str) -> None:
        """Refuse text that can be neither in a table nor in a command line."""
        items = content.items() if isinstance(content, Mapping) else [("", content)]
        for key, value in items:
            place = f"{where}.{key}".strip(".")
            for item in (key, *(value if isinstance(value, list) else [value])):
                if isinstance(item, str) and _unusable(item):
                    raise self.error(place, f"{item!r} has a character that is none")
            if isinstance(value, Mapping):
                self.check_texts(value, place)

    def case(self, content: Any, name: str) -> Case:
        """The case; exactly one of data and simulate is checked later, since an axis may give it."""
        given = self.section(content, "case", _CASE)
        values: dict[str, Any] = {}
        for key, value in given.items():
            if key in SECTIONS:
                values[key] = self.options(value, f"case.{key}")
            elif key == "time_limit":
                if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value <= _LONGEST_LIMIT:
                    raise self.error(
                        "case.time_limit", f"expected a number of seconds, at most {_LONGEST_LIMIT:g}, found {value!r}"
                    )
                values[key] = float(value)
            else:
                values[key] = self.scalar(key, value, f"case.{key}")
        return Case(name=name, **values)

    def options(self, content: Any, where: str) -> dict[str, Any]:
        """Options of a command by their names with hyphens."""
        out: dict[str, Any] = {}
        for key, value in self.section({} if content is None else content, where).items():
            name = key.replace("_", "-")
            self.check_own(where.removeprefix("case."), name, f"{where}.{key}")
            out[name] = self.settings(value, f"{where}.set") if name == "set" else self.value(value, f"{where}.{key}")
        return out

    def check_own(self, section: str, name: str, where: str) -> None:
        """Refuse an option that would have no effect, or take the result away."""
        if name in OWN[section]:
            raise self.error(where, f"the sweep sets --{name} itself", "  metrics has what the table gets")

    def settings(self, content: Any, where: str) -> dict[str, Any]:
        """What ``--set`` gets: a mapping, or a list of key=value."""
        if isinstance(content, list):
            pairs = [item.partition("=") if isinstance(item, str) else ("", "", "") for item in content]
            if not all(equals for _, equals, _ in pairs):
                raise self.error(where, f"expected keys with values, or a list of key=value, found {_shown(content)}")
            return {key: value for key, _, value in pairs}
        return self.section(content, where)

    def value(self, value: Any, where: str) -> Any:
        """Of an option: a scalar, or a list of them."""
        if value is None or isinstance(value, _SCALAR):
            return value
        if isinstance(value, list) and value and all(isinstance(item, _SCALAR) for item in value):
            return value
        raise self.error(where, f"expected a value or a list of values, found {_shown(value)}")

    def scalar(self, key: str, value: Any, where: str) -> str:
        """A word of a case; a file becomes an absolute path."""
        if not isinstance(value, str) or not value:
            raise self.error(where, f"expected text, found {_shown(value)}")
        if key not in FILES or (key == "simulate" and value in (*WORLDS, *CAMERA_WORLDS)):
            return value
        beside = self.folder / value
        if beside.is_file() or (key == "data" and beside.is_dir()):
            return str(beside)
        if key == "simulate":
            if value.endswith((".yaml", ".yml")):
                raise self.missing(where, beside)
            known = (*WORLDS, *CAMERA_WORLDS)
            raise self.error(where, f"there is no world and no file {value!r}", suggestion(value, known))
        try:  # not a file of the folder that slamcli was called in
            found = find(value)
            if found is None:
                raise self.missing(where, beside, *suggestions(value))
            return str(checked(found).resolve())
        except (UsageError, InputError) as error:
            if error.message.startswith(self.path):
                raise
            raise type(error)(f"{self.place(where)}: {error.message}", error.details) from None

    def axes(self, content: Any) -> tuple[Axis, ...]:
        """The axes; no two may set the same."""
        out: list[Axis] = []
        owners: dict[str, str] = {}
        for name, values in self.section({} if content is None else content, "axes").items():
            axis = Axis(name, self.levels(name, values))
            for address in sorted({address for level in axis.levels for address in level.settings}):
                other = owners.setdefault(address, name)
                if other != name:
                    raise self.error(f"axes.{name}", f"sets {address}, as the axis {other} does")
            if name in COLUMNS:
                raise self.error(f"axes.{name}", "is the name of a column that every table has")
            if not name.strip():
                raise self.error("axes", "an axis needs a name")
            out.append(axis)
        return tuple(out)

    def levels(self, name: str, values: Any) -> tuple[Level, ...]:
        """Values of one key, or labels that set several."""
        where = f"axes.{name}"
        if isinstance(values, list):
            # labels as the file has them: the place of a data set is another one on each machine
            levels = [Level(_label(value), dict([self.setting(name, value, where)])) for value in values]
        else:
            levels = []
            for label, content in self.section(values, where).items():
                settings = self.section({} if content is None else content, f"{where}.{label}").items()
                levels.append(
                    Level(label, dict(self.setting(key, value, f"{where}.{label}") for key, value in settings))
                )
        if not levels:
            raise self.error(where, "has no value")
        labels = [level.label for level in levels]
        seen: set[Any] = set()
        for label in labels:
            # also 1 and 1.0, or 1 and true, or 1 and "1": equal in the table
            if label in seen or text(label) in seen:
                raise self.error(where, f"the value {text(label)} stands twice")
            seen |= {label, text(label)}
        return tuple(levels)

    def setting(self, address: str, value: Any, where: str) -> tuple[str, Any]:
        """An address of the case with a value."""
        section, _, rest = address.partition(".")
        if address in SCALARS:
            return address, self.scalar(address, value, where)
        if section not in SECTIONS or not rest:
            known = (*SCALARS, *(f"{name}.OPTION" for name in SECTIONS))
            raise self.error(where, f"{address!r} is no key of the case", suggestion(address, known))
        if rest.startswith("set."):
            return address, value
        if "." in rest or rest == "set":
            raise self.error(where, f"{address!r}: options have no dots; {section}.set.KEY is what --set gets")
        name = rest.replace("_", "-")
        self.check_own(section, name, where)
        return f"{section}.{name}", self.value(value, where)

    def metrics(self, content: Any, axes: Iterable[str]) -> tuple[str, ...]:
        """Names that exist, say the same on each run and are those of no axis."""
        if not isinstance(content, list) or not content or not all(isinstance(name, str) for name in content):
            raise self.error("metrics", f"expected a list of names, found {_shown(content)}")
        for name in content:
            if name in COLUMNS:
                raise self.error("metrics", f"{name} is a column of the table anyway")
            if name in _UNSTEADY:
                raise self.error("metrics", f"{name} changes from run to run", "  --times writes a table of times")
            step, colon, key = name.partition(":")
            if name not in METRICS and not (step and colon and key):
                known = [known for known in METRICS if known not in _UNSTEADY and known not in COLUMNS]
                raise self.error("metrics", f"there is no metric {name!r}", suggestion(name, known))
            if content.count(name) > 1:
                raise self.error("metrics", f"{name} stands twice")
            if name in axes:
                raise self.error(f"axes.{name}", "is the name of a metric, too: the table has one column of a name")
        return tuple(content)

    def summary(self, content: Any, all_axes: Sequence[Axis]) -> SummaryOptions:
        """How to summarize."""
        axes = [axis.name for axis in all_axes]
        given = self.section({} if content is None else content, "summary", _SUMMARY)
        by = given.get("by", axes)
        if not isinstance(by, list):
            raise self.error("summary.by", f"expected a list of axes, found {_shown(by)}")
        for name in by:
            if name not in axes:
                raise self.error("summary.by", f"there is no axis {name!r}", suggestion(str(name), axes, "axes"))
            if by.count(name) > 1:
                raise self.error("summary.by", f"{name} stands twice")
        statistic = given.get("statistic", "mean")
        if statistic not in STATISTICS:
            raise self.error("summary.statistic", f"expected mean or median, found {statistic!r}")
        confidence = given.get("confidence", 0.95)
        if not isinstance(confidence, float) or not 0.0 < confidence < 1.0:
            raise self.error("summary.confidence", f"expected a number between 0 and 1, found {confidence!r}")
        return SummaryOptions(tuple(by), statistic, confidence, self.compare(given.get("compare"), all_axes))

    def compare(self, content: Any, axes: Sequence[Axis]) -> tuple[str, Any] | None:
        """An axis with the label that the others are compared with."""
        if content is None:
            return None
        where = "summary.compare"
        given = self.section(content, where)
        if len(given) != 1:
            raise self.error(where, "expected one axis with one of its values, such as {options.robust: none}")
        ((name, label),) = given.items()
        found = [axis for axis in axes if axis.name == name]
        if not found:
            raise self.error(
                where, f"there is no axis {name!r}", suggestion(name, [axis.name for axis in axes], "axes")
            )
        labels = [level.label for level in found[0].levels]
        if _label(label) not in labels:
            raise self.error(where, f"{name} has no value {text(label)}", suggestion(text(label), map(text, labels)))
        return name, _label(label)

    def count(self, content: dict[str, Any], key: str, least: int) -> int | None:
        """A whole number, None if it is not there."""
        value = content.get(key)
        if key not in content:
            return None
        if isinstance(value, bool) or not isinstance(value, int) or value < least:
            raise self.error(key, f"expected a whole number of at least {least}, found {value!r}")
        return value

    def check(self, sweep: Sweep) -> None:
        """Each task has its data, from one place, and something random for its seed."""
        settings = [level.settings for axis in sweep.axes for level in axis.levels]
        varied = {address for setting in settings for address in setting}
        commands = {sweep.case.command, *(setting["command"] for setting in settings if "command" in setting)}
        for name in sweep.metrics:
            step, colon, _ = name.partition(":")
            if colon and step not in (known := ("simulate", "inject", "evaluate", *sorted(commands))):
                raise self.error("metrics", f"{name}: there is no step {step!r}", f"  steps: {', '.join(known)}")
        has = {name: getattr(sweep.case, name) is not None or name in varied for name in ("data", "simulate")}
        if has["data"] == has["simulate"]:
            found = "both" if has["data"] else "neither"
            raise self.error("case", f"needs data or simulate, has {found}", "  data: FILE, or simulate: WORLD")
        injects = bool(sweep.case.inject) or any(address.startswith("inject.") for address in varied)
        if has["data"] and (sweep.case.simulation or any(a.startswith("simulation.") for a in varied)):
            raise self.error("case.simulation", "has no meaning with data")
        if sweep.seeds is None:
            return
        if not has["simulate"] and not injects:
            raise self.error("seeds", "nothing in this case is random", "  simulate or inject take a seed")
        for section in ("simulation", "inject"):
            if "seed" in getattr(sweep.case, section) or f"{section}.seed" in varied:
                raise self.error("seeds", f"sets the seed of {section}: take {section}.seed out of the case")

    def place(self, where: str, at: str | None = None) -> str:
        """A key of the file, with the line of it or of another one."""
        line = line_of(self.path, where if at is None else at)
        return ": ".join(filter(None, (self.path if line is None else f"{self.path}:{line}", where)))

    def error(self, where: str, message: str, *details: str, at: str | None = None) -> UsageError:
        """An error at a key of the file, with the line of it or of another one."""
        return UsageError(f"{self.place(where, at)}: {message}", details)

    def missing(self, where: str, path: Path, *details: str) -> InputError:
        """A file that is not there."""
        return InputError(f"{self.place(where)}: {path}: there is no such file", details)


def _label(value: Any) -> Any:
    """Numbers, truth values and text as they are, the rest as text."""
    return value if isinstance(value, _SCALAR) else text(value)


def _shown(value: Any) -> str:
    return "nothing" if value is None else text(value) if isinstance(value, _SCALAR) else type(value).__name__


def _unusable(value: str) -> bool:
    """Whether text holds NUL, which no command line takes, or halves of characters, which no encoding takes."""
    return "\0" in value or any("\ud800" <= character <= "\udfff" for character in value)
