"""Verdicts on what a suite measured, with a machine that answers from a table."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from regression_suites import ONE, OPTIMIZED, FakeMachine, blessed, figure, optimized, ran, suite_of

from slamcli.batch.metrics import EQUAL, HIGHER, LOWER, METRICS, metric
from slamcli.batch.regression.baseline import BaselineFigure
from slamcli.batch.regression.compare import compared
from slamcli.batch.regression.result import GRAVITY, Verdict
from slamcli.errors import ExitCode, UsageError


@pytest.mark.parametrize(
    ("better", "value", "verdict"),
    [
        (LOWER, 110.0, Verdict.PASS),
        (LOWER, 111.1, Verdict.REGRESSION),
        (LOWER, 88.0, Verdict.IMPROVED),
        (HIGHER, 90.0, Verdict.PASS),
        (HIGHER, 88.0, Verdict.REGRESSION),
        (HIGHER, 112.0, Verdict.IMPROVED),
        (EQUAL, 91.0, Verdict.PASS),
        (EQUAL, 112.0, Verdict.REGRESSION),
        (EQUAL, 88.0, Verdict.REGRESSION),
    ],
)
def test_directions_and_tolerances(better: str, value: float, verdict: Verdict) -> None:
    """Worse by more than 1 + 0.1 * 100 is a regression, better by as much an improvement."""
    kind = replace(metric("chi2"), better=better, relative=0.1, absolute=0.0)
    kind = replace(kind, absolute=1.0 if verdict is Verdict.REGRESSION else 0.0)
    assert compared(kind, value, None, BaselineFigure(100.0)).verdict is verdict


@given(
    st.sampled_from(sorted(METRICS)),
    st.floats(-1e12, 1e12).filter(lambda x: abs(x) > 1e-6),
    st.floats(0.0, 0.5),
)
def test_no_figure_is_worse_than_itself_and_worse_is_symmetric(name: str, value: float, share: float) -> None:
    kind = replace(metric(name), gate=True)
    assert compared(kind, value, None, BaselineFigure(value)).verdict is Verdict.PASS
    lower, higher = replace(kind, better=LOWER), replace(kind, better=HIGHER)
    other = value + share * abs(value)
    one = compared(lower, other, None, BaselineFigure(value)).verdict
    two = compared(higher, -other, None, BaselineFigure(-value)).verdict
    assert one is two


def test_times_are_forgiven_what_their_repeats_scatter() -> None:
    kind = replace(METRICS["solve_seconds"], gate=True, relative=0.0)
    assert compared(kind, 1.4, None, BaselineFigure(1.0)).verdict is Verdict.REGRESSION
    # 3 * 1.4826 * (0.05 + 0.05) = 0.44
    assert compared(kind, 1.4, 0.05, BaselineFigure(1.0, 0.05, 5)).verdict is Verdict.PASS
    assert compared(replace(kind, gate=False), 9.0, None, BaselineFigure(1.0)).verdict is Verdict.INFO
    chi2 = replace(METRICS["chi2"], relative=0.0)
    assert compared(chi2, 1.4, 0.05, BaselineFigure(1.0, 0.05, 5)).verdict is Verdict.REGRESSION


def test_a_worse_figure_fails_and_says_by_how_much(tmp_path: Path) -> None:
    suite = blessed(tmp_path)
    report = ran(suite)
    assert (report.exit_code, report.cases[0].verdict) == (ExitCode.SUCCESS, Verdict.PASS)
    report = ran(suite, FakeMachine({"optimize": optimized(chi2=11.0)}))
    assert report.exit_code == ExitCode.CHECK_FAILED
    assert figure(report, "chi2").message == "11, baseline 10 (+10 %, allowed 1e-05)"
    report = ran(suite, FakeMachine({"optimize": optimized(chi2=9.0)}))
    assert (report.exit_code, report.cases[0].verdict) == (ExitCode.SUCCESS, Verdict.IMPROVED)


def test_without_baseline_limits_and_exit_code_count(tmp_path: Path) -> None:
    case = "  - {name: one, data: graph.g2o, metrics: {chi2: {at_most: 9, at_least: 12, equals: 4}}}\n"
    report = ran(suite_of(tmp_path, case))
    assert report.exit_code == ExitCode.CHECK_FAILED
    assert figure(report, "chi2").message == (
        "10 is above the limit 9 and is below the limit 12 and should be 4 (allowed 4e-06)"
    )
    report = ran(suite_of(tmp_path, ONE))
    assert (report.exit_code, report.cases[0].verdict) == (ExitCode.SUCCESS, Verdict.NEW)
    assert "no baseline" in report.notes[0]


def test_the_optimum_of_the_registry(tmp_path: Path) -> None:
    """877.0484089 is that of manhattan_small; below it is as wrong as above."""
    suite = suite_of(tmp_path, "  - {name: one, data: manhattan_small, optimum: true}\n")
    for chi2, verdict, words in (
        (877.0484092, Verdict.NEW, ""),
        (878.0, Verdict.LIMIT, "878 is above the known optimum 877.048409"),
        (870.0, Verdict.LIMIT, "is below the known optimum"),
    ):
        report = ran(suite, FakeMachine({"optimize": optimized(chi2=chi2)}))
        assert figure(report, "chi2").verdict is verdict
        assert words in figure(report, "chi2").message
    suite = suite_of(tmp_path, "  - {name: one, data: manhattan_small, optimum: 0.1}\n")
    assert figure(ran(suite, FakeMachine({"optimize": optimized(chi2=900.0)})), "chi2").verdict is Verdict.NEW


def test_an_exit_code_that_was_not_expected(tmp_path: Path) -> None:
    suite = blessed(tmp_path)
    fake = FakeMachine({}, {"optimize": 5}, {"optimize": "warning: x\nerror: H is singular\n  edges ...\n"})
    report = ran(suite, fake)
    assert figure(report, "exit_code").message == "5: error: H is singular, expected 0"
    assert figure(report, "chi2").verdict is Verdict.ABSENT
    assert report.cases[0].messages.endswith("edges ...")
    suite = suite_of(tmp_path, "  - {name: one, data: graph.g2o, expect: {exit_code: 5}}\n")
    assert ran(suite, fake).cases[0].verdict is not Verdict.LIMIT
    assert ran(suite).cases[0].verdict is Verdict.LIMIT


def test_a_process_that_was_killed(tmp_path: Path) -> None:
    report = ran(suite_of(tmp_path, ONE), FakeMachine({}, {"optimize": 137}))
    assert figure(report, "exit_code").message == "137: ended by SIGKILL (out of memory?), expected 0"


def test_a_step_beside_the_command_that_fails(tmp_path: Path) -> None:
    suite = suite_of(tmp_path, "  - {name: one, simulate: square, metrics: [chi2]}\n")
    report = ran(suite, FakeMachine({}, {"simulate": 2}, {"simulate": "error: no such world\n"}))
    assert report.cases[0].verdict is Verdict.FAILED
    assert report.cases[0].message == "simulate ended with 2: error: no such world"
    assert report.exit_code == ExitCode.CHECK_FAILED


def test_a_time_limit_is_said(tmp_path: Path) -> None:
    suite = suite_of(tmp_path, "  - {name: one, data: graph.g2o, time_limit: 3}\n")
    report = ran(suite, FakeMachine({}, {"optimize": 124}))
    assert "124: stopped after 3 s (time_limit)" in figure(report, "exit_code").message


def test_figures_that_are_not_printed_or_not_finite(tmp_path: Path) -> None:
    suite = blessed(tmp_path)
    for document in (optimized(chi2=None, final_chi2=None), optimized(chi2=math.inf, final_chi2=None), None):
        assert figure(ran(suite, FakeMachine({"optimize": document})), "chi2").verdict is Verdict.ABSENT


def test_missing_data_fail_unless_they_are_optional(tmp_path: Path) -> None:
    for optional, verdict, code in (
        ("false", Verdict.MISSING, ExitCode.INVALID_INPUT),
        ("true", Verdict.SKIPPED, ExitCode.SUCCESS),
    ):
        fake = FakeMachine()
        suite = suite_of(tmp_path, f"  - {{name: one, data: no.g2o, optional: {optional}}}\n")
        report = ran(suite, fake)
        assert (report.cases[0].verdict, report.exit_code, fake.lines) == (verdict, code, [])
    # a regression beside it counts more
    suite = suite_of(
        tmp_path, "  - {name: one, data: no.g2o}\n  - {name: two, data: graph.g2o, metrics: {chi2: {at_most: 1}}}\n"
    )
    assert ran(suite).exit_code == ExitCode.CHECK_FAILED


def test_a_wrong_file_is_not_an_optional_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "pose3d").mkdir()
    (tmp_path / "pose3d" / "sphere2500.g2o").write_text("another one")
    monkeypatch.setenv("SLAMCLI_DATASETS", str(tmp_path))
    report = ran(suite_of(tmp_path, "  - {name: one, data: sphere2500, optional: true}\n"))
    assert report.cases[0].verdict is Verdict.MISSING
    assert "is not the file of the data set" in report.cases[0].message


def test_changed_inputs_are_said_and_not_compared(tmp_path: Path) -> None:
    suite = blessed(tmp_path)
    (tmp_path / "graph.g2o").write_text("VERTEX_SE2 7 0 0 0\n")
    report = ran(suite, FakeMachine({"optimize": optimized(chi2=9.0)}))
    assert report.cases[0].verdict is Verdict.CHANGED
    assert report.cases[0].message == "graph.g2o has another sha256 than at the baseline: nothing was compared"
    assert figure(report, "chi2").baseline is None
    assert report.exit_code == ExitCode.CHECK_FAILED


def test_a_changed_case_is_said_and_not_compared(tmp_path: Path) -> None:
    blessed(tmp_path)
    suite = suite_of(tmp_path, "  - {name: one, data: graph.g2o, options: {method: lm}, metrics: [chi2]}\n")
    report = ran(suite)
    assert "the case runs something else" in report.cases[0].message
    assert report.cases[0].verdict is Verdict.CHANGED


def test_cases_and_figures_that_are_gone_fail_unless_only_some_run(tmp_path: Path) -> None:
    two = "  - {name: two, data: graph.g2o, metrics: [chi2, iterations]}\n"
    blessed(tmp_path, ONE + two)
    suite = suite_of(tmp_path, "  - {name: two, data: graph.g2o, metrics: [chi2]}\n")
    report = ran(suite)
    assert [case.verdict for case in report.cases] == [Verdict.GONE, Verdict.GONE]
    assert (report.cases[1].name, report.cases[1].line, report.exit_code) == ("one", None, ExitCode.CHECK_FAILED)
    report = ran(suite_of(tmp_path, two), only=["tw*"])
    assert (len(report.cases), report.exit_code) == (1, ExitCode.SUCCESS)


def test_a_name_that_is_no_pattern_of_itself(tmp_path: Path) -> None:
    suite = suite_of(tmp_path, ONE.replace("one", '"a[1]"') + ONE)
    assert [case.name for case in ran(suite, only=["a[1]"]).cases] == ["a[1]"]


def test_only_has_to_match(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="has no such case"):
        ran(suite_of(tmp_path, ONE), only=["one", "tow"])


def test_median_and_deviation_of_repeats(tmp_path: Path) -> None:
    suite = suite_of(tmp_path, "  - {name: one, data: graph.g2o, repeats: 5, metrics: [memory]}\n")
    documents = [optimized(peak_memory_mb=value) for value in (50.0, 90.0, 51.0, 49.0, 53.0)]
    report = ran(suite, FakeMachine({"optimize": documents}))
    memory = figure(report, "memory")
    # |50 - 51|, |90 - 51|, 0, 2, 2: the median is 2
    assert (memory.value, memory.mad, memory.values) == (51.0, 2.0, (50.0, 90.0, 51.0, 49.0, 53.0))


def test_time_ratio_is_to_a_kernel_that_runs_before_and_after(tmp_path: Path) -> None:
    suite = suite_of(tmp_path, "  - {name: one, data: graph.g2o, repeats: 2, metrics: [time_ratio, solve_seconds]}\n")
    paces = iter((0.25, 0.75, 1.0, 2.0))
    fake = FakeMachine(pace=lambda: next(paces))
    report = ran(suite, fake)
    assert figure(report, "solve_seconds").values == (1.75, 1.75)  # of 19.75 with reading and writing
    assert figure(report, "time_ratio").values == (1.75 / 0.5, 1.75 / 1.5)
    assert fake.paces == 4
    assert report.exit_code == ExitCode.SUCCESS


def test_times_need_one_job(tmp_path: Path) -> None:
    suite = suite_of(tmp_path, "  - {name: one, data: graph.g2o, metrics: {time_ratio: {gate: true}, chi2: }}\n")
    fake = FakeMachine()
    report = ran(suite, fake, jobs=2)
    assert figure(report, "time_ratio").verdict is Verdict.SKIPPED
    assert (fake.paces, report.cases[0].verdict) == (0, Verdict.NEW)


def test_no_repeat_of_a_failure(tmp_path: Path) -> None:
    suite = suite_of(tmp_path, "  - {name: one, data: graph.g2o, repeats: 5}\n")
    fake = FakeMachine({}, {"optimize": 5})
    ran(suite, fake)
    assert len(fake.lines) == 1


def test_every_verdict_has_a_gravity() -> None:
    assert set(GRAVITY) == set(Verdict)
    assert not any(v.fails for v in (Verdict.PASS, Verdict.INFO, Verdict.SKIPPED, Verdict.NEW, Verdict.IMPROVED))
    assert OPTIMIZED["time"]["total"] == sum(OPTIMIZED["time"].values()) - OPTIMIZED["time"]["total"]  # type: ignore[index,attr-defined]
