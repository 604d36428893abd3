"""A whole run of a suite: look up, run, judge, and bless where that is asked for."""

from __future__ import annotations

import fnmatch
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

from slamcli.batch.metrics import metric
from slamcli.batch.provenance import differences, provenance, source_digest
from slamcli.batch.regression import baseline as baselines
from slamcli.batch.regression import reference
from slamcli.batch.regression.baseline import Baseline, BaselineCase, BaselineFigure
from slamcli.batch.regression.compare import gone, judge
from slamcli.batch.regression.inputs import Prepared, prepare
from slamcli.batch.regression.result import CaseResult, Change, RegressionReport, Update, Verdict
from slamcli.batch.regression.run import CaseRun, Finished, Machine, run_cases
from slamcli.batch.regression.suite import Suite, SuiteCase
from slamcli.errors import SlamcliError, UsageError
from slamcli.formats.configuration import suggestion

#: Verdicts that no blessing mends: they speak of the suite, not of the baseline.
_UNBLESSED = (Verdict.FAILED, Verdict.LIMIT, Verdict.ABSENT)
#: Verdicts of figures that a blessing is to settle, also those of times.
_TOLD = (Verdict.REGRESSION, Verdict.IMPROVED)
#: Figures that differ a little from run to run.
_NOISY = ("memory",)


def selected(suite: Suite, only: Sequence[str]) -> tuple[SuiteCase, ...]:
    """Cases whose names match one of the patterns; all without a pattern.

    Raises
    ------
    UsageError
        If a pattern matches none.
    """
    names = [case.name for case in suite.cases]
    for pattern in only:
        if not any(_matches(name, pattern) for name in names):
            raise UsageError(f"--only {pattern}: {suite.path} has no such case", (suggestion(pattern, names, "cases"),))
    return tuple(c for c in suite.cases if not only or any(_matches(c.name, pattern) for pattern in only))


def _matches(name: str, pattern: str) -> bool:
    """Also a name that is no pattern of itself, such as ``a[1]``."""
    return name == pattern or fnmatch.fnmatchcase(name, pattern)


def regress(
    suite: Suite,
    machine: Machine,
    *,
    baseline: Baseline | None,
    baseline_path: str,
    only: Sequence[str] = (),
    update: bool = False,
    jobs: int = 1,
    finished: Finished | None = None,
    begin: Callable[[int], None] = lambda count: None,
    tick: Callable[[CaseRun], None] = lambda run: None,
) -> RegressionReport:
    """Run a suite and judge it.

    Parameters
    ----------
    suite, machine
        What runs, and on what.
    baseline, baseline_path
        None where there is no file; where an update goes.
    only
        Patterns of the names of the cases to run.
    update
        Make what was measured the baseline.
    jobs, finished, tick
        As ``run_cases``.
    begin
        Called once with the number of cases, before the first one.

    Raises
    ------
    UsageError
        If the suite names data that do not exist, or a pattern no case.
    InputError
        If there is no room for temporary files. A baseline that cannot be written is told in the report.
    """
    chosen = selected(suite, only)
    cases = prepare(suite, chosen)
    started = time.perf_counter()
    here = {**provenance(), "reference_kernel": reference.VERSION}
    begin(len(cases))
    runs, interrupted = run_cases(cases, machine, jobs=jobs, source=source_digest(), finished=finished, tick=tick)
    results = judge(cases, runs, baseline, reference.VERSION)
    if not only:
        results += gone({case.name for case in suite.cases}, baseline)
    report = RegressionReport(
        suite=suite.name,
        path=str(suite.path),
        sha256=suite.sha256,
        baseline=baseline_path if baseline is not None else None,
        cases=tuple(results),
        left_out=len(suite.cases) - len(chosen),
        interrupted=interrupted,
        planned=len(chosen),
        jobs=jobs,
        seconds=time.perf_counter() - started,
        provenance=here,
        baseline_provenance=tuple(baseline.provenance.values()) if baseline is not None else (),
    )
    if not update:
        return replace(report, notes=_notes(report, suite, baseline))
    return replace(report, update=_updated(suite, baseline or Baseline(baseline_path), cases, runs, report, bool(only)))


