"""docs/regress.md has every key, figure and verdict; the examples for CI say what the command line takes."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

from slamcli.batch.metrics import METRICS
from slamcli.batch.regression import reading
from slamcli.batch.regression.result import Verdict
from slamcli.batch.regression.suite import Gauge
from slamcli.cli.main import build_group, main

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "regress.md").read_text(encoding="utf-8")
CI = ROOT / "docs" / "ci"


def rows() -> list[list[str]]:
    return [line.strip("| ").split(" | ") for line in PAGE.replace("\\|", "¦").splitlines() if line.startswith("|")]


def test_the_table_of_figures_is_that_of_the_code():
    found = {row[0].strip("`"): row[1:] for row in rows() if len(row) == 6 and row[0].startswith("`")}
    assert list(found) == list(METRICS)
    for name, metric in METRICS.items():
        numbers = [f"{metric.relative:g}", f"{metric.absolute:g}", "yes" if metric.gate else "no"]
        assert found[name] == [metric.meaning.replace("|", "¦"), metric.better, *numbers]


def test_every_key_and_verdict_is_explained():
    first = " ".join(row[0] for row in rows())
    for key in (*reading.CASE_KEYS, *reading.METRIC_KEYS, *Verdict):
        assert f"`{key}`" in first, key
    for key in (*reading.SUITE_KEYS, *reading.DEFAULT_KEYS, *reading.COMMANDS):
        assert f"`{key}`" in PAGE, key
    assert f"{{{reading.EXPECT_KEYS[0]}: 4}}" in PAGE
    assert set(Gauge(METRICS["chi2"], 1.0, 1.0, 1.0).limits) <= set(reading.METRIC_KEYS)


def test_every_json_key_is_explained(tmp_path, monkeypatch, capsys):
    shutil.copytree(ROOT / "datasets", tmp_path / "datasets")
    monkeypatch.chdir(tmp_path)
    Path("suite.yaml").write_text("cases: [{name: a, data: datasets/square_toro.graph, command: info}]\n")
    assert main(["regress", "suite.yaml", "--update-baseline", "--format", "json"]) == 0
    document = json.loads(capsys.readouterr().out)
    text = (ROOT / "docs" / "json.md").read_text(encoding="utf-8")
    section = text[text.index("## `regress`") : text.index("## `sweep`")]
    (case,) = document["cases"]
    keys = [
        *document,
        *case,
        *case["metrics"][0],
        *document["update"],
        *document["provenance"],
        *document["provenance"]["versions"],
        *document["suite"],
    ]
    for key in keys:
        assert f"`{key}`" in section or key in ("schema_version", "command", "version"), key


def lines_of(words):
    """All command lines of slamcli in a text of YAML."""
    return re.findall(r"(?m)^\s*(?:-\s+)?(?:run:\s+)?(slamcli regress [^#\n]+)", words)


@pytest.mark.parametrize("name", ["github-actions.yml", "gitlab-ci.yml"])
def test_workflows_are_yaml_and_their_commands_exist(name):
    text = (CI / name).read_text(encoding="utf-8")
    content = yaml.safe_load(text)
    assert "jobs" in content or "script" in content["slam"]
    command = build_group().get_command(None, "regress")  # type: ignore[arg-type]
    commands = lines_of(text)
    assert commands
    for line in commands:
        command.make_context("regress", line.split()[2:], help_option_names=["-h", "--help"])


@pytest.mark.skipif(shutil.which("make") is None, reason="needs make")
def test_the_makefile_works_when_it_is_included(tmp_path):
    (tmp_path / "Makefile").write_text(
        f"SLAMCLI := echo ran\nSLAMCLI_SUITE := s.yaml\ninclude {CI / 'slamcli.mk'}\nall: ; @echo mine\n"
    )

    def made(target):
        words = ["make", "-s", "-C", str(tmp_path), target, "ARGS=--only 'a*'"]
        done = subprocess.run(words, capture_output=True, text=True, check=True)
        return [line for line in done.stdout.splitlines() if line.startswith("ran")]

    assert made("slam-regress") == ["ran regress s.yaml --only a*"]
    assert made("slam-report") == ["ran regress s.yaml -o slam-report.html --only a*"]
    plain = subprocess.run(["make", "-s", "-C", str(tmp_path)], capture_output=True, text=True, check=True)
    assert "mine" in plain.stdout  # the first target of a Makefile stays the default
    assert made("slam-bless") == ["ran regress s.yaml --update-baseline --only a*"]
