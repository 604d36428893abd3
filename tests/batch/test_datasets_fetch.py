"""Fetching from a mirror: whole, in pieces, wrong, refused, interrupted."""

from __future__ import annotations

import hashlib
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from mirror import Mirror, serving

from slamcli.batch.datasets.download import Policy, mirror_url, without_password
from slamcli.batch.datasets.entries import DatasetEntry, FileEntry, Source
from slamcli.batch.datasets.fetch import fetch
from slamcli.batch.datasets.search import cache_folder
from slamcli.errors import InputError, UsageError

DATA = random.Random(0).randbytes(300_000)
PATH = "pose2d/world.g2o"
SOURCE = Source("nobody/nothing", "world.g2o", "none", "made for a test")
QUICK = Policy(retries=2, wait=0.001, timeout=5.0)


def one_file(path: str = PATH, data: bytes = DATA) -> DatasetEntry:
    file = FileEntry(path, hashlib.sha256(data).hexdigest(), len(data))
    return DatasetEntry("world", "pose2d", "a world", path, (file,), "g2o", "graph", SOURCE)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("SLAMCLI_DATASETS", raising=False)
    return cache_folder()


@pytest.fixture
def mirror() -> Iterator[Mirror]:
    with serving(Mirror({PATH: DATA})) as running:
        yield running


def left(cache: Path) -> list[str]:
    """The files that the cache holds."""
    return sorted(str(path.relative_to(cache)) for path in cache.rglob("*") if path.is_file())


def get(mirror: Mirror, entry: DatasetEntry | None = None, policy: Policy = QUICK) -> tuple[Path, int]:
    return fetch(entry or one_file(), mirror.url, policy=policy)


@pytest.mark.parametrize(
    "url",
    [
        "http://[bad",
        "http://h:port",
        "http://h:99999",
        "http://..x",
        f"http://{'a' * 300}",
        "http://:80",
        "http://u:pw@h:x",
    ],
)
def test_addresses_that_are_none(url: str) -> None:
    with pytest.raises(UsageError, match="is no http or https address") as caught:
        mirror_url(url, PATH)
    assert "pw" not in caught.value.message


@pytest.mark.parametrize("place", ["http://[bad", f"http://{'a' * 300}", "file:///etc/passwd", "/loop"])
def test_redirections_to_nowhere(cache: Path, place: str) -> None:
    with (
        serving(Mirror({PATH: DATA}, redirect=place)) as mirror,
        pytest.raises(InputError, match="leads to an address that is none, or round in circles"),
    ):
        get(mirror)
    assert left(cache) == []


def test_a_web_page_is_no_file(cache: Path) -> None:
    with (
        serving(Mirror({PATH: b"<html>"}, kind="text/html; charset=utf-8")) as mirror,
        pytest.raises(InputError, match="the server answered with a web page"),
    ):
        get(mirror)
    assert left(cache) == []


def test_a_server_that_falls_asleep(cache: Path) -> None:
    with (
        serving(Mirror({PATH: DATA}, sleep=0.6)) as mirror,
        pytest.raises(InputError, match=r"did not answer in time, 1 time$"),
    ):
        get(mirror, policy=Policy(retries=0, timeout=0.2))


def test_whole_file(cache: Path, mirror: Mirror) -> None:
    seen: list[tuple[str, int, int]] = []
    path, size = fetch(one_file(), mirror.url + "/", policy=QUICK, progress=lambda *state: seen.append(state))
    assert (path, size) == (cache / PATH, len(DATA))
    assert path.read_bytes() == DATA
    assert left(cache) == [PATH]
    assert mirror.requests == [("/" + PATH, None)]
    assert seen[0] == (PATH, 0, len(DATA))
    assert seen[-1] == (PATH, len(DATA), len(DATA))


def test_what_is_there_is_not_fetched_again(cache: Path, mirror: Mirror) -> None:
    get(mirror)
    assert get(mirror) == (cache / PATH, 0)
    assert fetch(one_file(), None) == (cache / PATH, 0)
    assert len(mirror.requests) == 1


