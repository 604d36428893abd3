"""Reports of a suite in all formats, of one made-up run with every verdict and the signs that formats trip over."""

from __future__ import annotations

import io
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from slamcli.batch.regression.result import (
    GRAVITY,
    CaseResult,
    Change,
    MetricResult,
    RegressionReport,
    Update,
    Verdict,
)
from slamcli.reporting.regression import FORMATS, github, render
from slamcli.reporting.regression.table import render as table

NASTY = "a: b, 100% <b>&\"'|`*_ \x00\x1b[31m]]> ü"


def _case(verdict: Verdict, name: str) -> CaseResult:
    figure = MetricResult(
        "chi2", "sum of e^T Omega e", "lower", verdict, f"11, baseline 10\n{NASTY}", 11.0, 0.5, (11.0, 12.0), 10.0
    )
    quiet = MetricResult("exit_code", "", "equal", Verdict.PASS, value=0.0)
    return CaseResult(
        name,
        3 + GRAVITY.index(verdict),
        verdict,
        NASTY if verdict in (Verdict.MISSING, Verdict.SKIPPED, Verdict.FAILED) else "",
        (quiet, figure),
        ("slamcli optimize 'a b.g2o' --json",),
        NASTY,
        1.5,
        2,
    )


def made(*verdicts: Verdict, **changes: object) -> RegressionReport:
    cases = tuple(_case(verdict, f"{verdict.value} case") for verdict in verdicts)
    provenance = {
        "date": "2026-01-02T03:04:05+00:00",
        "processor": "x",
        "versions": {"slamcli": "0.1.0", "python": "3.12", "numpy": "2", "scipy": None},
    }
    report = RegressionReport(
        "the suite", "suite.yaml", "f" * 64, "b.json", cases, 2, False, len(cases), 1, 12.5, provenance, (provenance,)
    )
    return replace(report, **changes)  # type: ignore[arg-type]


ALL = made(
    *GRAVITY,
    notes=(NASTY,),
    update=Update("b.json", True, (Change("a", "chi2", 1.0, None), Change("a", "ate", 1.0, 1.5)), 3, {"c": NASTY}),
)


@pytest.mark.parametrize("form", FORMATS)
def test_every_format_names_every_case_and_ends_its_last_line(form: str) -> None:
    text = render(ALL, form)
    assert text.endswith("\n") and not text.endswith("\n\n")
    for case in ALL.cases:
        if form != "github" or case.verdict not in (Verdict.PASS, Verdict.INFO):
            assert case.name in text.replace("%2C", ",")
    assert render(made(), form)
    assert "interrupted" in render(made(interrupted=True, planned=4), form)


def test_junit_is_valid_and_counts() -> None:
    xmlschema = pytest.importorskip("xmlschema")
    schema = xmlschema.XMLSchema(str(Path(__file__).with_name("junit.xsd")))
    for report in (ALL, made(), made(Verdict.PASS), made(interrupted=True)):
        text = render(report, "junit")
        schema.validate(io.StringIO(text))
        root = ElementTree.fromstring(text)
        for place in (root, *root.findall("testsuite")):
            for name, tag in (("failures", "failure"), ("errors", "error"), ("tests", "testcase")):
                assert int(place.get(name, "")) == len(list(root.iter(tag)))
    broken = render(ALL, "junit").replace("<testcase name=", "<testcase title=")
    with pytest.raises(xmlschema.XMLSchemaValidationError):
        schema.validate(io.StringIO(broken))


def test_junit_tells_failures_from_errors() -> None:
    root = ElementTree.fromstring(render(ALL, "junit"))
    kinds = {case.get("name"): next(child.tag for child in case) for case in root.iter("testcase")}
    assert kinds["regression case"] == kinds["limit case"] == kinds["gone case"] == "failure"
    assert kinds["failed case"] == kinds["missing data case"] == "error"
    assert kinds["skipped case"] == "skipped"
    assert kinds["pass case"] == kinds["improved case"] == kinds["new case"] == "system-out"
    failure = next(root.iter("failure"))
    assert failure.get("type") and "chi2: 11, baseline 10" in (failure.text or "")


#: A workflow command as GitHub's runner takes it apart.
_COMMAND = re.compile(r"::(?P<name>error|warning|notice) (?P<properties>[^\r\n]*?)::(?P<message>[^\r\n]*)")


def _parsed(line: str) -> tuple[str, dict[str, str], str]:
    found = _COMMAND.fullmatch(line)
    assert found, line

    def data(text: str) -> str:
        return text.replace("%0D", "\r").replace("%0A", "\n").replace("%25", "%")

    pairs = (part.split("=", 1) for part in found["properties"].split(","))
    properties = {key: data(value.replace("%3A", ":").replace("%2C", ",")) for key, value in pairs}
    return found["name"], properties, data(found["message"])


