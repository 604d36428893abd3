"""A report as JUnit's XML: what Jenkins, GitLab and others show as tests."""

from __future__ import annotations

import platform
import re
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from slamcli.batch.regression.result import CaseResult, RegressionReport, Verdict
from slamcli.reporting.regression import words

#: What XML 1.0 has no way to write.
_FORBIDDEN = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
#: Verdicts under which a case is not tested rather than failed.
_ERRORS = (Verdict.FAILED, Verdict.MISSING)


def render(report: RegressionReport) -> str:
    """One test suite with a test for each case.

    A case that is worse fails; where data are missing, or a step besides the command failed, it is an error.
    """
    kinds = [_kind(case) for case in report.cases]
    counts = {
        "tests": str(len(kinds)),
        "failures": str(kinds.count("failure")),
        "errors": str(kinds.count("error")),
        "skipped": str(kinds.count("skipped")),
        "time": f"{report.seconds:.3f}",
    }
    root = Element("testsuites", {key: value for key, value in counts.items() if key != "skipped"})
    root.set("name", _clean(report.suite))
    made = report.provenance
    stamp = str(made["date"]).split("+")[0]
    place = {"timestamp": stamp, "hostname": _clean(platform.node() or "unknown")}
    suite = SubElement(root, "testsuite", {"name": _clean(report.suite), **place, **counts})
    properties = SubElement(suite, "properties")
    facts = {**words.facts(made), "suite": report.path, "suite_sha256": report.sha256, "baseline": report.baseline}
    for key, value in facts.items():
        SubElement(properties, "property", name=key, value=_clean(str(value)))
    for case, kind in zip(report.cases, kinds, strict=True):
        _test(suite, report, case, kind)
    SubElement(suite, "system-out").text = _clean("\n".join([*report.notes, words.headline(report)]))
    SubElement(suite, "system-err")
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _test(suite: Element, report: RegressionReport, case: CaseResult, kind: str) -> None:
    test = SubElement(
        suite, "testcase", name=_clean(case.name), classname=_clean(report.suite), time=f"{case.seconds:.3f}"
    )
    if kind == "skipped":
        SubElement(test, "skipped", message=_clean(case.message))
    elif kind:
        complaints = case.complaints or (case.verdict.value,)
        found = SubElement(test, kind, message=_clean(complaints[0]), type=case.verdict.value)
        found.text = _clean("\n".join([*complaints, "", *(f"$ {command}" for command in case.commands)]))
    figures = [
        f"{f.name} {words.spread(f)} (baseline {words.number(f.baseline)}): {f.verdict.value}" for f in case.metrics
    ]
    if figures:
        SubElement(test, "system-out").text = _clean("\n".join(figures))
    if case.messages:
        SubElement(test, "system-err").text = _clean(case.messages)


def _kind(case: CaseResult) -> str:
    if case.verdict is Verdict.SKIPPED:
        return "skipped"
    if not case.verdict.fails:
        return ""
    return "error" if case.verdict in _ERRORS else "failure"


def _clean(text: str) -> str:
    return _FORBIDDEN.sub("\ufffd", text)
