"""Judges what a suite measured: against its limits, and against the baseline."""

from __future__ import annotations

import signal
import statistics
from collections.abc import Sequence
from dataclasses import dataclass, replace

from slamcli.batch.execution import TIMED_OUT
from slamcli.batch.metrics import EXIT_CODE, HIGHER, LOWER, TIME_RATIO, Metric, metric
from slamcli.batch.regression.baseline import Baseline, BaselineCase, BaselineFigure
from slamcli.batch.regression.inputs import Prepared
from slamcli.batch.regression.result import CaseResult, MetricResult, Verdict
from slamcli.batch.regression.run import CaseRun
from slamcli.batch.regression.suite import Gauge

#: Standard deviation of a normal distribution over its median absolute deviation; times may be so many of these off.
_SIGMA, _SIGMAS = 1.4826, 3.0
#: Exit codes above it: the signal that ended a process.
_BY_SIGNAL = 128
#: Why a time is not there.
_SEVERAL = "times are measured with --jobs 1 only"


def judge(
    cases: Sequence[Prepared], runs: Sequence[CaseRun], baseline: Baseline | None, version: int
) -> list[CaseResult]:
    """Verdicts of the cases that ran, in their order.

    Parameters
    ----------
    cases, runs
        What was to run; what ran.
    baseline
        None for none: every figure is new.
    version
        Of the reference kernel; ratios to another one say nothing.
    """
    ran = {run.name: run for run in runs}
    return [_judged(case, ran[case.name], baseline, version) for case in cases if case.name in ran]


def gone(names: set[str], baseline: Baseline | None) -> list[CaseResult]:
    """Cases that only the baseline has."""
    missing = [name for name in (baseline.cases if baseline else ()) if name not in names]
    text = "the baseline has this case, the suite does not: --update-baseline forgets it"
    return [CaseResult(name, None, Verdict.GONE, text) for name in missing]


def _judged(case: Prepared, run: CaseRun, baseline: Baseline | None, version: int) -> CaseResult:
    entry = case.suite_case
    result = CaseResult(
        name=case.name,
        line=entry.line,
        verdict=Verdict.PASS,
        commands=tuple(run.commands),
        seconds=run.seconds,
        repeats=run.repeats,
        inputs=run.inputs,
        made=run.made,
        resumed=run.resumed,
    )
    if run.missing:
        return replace(result, verdict=Verdict.SKIPPED if run.skipped else Verdict.MISSING, message=run.missing)
    old = baseline.cases.get(case.name) if baseline is not None else None
    judged = _judged_by(case, run, old, baseline, version)
    # figures of the baseline that the suite does not ask for any more
    names = {gauge.metric.name for gauge in case.suite_case.gauges}
    judged += [_gone(name, figure) for name, figure in (old.figures if old else {}).items() if name not in names]
    verdict = max((found.verdict for found in judged), key=lambda found: found.gravity)
    if verdict in (Verdict.INFO, Verdict.SKIPPED):  # of figures, not of the case
        verdict = Verdict.PASS
    message = ""
    if run.failed is not None:
        verdict = Verdict.FAILED
        message = f"{run.failed} ended with {_code_words(run, case)}"
    elif _differs(case, run, old):
        message = _differs(case, run, old)
        verdict = max(verdict, Verdict.CHANGED, key=lambda found: found.gravity)
    elif old is not None and old.made is not None and old.made != run.made:
        message = "simulate or inject made another graph than at the baseline"
    return replace(
        result,
        verdict=verdict,
        message=message,
        metrics=tuple(judged),
        messages=run.messages if verdict.fails else "",
    )


def _judged_by(
    case: Prepared, run: CaseRun, old: BaselineCase | None, baseline: Baseline | None, version: int
) -> list[MetricResult]:
    changed = bool(_differs(case, run, old))
    kernel = baseline.of(case.name).get("reference_kernel") if baseline is not None and old is not None else None
    found = []
    for gauge in with_optimum(case):
        name = gauge.metric.name
        figure = old.figures.get(name) if old is not None else None
        if name == TIME_RATIO and kernel != version:
            figure = None
        found.append(_figure(gauge, run, figure, changed, case))
    return found


def with_optimum(case: Prepared) -> tuple[Gauge, ...]:
    """The figures of a case, chi2 with the optimum that the registry states where the suite asks for it."""
    entry = case.suite_case
    if case.optimum is None or entry.optimum is None:
        return entry.gauges
    return tuple(
        replace(gauge, optimum=case.optimum, within=entry.optimum) if gauge.metric.name == "chi2" else gauge
        for gauge in entry.gauges
    )


def _differs(case: Prepared, run: CaseRun, old: BaselineCase | None) -> str:
    """What is another one than at the baseline; empty for nothing."""
    if old is None:
        return ""
    parts = [
        f"{name} has another sha256" for name in run.inputs if old.inputs.get(name) not in (None, run.inputs[name])
    ]
    if not parts and (old.definition != case.suite_case.definition or old.inputs.keys() != run.inputs.keys()):
        parts = ["the case runs something else"]
    return f"{' and '.join(parts)} than at the baseline: nothing was compared" if parts else ""


@dataclass(frozen=True)
class _Judgement:
    verdict: Verdict
    message: str = ""
    allowed: float | None = None


