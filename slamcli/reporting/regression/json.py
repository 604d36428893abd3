"""A report as one JSON document."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from slamcli.batch.regression.result import CaseResult, RegressionReport
from slamcli.reporting.documents import dumps, head


def document(report: RegressionReport) -> dict[str, Any]:
    """The document of ``slamcli regress --format json``."""
    return {
        **head("regress"),
        "suite": {"name": report.suite, "path": report.path, "sha256": report.sha256},
        "baseline": report.baseline,
        "exit_code": int(report.exit_code),
        "interrupted": report.interrupted,
        "counts": {verdict.value: count for verdict, count in report.counts.items()},
        "planned": report.planned,
        "left_out": report.left_out,
        "jobs": report.jobs,
        "cases": [_case(case) for case in report.cases],
        "notes": list(report.notes),
        "update": None if report.update is None else asdict(report.update),
        "provenance": report.provenance,
        "baseline_provenance": list(report.baseline_provenance),
        "time": {"total": report.seconds},
    }


def render(report: RegressionReport) -> str:
    """The same as text."""
    return dumps(document(report))


def _case(case: CaseResult) -> dict[str, Any]:
    entry = asdict(case)
    entry["verdict"] = case.verdict.value
    entry["metrics"] = [{**asdict(figure), "verdict": figure.verdict.value} for figure in case.metrics]
    entry["time"] = entry.pop("seconds")
    return entry
