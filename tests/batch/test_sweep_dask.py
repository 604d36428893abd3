"""Sweeps on a dask cluster: workers that are killed mid-run, and a scheduler that is not there or goes away."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from sweeps import SMALL, Pretender, pretended, tasks_in

from slamcli.batch.sweep.cluster import cluster
from slamcli.batch.sweep.local import local
from slamcli.batch.sweep.perform import Performer
from slamcli.batch.sweep.run import opened, pending, run, state_of
from slamcli.batch.sweep.table import columns, csv_bytes
from slamcli.errors import InputError, UsageError

distributed = pytest.importorskip("distributed")

SIXTY = SMALL.replace("seeds: 2", "seeds: 30")


@pytest.fixture(scope="module")
def workers():
    """Two workers of one thread."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs=50, host="127.0.0.1"
    ) as found:
        yield found


def written(tasks, folder, engine, tick=lambda: None):
    """The table, the number of results, and that of lines in the journal."""
    with opened(folder) as journal:
        run(pending(tasks, journal), journal, engine, tick)
        found = csv_bytes(columns(state_of(tasks, journal)))
    return found, len(journal.records), (folder / "journal.jsonl").read_bytes().count(b"\n") - 1


def test_killed_workers_lose_nothing_and_count_nothing_twice(workers, tmp_path):
    tasks = tasks_in(tmp_path, SIXTY)
    expected, *_ = written(tasks, tmp_path / "local", pretended)
    ended, killed = [], []

    def kill():
        """One worker after ten results, the other one, or its successor, after thirty."""
        ended.append(1)
        if len(ended) in (10, 30):
            worker = workers.workers[len(killed)]
            killed.append(worker.pid)
            os.kill(worker.pid, signal.SIGKILL)

    found, results, lines = written(
        tasks, tmp_path / "dask", lambda given: cluster(given, Pretender(), workers.scheduler_address), kill
    )
    assert len(set(killed)) == 2
    assert found == expected
    assert results == lines == len(ended) == 60


def test_tables_are_those_of_joblib_and_what_is_there_is_not_run_again(workers, tmp_path):
    """With real tasks."""
    tasks = tasks_in(tmp_path)
    expected, *_ = written(tasks, tmp_path / "local", lambda given: local(given, Performer(), 1))
    engine = lambda given: cluster(given, Performer(), workers.scheduler_address)  # noqa: E731
    part, *_ = written(tasks[:2], tmp_path / "out", engine)
    found, results, lines = written(tasks, tmp_path / "out", engine)
    assert expected.startswith(part)
    assert found == expected
    assert results == lines == 4


def test_two_sweeps_with_the_same_tasks_do_not_end_each_other(workers, tmp_path):
    """The scheduler knows a task by its key: that of another sweep's is another one."""
    tasks = tasks_in(tmp_path)
    first = cluster(tasks, Pretender(0.2), workers.scheduler_address)
    second = cluster(tasks, Pretender(0.2), workers.scheduler_address)
    next(first), next(second)
    first.close()  # as Ctrl-C does: what it has submitted is cancelled
    assert len(list(second)) == len(tasks) - 1


def test_an_error_of_a_worker_is_told(workers, tmp_path):
    tasks = tasks_in(tmp_path)
    with opened(tmp_path / "out") as journal:
        engine = lambda given: cluster(given, Performer(version="0.0"), workers.scheduler_address)  # noqa: E731
        with pytest.raises(InputError, match=r"a worker has slamcli .*, this is slamcli 0\.0"):
            run(tasks, journal, engine)
        assert journal.records == {}


@pytest.mark.parametrize("address", ["local:", "local:0", "local:two", "nonsense://here"])
def test_bad_addresses(tmp_path, address):
    with pytest.raises(UsageError, match=f"--dask {address}"):
        next(cluster(tasks_in(tmp_path), Performer(), address))


def test_no_scheduler(tmp_path, monkeypatch):
    monkeypatch.setattr("slamcli.batch.sweep.cluster._PATIENCE", (1, 1))
    with pytest.raises(InputError, match="no dask scheduler answers at tcp://"):
        next(cluster(tasks_in(tmp_path), Performer(), "tcp://127.0.0.1:9"))


def test_no_worker(tmp_path, monkeypatch):
    monkeypatch.setattr("slamcli.batch.sweep.cluster._PATIENCE", (10, 1))
    with (
        distributed.LocalCluster(n_workers=0, dashboard_address=":0", silence_logs=50, host="127.0.0.1") as empty,
        pytest.raises(InputError, match="has no worker"),
    ):
        next(cluster(tasks_in(tmp_path), Performer(), empty.scheduler_address))


def test_a_scheduler_that_goes_away(tmp_path):
    """The sweep ends with a message; what came before is kept."""
    options = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": ":0", "processes": False}
    code = f"""if True:
        import distributed, time
        found = distributed.LocalCluster(protocol="tcp", **{options})
        print(found.scheduler_address, flush=True)
        time.sleep(120)"""
    kept = os.environ | {"PYTHONPATH": str(Path(__file__).parent)}  # where the pretender is
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, env=kept)
    try:
        assert process.stdout is not None
        address = process.stdout.readline().strip()
        tasks = tasks_in(tmp_path, SIXTY)
        with opened(tmp_path / "out") as journal:
            began = time.monotonic()
            with pytest.raises(InputError, match="is gone"):
                run(tasks, journal, lambda given: cluster(given, Pretender(), address), process.kill)
            assert time.monotonic() - began < 60
            assert 1 <= len(journal.records) < 60
    finally:
        process.kill()
        process.communicate()
