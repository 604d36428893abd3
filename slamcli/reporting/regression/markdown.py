"""A report as Markdown, for pages, comments and the summary of a job."""

from __future__ import annotations

from slamcli.batch.regression.result import RegressionReport
from slamcli.reporting.regression import words
from slamcli.reporting.text import seconds


def render(report: RegressionReport) -> str:
    """A table of all figures, and what is wrong in words."""
    lines = [f"**{_text(report.suite)}: {words.outcome(report)}.** {_text(words.headline(report))}", ""]
    if report.failed:
        for case in report.failed:
            lines.append(f"- **{_text(case.name)}** ({case.verdict.value})")
            lines += [f"  - {_text(line)}" for line in case.complaints]
        lines.append("")
    if report.cases:
        lines += ["| case | time | figure | value | baseline | change | limit | verdict |"]
        lines += ["|---|---:|---|---:|---:|---:|---|---|"]
    for case in report.cases:
        name, time = _text(case.name), seconds(case.seconds) if case.repeats else ""
        figures = words.shown(case)
        if not figures:
            lines.append(f"| {name} | {time} | {_text(case.message)} | | | | | {case.verdict.value} |")
        for figure in figures:
            cells = [name, time, figure.name, words.spread(figure), words.number(figure.baseline)]
            cells += [words.change(figure), words.limits(figure), figure.verdict.value]
            lines.append(f"| {' | '.join([*cells[:2], *map(_text, cells[2:])])} |")
            name = time = ""
    lines += [line for note in report.notes for line in ("", f"Note: {_text(note)}")]
    if report.update is not None:
        first, *others = words.update_lines(report.update)
        lines += ["", _text(first), "", *(f"- {_text(line.strip())}" for line in others)]
    lines += ["", _text(words.made_by(report.provenance))]
    return "\n".join(lines) + "\n"


def _text(text: str) -> str:
    """Text that Markdown leaves as it is, also within a table."""
    for sign in "\\`*_<>|[]":
        text = text.replace(sign, f"\\{sign}")
    return text.replace("\n", " ")
