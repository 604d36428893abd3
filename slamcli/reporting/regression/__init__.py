"""Reports of a regression suite: text, Markdown, JUnit, GitHub's annotations, HTML, JSON."""

from __future__ import annotations

from importlib import import_module

from slamcli.batch.regression.result import RegressionReport

#: Each is a module of this package with a function ``render``.
FORMATS = ("table", "json", "junit", "github", "markdown", "html")


def render(report: RegressionReport, form: str) -> str:
    """The text of a report in one of ``FORMATS``, with its last newline."""
    text: str = import_module(f"{__name__}.{form}").render(report)
    return text.rstrip("\n") + "\n"
