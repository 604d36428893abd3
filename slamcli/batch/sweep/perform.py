"""One task of a sweep, where it is run: by a thread of this process, or by a worker on another machine."""

from __future__ import annotations

import errno
import os
import signal
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from slamcli import __version__
from slamcli.batch.execution import Execution, Executor, Processes
from slamcli.batch.interpreter import INTERPRETERS
from slamcli.batch.metrics import value
from slamcli.batch.pipeline import Outcome, run
from slamcli.batch.sweep.journal import Record
from slamcli.batch.sweep.plan import Task
from slamcli.errors import ExitCode, InputError

#: Codes of a process that somebody else has ended, for want of memory as a rule; the task gets a second chance.
_ENDED = (128 + signal.SIGKILL, 128 + signal.SIGTERM)
#: Exit code of a step that slamcli itself did not survive, which says nothing about the method (EX_SOFTWARE of
#: sysexits.h).
CRASHED = 70
#: Codes with which a command has printed its document.
_WITH_DOCUMENT = (ExitCode.SUCCESS, ExitCode.CHECK_FAILED, ExitCode.NOT_CONVERGED)
#: What a full disk, a quota and a limit of file sizes say.
_FULL = tuple(map(os.strerror, (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)))
#: Written to find out whether a disk is full, in bytes.
_PROBE = 1 << 16
#: Messages are for one cell of a table.
_LONGEST_MESSAGE = 300


@dataclass(frozen=True)
class Performer:
    """Runs tasks; goes to the workers of a cluster as it is.

    Attributes
    ----------
    isolate
        Whether each step has a process of its own, rather than one that stays.
    version
        Of slamcli where the sweep was started.
    """

    isolate: bool = False
    version: str = __version__

    def __call__(self, task: Task, folder: str | None = None) -> Record:
        """Run a task in a new folder below this one (that of temporary files), which is gone afterwards.

        Raises
        ------
        InputError
            If this machine has another version of slamcli, or its disk is full: no result of the task.
        """
        if self.version != __version__:
            raise InputError(
                f"a worker has slamcli {__version__}, this is slamcli {self.version}",
                ("  results of two versions are not comparable: install the same on all machines",),
            )
        if self.isolate:
            return _performed(task, PROCESSES.current.execute, folder)
        with INTERPRETERS.lease() as interpreter:
            return _performed(task, interpreter, folder)


class _Processes:
    """Those of steps with a process of their own; ended together."""

    def __init__(self) -> None:
        self.current = Processes()

    def close(self) -> None:
        ended, self.current = self.current, Processes()
        ended.stop()


PROCESSES = _Processes()


def close() -> None:
    """End what runs in this process."""
    PROCESSES.close()
    INTERPRETERS.close()


def _performed(task: Task, execute: Executor, folder: str | None) -> Record:
    record = _once(task, execute, folder)
    return _once(task, execute, folder) if record.exit_code in _ENDED else record


def _once(task: Task, execute: Executor, folder: str | None) -> Record:
    try:
        with tempfile.TemporaryDirectory(prefix="slamcli-sweep-", dir=folder) as name:
            record = record_of(task, run(task.case, Path(name), execute))
            if record.exit_code == CRASHED:  # a full disk may leave no message
                Path(name, "probe").write_bytes(bytes(_PROBE))
            return record
    except OSError as error:
        place = folder or tempfile.gettempdir()
        raise InputError(f"{place}: a task cannot have its folder there: {error.strerror}") from None


def record_of(task: Task, outcome: Outcome) -> Record:
    """What is kept of an outcome.

    Raises
    ------
    InputError
        If the disk was full.
    """
    code = outcome.exit_code
    step = outcome.failed or outcome.command
    crashed = next((name for name, execution in outcome.steps.items() if _crashed(execution)), None)
    if crashed is not None:
        code, step = CRASHED, crashed
    message = "" if code == ExitCode.SUCCESS else message_of(outcome.steps[step])
    if any(words in message for words in _FULL):
        raise InputError(f"the disk is full where tasks have their files ({tempfile.gettempdir()})", (f"  {message}",))
    return Record(
        key=task.key,
        exit_code=code,
        failed=None if code == ExitCode.SUCCESS else step,
        message=message,
        figures={name: value(outcome, name) for name in task.metrics},
        seconds={name: execution.seconds for name, execution in outcome.steps.items()},
    )


def _crashed(execution: Execution) -> bool:
    """Whether a command ended as only Python does, or without the document that it owes."""
    if execution.exit_code == ExitCode.CHECK_FAILED and "Traceback (most recent call last)" in execution.messages:
        return True
    return execution.document is None and execution.exit_code in _WITH_DOCUMENT


def message_of(execution: Execution) -> str:
    """Why a step failed, in a line: its error, or what else it says at the end."""
    lines = [line.strip() for line in execution.messages.splitlines() if line.strip()]
    errors = [line.removeprefix("error: ") for line in lines if line.startswith("error: ")]
    document = execution.document or {}
    found = errors[0] if errors else document.get("reason") or (lines[-1] if lines else "")
    if not found and execution.exit_code >= 128:
        found = f"ended by signal {execution.exit_code - 128}"
    return str(found)[:_LONGEST_MESSAGE]


#: What runs a task.
Perform = Callable[[Task], Record]
