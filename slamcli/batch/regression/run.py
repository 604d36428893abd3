"""Runs the cases of a suite: what they measured, not yet judged."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import shlex
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

from slamcli.batch import pipeline
from slamcli.batch.execution import PYTHON, Executor, Processes
from slamcli.batch.metrics import SOLVE_SECONDS, TIME_RATIO, value
from slamcli.batch.pipeline import Outcome
from slamcli.batch.regression.inputs import Prepared, sha256_of
from slamcli.errors import InputError

#: Lines of a step's standard error that are kept.
_LINES = 12
#: Graphs that the steps before the command make, the later one first.
_MADE = ("spoiled.g2o", "spoiled.bal", "graph.g2o", "graph.bal")


@dataclass(frozen=True)
class CaseRun:
    """What running a case gave. Only plain values: it goes through a file.

    Attributes
    ----------
    name, key
        Of the case; hash of all that determines what it gives.
    figures
        Values of each figure, one for each repeat that has it.
    exit_code
        Of the command, or of the step that failed beside it; None if nothing ran.
    failed
        Name of that step, None if none did.
    missing, skipped
        Why nothing ran (empty: it did), and whether the suite bears with that.
    commands, messages
        Command lines of the last repeat, and the last lines of their standard error.
    seconds, repeats
        Wall-clock time of all repeats; how many.
    inputs, made
        sha256 of the inputs by name; that of a graph that was simulated or spoiled.
    resumed
        Whether it was taken from an interrupted run.
    """

    name: str
    key: str
    figures: dict[str, list[float]] = field(default_factory=dict)
    exit_code: int | None = None
    failed: str | None = None
    missing: str = ""
    skipped: bool = False
    commands: tuple[str, ...] = ()
    messages: str = ""
    seconds: float = 0.0
    repeats: int = 0
    inputs: dict[str, str] = field(default_factory=dict)
    made: str | None = None
    resumed: bool = False


class Finished(Protocol):
    """Where finished cases are kept."""

    finished: dict[str, CaseRun]

    def add(self, run: CaseRun) -> None:
        """Keep one."""


@dataclass(frozen=True)
class Machine:
    """What runs cases.

    Attributes
    ----------
    execute
        Runs a command line of slamcli.
    stop
        Ends all that run.
    reference
        Seconds of the reference kernel now.
    """

    execute: Executor
    stop: Callable[[], None]
    reference: Callable[[], float]


def this_machine() -> Machine:
    """Processes of this one."""
    processes = Processes()

    def reference() -> float:
        line = [*PYTHON, "slamcli.batch.regression.reference"]
        found = processes.run(line, ["reference"], Path(tempfile.gettempdir()), 60.0)
        return float(found.document["seconds"]) if found.document else math.nan

    return Machine(processes.execute, processes.stop, reference)


def run_cases(
    cases: Sequence[Prepared],
    machine: Machine,
    *,
    jobs: int = 1,
    source: str = "",
    finished: Finished | None = None,
    tick: Callable[[CaseRun], None] = lambda run: None,
) -> tuple[list[CaseRun], bool]:
    """Run cases, in their order where one runs at a time.

    Parameters
    ----------
    cases, machine
        What runs, and on what.
    jobs
        So many at a time; times are measured only with one.
    source
        Hash of the program, which determines what a case gives as its inputs do.
    finished
        Cases that need not run again, and what keeps each one that has ended.
    tick
        Called after each case, from this thread.

    Returns
    -------
    tuple[list[CaseRun], bool]
        Those that ended, in the order of ``cases``; whether the user interrupted the run.

    Raises
    ------
    InputError
        If there is no room for temporary files.
    """
    keys = [_key(case, source, jobs == 1) for case in cases]
    known = {} if finished is None else finished.finished
    found = {index: replace(known[key], resumed=True) for index, key in enumerate(keys) if key in known}
    for run in found.values():
        tick(run)
    interrupted = False
    with ThreadPoolExecutor(jobs) as pool, _uninterrupted_end(machine):
        waiting: dict[Future[CaseRun], int] = {}
        try:
            for index, case in enumerate(cases):
                if index not in found:
                    waiting[pool.submit(_run_case, case, keys[index], machine, jobs == 1)] = index
            while waiting:
                done, _ = wait(waiting, return_when=FIRST_COMPLETED)
                for future in done:
                    run = future.result()
                    found[waiting.pop(future)] = run
                    if finished is not None and not run.missing:
                        finished.add(run)
                    tick(run)
        except KeyboardInterrupt:
            interrupted = True
            machine.stop()
            pool.shutdown(cancel_futures=True)
            for future, index in waiting.items():  # ended in the meantime
                if future.done() and not future.cancelled() and future.exception() is None:
                    found[index] = future.result()
                    if finished is not None and not found[index].missing:
                        finished.add(found[index])
        except BaseException:
            machine.stop()
            pool.shutdown(cancel_futures=True)
            raise
    return [found[index] for index in sorted(found)], interrupted


@contextlib.contextmanager
def _uninterrupted_end(machine: Machine) -> Iterator[None]:
    """Whatever happens, nothing is left running."""
    try:
        yield
    except BaseException:
        machine.stop()
        raise


def _run_case(case: Prepared, key: str, machine: Machine, alone: bool) -> CaseRun:
    """One case with all its repeats; a stopped machine raises KeyboardInterrupt."""
    if case.missing:
        skipped = case.suite_case.optional and case.absent
        return CaseRun(case.name, key, missing=case.missing, skipped=skipped, inputs=case.inputs)
    started = time.perf_counter()
    names = [gauge.metric.name for gauge in case.suite_case.gauges if alone or not gauge.metric.timed]
    figures: dict[str, list[float]] = {name: [] for name in names}
    outcomes: list[Outcome] = []
    made = None
    while len(outcomes) < case.suite_case.repeats:
        try:
            outcome, made, pace = _repeat(case, machine, TIME_RATIO in figures)
        except OSError as error:  # a full disk, no memory for another process
            raise InputError(
                f"the case {case.name} cannot be run: {error.strerror or error}",
                ("  TMPDIR names another place for temporary files",),
            ) from None
        outcomes.append(outcome)
        for name, values in figures.items():
            found = _figure(outcome, name, pace)
            if found is not None and math.isfinite(found):
                values.append(found)
        if outcome.failed is not None or outcome.exit_code != case.suite_case.expected:
            break  # no repeat changes that
    return _case_run(case, key, outcomes, figures, made, time.perf_counter() - started)


def _repeat(case: Prepared, machine: Machine, paced: bool) -> tuple[Outcome, str | None, float]:
    """One run of a case: what came of it, the graph that was made, seconds of the reference kernel around it."""
    before = machine.reference() if paced else math.nan
    with _folder() as folder:
        outcome = pipeline.run(case.case, folder, machine.execute)
        made = _made(folder, case)
    after = machine.reference() if paced else math.nan
    return outcome, made, 0.5 * (before + after)


def _figure(outcome: Outcome, name: str, pace: float) -> float | None:
    if name != TIME_RATIO:
        return value(outcome, name)
    seconds = value(outcome, SOLVE_SECONDS)
    return None if seconds is None else seconds / pace


def _case_run(
    case: Prepared,
    key: str,
    outcomes: list[Outcome],
    figures: dict[str, list[float]],
    made: str | None,
    seconds: float,
) -> CaseRun:
    outcome = outcomes[-1]
    text = "".join(step.messages for step in outcome.steps.values())
    return CaseRun(
        name=case.name,
        key=key,
        figures=figures,
        exit_code=outcome.exit_code,
        failed=outcome.failed,
        commands=tuple(shlex.join(["slamcli", *step.words]) for step in outcome.steps.values()),
        messages="\n".join(text.splitlines()[-_LINES:]),
        seconds=seconds,
        repeats=len(outcomes),
        inputs=case.inputs,
        made=made,
    )


def _key(case: Prepared, source: str, alone: bool) -> str:
    entry = case.suite_case
    names = sorted(gauge.metric.name for gauge in entry.gauges)
    timed = alone and any(gauge.metric.timed for gauge in entry.gauges)
    parts = [entry.name, entry.definition, case.case.time_limit, entry.repeats, names, case.inputs, source, timed]
    parts.append(entry.expected)
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def _made(folder: Path, case: Prepared) -> str | None:
    """Hash of the graph that the command read, if a step before it made that."""
    if case.case.simulate is None and not case.case.inject:
        return None
    return next((sha256_of(folder / name) for name in _MADE if (folder / name).is_file()), None)


@contextlib.contextmanager
def _folder() -> Iterator[Path]:
    """A folder for the files of a case."""
    try:
        folder = tempfile.TemporaryDirectory(prefix="slamcli-", ignore_cleanup_errors=True)
    except OSError as error:
        raise InputError(
            f"no folder for temporary files: {error.strerror}", ("  TMPDIR names another place",)
        ) from None
    with folder as name:
        yield Path(name)
