"""Bytes in and out: paths and standard streams, gzip by content, atomic output files."""

from __future__ import annotations

import contextlib
import os
import stat
import sys
import tempfile
from pathlib import Path

from slamcli.errors import InputError

_GZIP = b"\x1f\x8b"
_UTF16 = (b"\xff\xfe", b"\xfe\xff")


def read_bytes(path: str) -> tuple[bytes, bytes]:
    """Content of a file or of standard input (``-``), as it is and decompressed.

    Raises
    ------
    InputError
        If it cannot be read, or is not text.
    """
    try:
        raw = sys.stdin.buffer.read() if path == "-" else Path(path).read_bytes()
    except IsADirectoryError:
        raise InputError(f"{path}: is a directory, expected a graph file") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    data = _decompress(path, raw) if raw.startswith(_GZIP) else raw
    if data.startswith(_UTF16):
        raise InputError(f"{path}: is UTF-16 text, expected ASCII or UTF-8", ("  hint: convert it with iconv",))
    if b"\0" in data[:65536]:
        raise InputError(f"{path}: is a binary file, expected g2o or TORO text")
    return raw, data


def _decompress(path: str, raw: bytes) -> bytes:
    import gzip  # lazily: rarely needed
    import zlib

    try:
        return gzip.decompress(raw)
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{path}: damaged gzip file: {error}") from None


def write_bytes(path: str, data: bytes) -> None:
    """Write a file atomically (a temporary file beside it, then a rename), or to standard output (``-``).

    A path that ends in ``.gz`` is compressed. Devices and pipes are written directly. A failure leaves an
    existing file as it was.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    if path == "-":
        sys.stdout.buffer.write(data)
        sys.stdout.buffer.flush()
        return
    if path.endswith(".gz"):
        import gzip

        data = gzip.compress(data, mtime=0)
    target = Path(os.path.realpath(path))
    try:
        if target.exists() and not target.is_file():
            if target.is_dir():
                raise IsADirectoryError(21, "is a directory")
            target.write_bytes(data)
            return
        _replace(target, data)
    except BrokenPipeError:
        raise
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}; an existing file is unchanged") from None


def _replace(target: Path, data: bytes) -> None:
    handle, temporary = tempfile.mkstemp(prefix=f".{target.name}.", dir=target.parent)
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
        os.chmod(temporary, stat.S_IMODE(target.stat().st_mode) if target.exists() else 0o666 & ~_umask())
        os.replace(temporary, target)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(temporary)
        raise


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
