"""Sweeps for the tests: files, a task without any work, an engine that only pretends."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from slamcli.batch.sweep.journal import Record
from slamcli.batch.sweep.plan import Sweep, Task, tasks_of
from slamcli.batch.sweep.read import read_sweep

#: Four tasks, of two seeds and two methods.
SMALL = """\
seeds: 2
case:
  simulate: square
  simulation: {poses: 30, set: {closures.count: 4}}
axes:
  options.method: [gn, lm]
metrics: [ate, chi2]
"""


def sweep_of(folder: Path, content: str = SMALL) -> Sweep:
    """A sweep from this text."""
    path = folder / "study.yaml"
    path.write_text(content)
    return read_sweep(str(path))


def tasks_in(folder: Path, content: str = SMALL) -> list[Task]:
    """Its tasks."""
    return tasks_of(sweep_of(folder, content))


def record_of(task: Task, value: float = 1.5, code: int = 0) -> Record:
    """A record as if the task had been run."""
    failed, message = (None, "") if code == 0 else ("optimize", "it went wrong")
    return Record(task.key, code, failed, message, dict.fromkeys(task.metrics, value), {"optimize": 0.25})


@dataclass(frozen=True)
class Pretender:
    """Takes the place of a ``Performer``: the number of a task is its result, after some seconds."""

    seconds: float = 0.02

    def __call__(self, task: Task, folder: str | None = None) -> Record:
        time.sleep(self.seconds)
        return record_of(task, float(task.index))


def pretended(tasks: Sequence[Task]) -> Iterator[Record]:
    """An engine that runs nothing: the number of a task is its result. The last task ends first."""
    for task in reversed(tasks):
        yield record_of(task, float(task.index))
