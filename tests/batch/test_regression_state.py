"""Interrupted runs of a suite, and what the next run takes from them."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any

import pytest
from regression_suites import ONE, FakeMachine, ran, suite_of

from slamcli.batch.execution import Processes
from slamcli.batch.regression.state import State
from slamcli.errors import ExitCode, InputError


class _Interrupted(FakeMachine):
    """The user stops it at the second case."""

    def execute(self, words: Any, folder: Path, limit: float | None) -> Any:
        if len(self.lines) == 1:
            raise KeyboardInterrupt
        return super().execute(words, folder, limit)


THREE = "".join(f"  - {{name: c{k}, data: graph.g2o, metrics: [chi2]}}\n" for k in range(3))


def test_an_interrupted_run_goes_on_where_it_was(tmp_path: Path) -> None:
    suite = suite_of(tmp_path, THREE)
    path = str(tmp_path / "state")
    state = State(path, resume=False)
    report = ran(suite, _Interrupted(), finished=state)
    state.close(keep=True)
    assert (report.exit_code, report.interrupted, [c.name for c in report.cases]) == (130, True, ["c0"])
    fake = FakeMachine()
    state = State(path, resume=True)
    report = ran(suite, fake, finished=state)
    state.close(keep=False)
    assert (len(fake.lines), len(report.cases), report.exit_code) == (2, 3, ExitCode.SUCCESS)
    assert [case.resumed for case in report.cases] == [True, False, False]
    assert not Path(path).exists()
    whole = ran(suite)
    assert [c.metrics for c in report.cases] == [c.metrics for c in whole.cases]


def test_an_interrupted_run_blesses_nothing(tmp_path: Path) -> None:
    report = ran(suite_of(tmp_path, THREE), _Interrupted(), update=True)
    assert report.update is not None and not report.update.written
    assert not (tmp_path / "suite.baseline.json").exists()


def test_what_is_resumed_is_what_would_run(tmp_path: Path) -> None:
    """Another option, another input or another program is another case."""
    path = str(tmp_path / "state")

    def runs(cases: str) -> int:
        suite = suite_of(tmp_path, cases)
        if graph:
            (tmp_path / "graph.g2o").write_text(graph)
        fake = FakeMachine()
        state = State(path, resume=True)
        ran(suite, fake, finished=state)
        state.close(keep=True)
        return len(fake.lines)

    graph = ""
    assert runs(ONE) == 1
    assert runs(ONE) == 0
    assert runs(ONE.replace("metrics", "options: {method: lm}, metrics")) == 1
    graph = "VERTEX_SE2 9 0 0 0\n"
    assert runs(ONE) == 1


def test_a_torn_line_of_the_state_does_not_count(tmp_path: Path) -> None:
    suite = suite_of(tmp_path, THREE)
    path = tmp_path / "state"
    state = State(str(path), resume=False)
    ran(suite, finished=state)
    state.close(keep=True)
    text = path.read_bytes()
    path.write_bytes(text[:-40])
    fake = FakeMachine()
    state = State(str(path), resume=True)
    assert len(state.finished) == 2
    ran(suite, fake, finished=state)
    state.close(keep=True)
    assert len(fake.lines) == 1
    state = State(str(path), resume=True)
    assert len(state.finished) == 3
    state.close(keep=True)


def test_what_is_no_state_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "precious.g2o"
    path.write_text("VERTEX_SE2 0 0 0 0\n")
    for resume in (False, True):
        with pytest.raises(InputError, match="is no state file"):
            State(str(path), resume=resume)
    assert path.read_text() == "VERTEX_SE2 0 0 0 0\n"
    path.write_text('{"na')  # cut short by a full disk
    State(str(path), resume=True).close(keep=False)


def test_a_full_disk_is_told_as_such(tmp_path: Path) -> None:
    class Full(FakeMachine):
        def execute(self, words: Any, folder: Path, limit: float | None) -> Any:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with pytest.raises(InputError, match="case one cannot be run: No space left"):
        ran(suite_of(tmp_path, ONE), Full())


def test_two_runs_do_not_share_a_state(tmp_path: Path) -> None:
    pytest.importorskip("fcntl")
    state = State(str(tmp_path / "state"), resume=False)
    with pytest.raises(InputError, match="another run has it"):
        State(str(tmp_path / "state"), resume=True)
    state.close(keep=False)


def test_a_disk_that_fills_up_ends_no_run(tmp_path: Path) -> None:
    state = State(str(tmp_path / "state"), resume=False)
    state._stream.close()  # whatever is written now fails
    report = ran(suite_of(tmp_path, THREE), finished=state)
    assert len(report.cases) == 3
    assert "no resuming from here" in state.problem


def test_stopped_processes_end(tmp_path: Path) -> None:
    processes = Processes()
    processes.stop()
    with pytest.raises(KeyboardInterrupt):
        processes.execute(["--version"], tmp_path)
