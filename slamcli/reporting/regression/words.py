"""How numbers and outcomes of a suite are said, alike in every format."""

from __future__ import annotations

from typing import Any

from slamcli.batch.regression.result import CaseResult, MetricResult, RegressionReport, Update, Verdict
from slamcli.reporting.text import plural, seconds

_LIMITS = {"at_most": "≤ {}", "at_least": "≥ {}", "equals": "= {}", "optimum": "= optimum {}"}
#: Figures that say nothing where they pass.
_QUIET = ("exit_code",)
#: Differences below this part of a figure are rounding.
_ROUNDING = 1e-12


def number(value: float | None) -> str:
    """A figure with nine digits; whole numbers as such."""
    if value is None:
        return "-"
    return f"{value:.0f}" if value == round(value) and abs(value) < 1e15 else f"{value:.9g}"


def spread(figure: MetricResult) -> str:
    """A figure, and the deviation of its repeats."""
    return number(figure.value) + (f" ± {figure.mad:.2g}" if figure.mad else "")


def change(figure: MetricResult) -> str:
    """By how much a figure differs from the baseline."""
    if figure.value is None or figure.baseline is None:
        return ""
    return difference(figure.baseline, figure.value)


def difference(old: float, new: float) -> str:
    """A change in percent, or as it is where there is nothing to compare it with."""
    if new == old:
        return "0"
    if abs(new - old) <= _ROUNDING * abs(old):
        return "≈ 0"
    if old == 0.0 or abs((new - old) / old) >= 10.0:
        return f"{new - old:+.3g}"
    return f"{100.0 * (new - old) / abs(old):+.2g} %"


def limits(figure: MetricResult) -> str:
    """The limits of the suite."""
    return ", ".join(_LIMITS[name].format(number(value)) for name, value in figure.limits.items())


def shown(case: CaseResult) -> list[MetricResult]:
    """Figures of a case without those that say nothing."""
    return [f for f in case.metrics if f.name not in _QUIET or f.verdict.fails]


def headline(report: RegressionReport) -> str:
    """The outcome in a line."""
    counts = ", ".join(f"{count} {verdict.value}" for verdict, count in report.counts.items())
    ended = "interrupted: " if report.interrupted else ""
    ran = sum(case.line is not None for case in report.cases)
    of = f"{ran} of {plural(report.planned, 'case')}" if ran != report.planned else plural(report.planned, "case")
    left = f", {report.left_out} left out by --only" if report.left_out else ""
    return f"{report.suite}: {ended}{of} in {seconds(report.seconds)}: {counts or 'nothing ran'}{left}"


def outcome(report: RegressionReport) -> str:
    """``passed``, ``failed``, ...: what the exit code says."""
    if report.update is not None and report.update.failed and not report.interrupted:
        return "baseline not written"
    return {0: "passed", 1: "failed", 3: "data missing", 130: "interrupted"}[int(report.exit_code)]


def update_lines(update: Update) -> list[str]:
    """What blessing did, figure by figure."""
    lines = [
        f"  {change.case} {change.metric}: {number(change.old)} -> {number(change.new)}"
        + (f" ({difference(change.old, change.new)})" if change.old is not None and change.new is not None else "")
        for change in update.changes
    ]
    lines += [f"  {name} keeps its old figures: {why}" for name, why in update.refused.items()]
    counted = f"{plural(len(update.changes), 'figure')} changed, {update.unchanged} as before"
    if update.written:
        return [f"baseline {update.path} written: {counted}", *lines]
    return [f"baseline {update.path} not written: {update.reason}", *lines]


def facts(provenance: dict[str, Any]) -> dict[str, str]:
    """A provenance as names with words, the versions among them."""
    versions = {name: version or "absent" for name, version in provenance["versions"].items()}
    return {key: str(value) for key, value in {**versions, **provenance}.items() if key != "versions"}


def made_by(provenance: dict[str, Any]) -> str:
    """The most important of it in a line."""
    here = facts(provenance)
    versions = ", ".join(f"{word} {here[word.lower()]}" for word in ("slamcli", "Python", "numpy"))
    return f"{versions}, {here['processor']}, {here['date']}"


def verdict_colour(verdict: Verdict) -> str | None:
    """Of a terminal."""
    if verdict.fails:
        return "red"
    return {
        Verdict.PASS: "green",
        Verdict.IMPROVED: "green",
        Verdict.NEW: "yellow",
        Verdict.SKIPPED: "yellow",
    }.get(verdict)
