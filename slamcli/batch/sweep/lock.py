"""One sweep at a time in a folder."""

from __future__ import annotations

import contextlib
import json
import os
import socket
from collections.abc import Iterator
from pathlib import Path

from slamcli.errors import UsageError

NAME = "lock"


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder.

    The operating system holds it for as long as this process lives, so that none is left behind by a process that was
    killed; the file says who has it.

    Raises
    ------
    UsageError
        If another process has it.
    OSError
        If the file cannot be written.
    """
    path = folder / NAME
    handle = _acquired(path)
    try:
        os.ftruncate(handle, 0)
        os.pwrite(handle, json.dumps({"pid": os.getpid(), "host": socket.gethostname()}).encode(), 0)
        yield
    finally:
        with contextlib.suppress(OSError):
            path.unlink()
        os.close(handle)


def _acquired(path: Path) -> int:
    import fcntl  # not everywhere

    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if _same(handle, path):
                return handle
        except BlockingIOError:
            who = _holder(handle)
            os.close(handle)
            raise UsageError(
                f"{path.parent}: another sweep is at work on this folder{who}",
                ("  wait for it, or give this one a folder of its own with -o",),
            ) from None
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)  # its last holder has just removed the file


def _same(handle: int, path: Path) -> bool:
    """Whether the file that is open is still the one under this path."""
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except FileNotFoundError:
        return False


def _holder(handle: int) -> str:
    try:
        holder = json.loads(os.pread(handle, 4096, 0))
        return f": process {holder['pid']} on {holder['host']}"
    except (OSError, ValueError, KeyError):
        return ""
