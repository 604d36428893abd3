"""Downloads one file over HTTP so that it can be resumed: a ``.part`` file is kept until all bytes are there."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING
from urllib.parse import quote, urlsplit, urlunsplit

from slamcli.errors import InputError, UsageError

if TYPE_CHECKING:
    import requests

#: Answers that may be other ones in a while.
_PASSING = frozenset({408, 425, 429, 500, 502, 503, 504})
_CHUNK = 1 << 14
_LONGEST_WAIT = 30.0  # seconds
_ANOTHER = "  the mirror has another file under this name"


@dataclass(frozen=True)
class Policy:
    """How patient a download is.

    Attributes
    ----------
    retries
        How often it is tried again after a failure that may pass.
    wait
        Seconds before the first of them; each further wait is twice as long, 30 s at most.
    timeout
        Seconds without an answer, or without a byte of it, that count as a failure.
    """

    retries: int = 4
    wait: float = 0.5
    timeout: float = 30.0


class Interruption(Exception):
    """A failure that may pass: what it was, in words."""


def mirror_url(mirror: str, path: str) -> str:
    """The address of a file on a mirror.

    Raises
    ------
    UsageError
        If the mirror is no http or https address.
    """
    try:
        parts = urlsplit(mirror)
        labels = (parts.hostname or "").rstrip(".").split(".")
        # a colon is an address of version 6; a port that is none raises as well
        is_host = ":" in labels[0] or (all(0 < len(label) < 64 for label in labels) and parts.port != 0)
    except ValueError:
        is_host = False
    if not is_host or parts.scheme not in ("http", "https"):
        raise UsageError(
            f"--mirror {mirror.rpartition('@')[2]}: is no http or https address",
            ("  a folder of this machine needs no mirror: name it in SLAMCLI_DATASETS",),
        )
    return urlunsplit(parts._replace(path=f"{parts.path.rstrip('/')}/{quote(path)}"))


def without_password(url: str) -> str:
    """An address as it may be shown."""
    parts = urlsplit(url)
    return urlunsplit(parts._replace(netloc=parts.netloc.rpartition("@")[2]))


def download(url: str, part: Path, size: int, policy: Policy, progress: Callable[[int], None]) -> None:
    """Bring a file of known size to ``part``, from where an earlier attempt ended.

    Parameters
    ----------
    url
        Where it is.
    part
        Where to; what this file holds already is not asked for again, if the server knows ranges.
    size
        Bytes of the whole file.
    policy
        How often to try.
    progress
        Called with the number of bytes that are there.

    Raises
    ------
    InputError
        If the server does not have it, has another one, or fails too often. What came stays in ``part``.
    """
    import requests

    failures = 0
    with _opened(part) as stream, requests.Session() as session:
        while True:
            try:
                _attempt(session, url, stream, size, policy.timeout, progress)
                return
            except (requests.TooManyRedirects, ValueError):  # in any words, which may hold passwords
                shown = without_password(url)
                raise InputError(f"{shown}: leads to an address that is none, or round in circles") from None
            except (Interruption, requests.RequestException) as error:
                reason = _reason(error)
            failures += 1
            if failures > policy.retries:
                have = stream.tell()
                kept = f"  {have} of {size} bytes are kept; the same command goes on from there"
                raise InputError(
                    f"{without_password(url)}: {reason}, {failures} time{'s' * (failures > 1)}", (kept,) if have else ()
                )
            time.sleep(min(policy.wait * 2.0 ** (failures - 1), _LONGEST_WAIT))


def _attempt(
    session: requests.Session,
    url: str,
    stream: IO[bytes],
    size: int,
    timeout: float,
    progress: Callable[[int], None],
) -> None:
    """One request for what is missing, written behind what is there."""
    have = stream.seek(0, os.SEEK_END)
    if have > size:
        have = _restart(stream)
    progress(have)
    if have == size:
        return
    headers = {"Accept-Encoding": "identity"}  # bytes as they are stored: ranges count these
    if have:
        headers["Range"] = f"bytes={have}-"
    with session.get(url, headers=headers, stream=True, timeout=timeout) as answer:
        _refuse(url, answer)
        sent = answer.headers.get("Content-Range" if answer.status_code == 206 else "Content-Length", "")
        if (answer.status_code == 206 and not sent.startswith(f"bytes {have}-")) or answer.status_code == 416:
            _restart(stream)
            raise Interruption("the server sent another part than was asked for")
        if answer.status_code == 200:  # all of it, whatever was asked for
            have = _restart(stream)
            if sent.isdigit() and int(sent) != size:
                raise InputError(f"{without_password(url)}: has {sent} bytes, expected {size}", (_ANOTHER,))
        answer.raw.enforce_content_length = False  # else the last piece of a broken answer would be lost
        for chunk in answer.iter_content(_CHUNK):
            have += len(chunk)
            if have > size:
                _restart(stream)
                raise InputError(f"{without_password(url)}: is longer than the expected {size} bytes", (_ANOTHER,))
            stream.write(chunk)
            progress(have)
    if have < size:
        raise Interruption(f"the connection was closed after {have} of {size} bytes")


def _refuse(url: str, answer: requests.Response) -> None:
    """Raise what an answer other than the file means."""
    code = answer.status_code
    if code in _PASSING:
        raise Interruption(f"the server answered {code} {answer.reason}")
    if code not in (200, 206, 416):
        details = ("  the mirror does not have this file",) if code in (404, 410) else ()
        raise InputError(f"{without_password(url)}: the server answered {code} {answer.reason}", details)
    if code != 416 and answer.headers.get("Content-Type", "").startswith("text/html"):
        raise InputError(
            f"{without_password(url)}: the server answered with a web page",
            ("  it may want a login, or call this file otherwise",),
        )


def _restart(stream: IO[bytes]) -> int:
    stream.seek(0)
    stream.truncate()
    return 0


@contextlib.contextmanager
def _opened(part: Path) -> Iterator[IO[bytes]]:
    """The ``.part`` file, for this process alone; an empty one is not left behind."""
    try:
        with _locked(part) as stream:
            try:
                yield stream
            except BaseException:
                if stream.tell() == 0 == os.fstat(stream.fileno()).st_size:
                    part.unlink(missing_ok=True)
                raise
    except OSError as error:  # of the network it is dealt with where it occurs
        raise InputError(f"{part}: cannot be written: {error.strerror}") from None


def _locked(part: Path) -> IO[bytes]:
    while True:
        stream = os.fdopen(os.open(part, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666), "r+b")
        try:
            import fcntl
        except ImportError:  # Windows
            return stream
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            stream.close()
            raise InputError(f"{part}: another process is downloading this file") from None
        with contextlib.suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(stream.fileno()), part.stat()):
                return stream
        stream.close()  # another process has just put it in its place


def _reason(error: Exception) -> str:
    """A failure that may pass, in a few words: those of requests are full of names of its objects."""
    import requests
    from urllib3.exceptions import ReadTimeoutError

    # that of a body comes as a ConnectionError
    if isinstance(error, requests.Timeout) or any(isinstance(cause, ReadTimeoutError) for cause in error.args):
        return "the server did not answer in time"
    if isinstance(error, requests.exceptions.SSLError):
        return "its certificate was not accepted"
    if isinstance(error, requests.exceptions.ContentDecodingError):
        return "the file came in an encoding that it has not"
    if isinstance(error, requests.exceptions.ChunkedEncodingError):
        return "the connection was closed early"
    if isinstance(error, requests.ConnectionError):
        return "no connection to the server"
    return str(error)
