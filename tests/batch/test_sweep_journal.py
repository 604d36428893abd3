"""The journal of a sweep: what a crash, a full disk or a second sweep do to it."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys

import pytest
from sweeps import pretended, record_of, tasks_in

from slamcli.batch.sweep.journal import NAME, Journal
from slamcli.batch.sweep.lock import locked
from slamcli.batch.sweep.run import opened, pending, run, state_of
from slamcli.errors import InputError, UsageError


def filled(folder, tasks):
    """A journal with the results of these tasks, closed."""
    with opened(folder) as journal:
        run(tasks, journal, pretended)
    return folder / NAME


def test_records_come_back_as_they_were(tmp_path):
    tasks = tasks_in(tmp_path)
    records = [record_of(task, 0.1 + 0.2 * task.index) for task in tasks]
    with opened(tmp_path / "out") as journal:
        for record in records:
            journal.append(record)
    with opened(tmp_path / "out") as journal:
        assert journal.records == {record.key: record for record in records}
        assert [journal.records[record.key].seconds for record in records] == [r.seconds for r in records]
        assert pending(tasks, journal) == []


def test_a_torn_line_is_dropped_and_its_task_is_run_again(tmp_path):
    tasks = tasks_in(tmp_path)
    path = filled(tmp_path / "out", tasks)
    whole = path.read_bytes()
    lines = whole.splitlines(keepends=True)
    for cut in (1, len(lines[-1]) // 2, len(lines[-1]) - 1):
        path.write_bytes(b"".join(lines[:-1]) + lines[-1][:cut])
        with opened(tmp_path / "out") as journal:
            assert len(journal.notes) == 1 and "torn" in journal.notes[0]
            (again,) = pending(tasks, journal)
            run([again], journal, pretended)
            assert state_of(tasks, journal).missing == 0
        assert [json.loads(line) for line in path.read_bytes().splitlines()]


def test_a_journal_torn_in_its_first_line_begins_anew(tmp_path):
    path = filled(tmp_path / "out", tasks_in(tmp_path))
    path.write_bytes(path.read_bytes()[:10])
    with opened(tmp_path / "out") as journal:
        assert journal.records == {}
    assert path.read_bytes().count(b"\n") == 1


#: A record but for one value.
ODD = [
    b'{"key": ["a"], "exit_code": 0, "failed": null, "message": "", "figures": {}, "seconds": {}}',
    b'{"key": "a", "exit_code": 0, "failed": null, "message": "", "figures": [], "seconds": {}}',
    b'{"key": "a", "exit_code": "0", "failed": null, "message": "", "figures": {}, "seconds": {}}',
]


@pytest.mark.parametrize(
    "line", [b"{}", b"[]", b"x", b'{"key": "a"}', *ODD, b'{"journal": "slamcli sweep", "format": 2}']
)
@pytest.mark.parametrize("number", [1, 3])
def test_what_is_no_journal_is_refused_and_kept(tmp_path, line, number):
    path = filled(tmp_path / "out", tasks_in(tmp_path))
    lines = path.read_bytes().splitlines()
    lines[number - 1] = line
    content = b"\n".join(lines) + b"\n"
    path.write_bytes(content)
    with pytest.raises(InputError, match=f"{NAME}:{number}: is no line"), opened(tmp_path / "out"):
        pass
    assert path.read_bytes() == content


def test_no_resume_keeps_the_old_journal(tmp_path):
    path = filled(tmp_path / "out", tasks_in(tmp_path))
    content = path.read_bytes()
    with opened(tmp_path / "out", resume=False) as journal:
        assert journal.records == {}
    assert (tmp_path / "out" / "journal.jsonl.old").read_bytes() == content


def test_a_task_that_was_run_twice_counts_once(tmp_path):
    tasks = tasks_in(tmp_path)
    ticks = []

    def twice(given):
        for task in given:
            yield record_of(task, 1.0)
            yield record_of(task, 2.0)

    with opened(tmp_path / "out") as journal:
        run(tasks, journal, twice, lambda: ticks.append(1))
        assert {record.figures["ate"] for record in journal.records.values()} == {1.0}
    assert len(ticks) == len(tasks)
    assert (tmp_path / "out" / NAME).read_bytes().count(b"\n") == 1 + len(tasks)


def test_equal_tasks_are_run_once(tmp_path):
    tasks = tasks_in(tmp_path, SAME)
    assert len(tasks) == 2 and tasks[0].key == tasks[1].key
    with opened(tmp_path / "out") as journal:
        assert pending(tasks, journal) == tasks[:1]
        run(pending(tasks, journal), journal, pretended)
        assert state_of(tasks, journal).missing == 0


SAME = """\
case: {simulate: square}
axes: {method: {a: {options.method: gn}, b: {options.method: gn}}}
metrics: [chi2]
"""


def test_failed_tasks_are_results_until_they_are_tried_again(tmp_path):
    tasks = tasks_in(tmp_path)
    with opened(tmp_path / "out") as journal:
        for task in tasks:
            journal.append(record_of(task, code=5 if task.index == 2 else 0))
        assert pending(tasks, journal) == []
        assert pending(tasks, journal, retry_failed=True) == [tasks[2]]
        run([tasks[2]], journal, pretended)
    with opened(tmp_path / "out") as journal:
        state = state_of(tasks, journal)
        assert state.codes == {0: 4} and len(state.ended) == 4


def test_results_of_other_tasks_stay(tmp_path):
    tasks = tasks_in(tmp_path)
    filled(tmp_path / "out", tasks)
    with opened(tmp_path / "out") as journal:
        state = state_of(tasks[:1], journal)
        assert (state.missing, state.others) == (0, 3)


def test_a_full_disk_leaves_what_there_was(tmp_path, monkeypatch):
    """Half a line gets through, then the disk is full."""
    tasks = tasks_in(tmp_path)
    path = filled(tmp_path / "out", tasks[:2])
    before = path.read_bytes()
    write, calls = os.write, []

    def full(handle, data):
        calls.append(data)
        if len(calls) > 1:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(handle, data[: len(data) // 2])

    with opened(tmp_path / "out") as journal:
        monkeypatch.setattr(os, "write", full)
        with pytest.raises(InputError, match="No space left on device") as caught:
            run(tasks[2:], journal, pretended)
        monkeypatch.undo()
        assert "it has 2 results" in caught.value.details[0]
    assert path.read_bytes() == before


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission(tmp_path):
    (tmp_path / "out").mkdir(mode=0o500)
    with pytest.raises(InputError, match="cannot be written: Permission denied"), opened(tmp_path / "out"):
        pass


def test_a_file_in_place_of_the_folder(tmp_path):
    (tmp_path / "out").write_text("")
    with pytest.raises(InputError, match="out: cannot be written: File exists"), opened(tmp_path / "out"):
        pass


def test_a_folder_without_results_is_not_made_to_look_at_them(tmp_path):
    with pytest.raises(InputError, match="has no results of a sweep"), opened(tmp_path / "typo", make=False):
        pass
    assert not (tmp_path / "typo").exists()


def test_two_sweeps_at_once_are_refused(tmp_path):
    with locked(tmp_path):
        with pytest.raises(UsageError, match=f"another sweep is at work.*process {os.getpid()} on "), locked(tmp_path):
            pass
        assert (tmp_path / "lock").exists()
    assert not (tmp_path / "lock").exists()
    with locked(tmp_path):
        pass


def test_the_lock_of_a_killed_sweep_does_not_hold(tmp_path):
    code = "import sys, time, pathlib; from slamcli.batch.sweep.lock import locked\n"
    code += "with locked(pathlib.Path(sys.argv[1])): print(flush=True); time.sleep(60)"
    process = subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE)
    try:
        assert process.stdout is not None
        process.stdout.readline()
        with pytest.raises(UsageError, match=f"process {process.pid}"), locked(tmp_path):
            pass
    finally:
        process.send_signal(signal.SIGKILL)
        process.communicate()
    assert (tmp_path / "lock").exists()
    with locked(tmp_path):
        assert json.loads((tmp_path / "lock").read_text())["pid"] == os.getpid()


def test_reading_needs_no_order(tmp_path):
    """Lines in any order make the same records."""
    path = filled(tmp_path / "out", tasks_in(tmp_path))
    head, *rest = path.read_bytes().splitlines(keepends=True)
    found = Journal(path)
    path.write_bytes(head + b"".join(reversed(rest)))
    again = Journal(path)
    assert found.records == again.records
    found.close()
    again.close()
