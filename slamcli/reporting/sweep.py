"""What ``slamcli sweep`` prints: groups with their confidence intervals, counts of exit codes, the JSON document."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from slamcli.batch.sweep.paired import Difference
from slamcli.batch.sweep.plan import Sweep, Task, text
from slamcli.batch.sweep.run import State
from slamcli.batch.sweep.summary import Group, Interval, Statistics
from slamcli.reporting.documents import head
from slamcli.reporting.text import plural, table

#: What the exit codes of a task say.
_CODES = {
    0: "without a failure",
    1: "check failed",
    2: "usage",
    3: "invalid input",
    4: "not converged",
    5: "numerical failure",
    70: "slamcli itself failed",
    124: "time limit",
    137: "killed",
}


@dataclass(frozen=True)
class Ran:
    """What this run of a sweep did.

    Attributes
    ----------
    ran
        Tasks that it ran.
    reused
        Tasks whose results the journal had.
    seconds
        Wall-clock time of the tasks together.
    files
        Written, by what they hold.
    notes
        One sentence each.
    """

    ran: int
    reused: int
    seconds: float
    files: dict[str, str]
    notes: list[str]


@dataclass(frozen=True)
class Findings:
    """What the table says.

    Attributes
    ----------
    groups
        Of tasks with the same levels.
    differences
        Between levels at the same seed.
    """

    groups: list[Group]
    differences: list[Difference]


def sweep_summary(sweep: Sweep, state: State, found: Findings, ran: Ran) -> list[str]:
    """The summary for people."""
    made = " × ".join(f"{len(axis.levels)} {axis.name}" for axis in sweep.axes)
    seeds = "" if sweep.seeds is None else plural(sweep.seeds, "seed")
    rows = [
        ("sweep", f"{sweep.name}: {plural(len(state.tasks), 'task')}" + _of(" × ".join(filter(None, (made, seeds))))),
        ("results", _results(state, ran)),
        *((f"{what}", path) for what, path in ran.files.items()),
    ]
    lines = table(rows, "<<")
    if found.groups:
        lines += ["", *_group_lines(sweep, found.groups), *_legend(sweep, found.groups)]
    if found.differences:
        lines += ["", *_difference_lines(sweep, found.differences)]
    return [*lines, *(["", *(f"note: {note}" for note in ran.notes)] if ran.notes else [])]


def _of(made: str) -> str:
    return f" ({made})" if made else ""


def _results(state: State, ran: Ran) -> str:
    parts = [f"{ran.ran} run", f"{ran.reused} from the journal"] if ran.reused else [f"{ran.ran} run"]
    if state.missing:
        parts.append(f"{state.missing} missing")
    codes = [f"{count} {_CODES.get(code, f'exit code {code}')}" for code, count in state.codes.items()]
    return ", ".join(parts) + (f": {', '.join(codes)}" if codes else "")


def _group_lines(sweep: Sweep, groups: list[Group]) -> list[str]:
    """One row for each group."""
    rows = [(*sweep.summary.by, "tasks", "failed", *sweep.metrics)]
    for group in groups:
        cells = [_interval(group.statistics[name], sweep.summary.statistic) for name in sweep.metrics]
        rows.append((*map(text, group.labels.values()), str(group.tasks), str(group.failed), *cells))
    return table(rows, "<" * len(sweep.summary.by) + ">>" + ">" * len(sweep.metrics))


def _difference_lines(sweep: Sweep, differences: list[Difference]) -> list[str]:
    """One row for each group and level."""
    assert sweep.summary.compare is not None
    axis, reference = sweep.summary.compare
    names = list(differences[0].labels)
    rows = [(*names, *sweep.metrics)]
    for difference in differences:
        cells = [_interval(difference.statistics[name], sweep.summary.statistic) for name in sweep.metrics]
        rows.append((*map(text, difference.labels.values()), *cells))
    lines = table(rows, "<" * len(names) + ">" * len(sweep.metrics))
    return [f"difference to {axis} {text(reference)} at the same seed", *lines]


def _interval(statistics: Statistics | None, statistic: str) -> str:
    """``0.093 ± 0.004`` for a mean, ``0.093 [0.09, 0.10]`` for a median; a count where not all tasks have a value."""
    if statistics is None:
        return "-"
    found: Interval = getattr(statistics, statistic)
    if found.low is None or found.high is None:
        return f"{found.value:.4g}"
    if statistic == "mean":
        return f"{found.value:.4g} ± {found.high - found.value:.2g}"
    return f"{found.value:.4g} [{found.low:.4g}, {found.high:.4g}]"


def _legend(sweep: Sweep, groups: list[Group]) -> list[str]:
    share = f"{sweep.summary.confidence:.4g}".rstrip("0")
    how = {
        "mean": f"mean ± half of the {float(share):.4g} confidence interval (Student's t)",
        "median": f"median with its {float(share):.4g} confidence interval (order statistics)",
    }
    found = [s for g in groups for s in g.statistics.values() if s is not None]
    if found and all(getattr(s, sweep.summary.statistic).low is None for s in found):
        return [f"{sweep.summary.statistic}; too few values for confidence intervals"]
    lines = [how[sweep.summary.statistic]]
    counts = {(g.tasks, s.count) for g in groups for s in g.statistics.values() if s is not None}
    if any(count < tasks for tasks, count in counts):
        lines.append("tasks without a value of a metric do not count there: --json has the numbers")
    return lines


def sweep_document(sweep: Sweep, state: State, found: Findings, ran: Ran) -> dict[str, Any]:
    """The document of ``slamcli sweep --json``."""
    return {
        **head("sweep"),
        "name": sweep.name,
        "path": sweep.source,
        "axes": {axis.name: [level.label for level in axis.levels] for axis in sweep.axes},
        "seed": sweep.seed,
        "seeds": sweep.seeds,
        "metrics": list(sweep.metrics),
        "tasks": len(state.tasks),
        "ran": ran.ran,
        "reused": ran.reused,
        "missing": state.missing,
        "exit_codes": {str(code): count for code, count in state.codes.items()},
        "complete": state.complete,
        "statistic": sweep.summary.statistic,
        "confidence": sweep.summary.confidence,
        "groups": [_group_section(group) for group in found.groups],
        "compare": None if sweep.summary.compare is None else dict([sweep.summary.compare]),
        "differences": [
            {"levels": item.labels, "statistics": _statistics_section(item.statistics)} for item in found.differences
        ],
        "files": ran.files,
        "seconds": ran.seconds,
        "notes": ran.notes,
    }


def _group_section(group: Group) -> dict[str, Any]:
    return {
        "levels": group.labels,
        "tasks": group.tasks,
        "failed": group.failed,
        "exit_codes": {str(code): count for code, count in group.codes.items()},
        "statistics": _statistics_section(group.statistics),
    }


def _statistics_section(statistics: dict[str, Statistics | None]) -> dict[str, Any]:
    return {name: None if found is None else asdict(found) for name, found in statistics.items()}


def command_text(task: Task, lines: Sequence[tuple[str, ...]]) -> list[str]:
    """The command lines of a task, to be run one after another in an empty folder."""
    return [f"# task {task.index}: {task.name}", *(shlex.join(["slamcli", *words]) for words in lines)]


def usage_details(task: Task, words: Sequence[str], message: str) -> tuple[str, ...]:
    """What is wrong with a command line of a task."""
    return (f"  {message}", f"  in task {task.index} ({task.name}): {shlex.join(['slamcli', *words])}")


def interrupted_text(state: State, folder: Path) -> str:
    """What Ctrl-C leaves behind."""
    have = len(state.tasks) - state.missing
    return f"interrupted: {folder} has {have} of {len(state.tasks)} results; the same command goes on from there"


def failure_notes(state: State) -> list[str]:
    """For each exit code but 0: the first task that ended with it, and why; metrics that no task has; and what the
    journal has besides.
    """
    notes = []
    for code, count in state.codes.items():
        if code == 0:
            continue
        task, record = next((task, record) for task, record in state.ended if record.exit_code == code)
        more = "" if count == 1 else f" (and {count - 1} more)"
        notes.append(f"task {task.index}{more}: {record.failed} ended with {code}: {record.message}")
    records = [record for _, record in state.ended]
    absent = [name for name in state.tasks[0].metrics if all(r.figures.get(name) is None for r in records)]
    if absent and any(record.failed is None for record in records):
        notes.append(f"no task has a value of {', '.join(absent)}")
    if state.others:
        notes.append(
            f"the journal has {plural(state.others, 'result')} of other tasks: of --only, of another sweep file or "
            "version of slamcli"
        )
    return notes
