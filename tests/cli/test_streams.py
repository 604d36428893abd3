"""What goes where: standard output, standard error, files; broken pipes, full disks and interruptions."""

from __future__ import annotations

import hashlib
import json
import re
import resource
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import LINE, LOOSE, environment, manhattan, start
from support import BUNDLED

import slamcli
from slamcli.cli.main import main
from slamcli.reporting import iterations

GRAPH = str(BUNDLED / "manhattan_small.g2o")
SEPARATED = re.compile(
    r"iteration= \d+\t chi2= \d+\.\d{6}\t time= [-+.0-9e]+\t cumTime= [-+.0-9e]+\t edges= 699"
    r"(\t schur= 0(\t lambda= \d+\.\d{6}\t levenbergIter= \d+)?"
    r"|\t Delta= [-+.0-9e]+\t step= (GN|Descent|Dogleg)\t tries= \d+)"
)


def test_output_on_standard_output_is_the_graph_alone(
    capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path
) -> None:
    assert main(["optimize", GRAPH, "-o", str(tmp_path / "file.g2o")]) == 0
    capfdbinary.readouterr()
    assert main(["optimize", GRAPH, "-o", "-", "-v"]) == 0
    out, err = capfdbinary.readouterr()
    assert out == (tmp_path / "file.g2o").read_bytes()
    assert b"converged" in err and b"iteration" in err


def test_written_graph_has_the_reported_chi2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every digit is written: read again, the graph is the optimum."""
    target = str(tmp_path / "out.g2o")
    assert main(["optimize", GRAPH, "-o", target, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert slamcli.read(target).chi2() == pytest.approx(document["final_chi2"], rel=1e-12)
    assert document["input"]["sha256"] == hashlib.sha256(Path(GRAPH).read_bytes()).hexdigest()


@pytest.mark.parametrize("method", ["gn", "lm", "dogleg"])
def test_lines_of_g2o(method: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["optimize", GRAPH, "--g2o-log", "-q", "--method", method, "--init", "file"]) == 0
    out, err = capsys.readouterr()
    lines = err.splitlines()
    assert out == "" and len(lines) >= 3
    assert all(SEPARATED.fullmatch(line) for line in lines)
    assert [int(line.split()[1]) for line in lines] == list(range(len(lines)))
    times = [[float(text) for text in re.findall(r"ime= (\S+)", line)] for line in lines]
    assert times[-1][1] == pytest.approx(sum(time for time, _ in times), rel=1e-4)


def test_trace_is_json_lines(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "trace.jsonl"
    assert main(["optimize", GRAPH, "--trace", str(target), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    first, *records, last = [json.loads(line) for line in target.read_text().splitlines()]
    tried, records = records[:2], records[2:]
    assert [(event["event"], event["name"]) for event in tried] == [("tried", "file"), ("tried", "chordal")]
    assert first["event"] == "start" and first["chi2"] == document["initial_chi2"]
    assert [{k: v for k, v in record.items() if k != "event"} for record in records] == document["trace"]
    assert last["event"] == "end" and last["final_chi2"] == document["final_chi2"]


def test_no_iterations_where_nobody_watches(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["optimize", GRAPH]) == 0
    assert capsys.readouterr().err == ""


def test_a_failure_leaves_the_old_output(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, target = tmp_path / "in.g2o", tmp_path / "out.g2o"
    source.write_text(LOOSE)
    target.write_text("what was there before")
    assert main(["optimize", str(source), "-o", str(target)]) == 5
    assert target.read_text() == "what was there before"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in.g2o", "out.g2o"]
    assert "nothing is written" in capsys.readouterr().err


def test_the_input_may_be_the_output(tmp_path: Path) -> None:
    path = tmp_path / "graph.g2o"
    path.write_text(LINE)
    assert main(["optimize", str(path), "-o", str(path), "-q"]) == 0
    assert slamcli.read(str(path)).chi2() == pytest.approx(0.16 / 3.0)
    assert [entry.name for entry in tmp_path.iterdir()] == ["graph.g2o"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no full device")
@pytest.mark.parametrize(
    "words",
    [
        ["optimize", GRAPH, "-o", "/dev/full"],
        ["optimize", GRAPH, "--trace", "/dev/full"],
        ["convert", GRAPH, "/dev/full"],
    ],
)
def test_full_device(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words) == 3
    assert "error: /dev/full: cannot be written: No space left on device" in capsys.readouterr().err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no full device")
@pytest.mark.parametrize("words", [["optimize", GRAPH, "-o", "-"], ["info", GRAPH], ["--help"], ["info", "--help"]])
def test_standard_output_on_a_full_device(words: list[str]) -> None:
    with open("/dev/full", "wb") as full, start(*words, stdout=full) as process:
        err = process.communicate(timeout=60)[1].decode()
    assert process.returncode == 3
    assert "standard output" in err and "No space left" in err
    assert "Traceback" not in err and "Exception ignored" not in err


def test_a_disk_that_fills_up_leaves_the_old_file(tmp_path: Path) -> None:
    """A limit on the size of files stands for the disk: the temporary file breaks off in the middle."""
    target = tmp_path / "out.g2o"
    target.write_text("what was there before")

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))

    with start("convert", GRAPH, str(target), preexec_fn=limit) as process:
        err = process.communicate(timeout=60)[1].decode()
    assert process.returncode == 3
    assert "cannot be written" in err and "Traceback" not in err
    assert target.read_text() == "what was there before"
    assert [entry.name for entry in tmp_path.iterdir()] == ["out.g2o"]


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("words", [["optimize", "{big}", "-o", "-", "-q"], ["convert", "{big}", "-"]])
def test_broken_pipe(words: list[str], unbuffered: str, tmp_path: Path) -> None:
    """As in ``slamcli ... | head``: more than a pipe holds, and nobody to read it.

    Without a buffer Python's writes may be partial, and a pipe that breaks then shows at the next one only.
    """
    big = str(manhattan(tmp_path / "big.g2o", 2500))
    env = environment(PYTHONUNBUFFERED=unbuffered)
    with start(*(word.replace("{big}", big) for word in words), env=env) as process:
        assert process.stdout is not None and process.stderr is not None
        assert process.stdout.readline().startswith(b"VERTEX_SE2 0 ")
        process.stdout.close()
        err = process.stderr.read().decode()
        assert process.wait(timeout=60) == 141
    assert err == ""


@pytest.mark.parametrize("words", [["--help"], ["--version"], ["info", GRAPH], ["optimize", "--help"]])
def test_pipe_that_is_closed_from_the_start(words: list[str]) -> None:
    with start(*words) as process:
        assert process.stdout is not None and process.stderr is not None
        process.stdout.close()
        err = process.stderr.read().decode()
        assert process.wait(timeout=60) == 141
    assert err == ""


def test_interruption_of_a_process(tmp_path: Path) -> None:
    """After the first iteration line a Ctrl-C: the iteration is finished, the result is written."""
    source, target = manhattan(tmp_path / "big.g2o", 6000), tmp_path / "out.g2o"
    words = [
        "optimize",
        str(source),
        "-o",
        str(target),
        "-v",
        "--json",
        "--method",
        "lm",
        "--tolerance",
        "0",
        "--init",
        "file",
    ]
    with start(*words, "--max-iterations", "100000") as process:
        assert process.stdout is not None and process.stderr is not None
        lines = [process.stderr.readline() for _ in range(4)]  # the start's name, the titles, the start, an iteration
        assert lines[3].split()[0] == b"1"
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=120)
    assert process.returncode == 130
    assert b"interrupted" in err and b"Traceback" not in err
    document = json.loads(out)
    assert (document["status"], document["exit_code"]) == ("interrupted", 130)
    assert document["final_chi2"] < document["initial_chi2"]
    assert slamcli.read(str(target)).chi2() == pytest.approx(document["final_chi2"], rel=1e-9)


@pytest.mark.parametrize(("signals", "written"), [(1, True), (2, False)])
def test_second_interruption_stops_at_once(
    signals: int, written: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The signals come during the first iteration."""
    printed = iterations.line

    def line(chi2: float, record: iterations.IterationRecord | None) -> str:
        if record is not None and record.iteration == 1:
            for _ in range(signals):
                signal.raise_signal(signal.SIGINT)
        return printed(chi2, record)

    before = signal.getsignal(signal.SIGINT)
    monkeypatch.setattr(iterations, "line", line)
    target = tmp_path / "out.g2o"
    assert main(["optimize", GRAPH, "-v", "-o", str(target)]) == 130
    assert target.exists() == written
    assert "interrupted" in capsys.readouterr().err
    assert signal.getsignal(signal.SIGINT) is before


