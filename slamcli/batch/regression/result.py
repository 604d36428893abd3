"""What a suite found: cases, their figures beside those of the baseline, and verdicts."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from slamcli.errors import ExitCode


class Verdict(StrEnum):
    """Of a figure and of a case; a case has the gravest of its figures."""

    PASS = "pass"
    #: Measured and shown; it does not gate.
    INFO = "info"
    #: Not measured, for a reason that is said: optional data that are not there, times with several jobs.
    SKIPPED = "skipped"
    #: The baseline has no such figure.
    NEW = "new"
    #: Better than the baseline by more than the tolerance.
    IMPROVED = "improved"
    #: Worse than the baseline by more than the tolerance.
    REGRESSION = "regression"
    #: Beyond a limit of the suite, whatever the baseline says; also the exit code.
    LIMIT = "limit"
    #: The suite wants a figure that the commands did not print.
    ABSENT = "absent"
    #: An input, or the case itself, is another one than at the baseline: nothing was compared.
    CHANGED = "input changed"
    #: The baseline has it, the suite does not any more.
    GONE = "gone"
    #: A step besides the command failed: simulate, inject, evaluate.
    FAILED = "failed"
    #: Data that the suite needs are not there.
    MISSING = "missing data"

    @property
    def fails(self) -> bool:
        """Whether it makes the suite fail."""
        return self in FAILING

    @property
    def gravity(self) -> int:
        """Order of verdicts, the gravest last."""
        return GRAVITY.index(self)


GRAVITY = (
    Verdict.PASS,
    Verdict.INFO,
    Verdict.SKIPPED,
    Verdict.NEW,
    Verdict.IMPROVED,
    Verdict.GONE,
    Verdict.CHANGED,
    Verdict.ABSENT,
    Verdict.REGRESSION,
    Verdict.LIMIT,
    Verdict.FAILED,
    Verdict.MISSING,
)
FAILING = GRAVITY[GRAVITY.index(Verdict.GONE) :]


@dataclass(frozen=True)
class MetricResult:
    """One figure of a case.

    Attributes
    ----------
    name, meaning
        As in the suite; in words, with the unit.
    better
        ``lower``, ``higher`` or ``equal``.
    verdict, message
        And why, in a sentence; empty where the figure passes.
    value
        Median of the repeats; None if there is none.
    mad
        Median absolute deviation of the repeats from it; None below two repeats.
    values
        Of each repeat.
    baseline, baseline_mad
        The same of the baseline, None if it has none.
    allowed
        By how much the value may be worse than that of the baseline; None if nothing was compared.
    limits
        Of the suite: ``at_most``, ``at_least``, ``equals``, ``optimum``, those that are stated.
    gate
        Whether a comparison with the baseline can fail.
    """

    name: str
    meaning: str
    better: str
    verdict: Verdict
    message: str = ""
    value: float | None = None
    mad: float | None = None
    values: tuple[float, ...] = ()
    baseline: float | None = None
    baseline_mad: float | None = None
    allowed: float | None = None
    limits: dict[str, float] = field(default_factory=dict)
    gate: bool = True


@dataclass(frozen=True)
class CaseResult:
    """One case.

    Attributes
    ----------
    name
        As in the suite.
    line
        Of the suite file, where the case begins; None for one that is gone.
    verdict, message
        The gravest of its figures, and what is to be said about the case as a whole (empty if nothing is).
    metrics
        Its figures, in the order of the suite.
    commands
        Command lines that were run, of one repeat.
    messages
        Their standard error where the case fails, at most the last lines of it.
    seconds
        Wall-clock time of all repeats.
    repeats
        How often it was run.
    inputs
        sha256 of each file that it read, by name as the suite has it.
    made
        sha256 of the graph that was simulated or spoiled, None for a file.
    resumed
        Whether it was taken from an interrupted run.
    """

    name: str
    line: int | None
    verdict: Verdict
    message: str = ""
    metrics: tuple[MetricResult, ...] = ()
    commands: tuple[str, ...] = ()
    messages: str = ""
    seconds: float = 0.0
    repeats: int = 0
    inputs: dict[str, str] = field(default_factory=dict)
    made: str | None = None
    resumed: bool = False

    @property
    def complaints(self) -> tuple[str, ...]:
        """What makes it fail, one sentence each."""
        found = [self.message] if self.message and self.verdict.fails else []
        found += [f"{metric.name}: {metric.message}" for metric in self.metrics if metric.verdict.fails]
        return tuple(found)


@dataclass(frozen=True)
class Change:
    """What an update of the baseline does to one figure.

    Attributes
    ----------
    case, metric
        Names.
    old, new
        Values; None where there was, or is, none.
    """

    case: str
    metric: str
    old: float | None
    new: float | None


@dataclass(frozen=True)
class Update:
    """An update of the baseline.

    Attributes
    ----------
    path
        File that was written, or would have been.
    written
        Whether it was.
    changes
        Figures that change, as far as they do.
    unchanged
        Number of figures that stay as they are.
    refused
        Cases that keep their old figures although they ran: why, by name.
    reason
        Why nothing was written; empty if it was.
    failed
        Whether that is because it could not be.
    """

    path: str
    written: bool
    changes: tuple[Change, ...]
    unchanged: int
    refused: dict[str, str] = field(default_factory=dict)
    reason: str = ""
    failed: bool = False


@dataclass(frozen=True)
class RegressionReport:
    """All of a suite.

    Attributes
    ----------
    suite
        Its name.
    path
        Of its file.
    sha256
        Of its file.
    baseline
        Path of the baseline, None if there is none.
    cases
        In the order of the suite; those that are gone last.
    left_out
        Number of cases that ``--only`` leaves out.
    interrupted
        Whether the run was; the cases that did not run are then absent.
    planned
        Number of cases that were to run.
    jobs
        Cases run at the same time.
    seconds
        Wall-clock time of the run.
    provenance
        Versions, platform, processor, date and git revision of this run.
    baseline_provenance
        Those of the baseline, one for each time its cases were blessed.
    notes
        What a reader of the figures should know.
    update
        Of the baseline, None if none was asked for.
    """

    suite: str
    path: str
    sha256: str
    baseline: str | None
    cases: tuple[CaseResult, ...]
    left_out: int
    interrupted: bool
    planned: int
    jobs: int
    seconds: float
    provenance: dict[str, Any]
    baseline_provenance: tuple[dict[str, Any], ...] = ()
    notes: tuple[str, ...] = ()
    update: Update | None = None

    @property
    def failed(self) -> tuple[CaseResult, ...]:
        """Cases that fail."""
        return tuple(case for case in self.cases if case.verdict.fails)

    @property
    def counts(self) -> dict[Verdict, int]:
        """Number of cases by verdict, those that occur."""
        found = {verdict: sum(case.verdict is verdict for case in self.cases) for verdict in GRAVITY}
        return {verdict: number for verdict, number in found.items() if number}

    @property
    def exit_code(self) -> ExitCode:
        """Of the command: a regression counts before missing data, so that a script may bear with the latter alone."""
        if self.interrupted:
            return ExitCode.INTERRUPTED
        failing = {case.verdict for case in self.failed}
        if self.update is not None:
            if self.update.failed:
                return ExitCode.INVALID_INPUT
            if self.update.refused:
                return ExitCode.CHECK_FAILED
            failing &= {Verdict.LIMIT, Verdict.ABSENT, Verdict.FAILED, Verdict.MISSING}  # the rest is blessed
        if failing - {Verdict.MISSING}:
            return ExitCode.CHECK_FAILED
        return ExitCode.INVALID_INPUT if failing else ExitCode.SUCCESS
