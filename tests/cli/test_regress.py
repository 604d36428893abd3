"""What the table of command lines cannot say about ``slamcli regress``: files, signals, full disks."""

from __future__ import annotations

import gzip
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from command_line import LINE

from slamcli.cli.main import main

SUITE = "name: s\ncases:\n" + "".join(
    f"  - {{name: c{k}, data: graph.g2o, command: info, metrics: [edges]}}\n" for k in range(3)
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "graph.g2o").write_text(LINE)
    (tmp_path / "suite.yaml").write_text(SUITE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("GITHUB_STEP_SUMMARY", raising=False)
    return tmp_path


def test_blessed_then_green_then_red(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["regress", "suite.yaml", "--update-baseline", "--jobs", "2"]) == 0
    assert main(["regress", "suite.yaml", "--jobs", "2"]) == 0
    assert "3 pass" in capsys.readouterr().out
    # the same edge once more: the input is another one, and that is what is said
    with open("graph.g2o", "a") as stream:
        stream.write(LINE.splitlines()[-1] + "\n")
    assert main(["regress", "suite.yaml", "--only", "c1", "-o", "r.json"]) == 1
    out = capsys.readouterr().out
    assert "c1  input changed" in out and "graph.g2o has another sha256" in out
    assert json.loads(Path("r.json").read_text())["left_out"] == 2
    assert sorted(path.name for path in folder.iterdir()) == [
        "graph.g2o",
        "r.json",
        "suite.baseline.json",
        "suite.yaml",
    ]


def test_missing_data(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("suite.yaml").write_text(SUITE.replace("graph.g2o", "nowhere.g2o", 1))
    assert main(["regress", "suite.yaml", "--jobs", "2"]) == 3
    out = capsys.readouterr().out
    assert "c0  missing data" in out and "nowhere.g2o: no such file" in out


def test_a_report_that_cannot_be_written_goes_to_standard_output(
    folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    assert main(["regress", "suite.yaml", "--only", "c0", "-o", "/dev/full", "--format", "junit", "--state", "s"]) == 3
    out, err = capfd.readouterr()
    assert "<testsuites" in out
    assert "/dev/full: cannot be written" in err


def test_the_summary_of_a_job(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(folder / "summary.md"))
    Path("summary.md").write_text("before\n")
    assert main(["regress", "suite.yaml", "--only", "c0", "--format", "github"]) == 0
    text = Path("summary.md").read_text()
    assert text.startswith("before\n") and "| c0 |" in text


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["-o", "suite.baseline.json"], "is an input and would be overwritten"),
        (["--state", "suite.baseline.json"], "is an input and would be overwritten"),
        (["-o", "."], "is a folder"),
        (["--baseline", "-"], "--baseline needs a file"),
    ],
)
def test_what_no_report_may_overwrite(
    folder: Path, words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["regress", "suite.yaml", "--only", "c0", "--update-baseline"]) == 0
    before = Path("suite.baseline.json").read_bytes()
    assert main(["regress", "suite.yaml", *words]) in (2, 3)
    assert message in capsys.readouterr().err
    assert Path("suite.baseline.json").read_bytes() == before


def test_a_compressed_report_has_the_format_of_its_name(folder: Path) -> None:
    assert main(["regress", "suite.yaml", "--only", "c0", "-o", "r.json.gz"]) == 0
    with gzip.open("r.json.gz") as stream:
        assert json.load(stream)["command"] == "regress"


def test_files_of_the_working_directory_are_no_part_of_slamcli(folder: Path) -> None:
    """Nor of Python: a file random.py there would be imported in place of the library."""
    for name in ("random.py", "slamcli.py", "tempfile.py"):
        Path(name).write_text("raise SystemExit(77)\n")
    Path("suite.yaml").write_text("cases: [{name: a, data: graph.g2o, metrics: [time_ratio]}]\n")
    assert main(["regress", "suite.yaml"]) == 0


@pytest.mark.skipif(os.name == "nt", reason="signals")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_keeps_what_is_finished(folder: Path, number: signal.Signals) -> None:
    """The first case ends, the second one would take for ever; the next run takes the first from the state."""
    Path("suite.yaml").write_text(
        "cases:\n  - {name: quick, data: graph.g2o, command: info}\n"
        "  - {name: slow, simulate: manhattan, simulation: {poses: 60000}, command: optimize}\n"
    )
    words = [sys.executable, "-m", "slamcli", "regress", "suite.yaml", "-o", "r.json"]

    def start(*more: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [*words, *more],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            # whoever runs the tests may ignore Ctrl-C
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        )

    process = start()
    state = Path("r.json.state")
    for _ in range(600):
        if state.exists() and state.read_text():
            break
        time.sleep(0.05)
    process.send_signal(number)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "interrupted: 1 of 2 cases" in out and "--resume" in err and "Traceback" not in err
    assert [case["name"] for case in json.loads(Path("r.json").read_text())["cases"]] == ["quick"]
    assert main(["regress", "suite.yaml", "-o", "r.json", "--resume", "--only", "quick"]) == 0
    (case,) = json.loads(Path("r.json").read_text())["cases"]
    assert case["resumed"] is True