def _figure(gauge: Gauge, run: CaseRun, old: BaselineFigure | None, changed: bool, case: Prepared) -> MetricResult:
    kind = gauge.metric
    values = run.figures.get(kind.name)
    result = MetricResult(kind.name, kind.meaning, kind.better, Verdict.PASS, limits=gauge.limits, gate=kind.gate)
    if old is not None and not changed:
        result = replace(result, baseline=old.value, baseline_mad=old.mad)
    if values is None:
        return replace(result, verdict=Verdict.SKIPPED, message=_SEVERAL)
    if not values:
        why = f" (it ended with {run.exit_code})" if run.exit_code else ""
        return replace(result, verdict=Verdict.ABSENT, message=f"the commands printed no such figure{why}")
    middle = statistics.median(values)
    mad = statistics.median(abs(value - middle) for value in values) if len(values) > 1 else None
    result = replace(result, value=middle, mad=mad, values=tuple(values))
    if kind.name == EXIT_CODE:
        good = run.exit_code == case.suite_case.expected
        message = f"{_code_words(run, case)}, expected {case.suite_case.expected}"
        return result if good else replace(result, verdict=Verdict.LIMIT, message=message)
    broken = _broken(gauge, middle)
    if changed:
        judgement = _Judgement(Verdict.CHANGED if kind.gate else Verdict.INFO)
    elif old is None:
        judgement = _Judgement(Verdict.NEW if kind.gate else Verdict.INFO)
    else:
        judgement = compared(kind, middle, mad, old)
    if broken:
        compared_to = judgement.message.removeprefix(f"{_number(middle)}, ")
        message = "; ".join(part for part in (broken, compared_to) if part)
        return replace(result, verdict=Verdict.LIMIT, message=message, allowed=judgement.allowed)
    return replace(result, verdict=judgement.verdict, message=judgement.message, allowed=judgement.allowed)


def compared(kind: Metric, value: float, mad: float | None, old: BaselineFigure) -> _Judgement:
    """A figure beside the one of the baseline.

    It may be worse by absolute + relative · |old|; a time moreover by three standard deviations of either, as far as
    repeats tell them.
    """
    allowed = kind.absolute + kind.relative * abs(old.value)
    if kind.timed:
        allowed += _SIGMAS * _SIGMA * ((mad or 0.0) + (old.mad or 0.0))
    change = value - old.value
    worse = {LOWER: change, HIGHER: -change}.get(kind.better, abs(change))
    words = f"{_number(value)}, baseline {_number(old.value)} ({_change(value, old.value)}, allowed {allowed:.3g})"
    if worse > allowed:
        if not kind.gate:
            return _Judgement(Verdict.INFO, f"worse, does not gate: {words}", allowed)
        return _Judgement(Verdict.REGRESSION, words, allowed)
    if worse < -allowed:
        return _Judgement(Verdict.IMPROVED if kind.gate else Verdict.INFO, f"better: {words}", allowed)
    return _Judgement(Verdict.PASS if kind.gate else Verdict.INFO, "", allowed)


def _broken(gauge: Gauge, value: float) -> str:
    """Which limits of the suite a value breaks, in words."""
    found = []
    if gauge.at_most is not None and value > gauge.at_most:
        found.append(f"is above the limit {_number(gauge.at_most)}")
    if gauge.at_least is not None and value < gauge.at_least:
        found.append(f"is below the limit {_number(gauge.at_least)}")
    if gauge.equals is not None:
        allowed = gauge.metric.absolute + gauge.metric.relative * abs(gauge.equals)
        if abs(value - gauge.equals) > allowed:
            found.append(f"should be {_number(gauge.equals)} (allowed {allowed:.3g})")
    if gauge.optimum is not None and abs(value - gauge.optimum) > gauge.within * abs(gauge.optimum):
        off = f"the known optimum {_number(gauge.optimum)} ({_change(value, gauge.optimum)})"
        below = f"is below {off}: a new one, or another objective"
        found.append(f"is above {off}" if value > gauge.optimum else below)
    return f"{_number(value)} {' and '.join(found)}" if found else ""


def _code_words(run: CaseRun, case: Prepared) -> str:
    """An exit code and what the command said about it."""
    said = [line for line in run.messages.splitlines() if line.startswith("error: ")]
    if run.exit_code == TIMED_OUT:
        return f"{TIMED_OUT}: stopped after {case.case.time_limit:g} s (time_limit)"
    code = run.exit_code or 0
    if code > _BY_SIGNAL and code - _BY_SIGNAL in signal.valid_signals():
        name = signal.Signals(code - _BY_SIGNAL).name
        return f"{code}: ended by {name}" + (" (out of memory?)" if name == "SIGKILL" else "")
    return f"{code}: {said[-1]}" if said else f"{code}"


def _gone(name: str, figure: BaselineFigure) -> MetricResult:
    kind = metric(name)
    text = "the baseline has this figure, the suite does not: --update-baseline forgets it"
    return MetricResult(name, kind.meaning, kind.better, Verdict.GONE, text, baseline=figure.value)


def _number(value: float) -> str:
    return f"{value:.9g}"


def _change(value: float, old: float) -> str:
    change = value - old
    if old != 0.0 and abs(change / old) < 10.0:
        return f"{100.0 * change / abs(old):+.3g} %"
    return f"{change:+.3g}"
