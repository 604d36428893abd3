"""A report for terminals: a line for each case, and the figures that are not as they were."""

from __future__ import annotations

from slamcli.batch.regression.result import CaseResult, RegressionReport, Verdict
from slamcli.reporting.regression import words
from slamcli.reporting.text import coloured, plural, seconds, table

#: Verdicts of figures that need no line of their own.
_SILENT = (Verdict.PASS, Verdict.INFO, Verdict.NEW, Verdict.SKIPPED)


def render(report: RegressionReport, *, verbose: bool = False, colour: bool = False) -> str:
    """The report as text.

    Parameters
    ----------
    report
        Of a suite.
    verbose
        Every figure, not only those that changed.
    colour
        For a terminal that has colours.
    """
    lines: list[str] = []
    if report.cases:
        rows = [[case.name, case.verdict.value, _content(case)] for case in report.cases]
        for case, line in zip(report.cases, table(rows, "<<<"), strict=True):
            lines.append(_marked(line, case, colour))
            lines += _details(case, verbose)
        lines.append("")
    lines += [f"note: {note}" for note in report.notes]
    if report.update is not None:
        lines += words.update_lines(report.update)
    lines.append(words.headline(report))
    return "\n".join(lines) + "\n"


def _marked(line: str, case: CaseResult, colour: bool) -> str:
    """A line with its verdict in colour."""
    mark = words.verdict_colour(case.verdict)
    if mark is None:
        return line
    begin = line.index(case.verdict.value, len(case.name))
    end = begin + len(case.verdict.value)
    return line[:begin] + coloured(line[begin:end], mark, colour) + line[end:]


def _content(case: CaseResult) -> str:
    if case.line is None or case.verdict in (Verdict.SKIPPED, Verdict.MISSING):
        return case.message
    repeats = f", {case.repeats} times" if case.repeats > 1 else ""
    resumed = ", from an interrupted run" if case.resumed else ""
    return f"{plural(len(case.metrics), 'figure')}, {seconds(case.seconds)}{repeats}{resumed}"


def _details(case: CaseResult, verbose: bool) -> list[str]:
    lines = []
    if case.message and not (case.line is None or case.verdict in (Verdict.SKIPPED, Verdict.MISSING)):
        lines.append(f"    {case.message}")
    if verbose:
        rows = [
            [
                f"    {f.name}",
                words.spread(f),
                words.number(f.baseline),
                words.change(f),
                words.limits(f),
                f.verdict.value,
            ]
            for f in words.shown(case)
        ]
        lines += table(rows, "<>>><<") if rows else []
    lines += [
        f"    {figure.name} {figure.verdict.value}: {figure.message}"
        for figure in case.metrics
        if figure.message and (figure.verdict not in _SILENT or figure.verdict is Verdict.INFO)
    ]
    if case.verdict.fails and case.commands:
        lines += [f"    $ {command}" for command in case.commands]
    return lines
