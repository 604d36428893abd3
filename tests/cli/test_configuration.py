"""Where the value of an option comes from: flags beat the environment beats the file beats the defaults."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from support import BUNDLED

from slamcli.cli.main import main
from slamcli.solver.options import OptimizeOptions

GRAPH = str(BUNDLED / "square_toro.graph")
FILE = """\
method: dogleg
init: odometry
max-iterations: 7
tolerance: 1.0e-3
time_limit: 60
fix: [3, 4]
ordering: natural
linear_solver: superlu
scaling: marquardt
elimination: none
kernel: cauchy
kernel-width: 250
kernel-on: all
"""


@pytest.fixture(autouse=True)
def clean(monkeypatch: pytest.MonkeyPatch) -> None:
    import os

    for name in list(os.environ):
        if name.startswith("SLAMCLI_"):
            monkeypatch.delenv(name)


def options(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, Any]:
    """The options that were in effect, as the document tells them."""
    assert main(["optimize", GRAPH, "--json", *words]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)["options"]
    return found


@pytest.fixture
def file(tmp_path: Path) -> str:
    path = tmp_path / "options.yaml"
    path.write_text(FILE)
    return str(path)


def test_defaults(capsys: pytest.CaptureFixture[str]) -> None:
    """The defaults of the command line are those of the library."""
    found = options(capsys)
    assert {**found, "fix": tuple(found["fix"])} == {
        name: getattr(OptimizeOptions(), name) for name in OptimizeOptions.names()
    }


def test_file_beats_defaults(capsys: pytest.CaptureFixture[str], file: str) -> None:
    found = options(capsys, "--config", file)
    assert set(found) == set(OptimizeOptions.names())
    wanted = {
        "method": "dogleg",
        "init": "odometry",
        "max_iterations": 7,
        "tolerance": 1e-3,
        "time_limit": 60,
        "fix": [3, 4],
        "ordering": "natural",
        "linear_solver": "superlu",
        "scaling": "marquardt",
        "elimination": "none",
        "reduced_solver": "auto",
        "gauge": "auto",
        "intrinsics": "auto",
        "kernel": "cauchy",
        "kernel_width": 250,
        "kernel_on": "all",
        "robust": "none",
        "robust_probability": 0.9999,
        "noise_scale": None,
    }
    assert found == wanted


@pytest.mark.parametrize(
    ("name", "variable", "value", "wanted"),
    [
        ("method", "METHOD", "lm", "lm"),
        ("init", "INIT", "spanning-tree", "spanning-tree"),
        ("max_iterations", "MAX_ITERATIONS", "50", 50),
        ("tolerance", "TOLERANCE", "1e-7", 1e-7),
        ("time_limit", "TIME_LIMIT", "30", 30.0),
        ("fix", "FIX", "1 2", [1, 2]),
        ("ordering", "ORDERING", "amd", "amd"),
        ("linear_solver", "LINEAR_SOLVER", "cholmod", "cholmod"),
        ("scaling", "SCALING", "none", "none"),
    ],
)
def test_environment_beats_file(
    name: str,
    variable: str,
    value: str,
    wanted: object,
    file: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Also where the environment asks for what is the default."""
    before = options(capsys, "--config", file)
    monkeypatch.setenv(f"SLAMCLI_OPTIMIZE_{variable}", value)
    found = options(capsys, "--config", file)
    assert found == {**before, name: wanted} != before


@pytest.mark.parametrize(
    ("words", "name", "wanted"),
    [
        (["--method", "gn"], "method", "gn"),
        (["--init", "file"], "init", "file"),
        (["--max-iterations", "100"], "max_iterations", 100),
        (["--tolerance", "1e-9"], "tolerance", 1e-9),
        (["--time-limit", "9"], "time_limit", 9.0),
        (["--fix", "5"], "fix", [5]),
        (["--ordering", "amd"], "ordering", "amd"),
        (["--linear-solver", "cholmod"], "linear_solver", "cholmod"),
        (["--scaling", "none"], "scaling", "none"),
    ],
)
def test_flags_beat_everything(
    words: list[str],
    name: str,
    wanted: object,
    file: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("SLAMCLI_OPTIMIZE_METHOD", "lm")
    monkeypatch.setenv("SLAMCLI_OPTIMIZE_TOLERANCE", "1e-5")
    before = options(capsys, "--config", file)
    assert (before["method"], before["tolerance"]) == ("lm", 1e-5)
    assert options(capsys, "--config", file, *words) == {**before, name: wanted} != before


def test_flags_of_the_output_have_variables_too(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SLAMCLI_OPTIMIZE_JSON", "1")
    assert main(["optimize", GRAPH]) == 0
    assert json.loads(capsys.readouterr().out)["command"] == "optimize"


def test_wrong_values_in_the_environment_are_usage_errors(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SLAMCLI_OPTIMIZE_METHOD", "newton")
    assert main(["optimize", GRAPH]) == 2
    assert "newton" in capsys.readouterr().err


def test_the_example_file_is_valid(capsys: pytest.CaptureFixture[str]) -> None:
    example = Path(__file__).parents[2] / "configs" / "optimize.yaml"
    assert options(capsys, "--config", str(example))["method"] == "lm"


def test_other_commands_do_not_see_the_variables_of_optimize(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SLAMCLI_OPTIMIZE_JSON", "1")
    assert main(["info", GRAPH]) == 0
    assert capsys.readouterr().out.startswith("graph")
