"""Suite files: what they give, and that nothing in them is passed over."""

from __future__ import annotations

from pathlib import Path

import pytest
from regression_suites import suite_of

from slamcli.batch.metrics import METRICS
from slamcli.batch.regression import baseline as baselines
from slamcli.batch.regression.inputs import prepare
from slamcli.batch.regression.reading import read
from slamcli.errors import UsageError

SUITES = Path(__file__).parents[2] / "configs" / "suites"


def test_defaults_and_overrides(tmp_path: Path) -> None:
    (tmp_path / "graph.g2o").write_text("x")
    path = tmp_path / "s.yaml"
    path.write_text(
        "defaults:\n"
        "  time_limit: 9\n"
        "  repeats: 2\n"
        "  options: {method: lm, tolerance: 1e-6}\n"
        "  metrics: {chi2: {relative: 0.5}, iterations: }\n"
        "cases:\n"
        "  - name: a\n"
        "    data: graph.g2o\n"
        "    options: {method: gn}\n"
        "    metrics: {chi2: {at_most: 3, gate: false}}\n"
        "  - {name: b, data: graph.g2o, command: info, repeats: 1, time_limit: 1, expect: {exit_code: 3}}\n"
    )
    a, b = read(path).cases
    assert a.case.options == {"method": "gn", "tolerance": "1e-6"}
    assert (a.repeats, a.case.time_limit, a.line) == (2, 9.0, 7)
    code, chi2, iterations = a.gauges
    assert (code.metric.name, code.equals) == ("exit_code", 0.0)
    assert (chi2.metric.relative, chi2.at_most, chi2.metric.gate) == (0.5, 3.0, False)
    assert (chi2.metric.absolute, chi2.metric.better) == (METRICS["chi2"].absolute, "lower")
    assert iterations.metric == METRICS["iterations"]
    # options of another command are none of info's
    assert (b.case.options, b.repeats, b.case.time_limit, b.expected) == ({}, 1, 1.0, 3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("cases: [{name: a, data: graph.g2o, optons: {}}]", "unknown key 'optons' of a case\n  did you mean options?"),
        ("cases: [{name: a, data: graph.g2o, metrics: [chi]}]", "unknown metric 'chi'\n  did you mean chi2?"),
        ("cases: [{name: a, data: graph.g2o, metrics: {chi2: {beter: lower}}}]", "unknown key 'beter'"),
        (
            "cases: [{name: a, data: graph.g2o, metrics: {chi2: {better: less}}}]",
            "unknown word 'less'\n  known: lower, higher, equal",
        ),
        ("cases: [{name: a, data: graph.g2o, metrics: {chi2: {relative: -1}}}]", "a number from 0 on, found -1"),
        ("cases: [{name: a, data: graph.g2o, metrics: {chi2: {at_most: .nan}}}]", "expected a number, found .nan"),
        ("cases: [{name: a, data: graph.g2o, metrics: {exit_code: {equals: 1}}}]", "expect: {exit_code: N}"),
        ("cases: [{name: a, data: graph.g2o, metrics: {exit_code: {gate: false}}}]", "expect: {exit_code: N}"),
        (
            "defaults: {metrics: {exit_code: {equals: 1}}}\ncases: [{name: a, data: graph.g2o}]",
            ":1: say what the exit code should be",
        ),
        ("cases: [{name: a, data: graph.g2o, expect: {code: 1}}]", "unknown key 'code' of expect"),
        ("cases: [{name: a, data: graph.g2o, command: optimise}]", "unknown word 'optimise'\n  did you mean optimize?"),
        ("cases: [{name: a, data: graph.g2o, simulate: square}]", "needs data or simulate, one of them"),
        ("cases: [{name: a, data: graph.g2o, metrics: {chi2: lower}}]", "expected keys with values, found 'lower'"),
        ("cases: [{name: a, data: graph.g2o, metrics: [chi2, chi2]}]", "the metric chi2 stands twice"),
        ("cases: [{name: a, data: graph.g2o, options: {certify: }}]", "certify has no value"),
        ("cases: [{name: a, data: graph.g2o, time_limit: 0}]", "a positive number of seconds"),
        ("cases: [{name: a, data: graph.g2o, expect: {exit_code: 256}}]", "no process ends with 256"),
        ("cases: [{name: a, data: graph.g2o, command: info, truth: t.g2o}]", "truth goes with optimize and ekf"),
        ("cases: [{name: a, data: e.g2o, command: evaluate, truth: t.g2o}]", "options: {truth: 'file:...'}"),
        ("cases: [{name: a, data: graph.g2o, evaluate: {align: none}}]", "there is nothing to compare with"),
        ('cases: [{name: a, data: "a\\0b"}]', "can be in no name, option or path"),
        ('{name: "\\ud800", cases: []}', "is not valid YAML"),
        ("cases: [{name: a}]", "needs data or simulate, one of them"),
        ("cases: [{data: graph.g2o}]", "a case needs a name"),
        ("cases: [{name: a, data: graph.g2o}, {name: a, data: graph.g2o}]", "the name 'a' stands twice"),
        ("cases: [{name: a, data: graph.g2o, simulation: {seed: 1}}]", "simulation goes with simulate"),
        ("cases: [{name: a, simulate: square, truth: graph.g2o}]", "a simulation has its own truth"),
        ("cases: [{name: a, data: graph.g2o, labels: graph.g2o, inject: {false_closures: 1}}]", "inject says itself"),
        ("cases: [{name: a, simulate: square, optimum: true}]", "optimum of data sets only"),
        ("cases: [{name: a, data: graph.g2o, options: {output: x}}]", "'output' is set by regress itself"),
        ("cases: [{name: a, data: graph.g2o, options: {set: {a: 1}}}]", "expected a value or a list"),
        ("cases: [{name: a, data: graph.g2o, repeats: 0}]", "an integer from 1 on, found 0"),
        ("cases: [{name: a, data: graph.g2o, optional: maybe}]", "expected true or false, found 'maybe'"),
        ("cases: []", "at least one case"),
        ("cases: {}", "expected a list, found keys with values"),
        ("name: x", "a suite needs cases"),
        ("case: []", "unknown key 'case' of a suite\n  did you mean cases?"),
        ("[1]", "expected keys with values, found a list"),
        ("", "is empty"),
        ("cases: [", "is not valid YAML"),
        ("cases: []\ncases: []", ":2: the key 'cases' stands twice"),
    ],
)
def test_what_a_suite_may_not_say(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "graph.g2o").write_text("x")
    path = tmp_path / "s.yaml"
    path.write_text(text)
    with pytest.raises(UsageError) as caught:
        read(path)
    said = "\n".join([caught.value.message, *caught.value.details])
    assert message in said
    assert said.startswith(str(path))