def test_damaged_file_in_the_cache_is_replaced(cache: Path, mirror: Mirror) -> None:
    (cache / PATH).parent.mkdir(parents=True)
    (cache / PATH).write_bytes(DATA[:-1] + b"?")
    assert get(mirror) == (cache / PATH, len(DATA))
    assert (cache / PATH).read_bytes() == DATA


def test_damaged_file_earlier_in_the_search_path_is_named(
    cache: Path, mirror: Mirror, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wrong = tmp_path / "own" / PATH
    wrong.parent.mkdir(parents=True)
    wrong.write_bytes(b"something else")
    monkeypatch.setenv("SLAMCLI_DATASETS", str(tmp_path / "own"))
    with pytest.raises(InputError, match=r"own/pose2d/world\.g2o: is not the file") as caught:
        get(mirror)
    assert "remove it" in caught.value.details[0]
    assert mirror.requests == []


def test_truncated_answers_are_resumed(cache: Path, mirror: Mirror) -> None:
    mirror.answers = [-100_000, -50_000]
    assert get(mirror)[0].read_bytes() == DATA
    assert [wanted for _, wanted in mirror.requests] == [None, "bytes=100000-", "bytes=150000-"]
    assert left(cache) == [PATH]


def test_truncation_without_a_length_is_noticed(cache: Path, mirror: Mirror) -> None:
    """The end of such an answer looks like the end of the file."""
    mirror.length = False
    mirror.answers = [-100_000]
    assert get(mirror)[0].read_bytes() == DATA
    assert mirror.requests[1][1] == "bytes=100000-"


def test_truncation_without_end_is_an_error_and_the_next_run_goes_on(cache: Path, mirror: Mirror) -> None:
    mirror.answers = [-1000] * 3
    with pytest.raises(InputError, match=r"world.g2o: .*closed.* 3 times") as caught:
        get(mirror)
    assert "3000 of 300000 bytes are kept" in caught.value.details[0]
    assert left(cache) == [PATH + ".part"]
    assert (cache / (PATH + ".part")).read_bytes() == DATA[:3000]
    assert get(mirror)[0].read_bytes() == DATA
    assert mirror.requests[-1][1] == "bytes=3000-"
    assert left(cache) == [PATH]


def test_server_without_ranges_sends_it_all_again(cache: Path, mirror: Mirror) -> None:
    mirror.ranges = False
    mirror.answers = [-100_000]
    assert get(mirror)[0].read_bytes() == DATA
    assert [wanted for _, wanted in mirror.requests] == [None, "bytes=100000-"]


def test_another_range_than_asked_for_is_not_used(cache: Path, mirror: Mirror) -> None:
    mirror.wrong_range = True
    mirror.answers = [-100_000]
    assert get(mirror)[0].read_bytes() == DATA
    assert [wanted for _, wanted in mirror.requests] == [None, "bytes=100000-", None]


@pytest.mark.parametrize("status", [500, 503, 429])
def test_failures_that_may_pass_are_tried_again(cache: Path, mirror: Mirror, status: int) -> None:
    mirror.answers = [status, status]
    assert get(mirror)[0].read_bytes() == DATA
    mirror.requests.clear()
    mirror.answers = [status] * 3
    with pytest.raises(InputError, match=f"the server answered {status} .*, 3 times"):
        get(mirror, one_file("pose2d/other.g2o"))
    assert len(mirror.requests) == 3


@pytest.mark.parametrize("status", [400, 403, 404, 410])
def test_refusals_are_not_tried_again(cache: Path, mirror: Mirror, status: int) -> None:
    mirror.answers = [status]
    with pytest.raises(InputError, match=f"world.g2o: the server answered {status}"):
        get(mirror)
    assert len(mirror.requests) == 1


def test_missing_file_is_said_to_be_missing(cache: Path, mirror: Mirror) -> None:
    with pytest.raises(InputError, match="404") as caught:
        get(mirror, one_file("pose2d/absent.g2o"))
    assert caught.value.details == ("  the mirror does not have this file",)


def test_waits_grow(cache: Path, mirror: Mirror, monkeypatch: pytest.MonkeyPatch) -> None:
    waits: list[float] = []
    monkeypatch.setattr(time, "sleep", waits.append)
    mirror.answers = [500] * 9
    get(mirror, policy=Policy(retries=9, wait=0.5, timeout=5.0))
    assert waits == [0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 30.0, 30.0]


def test_no_server(cache: Path) -> None:
    with pytest.raises(InputError, match="no connection to the server, 3 times"):
        fetch(one_file(), "http://127.0.0.1:1", policy=QUICK)


def test_wrong_hash_is_not_kept(cache: Path, mirror: Mirror) -> None:
    mirror.files[PATH] = DATA[:-1] + b"?"
    with pytest.raises(InputError, match="is another file") as caught:
        get(mirror)
    assert hashlib.sha256(DATA).hexdigest() in caught.value.details[0]
    assert left(cache) == []


def test_wrong_hash_leaves_the_file_that_is_there(cache: Path, mirror: Mirror) -> None:
    (cache / PATH).parent.mkdir(parents=True)
    (cache / PATH).write_bytes(b"old")
    mirror.files[PATH] = DATA[:-1] + b"?"
    with pytest.raises(InputError, match="is another file"):
        get(mirror)
    assert (cache / PATH).read_bytes() == b"old"
    assert left(cache) == [PATH]


@pytest.mark.parametrize("length", [True, False])
@pytest.mark.parametrize("content", [DATA + b"more", b"<html>Please log in</html>"])
def test_wrong_size_is_not_kept(cache: Path, mirror: Mirror, content: bytes, length: bool) -> None:
    mirror.files[PATH], mirror.length = content, length
    expected = "expected" if length or len(content) > len(DATA) else r"closed after 26 of 300000 bytes, 3 times"
    with pytest.raises(InputError, match=expected):
        get(mirror)
    assert not (cache / PATH).exists()


def test_part_of_another_file_is_thrown_away(cache: Path, mirror: Mirror) -> None:
    part = cache / (PATH + ".part")
    part.parent.mkdir(parents=True)
    part.write_bytes(bytes(1000))
    assert get(mirror)[0].read_bytes() == DATA
    assert [wanted for _, wanted in mirror.requests] == ["bytes=1000-", None]
    assert left(cache) == [PATH]


@pytest.mark.parametrize("content", [DATA, DATA + b"more"])
def test_part_that_is_full_or_too_long(cache: Path, mirror: Mirror, content: bytes) -> None:
    part = cache / (PATH + ".part")
    part.parent.mkdir(parents=True)
    part.write_bytes(content)
    assert get(mirror)[0].read_bytes() == DATA
    assert len(mirror.requests) == (0 if content == DATA else 1)


def test_folder_fetches_what_is_missing(cache: Path, mirror: Mirror) -> None:
    names = {"raw/log/a.txt": b"a" * 10, "raw/log/b c#.txt": b"b" * 20}
    mirror.files |= {path.replace(" ", "%20").replace("#", "%23"): data for path, data in names.items()}
    files = tuple(FileEntry(path, hashlib.sha256(data).hexdigest(), len(data)) for path, data in names.items())
    entry = replace(one_file(), path="raw/log", files=files)
    assert get(mirror, entry) == (cache / "raw/log", 30)
    assert left(cache) == sorted(names)
    (cache / "raw/log/a.txt").unlink()
    mirror.requests.clear()
    assert get(mirror, entry) == (cache / "raw/log", 10)
    assert mirror.requests == [("/raw/log/a.txt", None)]


def test_unwritable_cache(cache: Path, mirror: Mirror) -> None:
    cache.parent.parent.mkdir(parents=True)
    cache.parent.write_text("a file where the folder should be")
    with pytest.raises(InputError, match=r"world.g2o: cannot be written: "):
        get(mirror)


def test_folder_in_the_place_of_the_part(cache: Path, mirror: Mirror) -> None:
    (cache / (PATH + ".part")).mkdir(parents=True)
    with pytest.raises(InputError, match=r"world.g2o.part: cannot be written: "):
        get(mirror)


@pytest.mark.skipif(sys.platform == "win32", reason="needs setrlimit")
def test_full_disk(cache: Path, mirror: Mirror) -> None:
    """As far as a process can have one of its own: no file may be longer than 100 kB."""
    import resource

    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limits[1]))
    try:
        with pytest.raises(InputError, match="part: cannot be written: File too large"):
            get(mirror)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert left(cache) == [PATH + ".part"]
    assert get(mirror)[0].read_bytes() == DATA


