"""Whether a file is the one that the registry means."""

from __future__ import annotations

import hashlib
from pathlib import Path

from slamcli.batch.datasets.entries import FileEntry


def check_file(path: Path, file: FileEntry) -> str | None:
    """What is wrong with a file that should have this size and hash, None if nothing is."""
    try:
        size = path.stat().st_size
        if size != file.bytes:
            return f"expected {file.bytes} bytes, found {size}"
        with open(path, "rb") as stream:
            found = hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        return f"cannot be read: {error.strerror}"
    return None if found == file.sha256 else f"expected the sha256 {file.sha256}, found {found}"
