"""Blessing: what an update writes, shows and refuses; baselines that are none."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from regression_suites import ONE, FakeMachine, blessed, optimized, ran, suite_of

from slamcli.batch.regression import baseline as baselines
from slamcli.batch.regression.result import Verdict
from slamcli.batch.regression.session import regress
from slamcli.errors import ExitCode, UsageError


def test_an_update_shows_what_changes_and_is_the_next_baseline(tmp_path: Path) -> None:
    suite = blessed(tmp_path)
    worse = FakeMachine({"optimize": optimized(chi2=11.0)})
    report = ran(suite, worse, update=True)
    assert report.update is not None
    assert [(c.case, c.metric, c.old, c.new) for c in report.update.changes] == [("one", "chi2", 10.0, 11.0)]
    assert (report.update.unchanged, report.exit_code) == (1, ExitCode.SUCCESS)
    assert ran(suite, worse).cases[0].verdict is Verdict.PASS


def test_nothing_is_written_without_an_update_or_a_change(tmp_path: Path) -> None:
    suite = blessed(tmp_path)
    path = tmp_path / "suite.baseline.json"
    before = path.read_bytes()
    ran(suite, FakeMachine({"optimize": optimized(chi2=11.0)}))
    report = ran(suite, update=True)
    assert report.update is not None and not report.update.written
    assert (report.update.reason, report.update.changes, path.read_bytes()) == ("nothing changes", (), before)


def test_an_update_of_some_cases_keeps_the_others(tmp_path: Path) -> None:
    cases = ONE + "  - {name: two, data: graph.g2o, metrics: [chi2]}\n"
    blessed(tmp_path, cases)
    suite = suite_of(tmp_path, cases + "  - {name: three, data: graph.g2o}\n")
    ran(suite, FakeMachine({"optimize": optimized(chi2=20.0)}), update=True, only=["two", "three"])
    found = baselines.read(str(tmp_path / "suite.baseline.json"))
    assert found is not None
    assert list(found.cases) == ["one", "two", "three"]
    assert (found.cases["one"].figures["chi2"].value, found.cases["two"].figures["chi2"].value) == (10.0, 20.0)
    # without --only, what the suite does not have any more is forgotten
    ran(suite_of(tmp_path, ONE), update=True)
    found = baselines.read(str(tmp_path / "suite.baseline.json"))
    assert found is not None and list(found.cases) == ["one"]


def test_what_breaks_a_limit_is_not_blessed(tmp_path: Path) -> None:
    cases = ONE + "  - {name: two, data: graph.g2o, metrics: {chi2: {at_most: 15}}}\n"
    suite = blessed(tmp_path, cases)
    report = ran(suite, FakeMachine({"optimize": optimized(chi2=20.0)}), update=True)
    assert report.update is not None
    assert list(report.update.refused) == ["two"]
    assert report.exit_code == ExitCode.CHECK_FAILED
    found = baselines.read(str(tmp_path / "suite.baseline.json"))
    assert found is not None
    assert (found.cases["one"].figures["chi2"].value, found.cases["two"].figures["chi2"].value) == (20.0, 10.0)


def test_two_updates_at_once_do_not_overwrite_each_other(tmp_path: Path) -> None:
    suite = blessed(tmp_path)
    path = baselines.default_path(suite.path)
    read_by_both = baselines.read(path)
    ran(suite, FakeMachine({"optimize": optimized(chi2=11.0)}), update=True)
    late = regress(
        suite,
        FakeMachine({"optimize": optimized(chi2=12.0)}).machine,
        baseline=read_by_both,
        baseline_path=path,
        update=True,
    )
    assert late.update is not None
    assert not late.update.written and "changed by someone else" in late.update.reason
    assert late.exit_code == ExitCode.INVALID_INPUT
    assert json.loads(Path(path).read_text())["cases"]["one"]["figures"]["chi2"]["value"] == 11.0


def test_a_baseline_that_cannot_be_written(tmp_path: Path) -> None:
    suite = suite_of(tmp_path, ONE)
    path = str(tmp_path / "nowhere" / "b.json")
    report = regress(suite, FakeMachine().machine, baseline=None, baseline_path=path, update=True)
    assert report.update is not None and report.update.failed
    assert report.exit_code == ExitCode.INVALID_INPUT


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.pop("kind"), "is no baseline"),
        (lambda d: d.update(schema_version=2), "of version 2, expected 1"),
        (lambda d: d.pop("cases"), "the key 'cases' is missing"),
        (lambda d: d["cases"]["one"]["figures"]["chi2"].update(value="x"), "chi2 has the value 'x'"),
        (lambda d: d["cases"]["one"]["figures"]["chi2"].update(worth=1), "damaged baseline"),
        (lambda d: d.update(cases=[]), "damaged baseline"),
        (lambda d: d["cases"]["one"]["figures"]["chi2"].update(value=10**400), "chi2 has the value 1"),
        # a deviation that is no number would forgive a time everything
        (lambda d: d["cases"]["one"]["figures"]["chi2"].update(mad=float("nan")), "chi2 has the deviation nan"),
        (lambda d: next(iter(d["provenance"].values())).update(versions=1), "damaged baseline"),
    ],
)
def test_damaged_baselines(change: Any, message: str, tmp_path: Path) -> None:
    suite = blessed(tmp_path)
    path = Path(baselines.default_path(suite.path))
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))
    with pytest.raises(UsageError, match=message):
        baselines.read(str(path))


def test_a_baseline_that_nests_without_end(tmp_path: Path) -> None:
    path = tmp_path / "b.json"
    path.write_text("[" * 100_000)
    with pytest.raises(UsageError, match="is no JSON document"):
        baselines.read(str(path))


def test_a_time_that_gates_can_be_blessed(tmp_path: Path) -> None:
    """Times change from run to run, so they alone are no reason to write; one that fails is."""
    case = "  - {name: one, data: graph.g2o, metrics: {solve_seconds: {gate: true}}}\n"
    suite = blessed(tmp_path, case)
    slower = FakeMachine({"optimize": optimized(time={"iterate": 9.0, "setup": 0.0, "certify": 0.0})})
    assert ran(suite, slower).exit_code == ExitCode.CHECK_FAILED
    report = ran(suite, slower, update=True)
    assert report.update is not None and report.update.written
    assert ran(suite, slower).exit_code == ExitCode.SUCCESS


def test_a_case_that_is_not_blessed_fails_whatever_else_is(tmp_path: Path) -> None:
    """Worse and incomplete: the graver of the two could be blessed, the other cannot."""
    suite = blessed(tmp_path, "  - {name: one, data: graph.g2o, metrics: [chi2, iterations]}\n")
    report = ran(suite, FakeMachine({"optimize": {"chi2": 20.0}}), update=True)
    assert report.update is not None and list(report.update.refused) == ["one"]
    assert report.exit_code == ExitCode.CHECK_FAILED


def test_the_baseline_says_where_it_comes_from(tmp_path: Path) -> None:
    suite = blessed(tmp_path)
    found = baselines.read(baselines.default_path(suite.path))
    assert found is not None
    entry = found.of("one")
    assert {"date", "platform", "processor", "revision", "source", "reference_kernel"} <= set(entry)
    assert {"slamcli", "python", "numpy", "scipy", "cvxopt"} <= set(entry["versions"])
    assert found.suite_sha256 == suite.sha256
    assert len(found.cases["one"].inputs["graph.g2o"]) == 64
    changed = {
        key: {**value, "versions": {**value["versions"], "numpy": "1.0"}} for key, value in found.provenance.items()
    }
    report = regress(suite, FakeMachine().machine, baseline=replace(found, provenance=changed), baseline_path="b")
    assert "the baseline was made elsewhere: numpy 1.0 -> " in report.notes[0]