@given(st.text(), st.text())
def test_github_reads_what_was_meant(message: str, title: str) -> None:
    line = github.command("error", message, file="a.yaml", line="3", title=title)
    message, title = (re.sub(r"[\x0b\x0c\x1c-\x1e\x85\u2028\u2029]", "?", text) for text in (message, title))
    line = re.sub(r"[\x0b\x0c\x1c-\x1e\x85\u2028\u2029]", "?", line)
    assert _parsed(line) == ("error", {"file": "a.yaml", "line": "3", "title": title}, message)


def test_github_annotates_the_lines_of_the_suite(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("GITHUB_WORKSPACE", str(tmp_path))
    report = replace(ALL, path=str(tmp_path / "ci" / "suite.yaml"))
    parsed = [_parsed(line) for line in render(report, "github").splitlines()]
    errors = [entry for entry in parsed if entry[0] == "error"]
    assert len(errors) == len(report.failed)
    case = next(case for case in report.cases if case.verdict is Verdict.REGRESSION)
    _, properties, message = next(entry for entry in errors if "regression case" in entry[1]["title"])
    assert (properties["file"], properties["line"]) == ("ci/suite.yaml", str(case.line))
    assert message.startswith("chi2: 11, baseline 10\n")
    assert not [entry for entry in parsed if "pass case" in entry[1]["title"]]


def test_markdown_tables_keep_their_columns() -> None:
    rows = [line for line in render(ALL, "markdown").splitlines() if line.startswith("|")]
    assert len(rows) == 2 + len(ALL.cases)
    for row in rows:
        assert len(re.findall(r"(?<!\\)\|", row)) == 9, row


def test_html_stands_alone_and_is_well_formed() -> None:
    text = render(ALL, "html")
    assert not re.search(r"(src|href)=|<script|@import|url\(", text)
    assert "<b>" not in text and "&lt;b&gt;" in text

    class Checker(HTMLParser):
        stack: list[str] = []  # noqa: RUF012

        def handle_starttag(self, tag: str, attrs: object) -> None:
            if tag not in ("meta", "br"):
                self.stack.append(tag)

        def handle_endtag(self, tag: str) -> None:
            assert self.stack.pop() == tag

    checker = Checker()
    checker.feed(text)
    assert checker.stack == []


def test_json_has_what_was_measured() -> None:
    document = json.loads(render(ALL, "json"))
    assert (document["command"], document["exit_code"], document["left_out"]) == ("regress", 1, 2)
    assert document["counts"] == {verdict.value: 1 for verdict in GRAVITY}
    case = next(case for case in document["cases"] if case["verdict"] == "regression")
    assert case["metrics"][1] | {"message": ""} == {
        "name": "chi2",
        "meaning": "sum of e^T Omega e",
        "better": "lower",
        "verdict": "regression",
        "message": "",
        "value": 11.0,
        "mad": 0.5,
        "values": [11.0, 12.0],
        "baseline": 10.0,
        "baseline_mad": None,
        "allowed": None,
        "limits": {},
        "gate": True,
    }


def test_the_table_is_short_unless_asked_and_coloured_on_terminals_only() -> None:
    report = made(Verdict.PASS, Verdict.REGRESSION)
    assert len(table(report).splitlines()) < len(table(report, verbose=True).splitlines())
    assert "\x1b[31mregression" in table(report, colour=True)
    assert "\x1b[3" not in table(made(Verdict.PASS))
    assert "$ slamcli optimize 'a b.g2o' --json" in table(report)


@pytest.mark.parametrize(
    ("verdicts", "changes", "code"),
    [
        ((Verdict.PASS, Verdict.NEW, Verdict.SKIPPED, Verdict.IMPROVED), {}, 0),
        ((Verdict.REGRESSION,), {}, 1),
        ((Verdict.MISSING,), {}, 3),
        ((Verdict.MISSING, Verdict.GONE), {}, 1),
        ((Verdict.REGRESSION,), {"interrupted": True}, 130),
        ((Verdict.REGRESSION, Verdict.CHANGED), {"update": Update("b", True, (), 0)}, 0),
        ((Verdict.LIMIT,), {"update": Update("b", True, (), 0)}, 1),
        # a case with two faults of which the graver could be blessed keeps its old figures
        ((Verdict.REGRESSION,), {"update": Update("b", True, (), 0, {"0": "chi2: absent"})}, 1),
        ((Verdict.PASS,), {"update": Update("b", False, (), 0, failed=True)}, 3),
    ],
)
def test_exit_codes(verdicts: tuple[Verdict, ...], changes: dict[str, object], code: int) -> None:
    assert made(*verdicts, **changes).exit_code == code