def test_messages_name_the_line(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"suite\.yaml:5: unknown metric 'chi'"):
        suite_of(tmp_path, "  - name: a\n    data: graph.g2o\n    metrics: {chi: }\n")


def test_inputs_are_relative_to_the_suite_and_hashed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "below"
    folder.mkdir()
    (folder / "options.yaml").write_text("method: lm\n")
    suite = suite_of(folder, "  - {name: a, data: graph.g2o, options: {config: 'file:options.yaml'}}\n")
    monkeypatch.chdir(tmp_path)
    (prepared,) = prepare(suite, suite.cases)
    assert prepared.case.data == str((folder / "graph.g2o").resolve())
    assert prepared.case.options == {"config": str((folder / "options.yaml").resolve())}
    assert sorted(prepared.inputs) == ["graph.g2o", "options.yaml"]
    (folder / "options.yaml").write_text("method: gn\n")
    (again,) = prepare(suite, suite.cases)
    assert again.inputs["graph.g2o"] == prepared.inputs["graph.g2o"]
    assert again.inputs["options.yaml"] != prepared.inputs["options.yaml"]


def test_data_that_are_not_there_and_names_that_mean_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SLAMCLI_DATASETS", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    cases = "  - {name: a, data: nowhere.g2o}\n  - {name: b, data: sphere2500}\n  - {name: c, data: nowhere.bal}\n"
    suite = suite_of(tmp_path, cases)
    first, second, third = prepare(suite, suite.cases)
    assert "nowhere.g2o: no such file" in first.missing
    assert "nowhere.bal: no such file" in third.missing
    assert "sphere2500 is not here" in second.missing
    suite = suite_of(tmp_path, "  - {name: a, data: sphere25}\n")
    with pytest.raises(UsageError, match=r"suite\.yaml:3: case a: there is no data set 'sphere25'"):
        prepare(suite, suite.cases)
    suite = suite_of(tmp_path, "  - {name: a, data: manhattan_small_truth, optimum: true}\n")
    with pytest.raises(UsageError, match="states no optimum"):
        prepare(suite, suite.cases)


def test_the_definition_of_a_case_is_what_it_runs(tmp_path: Path) -> None:
    def definition(text: str) -> str:
        return suite_of(tmp_path, f"  - {{name: a, data: graph.g2o, {text}}}\n").cases[0].definition

    base = definition("options: {method: lm}")
    assert definition("options: {method: lm}, repeats: 3, metrics: [chi2], time_limit: 4") == base
    assert definition("options: {method: gn}") != base
    assert definition("options: {method: lm}, truth: graph.g2o") != base


@pytest.mark.parametrize("path", sorted(SUITES.glob("*.yaml")), ids=lambda path: path.stem)
def test_our_suites_have_baselines_of_the_same_cases(path: Path) -> None:
    """Whoever changes a suite blesses it."""
    suite, baseline = read(path), baselines.read(baselines.default_path(path))
    assert baseline is not None and len(suite.cases) >= 20
    assert list(baseline.cases) == [case.name for case in suite.cases]
    for case in suite.cases:
        blessed = baseline.cases[case.name]
        assert blessed.definition == case.definition, case.name
        assert set(blessed.figures) == {gauge.metric.name for gauge in case.gauges}, case.name
