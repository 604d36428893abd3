"""A report as workflow commands of GitHub Actions: annotations at the lines of the suite."""

from __future__ import annotations

import os

from slamcli.batch.regression.result import RegressionReport, Verdict
from slamcli.reporting.regression import words

#: Verdicts that a reader should see although nothing fails.
_WARNED = (Verdict.IMPROVED, Verdict.SKIPPED, Verdict.NEW)


def render(report: RegressionReport) -> str:
    """An error for each case that fails, a warning where something deserves a look, a notice with the outcome."""
    lines = []
    for case in report.cases:
        place = {"file": _relative(report.path), "line": str(case.line or 1)}
        title = f"{report.suite}: {case.name}: {case.verdict.value}"
        if case.verdict.fails:
            text = [*(case.complaints or (case.verdict.value,)), *(f"$ {command}" for command in case.commands)]
            lines.append(command("error", "\n".join(text), **place, title=title))
        elif case.verdict in _WARNED:
            figures = [f"{f.name}: {f.message or f.verdict.value}" for f in case.metrics if f.verdict in _WARNED]
            lines.append(command("warning", "\n".join([case.message, *figures]).strip(), **place, title=title))
    lines += [command("warning", note, title=report.suite) for note in report.notes]
    if report.update is not None:
        lines.append(command("notice", "\n".join(words.update_lines(report.update)), title="baseline"))
    lines.append(command("notice", words.headline(report), title=f"{report.suite}: {words.outcome(report)}"))
    return "\n".join(lines) + "\n"


def command(name: str, message: str, **properties: str) -> str:
    """One workflow command; the signs that end its parts are written as GitHub's runner reads them."""
    given = ",".join(f"{key}={_property(value)}" for key, value in properties.items())
    return f"::{name} {given}::{_data(message)}"


def _data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    return _data(text).replace(":", "%3A").replace(",", "%2C")


def _relative(path: str) -> str:
    """A path within the repository, as annotations need it."""
    root = os.environ.get("GITHUB_WORKSPACE")
    full = os.path.realpath(path)
    if root and full.startswith(os.path.realpath(root) + os.sep):
        return os.path.relpath(full, os.path.realpath(root)).replace(os.sep, "/")
    return path
