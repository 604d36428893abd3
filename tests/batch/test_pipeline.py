"""The command lines of a case, and the processes that run them."""

from __future__ import annotations

import sys
import threading
import time
from pathlib import Path

import pytest
from regression_suites import FakeMachine

from slamcli.batch.execution import TIMED_OUT, Processes, document_of, execute
from slamcli.batch.pipeline import Case, run, words_of


def lines(case: Case, folder: Path, **codes: int) -> list[str]:
    fake = FakeMachine({}, codes)
    run(case, folder, fake.execute)
    return [" ".join(line) for line in fake.lines]


def test_options_become_words() -> None:
    options = {"method": "lm", "certify": True, "restart": False, "fix": [1, 2], "max_iterations": 3, "kernel": None}
    assert " ".join(words_of(options)) == "--method lm --certify --no-restart --fix 1 --fix 2 --max-iterations 3"


def test_all_steps_of_a_simulation(tmp_path: Path) -> None:
    case = Case(
        "a",
        options={"robust": "gnc"},
        simulate="square",
        simulation={"poses": 5},
        inject={"false_closures": 2},
        evaluate={"align": "none"},
    )
    assert lines(case, tmp_path) == [
        "simulate square --poses 5 -o graph.g2o --truth truth.g2o --json",
        "inject graph.g2o --false-closures 2 -o spoiled.g2o --labels labels.csv --json",
        "optimize spoiled.g2o --robust gnc -o estimate.g2o --labels-out estimated.csv --json",
        "evaluate estimate.g2o --align none --truth truth.g2o"
        " --labels labels.csv --estimated-labels estimated.csv --json",
    ]
    assert len(lines(case, tmp_path, simulate=2)) == 1
    assert len(lines(case, tmp_path, inject=2)) == 2
    assert len(lines(case, tmp_path, optimize=5)) == 3
    assert len(lines(case, tmp_path, optimize=4)) == 4  # the result so far is written


def test_only_false_edges_have_labels(tmp_path: Path) -> None:
    case = Case("a", data="x.g2o", truth="t.g2o", inject={"perturb": "0.1"})
    assert lines(case, tmp_path) == [
        "inject x.g2o --perturb 0.1 -o spoiled.g2o --json",
        "optimize spoiled.g2o -o estimate.g2o --json",
        "evaluate estimate.g2o --truth t.g2o --json",
    ]


def test_nothing_is_compared_without_a_truth(tmp_path: Path) -> None:
    assert lines(Case("a", data="x.g2o"), tmp_path) == ["optimize x.g2o --json"]
    assert lines(Case("a", data="x.g2o", truth="t.g2o", command="info"), tmp_path) == ["info x.g2o --json"]


@pytest.mark.parametrize("world", ["camera-ring", "scene.yaml"])
def test_scenes_of_cameras_are_bal_files(world: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("scene.yaml").write_text("world: camera-flight\n")
    found = lines(Case("a", simulate=world), tmp_path)
    assert found[0] == f"simulate {world} -o graph.bal --truth truth.bal --json"
    assert found[1] == "optimize graph.bal -o estimate.bal --json"


def test_exit_codes_documents_and_messages_of_processes(tmp_path: Path) -> None:
    done = execute(["info", "nowhere.g2o", "--json"], tmp_path)
    assert (done.exit_code, done.document) == (3, None)
    assert "nowhere.g2o: cannot be read" in done.messages
    done = Processes().run([sys.executable, "-c", "print('{\"a\": 1}')"], ["a"], tmp_path)
    assert (done.exit_code, done.document, done.words) == (0, {"a": 1}, ("a",))
    assert [document_of(text) for text in (b"", b"[1]", b"\xff", b'{"a": 1}')] == [None, None, None, {"a": 1}]


def test_a_process_that_takes_too_long_or_dies(tmp_path: Path) -> None:
    done = Processes().run([sys.executable, "-c", "import time; time.sleep(60)"], ["a"], tmp_path, 0.2)
    assert (done.exit_code, done.seconds < 30.0) == (TIMED_OUT, True)
    if sys.platform != "win32":
        done = Processes().run([sys.executable, "-c", "import os; os.kill(os.getpid(), 9)"], ["a"], tmp_path)
        assert done.exit_code == 128 + 9


def test_stop_ends_what_other_threads_wait_for(tmp_path: Path) -> None:
    processes, ended = Processes(), []

    def wait() -> None:
        try:
            processes.run([sys.executable, "-c", "import time; time.sleep(60)"], ["a"], tmp_path)
        except KeyboardInterrupt:
            ended.append(True)

    thread = threading.Thread(target=wait)
    thread.start()
    while not processes._running:
        time.sleep(0.01)
    processes.stop()
    thread.join(30.0)
    assert ended == [True]
