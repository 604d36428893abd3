"""Bytes in and out: paths and standard streams, gzip and bzip2 by content, atomic output files."""

from __future__ import annotations

import contextlib
import os
import sys

from slamcli.errors import InputError

_GZIP, _BZIP2 = b"\x1f\x8b", b"BZh"
_UTF16 = (b"\xff\xfe", b"\xfe\xff")


def read_bytes(path: str) -> tuple[bytes, bytes]:
    """Content of a file or of standard input (``-``), as it is and decompressed.

    Raises
    ------
    InputError
        If it cannot be read, or is not text.
    """
    try:
        if path == "-":
            if sys.stdin is None:
                raise InputError("standard input is closed")
            raw = sys.stdin.buffer.read()
        else:
            with open(path, "rb") as stream:
                raw = stream.read()
    except IsADirectoryError:
        raise InputError(f"{path}: is a directory, expected a graph file") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    data = _decompress(path, raw) if raw.startswith((_GZIP, _BZIP2)) else raw
    if data.startswith(_UTF16):
        raise InputError(f"{path}: is UTF-16 text, expected ASCII or UTF-8", ("  hint: convert it with iconv",))
    if b"\0" in data:
        raise InputError(f"{path}: is a binary file, expected g2o or TORO text")
    return raw, data


def _decompress(path: str, raw: bytes) -> bytes:
    import bz2  # lazily: rarely needed
    import gzip
    import zlib

    name, decompress = ("bzip2", bz2.decompress) if raw.startswith(_BZIP2) else ("gzip", gzip.decompress)
    try:
        return decompress(raw)
    except (OSError, EOFError, ValueError, zlib.error) as error:
        raise InputError(f"{path}: damaged {name} file: {error}") from None


def write_bytes(path: str, data: bytes) -> None:
    """Write a file atomically (a temporary file beside it, then a rename), or to standard output (``-``).

    A path that ends in ``.gz`` or ``.bz2`` is compressed. Devices and pipes are written directly. A failure leaves an
    existing file as it was.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    if path == "-":
        rest = memoryview(data)
        while rest:  # under PYTHONUNBUFFERED a write may be partial
            rest = rest[sys.stdout.buffer.write(rest) :]
        sys.stdout.buffer.flush()
        return
    if path.endswith(".gz"):
        import gzip

        data = gzip.compress(data, mtime=0)
    elif path.endswith(".bz2"):
        import bz2

        data = bz2.compress(data)
    try:
        if os.path.exists(path) and not os.path.isfile(path):
            # the path as it was given: what /dev/stdout points at may have no name
            with open(path, "wb") as stream:
                stream.write(data)
        else:
            _replace(os.path.realpath(path), data)
    except BrokenPipeError:
        raise
    except OSError as error:
        kept = "; the existing file is unchanged" if os.path.isfile(path) else ""
        raise InputError(f"{path}: cannot be written: {error.strerror}{kept}") from None


def _replace(target: str, data: bytes) -> None:
    """Write beside the target and rename; the mode of an existing file is kept."""
    folder = os.path.dirname(target)
    temporary = os.path.join(folder, f".slamcli-{os.urandom(6).hex()}.tmp")
    mode = os.stat(target).st_mode & 0o7777 if os.path.exists(target) else None
    handle = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666 if mode is None else 0o600)
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
        if mode is not None:
            os.chmod(temporary, mode)
        os.replace(temporary, target)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(temporary)
        raise