@pytest.mark.skipif(sys.platform == "win32", reason="needs flock")
def test_two_at_once(cache: Path, mirror: Mirror) -> None:
    import fcntl

    part = cache / (PATH + ".part")
    part.parent.mkdir(parents=True)
    with open(part, "wb") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        with pytest.raises(InputError, match="another process is downloading"):
            get(mirror)
    assert get(mirror)[0].read_bytes() == DATA


def test_no_mirror(cache: Path) -> None:
    with pytest.raises(UsageError, match="no mirror is named") as caught:
        fetch(one_file(), None)
    assert any("nobody/nothing: world.g2o" in line for line in caught.value.details)


def test_addresses() -> None:
    assert mirror_url("https://x.org/a/", "b/c d.g2o") == "https://x.org/a/b/c%20d.g2o"
    assert mirror_url("http://x.org?key=1", "b.g2o") == "http://x.org/b.g2o?key=1"
    assert without_password("https://me:secret@x.org:8080/a") == "https://x.org:8080/a"
    for wrong in ("ftp://x.org", "/a/folder", "x.org", "https://", ""):
        with pytest.raises(UsageError, match="no http or https address"):
            mirror_url(wrong, "b.g2o")


def test_password_is_not_shown(cache: Path, mirror: Mirror) -> None:
    with pytest.raises(InputError) as caught:
        fetch(one_file("absent.g2o"), mirror.url.replace("//", "//me:secret@"), policy=QUICK)
    assert "secret" not in caught.value.message + "".join(caught.value.details)


