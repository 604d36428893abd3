"""Running sweeps: the same numbers however they are run, interruption and resumption, crashes, time limits."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from sweeps import SMALL, pretended, tasks_in

from slamcli.batch.execution import TIMED_OUT, Execution, execute
from slamcli.batch.interpreter import Closed, Interpreter, scratch
from slamcli.batch.sweep import perform as performing
from slamcli.batch.sweep.local import local
from slamcli.batch.sweep.perform import CRASHED, Performer
from slamcli.batch.sweep.run import RESULTS, opened, pending, run, state_of
from slamcli.batch.sweep.table import columns, csv_bytes
from slamcli.cli.main import main
from slamcli.cli.process import terminable
from slamcli.errors import InputError

#: Tasks of some 40 ms.
MANY = SMALL.replace("seeds: 2", "seeds: 8").replace("poses: 30", "poses: 200")


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
        ["info", "-"],
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


def plainly(tasks):
    """An engine that runs one task after another by the interpreter of this module."""
    for task in tasks:
        yield Performer()(task)


@pytest.fixture(scope="module", autouse=True)
def _ended():
    yield
    performing.close()


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """The records of two tasks that are spoiled, too."""
    content = SMALL.replace("axes:", "  inject: {false-closures: 2}\naxes:").replace("chi2]", "chi2, recall]")
    content = content.replace("options.method: [gn, lm]", "options.robust: [none, auto]").replace("s: 2\n", "s: 1\n", 1)
    tasks = tasks_in(tmp_path_factory.mktemp("small"), content)
    return tasks, list(plainly(tasks))


def test_tables_do_not_depend_on_how_tasks_are_run(tmp_path, small):
    tasks, records = small
    with opened(tmp_path / "one") as journal:
        run(tasks, journal, lambda given: (record for record in records))
        one = csv_bytes(columns(state_of(tasks, journal)))
    assert one.count(b"\n") == 1 + len(tasks) == 3
    assert b",0,,0." in one
    # the second one first, by joblib, and all from the journal in the end
    table(tasks[1:], tmp_path / "two", jobs=2)
    assert table(tasks, tmp_path / "two") == one


def test_a_process_for_each_step_gives_the_same(tmp_path):
    """Two steps; more is in the test of the interpreter above."""
    tasks = tasks_in(tmp_path, "seeds: 1\ncase: {simulate: square, command: info}\nmetrics: [chi2]\n")
    assert list(local(tasks, Performer(isolate=True), 2)) == list(plainly(tasks))


def test_a_result_does_not_depend_on_the_tasks_before_it(small):
    """No cache of one task is seen by the next."""
    tasks, records = small
    assert list(plainly(reversed(tasks))) == records[::-1]


def test_failures_are_results(tmp_path):
    content = SMALL.replace("options.method: [gn, lm]", "options.fix: [0, 999]").replace("seeds: 2", "seeds: 1")
    tasks = tasks_in(tmp_path, content)
    with opened(tmp_path / "out") as journal:
        run(tasks, journal, plainly)
        state = state_of(tasks, journal)
    assert state.codes == {0: 1, 2: 1} and not state.complete
    _, failed = [record for _, record in state.ended]
    assert (failed.failed, failed.figures) == ("optimize", {"ate": None, "chi2": None})
    assert "999" in failed.message


def test_a_task_that_takes_too_long_is_a_result(tmp_path):
    """Each step has the limit; what a process does about it is shown above."""
    (task, *_) = tasks_in(tmp_path, SMALL.replace("case:", "case:\n  time_limit: 0.05"))
    limits = []

    def late(words, folder, limit):
        limits.append(limit)
        return Execution(tuple(words), TIMED_OUT, None, "", 0.05)

    record = performing._once(task, late, str(tmp_path))
    assert (record.exit_code, record.failed, limits) == (TIMED_OUT, "simulate", [0.05])


def test_a_process_that_is_killed_from_outside_gets_a_second_chance(small, monkeypatch):
    (task, _), (expected, _) = small
    calls = []
    call = Interpreter.__call__

    def killed(self, words, folder, limit=None):
        calls.append(words[0])
        if calls == ["simulate", "inject", "optimize"]:
            os.kill(self._process.pid, signal.SIGKILL)
        return call(self, words, folder, limit)

    monkeypatch.setattr(Interpreter, "__call__", killed)
    assert Performer()(task) == expected
    assert calls == ["simulate", "inject", "optimize", "simulate", "inject", "optimize", "evaluate"]


@pytest.mark.parametrize(
    ("code", "messages", "document"),
    [
        (1, "Traceback (most recent call last):\n  ...\nKeyError: 'x'\n", None),
        (0, "", None),
        (4, "", None),
        (1, "", None),
    ],
)
def test_a_crash_is_no_result_of_the_method(tmp_path, code, messages, document):
    """An exception of Python's own ends a process with 1, as a check that failed does."""
    (task, *_) = tasks_in(tmp_path)

    def crashing(words, folder, limit):
        return Execution(tuple(words), code, document, messages, 0.1)

    record = performing._once(task, crashing, str(tmp_path))
    assert (record.exit_code, record.failed) == (CRASHED, "simulate")
    assert "KeyError" in record.message or not messages
    assert CRASHED not in RESULTS