def test_interruption_while_reading(tmp_path: Path) -> None:
    """Nothing to write yet: no traceback, exit code 130."""
    with start("info", "-") as process:
        assert process.stdin is not None
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(timeout=1.5)
        process.send_signal(signal.SIGINT)
        err = process.communicate(timeout=60)[1].decode()
    assert process.returncode == 130
    assert "interrupted" in err and "Traceback" not in err


@pytest.mark.parametrize(("variables", "coloured"), [({}, True), ({"NO_COLOR": "1"}, False), ({"TERM": "dumb"}, False)])
def test_colour_on_a_terminal(variables: dict[str, str], coloured: bool) -> None:
    import os
    import pty

    master, terminal = pty.openpty()
    words = [sys.executable, "-m", "slamcli", "optimize", GRAPH]
    env = environment(**{"TERM": "xterm", **variables})
    with subprocess.Popen(words, env=env, stdout=terminal, stderr=terminal) as process:
        os.close(terminal)
        found = b""
        while True:
            try:
                part = os.read(master, 65536)
            except OSError:  # how Linux says that the other end is closed
                break
            if not part:
                break
            found += part
    os.close(master)
    assert process.returncode == 0
    assert (b"\x1b[32mconverged" in found) == coloured
    assert b"gradient" in found  # on a terminal the iterations are shown


def test_too_little_memory_is_said_without_a_traceback(monkeypatch, capsys):
    def hungry(*_args, **_more):
        raise MemoryError

    monkeypatch.setattr("slamcli.simulation.simulate.simulate", hungry)
    assert main(["simulate", "square"]) == 5
    assert capsys.readouterr().err.startswith("error: out of memory\n")


def test_output_that_the_encoding_lacks_is_utf8(tmp_path):
    """As on Windows, where a pipe has one of the old code pages."""
    target = tmp_path / "grün.g2o"
    with start("optimize", str(GRAPH), "-o", str(target), env=environment(PYTHONIOENCODING="ascii")) as process:
        out, err = process.communicate()
    assert process.returncode == 0
    assert b"Traceback" not in err
    assert "grün.g2o" in out.decode("utf-8")