def fetching(mirror: Mirror, cache_home: Path, *words: str) -> subprocess.Popen[str]:
    """``slamcli datasets fetch`` in a process of its own."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("SLAMCLI_")}
    environment = {**kept, "XDG_CACHE_HOME": str(cache_home), "SLAMCLI_DATASETS_MIRROR": mirror.url}
    command = [sys.executable, "-m", "slamcli", "datasets", "fetch", *words]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_command_goes_on_after_a_failure(cache: Path, mirror: Mirror, tmp_path: Path) -> None:
    process = fetching(mirror, tmp_path / "cache", "sphere2500", "square_toro", "square_toro")
    out, err = process.communicate(timeout=60)
    assert process.returncode == 3
    assert err.startswith("error: ")
    assert "sphere2500.g2o: the server answered 404" in err
    assert len(out.splitlines()) == 1
    assert out.startswith("square_toro: was here: ")


@pytest.mark.skipif(sys.platform == "win32", reason="needs SIGINT")
def test_interruption_leaves_the_part(cache: Path, tmp_path: Path) -> None:
    with serving(Mirror({"pose2d/noisyToyGraph.txt": b"x" * 637}, length=False, answers=[-100] * 100)) as mirror:
        process = fetching(mirror, tmp_path / "cache", "noisyToyGraph", "--retries", "90")
        part = cache / "pose2d/noisyToyGraph.txt.part"
        deadline = time.monotonic() + 30.0
        while time.monotonic() < deadline and not (part.exists() and part.stat().st_size > 0):
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert (out, err) == ("", "slamcli: interrupted\n")
    assert left(cache) == ["pose2d/noisyToyGraph.txt.part"]
    assert 0 < part.stat().st_size < 637