def test_a_full_disk_that_leaves_no_message_is_no_result(tmp_path, monkeypatch):
    """A command that cannot even write its message looks like a crash."""
    (task, *_) = tasks_in(tmp_path)

    def full(self, data):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(InputError, match="No space left on device"):
        performing._once(task, lambda words, folder, limit: Execution(tuple(words), 1, None, "", 0.1), str(tmp_path))


@pytest.mark.skipif(not hasattr(os, "memfd_create"), reason="nameless files are in memory on Linux only")
def test_interpreters_need_no_disk_for_what_is_printed(tmp_path):
    with scratch() as stream:
        assert os.fstat(stream.fileno()).st_dev != tmp_path.stat().st_dev
        assert os.readlink(f"/proc/self/fd/{stream.fileno()}").startswith("/memfd:")


@pytest.mark.parametrize("error", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG])
def test_a_full_disk_under_the_tasks_is_no_result(tmp_path, monkeypatch, error):
    tasks = tasks_in(tmp_path)

    def full(self, words, folder, limit=None):
        messages = f"error: graph.g2o: cannot be written: {os.strerror(error)}\n"
        return Execution(tuple(words), 3, None, messages, 0.1)

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


def test_an_interrupted_sweep_goes_on(tmp_path, monkeypatch, capsys):
    """By Ctrl-C, and a kill without a chance to do anything."""
    tasks = tasks_in(tmp_path, MANY)
    have = 0
    for how in (signal.SIGINT, signal.SIGKILL):
        process = sweep(tmp_path, "--jobs", "1")
        wait_for(tmp_path, have + 2, process)
        process.send_signal(how)
        out, err = process.communicate()
        assert out == ""
        if how != signal.SIGKILL:
            assert process.returncode == 130
            assert err.startswith("interrupted: out has ") and err.count("\n") == 1
            assert "of 16 results; the same command goes on from there" in err
        before, have = have, (tmp_path / "out" / "journal.jsonl").read_bytes().count(b"\n") - 1
        assert before + 2 <= have < 16
    monkeypatch.chdir(tmp_path)
    assert main(["sweep", "study.yaml", "-o", "out", "--jobs", "1"]) == 0
    assert f"{have} from the journal" in capsys.readouterr().out
    with opened(tmp_path / "expected") as journal:
        run(tasks, journal, plainly)
        expected = csv_bytes(columns(state_of(tasks, journal)))
    assert (tmp_path / "out" / "table.csv").read_bytes() == expected


def test_refused_before_anything_is_run(tmp_path, capsys, monkeypatch):
    """Command lines and outputs that cannot be; nothing is made."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "labels.csv").write_text("")
    (tmp_path / "g.g2o").write_text("VERTEX_SE2 0 0 0 0\n")
    cases = [
        (SMALL.replace("axes:", "  options: {trace: t.jsonl}\naxes:"), [], "--trace t.jsonl: must be an absolute path"),
        (SMALL.replace("case:", "case:\n  command: --version"), [], "there is no command '--version'"),
        (SMALL.replace("case:", "case:\n  command: datasets"), [], "datasets takes no graph"),
        (SMALL, ["--no-run", "--no-resume"], "--no-resume puts them aside"),
        (SMALL, ["--no-run"], "has no results of a sweep"),
        (SMALL, ["--table", "nowhere/x.csv"], "there is no folder nowhere"),
        (SMALL, ["--only", "*lm*", "--show", "0"], "there are 2, from 2 to 3"),
        (
            "case: {data: g.g2o, labels: labels.csv}\nmetrics: [chi2]\n",
            ["--table", "labels.csv"],
            "labels.csv is an input and would be overwritten",
        ),
    ]
    for content, words, said in cases:
        tasks_in(tmp_path, content)
        assert main(["sweep", "study.yaml", "-o", "out", *words]) in (2, 3)
        out, err = capsys.readouterr()
        assert (out, said in err) == ("", True), err
        assert not (tmp_path / "out").exists()


def test_what_a_queue_sends_counts_as_ctrl_c():
    """SIGTERM, while tasks run; before and after it ends the process."""
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt), terminable():
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(1.0)
    assert signal.getsignal(signal.SIGTERM) == before


def test_a_second_sweep_on_the_same_folder_is_refused(tmp_path, capsys):
    tasks_in(tmp_path)
    with opened(tmp_path / "out"):
        assert main(["sweep", str(tmp_path / "study.yaml"), "-o", str(tmp_path / "out")]) == 2
    assert "another sweep is at work on this folder" in capsys.readouterr().err


def test_a_table_that_cannot_be_written_loses_nothing(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("slamcli.cli.sweep._engine", lambda given: pretended)
    tasks_in(tmp_path)
    (tmp_path / "out" / "table.csv").mkdir(parents=True)
    words = ["sweep", str(tmp_path / "study.yaml"), "-o", str(tmp_path / "out"), "--jobs", "1"]
    assert main(words) == 3
    out, err = capsys.readouterr()
    assert out == "" and "table.csv: cannot be written" in err
    (tmp_path / "out" / "table.csv").rmdir()
    assert main(words) == 0
    assert "0 run, 4 from the journal" in capsys.readouterr().out
