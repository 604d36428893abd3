"""Output files: written whole or not at all, compressed by name, through links, to devices and standard output."""

import errno
import gzip
import io
import os
import resource
import stat
import sys
import threading
from pathlib import Path

import pytest
from support import vectors, write_file

import slamcli
from slamcli.errors import InputError
from slamcli.formats import source
from slamcli.formats.source import read_bytes, write_bytes

NEW, OLD = b"new content\n", b"old content\n"


def names(folder: Path) -> list[str]:
    return sorted(os.listdir(folder))


def test_a_new_file_has_the_usual_mode_and_nothing_is_left_beside_it(tmp_path: Path) -> None:
    mask = os.umask(0o027)
    try:
        write_bytes(str(tmp_path / "out.g2o"), NEW)
    finally:
        os.umask(mask)
    assert (tmp_path / "out.g2o").read_bytes() == NEW
    assert stat.S_IMODE((tmp_path / "out.g2o").stat().st_mode) == 0o640
    assert names(tmp_path) == ["out.g2o"]


@pytest.mark.parametrize("mode", [0o600, 0o755, 0o444])
def test_an_existing_file_is_replaced_and_keeps_its_mode(tmp_path: Path, mode: int) -> None:
    target = write_file(tmp_path, OLD)
    target.chmod(mode)
    write_bytes(str(target), NEW)
    assert target.read_bytes() == NEW
    assert stat.S_IMODE(target.stat().st_mode) == mode
    assert names(tmp_path) == [target.name]


@pytest.mark.parametrize("exists", [False, True])
def test_a_failing_rename_leaves_everything_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, exists: bool
) -> None:
    target = write_file(tmp_path, OLD) if exists else tmp_path / "graph.g2o"

    def fail(*args: object) -> None:
        raise OSError(errno.EACCES, os.strerror(errno.EACCES))

    with monkeypatch.context() as patch, pytest.raises(InputError, match="cannot be written: Permission denied") as e:
        patch.setattr(os, "replace", fail)
        write_bytes(str(target), NEW)
    assert str(target) in str(e.value)
    assert ("the existing file is unchanged" in str(e.value)) == exists
    assert names(tmp_path) == ([target.name] if exists else [])
    assert not exists or target.read_bytes() == OLD


@pytest.mark.parametrize("exists", [False, True])
def test_no_room_for_the_whole_file(tmp_path: Path, exists: bool) -> None:
    """A limit on the size of files stands for a full disk: the write stops half-way."""
    target = write_file(tmp_path, OLD) if exists else tmp_path / "graph.g2o"
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limits[1]))
    try:
        with pytest.raises(InputError, match="cannot be written: File too large"):
            write_bytes(str(target), NEW * 100_000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert names(tmp_path) == ([target.name] if exists else [])
    assert not exists or target.read_bytes() == OLD


def test_an_interruption_leaves_everything_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = write_file(tmp_path, OLD)

    def interrupt(*args: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(os, "replace", interrupt)
        write_bytes(str(target), NEW)
    assert names(tmp_path) == [target.name]
    assert target.read_bytes() == OLD


def test_compression_by_name(tmp_path: Path) -> None:
    graph = slamcli.read(str(write_file(tmp_path, vectors)))
    slamcli.write(graph, str(tmp_path / "out.g2o.gz"))
    packed = (tmp_path / "out.g2o.gz").read_bytes()
    assert gzip.decompress(packed) == vectors.encode()
    again = slamcli.read(str(tmp_path / "out.g2o.gz"))
    assert again.chi2() == graph.chi2()
    slamcli.write(again, str(tmp_path / "plain.g2o"))
    assert (tmp_path / "plain.g2o").read_bytes() == vectors.encode()
    assert packed[3:8] == bytes(5)  # neither a name nor a time: the same graph makes the same file


def test_the_target_of_a_link_is_replaced_not_the_link(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    target = write_file(tmp_path / "folder", OLD)
    link = tmp_path / "link.g2o"
    link.symlink_to(Path("folder") / target.name)
    write_bytes(str(link), NEW)
    assert link.is_symlink()
    assert target.read_bytes() == NEW
    assert names(tmp_path) == ["folder", "link.g2o"]
    assert names(tmp_path / "folder") == [target.name]
    target.unlink()
    write_bytes(str(link), OLD)  # a link that hangs is followed just so
    assert link.is_symlink()
    assert target.read_bytes() == OLD


def test_devices_are_written_to_not_replaced() -> None:
    write_bytes("/dev/null", NEW)
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)


def test_a_named_pipe_is_written_to_not_replaced(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    received: list[bytes] = []
    reader = threading.Thread(target=lambda: received.append(pipe.read_bytes()), daemon=True)
    reader.start()
    write_bytes(str(pipe), NEW)
    reader.join(timeout=10)
    assert received == [NEW]
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_a_pipe_by_its_descriptor_has_no_other_name() -> None:
    """As in ``/dev/stdout`` and in the shell's ``>(command)``: what the path points at is no path."""
    reading, writing = os.pipe()
    try:
        write_bytes(f"/dev/fd/{writing}", NEW)
        assert os.read(reading, 100) == NEW
    finally:
        os.close(reading)
        os.close(writing)


def test_where_nothing_can_be_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written: Is a directory"):
        write_bytes(str(tmp_path), NEW)
    with pytest.raises(InputError, match="cannot be written: No such file or directory"):
        write_bytes(str(tmp_path / "missing" / "out.g2o"), NEW)
    assert names(tmp_path) == []


def test_standard_output_takes_the_bytes_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(stream, newline="\r\n"))
    write_bytes("-", NEW)
    assert stream.getvalue() == NEW


def test_a_file_may_be_written_over_itself(tmp_path: Path) -> None:
    path = write_file(tmp_path, vectors)
    graph = slamcli.read(str(path))
    slamcli.write(graph.with_values({name: column.values for name, column in graph.variables.items()}), str(path))
    assert read_bytes(str(path)) == (vectors.encode(), vectors.encode())


def test_a_file_that_may_not_be_read_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_file(tmp_path, vectors)

    def refuse(*args: object) -> None:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(source, "open", refuse, raising=False)
    with pytest.raises(InputError, match="cannot be read: Permission denied"):
        slamcli.read(str(path))
