"""What a sweep consists of: a case, axes along which it varies, seeds; and the tasks that this makes."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace
from fnmatch import fnmatchcase
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from slamcli import __version__
from slamcli.batch.execution import Execution
from slamcli.batch.pipeline import Case, run
from slamcli.errors import InputError, UsageError

#: What an axis can vary: options of these parts of a case ...
SECTIONS = ("simulation", "inject", "options", "evaluate")
#: ... and these themselves.
SCALARS = ("simulate", "data", "truth", "labels", "command")
#: Those of them that name files.
FILES = ("simulate", "data", "truth", "labels")
#: Options of the sections that name files which a command reads.
INPUTS = {
    "simulation": (),
    "inject": ("truth",),
    "options": ("config", "truth"),
    "evaluate": ("timestamps", "truth-timestamps", "covariances"),
}
#: More tasks than this are a mistake.
MOST_TASKS = 1_000_000


@dataclass(frozen=True)
class Level:
    """One value of an axis.

    Attributes
    ----------
    label
        As in the table: a number, a truth value or text.
    settings
        Values by address, such as ``options.robust`` or ``simulation.set.robot.noise``; None takes an option away.
    """

    label: Any
    settings: dict[str, Any]


@dataclass(frozen=True)
class Axis:
    """What varies together, under one name."""

    name: str
    levels: tuple[Level, ...]


@dataclass(frozen=True)
class SummaryOptions:
    """How the table is summarized.

    Attributes
    ----------
    by
        Axes whose levels make the groups.
    statistic
        ``mean`` or ``median``.
    confidence
        Of the intervals.
    compare
        An axis and the label of it that the other levels are compared with; None for no comparison.
    """

    by: tuple[str, ...]
    statistic: str = "mean"
    confidence: float = 0.95
    compare: tuple[str, Any] | None = None


@dataclass(frozen=True)
class Sweep:
    """A study.

    Attributes
    ----------
    name
        Of the study.
    source
        File that it was read from.
    case
        What each task runs where no axis says otherwise; the values of its sections are scalars and lists, and under
        ``set`` a mapping of keys with values as text.
    axes
        In the order of the file: the last one varies fastest, but for the seeds.
    metrics
        Columns of the table.
    summary
        How it is summarized.
    seed, seeds
        The first seed and their number, None where the file does not say it: the case keeps its own seeds then.
    """

    name: str
    source: str
    case: Case
    axes: tuple[Axis, ...]
    metrics: tuple[str, ...]
    summary: SummaryOptions
    seed: int = 0
    seeds: int | None = None


@dataclass(frozen=True)
class Task:
    """One run of the pipeline: a row of the table.

    Attributes
    ----------
    index
        Row of the whole table, from 0; the same with ``--only``.
    labels
        Label of each axis.
    seed
        Of its world; None where the case keeps its own.
    case
        What is run.
    metrics
        What is taken from it.
    key
        Hash of all that its result depends on: case, content of the files it reads, metrics, version of slamcli.
    """

    index: int
    labels: dict[str, Any]
    seed: int | None
    case: Case
    metrics: tuple[str, ...] = field(repr=False)
    key: str

    @property
    def name(self) -> str:
        """``robust=auto,seed=3``: what ``--only`` looks at."""
        parts = [f"{name}={text(label)}" for name, label in self.labels.items()]
        return ",".join([*parts, *([] if self.seed is None else [f"seed={self.seed}"])])


def tasks_of(sweep: Sweep, only: str | None = None) -> list[Task]:
    """All tasks in the order of the table, or those whose name matches a pattern as of file names.

    Raises
    ------
    UsageError
        If there are too many, or no name matches.
    InputError
        If a file that they name cannot be read.
    """
    size = (sweep.seeds or 1) * math.prod(len(axis.levels) for axis in sweep.axes)
    if size > MOST_TASKS:
        shown = size if size < 10**15 else "more than 10^15"
        raise UsageError(f"{sweep.source}: makes {shown} tasks, more than {MOST_TASKS}")
    digest = lru_cache(maxsize=None)(_digest)
    tasks: list[Task] = []
    for levels in itertools.product(*(axis.levels for axis in sweep.axes)):
        labels = {axis.name: level.label for axis, level in zip(sweep.axes, levels, strict=True)}
        case = sweep.case
        for level in levels:
            for address, value in level.settings.items():
                case = assigned(case, address, value)
        case = _complete(case)
        files = {name: digest(path) for name, path in input_files(case)}
        for seed in [None] if sweep.seeds is None else range(sweep.seed, sweep.seed + sweep.seeds):
            seeded = case if seed is None else _seeded(case, seed)
            key = _key(seeded, files, sweep.metrics)
            tasks.append(Task(len(tasks), labels, seed, seeded, sweep.metrics, key))
    kept = tasks if only is None else [task for task in tasks if fnmatchcase(task.name, only)]
    if not kept:
        raise UsageError(f"no task matches --only {only!r}", (f"  the first is called {tasks[0].name}",))
    return kept


def assigned(case: Case, address: str, value: Any) -> Case:
    """A case in which the value at an address is another one."""
    section, _, rest = address.partition(".")
    if not rest:
        return replace(case, **{section: value})
    options = dict(getattr(case, section))
    if rest.startswith("set."):
        options["set"] = {**options.get("set", {}), rest.removeprefix("set."): value}
    else:
        options[rest] = value
    changed: dict[str, Any] = {section: options}
    return replace(case, **changed)


def injection_seed(seed: int) -> int:
    """Seed of ``inject`` in a task with this seed.

    Another one than that of the world: both commands take their random numbers from the seed in the same way, so that
    equal seeds would make equal numbers.
    """
    return int(np.random.SeedSequence((seed, 1)).generate_state(1)[0] >> 1)


def command_lines(task: Task) -> list[tuple[str, ...]]:
    """The words of all steps of a task, as if each went well."""
    lines: list[tuple[str, ...]] = []

    def record(words: Any, folder: Path, limit: float | None) -> Execution:
        lines.append(tuple(words))
        return Execution(tuple(words), 0, None, "", 0.0)

    run(task.case, Path(), record)
    return lines


def command_levels(tasks: list[Task]) -> Iterator[Task]:
    """One task for each combination of levels: those of other seeds have the same options."""
    labels: dict[str, Any] | None = None
    for task in tasks:
        if task.labels is not labels:
            labels = task.labels
            yield task


def input_files(case: Case) -> Iterator[tuple[str, str]]:
    """The files that a case reads, by their place in it; also the name of a world."""
    for name in FILES:
        if (path := getattr(case, name)) is not None:
            yield name, path
    for section, names in INPUTS.items():
        for name in names:
            path = getattr(case, section).get(name)
            if isinstance(path, str) and os.path.isabs(path) and os.path.isfile(path):
                yield f"{section}.{name}", path


def options_of(case: Case, step: str) -> dict[str, Any]:
    """The options that a case has for a step."""
    section = {"simulate": "simulation", "inject": "inject", "evaluate": "evaluate"}
    return dict(getattr(case, "options" if step == case.command else section[step]))


def text(value: Any) -> str:
    """A value on one line, as YAML has it; text without quotes."""
    if isinstance(value, str):
        return value
    import yaml

    shown: str = yaml.safe_dump(value, default_flow_style=True, width=float("inf"))
    return shown.removesuffix("\n").removesuffix("\n...")


def _seeded(case: Case, seed: int) -> Case:
    """Each task of the same seed has the same world and, where the options of ``inject`` agree, the same spoiling."""
    if case.simulate is not None:
        case = replace(case, simulation={**case.simulation, "seed": seed})
    if case.inject:
        case = replace(case, inject={**case.inject, "seed": injection_seed(seed)})
    return case


def _complete(case: Case) -> Case:
    """The case as the pipeline takes it: without options that an axis has taken away, ``set`` as key=value."""
    sections: dict[str, Any] = {}
    for name in SECTIONS:
        options = {key: value for key, value in getattr(case, name).items() if value is not None}
        if "set" in options:
            options["set"] = [f"{key}={text(value)}" for key, value in options["set"].items() if value is not None]
        sections[name] = options
    return replace(case, **sections)


def _key(case: Case, files: dict[str, str], metrics: tuple[str, ...]) -> str:
    content = {part.name: getattr(case, part.name) for part in fields(case)}
    content |= files | {"name": "", "metrics": metrics, "version": __version__}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _digest(path: str) -> str:
    """Hash of a file's content, or of all files of a folder; the name of a world stands for itself."""
    if not os.path.isabs(path):
        return path
    try:
        if os.path.isdir(path):  # a log of several files
            inside = sorted(found for found in Path(path).rglob("*") if found.is_file())
            listing = [(found.relative_to(path).as_posix(), _digest(str(found))) for found in inside]
            return hashlib.sha256(json.dumps(listing).encode()).hexdigest()
        with open(path, "rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