def _notes(report: RegressionReport, suite: Suite, baseline: Baseline | None) -> tuple[str, ...]:
    """What explains figures that differ, and what was not compared."""
    notes = []
    if baseline is None:
        notes.append("no baseline: only limits and exit codes were checked; --update-baseline makes one")
    else:
        changes = sorted({line for old in baseline.provenance.values() for line in differences(old, report.provenance)})
        if changes:
            notes.append(f"the baseline was made elsewhere: {', '.join(changes)}")
        if baseline.suite and baseline.suite != suite.name:
            notes.append(f"the baseline is of the suite {baseline.suite}")
    if report.jobs > 1 and any(figure.verdict is Verdict.SKIPPED for case in report.cases for figure in case.metrics):
        notes.append("times were not measured: they mean something with --jobs 1 only")
    resumed = sum(case.resumed for case in report.cases)
    if resumed:
        notes.append(f"{resumed} of {len(report.cases)} cases were taken from an interrupted run")
    return tuple(notes)


def _updated(
    suite: Suite,
    old: Baseline,
    cases: Sequence[Prepared],
    runs: Sequence[CaseRun],
    report: RegressionReport,
    partial: bool,
) -> Update:
    """Write the new baseline, unless the run was interrupted; what changes, figure by figure."""
    new, refused, unchanged = _blessed(suite, old, cases, runs, report, partial)
    changes = _changes(old, new)
    update = Update(old.path, False, changes, unchanged, refused)
    if report.interrupted:
        return replace(update, reason="the run was interrupted")
    if new.cases == old.cases and old.digest is not None:
        return replace(update, reason="nothing changes")
    try:
        baselines.write(new)
    except SlamcliError as error:
        return replace(update, failed=True, reason=error.message)
    return replace(update, written=True)


def _blessed(
    suite: Suite,
    old: Baseline,
    cases: Sequence[Prepared],
    runs: Sequence[CaseRun],
    report: RegressionReport,
    partial: bool,
) -> tuple[Baseline, dict[str, str], int]:
    """The new baseline; why cases keep their old figures; how many figures stay the same."""
    entries = {case.name: case.suite_case for case in cases}
    results = {case.name: case for case in report.cases}
    key = baselines.provenance_key(report.provenance)
    names = {case.name for case in suite.cases}
    kept = {name: case for name, case in old.cases.items() if partial or name in names}
    refused: dict[str, str] = {}
    unchanged = 0
    for run in runs:
        result = results[run.name]
        if run.missing:
            continue
        if result.verdict is Verdict.FAILED or any(figure.verdict in _UNBLESSED for figure in result.metrics):
            refused[run.name] = next(iter(result.complaints))
            continue
        case = BaselineCase(
            entries[run.name].definition, dict(run.inputs), run.made, key, _figures(result, old.cases.get(run.name))
        )
        if _same(case, old.cases.get(run.name)) and not any(f.verdict in _TOLD for f in result.metrics):
            unchanged += len(case.figures)
        else:
            kept[run.name] = case
            before = old.cases[run.name].figures if run.name in old.cases else {}
            unchanged += sum(name in before and before[name].value == f.value for name, f in case.figures.items())
    order = [case.name for case in suite.cases if case.name in kept]
    order += [name for name in kept if name not in names]
    new = Baseline(
        path=old.path,
        digest=old.digest,
        suite=suite.name,
        suite_sha256=suite.sha256,
        provenance={**old.provenance, key: report.provenance},
        cases={name: kept[name] for name in order},
    )
    return new, refused, unchanged


def _figures(result: CaseResult, old: BaselineCase | None) -> dict[str, BaselineFigure]:
    """What was measured; times that this run could not measure stay as they were."""
    found = {}
    for figure in result.metrics:
        if figure.value is not None:
            found[figure.name] = BaselineFigure(figure.value, figure.mad, len(figure.values))
        elif figure.verdict is Verdict.SKIPPED and old is not None and figure.name in old.figures:
            found[figure.name] = old.figures[figure.name]
    return found


def _same(new: BaselineCase, old: BaselineCase | None) -> bool:
    """Whether a case stays as it was but for what no two runs have in common: times, and a little memory."""
    if old is None or new.figures.keys() != old.figures.keys():
        return False
    if (new.definition, new.inputs, new.made) != (old.definition, old.inputs, old.made):
        return False
    for name, figure in new.figures.items():
        kind, before = metric(name), old.figures[name].value
        allowed = kind.absolute + kind.relative * abs(before) if name in _NOISY else 0.0
        if not kind.timed and abs(figure.value - before) > allowed:
            return False
    return True


def _changes(old: Baseline, new: Baseline) -> tuple[Change, ...]:
    changes = []
    for name in dict.fromkeys([*new.cases, *old.cases]):
        before = old.cases[name].figures if name in old.cases else {}
        after = new.cases[name].figures if name in new.cases else {}
        for figure in dict.fromkeys([*after, *before]):
            pair = [found[figure].value if figure in found else None for found in (before, after)]
            if pair[0] != pair[1]:
                changes.append(Change(name, figure, pair[0], pair[1]))
    return tuple(changes)
