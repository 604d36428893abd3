"""Running sweeps: the same numbers however they are run, interruption and resumption, crashes, time limits."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from sweeps import SMALL, tasks_in

from slamcli.batch.execution import TIMED_OUT, execute
from slamcli.batch.interpreter import Closed, Interpreter
from slamcli.batch.sweep import perform as performing
from slamcli.batch.sweep.local import local
from slamcli.batch.sweep.perform import Performer
from slamcli.batch.sweep.run import opened, pending, run, state_of
from slamcli.batch.sweep.table import columns, csv_bytes
from slamcli.cli.main import main
from slamcli.errors import InputError

#: Twenty tasks of some 40 ms.
MANY = SMALL.replace("seeds: 2", "seeds: 10").replace("poses: 30", "poses: 200")


@pytest.fixture(scope="module")
def interpreter():
    found = Interpreter()
    yield found
    found.close()


def table(tasks, folder, *, jobs=1, isolate=False):
    with opened(folder) as journal:
        run(pending(tasks, journal), journal, lambda given: local(given, Performer(isolate), jobs))
        return csv_bytes(columns(state_of(tasks, journal)))


def test_interpreter_gives_what_a_process_gives(interpreter, tmp_path):
    """Documents, exit codes and messages, one command after another."""
    lines = [
        ["simulate", "square", "--poses", "20", "-o", "graph.g2o", "--truth", "truth.g2o", "--json"],
        ["optimize", "graph.g2o", "--max-iterations", "1", "--tolerance", "0", "--json"],
        ["optimize", "nowhere.g2o", "--json"],
        ["optimize", "graph.g2o", "--methd", "gn"],
        ["info", "graph.g2o"],
        ["info", "-"],
        ["info", "graph.g2o", "--json"],
    ]
    folders = [tmp_path / "a", tmp_path / "b"]
    for folder in folders:
        folder.mkdir()
    for words in lines:
        kept, own = interpreter(words, folders[0]), execute(words, folders[1])
        assert kept.exit_code == own.exit_code
        assert _steady(kept.document) == _steady(own.document)
        assert kept.messages.splitlines()[-1:] == own.messages.splitlines()[-1:] or "time" in kept.messages
    assert (folders[0] / "graph.g2o").read_bytes() == (folders[1] / "graph.g2o").read_bytes()


def _steady(document):
    """A document without times and memory."""
    if isinstance(document, dict):
        return {
            k: _steady(v) for k, v in document.items() if not any(word in k for word in ("time", "memory", "phases"))
        }
    return [_steady(item) for item in document] if isinstance(document, list) else document


def test_interpreter_survives_its_end(interpreter, tmp_path):
    assert interpreter(["--version"], tmp_path).exit_code == 0
    os.kill(interpreter._process.pid, signal.SIGKILL)
    assert interpreter(["--version"], tmp_path).exit_code == 128 + signal.SIGKILL
    assert interpreter(["--version"], tmp_path).exit_code == 0


def test_interpreter_has_a_time_limit(interpreter, tmp_path):
    began = time.monotonic()
    words = ["simulate", "manhattan", "--poses", "2000000", "-o", "graph.g2o"]
    assert interpreter(words, tmp_path, 0.2).exit_code == TIMED_OUT
    assert time.monotonic() - began < 30
    assert interpreter(["--version"], tmp_path, 60.0).exit_code == 0


def test_interpreter_reads_no_settings_of_the_user(tmp_path, monkeypatch):
    monkeypatch.setenv("SLAMCLI_OPTIMIZE_MAX_ITERATIONS", "0")
    found = Interpreter()
    try:
        found(["simulate", "square", "--poses", "20", "-o", "graph.g2o"], tmp_path)
        assert found(["optimize", "graph.g2o"], tmp_path).exit_code == 0
    finally:
        found.close()


def test_closing_ends_what_runs(tmp_path):
    found = Interpreter()
    threading.Timer(0.3, found.close).start()
    with pytest.raises(Closed):
        found(["simulate", "manhattan", "--poses", "2000000", "-o", "graph.g2o"], tmp_path)
    with pytest.raises(Closed):
        found(["--version"], tmp_path)


def test_tables_do_not_depend_on_how_tasks_are_run(tmp_path):
    content = SMALL.replace("axes:", "  inject: {false-closures: 2}\naxes:").replace(
        "chi2]", "chi2, precision, recall]"
    )
    content = content.replace("options.method: [gn, lm]", "options.robust: [none, auto]").replace(
        "seeds: 2", "seeds: 1"
    )
    tasks = tasks_in(tmp_path, content)
    one = table(tasks, tmp_path / "one")
    assert one.count(b"\n") == 1 + len(tasks)
    assert b",0,,0." in one
    assert table(tasks, tmp_path / "two", jobs=3) == one
    assert table(tasks, tmp_path / "three", jobs=2, isolate=True) == one
    # in pieces, from the end
    for task in reversed(tasks):
        table([task], tmp_path / "four")
    assert table(tasks, tmp_path / "four") == one


def test_a_result_does_not_depend_on_the_tasks_before_it(tmp_path):
    """No cache of one task is seen by the next."""
    tasks = tasks_in(tmp_path, SMALL.replace("[gn, lm]", "[gn, lm, dogleg]"))
    performer = Performer()
    try:
        forward = [performer(task) for task in tasks]
        backward = [performer(task) for task in reversed(tasks)]
        assert forward == backward[::-1]
    finally:
        performing.close()


def test_failures_are_results(tmp_path):
    content = SMALL.replace("options.method: [gn, lm]", "options.fix: [0, 999]")
    tasks = tasks_in(tmp_path, content)
    with opened(tmp_path / "out") as journal:
        run(tasks, journal, lambda given: local(given, Performer(), 2))
        state = state_of(tasks, journal)
    assert state.codes == {0: 2, 2: 2} and not state.complete
    _, _, failed, _ = [record for _, record in state.ended]
    assert (failed.failed, failed.figures) == ("optimize", {"ate": None, "chi2": None})
    assert "999" in failed.message


def test_a_task_that_takes_too_long_is_a_result(tmp_path):
    content = SMALL.replace("poses: 30", "poses: 100000").replace("seeds: 2", "seeds: 1")
    tasks = tasks_in(tmp_path, content.replace("case:", "case:\n  time_limit: 0.05"))
    with opened(tmp_path / "out") as journal:
        run(tasks, journal, lambda given: local(given, Performer(), 2))
        assert state_of(tasks, journal).codes == {TIMED_OUT: 2}


def test_a_process_that_is_killed_from_outside_gets_a_second_chance(tmp_path, monkeypatch):
    (task, *_) = tasks_in(tmp_path)
    expected = Performer()(task)
    calls = []
    call = Interpreter.__call__

    def killed(self, words, folder, limit=None):
        calls.append(words[0])
        if calls == ["simulate", "optimize"]:
            os.kill(self._process.pid, signal.SIGKILL)
        return call(self, words, folder, limit)

    monkeypatch.setattr(Interpreter, "__call__", killed)
    try:
        assert Performer()(task) == expected
    finally:
        performing.close()
    assert calls == ["simulate", "optimize", "simulate", "optimize", "evaluate"]


def test_a_full_disk_under_the_tasks_is_no_result(tmp_path, monkeypatch):
    tasks = tasks_in(tmp_path)
    found = execute(["info", "nowhere.g2o"], tmp_path)

    def full(self, words, folder, limit=None):
        messages = "error: graph.g2o: cannot be written: No space left on device\n"
        return type(found)(tuple(words), 3, None, messages, 0.1)

    monkeypatch.setattr(Interpreter, "__call__", full)
    with opened(tmp_path / "out") as journal:
        with pytest.raises(InputError, match="the disk is full where tasks have their files"):
            run(tasks, journal, lambda given: local(given, Performer(), 2))
        assert journal.records == {}


def test_another_version_is_refused(tmp_path):
    (task, *_) = tasks_in(tmp_path)
    with pytest.raises(InputError, match=r"a worker has slamcli .*, this is slamcli 0\.0"):
        Performer(version="0.0")(task)


def sweep(folder: Path, *words: str) -> subprocess.Popen[str]:
    """``slamcli sweep`` in a process of its own, to be interrupted."""
    kept = {name: text for name, text in os.environ.items() if not name.startswith("SLAMCLI_")}
    line = [sys.executable, "-m", "slamcli", "sweep", "study.yaml", "-o", "out", *words]
    return subprocess.Popen(
        line, cwd=folder, env=kept, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )


def wait_for(folder: Path, results: int, process: subprocess.Popen[str]) -> None:
    """Until so many results are in the journal."""
    path = folder / "out" / "journal.jsonl"
    while not path.exists() or path.read_bytes().count(b"\n") <= results:
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    """The table of ``MANY``, made without an interruption."""
    folder = tmp_path_factory.mktemp("expected")
    return table(tasks_in(folder, MANY), folder / "out", jobs=2)


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_an_interrupted_sweep_goes_on(tmp_path, expected, how):
    tasks_in(tmp_path, MANY)
    process = sweep(tmp_path, "--jobs", "2")
    wait_for(tmp_path, 3, process)
    process.send_signal(how)
    out, err = process.communicate()
    assert out == ""
    if how != signal.SIGKILL:
        assert process.returncode == 130
        assert err.startswith("interrupted: out has ") and err.count("\n") == 1
        assert "of 20 results; the same command goes on from there" in err
    have = (tmp_path / "out" / "journal.jsonl").read_bytes().count(b"\n") - 1
    assert 3 <= have < 20
    process = sweep(tmp_path, "--jobs", "2")
    out, err = process.communicate()
    assert process.returncode == 0
    assert f"{have} from the journal" in out
    assert (tmp_path / "out" / "table.csv").read_bytes() == expected


def test_a_second_sweep_on_the_same_folder_is_refused(tmp_path, capsys):
    tasks_in(tmp_path)
    with opened(tmp_path / "out"):
        assert main(["sweep", str(tmp_path / "study.yaml"), "-o", str(tmp_path / "out")]) == 2
    assert "another sweep is at work on this folder" in capsys.readouterr().err


def test_a_table_that_cannot_be_written_loses_nothing(tmp_path, capsys):
    tasks_in(tmp_path)
    (tmp_path / "out" / "table.csv").mkdir(parents=True)
    words = ["sweep", str(tmp_path / "study.yaml"), "-o", str(tmp_path / "out")]
    assert main(words) == 3
    out, err = capsys.readouterr()
    assert out == "" and "table.csv: cannot be written" in err
    (tmp_path / "out" / "table.csv").rmdir()
    assert main(words) == 0
    assert "0 run, 4 from the journal" in capsys.readouterr().out
