"""Runs the tasks of a sweep that have no result yet, and keeps each result as it comes."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from slamcli.batch.sweep import journal as journals
from slamcli.batch.sweep.journal import Journal, Record
from slamcli.batch.sweep.lock import locked
from slamcli.batch.sweep.plan import Task
from slamcli.errors import ExitCode, InputError

#: Runs tasks, and gives their records as they end.
Engine = Callable[[Sequence[Task]], Iterator[Record]]
#: Codes that say something about the method: what a study is about. With any other a task has no result.
RESULTS = (ExitCode.SUCCESS, ExitCode.CHECK_FAILED, ExitCode.NOT_CONVERGED, ExitCode.NUMERICAL_FAILURE)


@dataclass(frozen=True)
class State:
    """Tasks and what is known of them.

    Attributes
    ----------
    tasks
        In the order of the table.
    records
        By key.
    others
        Number of records of the journal that belong to no task.
    """

    tasks: list[Task]
    records: dict[str, Record]
    others: int = 0

    @property
    def ended(self) -> list[tuple[Task, Record]]:
        """The tasks that have a record, with it."""
        return [(task, self.records[task.key]) for task in self.tasks if task.key in self.records]

    @property
    def missing(self) -> int:
        """Number of tasks without a record."""
        return sum(task.key not in self.records for task in self.tasks)

    @property
    def codes(self) -> dict[int, int]:
        """Number of tasks by exit code, ascending."""
        codes = [record.exit_code for _, record in self.ended]
        return {code: codes.count(code) for code in sorted(set(codes))}

    @property
    def complete(self) -> bool:
        """Whether each task has ended with a code of ``RESULTS``."""
        return self.missing == 0 and all(code in RESULTS for code in self.codes)


@contextlib.contextmanager
def opened(folder: Path, *, resume: bool = True, make: bool = True) -> Iterator[Journal]:
    """The journal of a folder, which is made if it does not exist, for as long as it is locked.

    Parameters
    ----------
    resume
        Whether the results that it has count; else they are put aside.
    make
        Whether it is made if it does not exist.

    Raises
    ------
    UsageError
        If another sweep is at work there.
    InputError
        If it cannot be written, or is not there and not to be made.
    """
    if not make and not (folder / journals.NAME).exists():
        raise InputError(f"{folder}: has no results of a sweep ({journals.NAME})")
    with contextlib.ExitStack() as stack:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            stack.enter_context(locked(folder))
            if not resume:
                journals.set_aside(folder / journals.NAME)
        except OSError as error:
            raise InputError(f"{folder}: cannot be written: {error.strerror}") from None
        journal = Journal(folder / journals.NAME)
        stack.callback(journal.close)
        yield journal


def pending(tasks: Sequence[Task], journal: Journal, *, retry_failed: bool = False) -> list[Task]:
    """Tasks without a record, and if asked for those that failed; of equal tasks one."""
    wanted: dict[str, Task] = {}
    for task in tasks:
        record = journal.records.get(task.key)
        if record is None or (retry_failed and record.failed is not None):
            wanted.setdefault(task.key, task)
    return list(wanted.values())


def run(tasks: Sequence[Task], journal: Journal, engine: Engine, tick: Callable[[], None] = lambda: None) -> None:
    """Run tasks; each result is in the journal before the next one is looked at.

    Raises
    ------
    InputError
        If the journal cannot be written, or tasks cannot be run at all; what it has is kept.
    """
    wanted = {task.key for task in tasks}
    with contextlib.closing(engine(tasks)) as records:  # type: ignore[type-var]
        for record in records:
            if record.key in wanted:  # a task that was run twice counts once
                wanted.remove(record.key)
                journal.append(record)
                tick()


def state_of(tasks: list[Task], journal: Journal) -> State:
    """What is known of the tasks."""
    keys = {task.key for task in tasks}
    found = {key: record for key, record in journal.records.items() if key in keys}
    return State(tasks, found, len(journal.records) - len(found))
