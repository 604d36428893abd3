"""Fetches data sets from a mirror into the user's cache: pooch checks and puts in place, ``download`` resumes."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

from slamcli.batch.datasets.download import Policy, download, mirror_url, without_password
from slamcli.batch.datasets.entries import DatasetEntry, FileEntry
from slamcli.batch.datasets.files import check_file
from slamcli.batch.datasets.search import cache_folder, locate
from slamcli.errors import InputError, UsageError

#: The environment variable of the mirror.
VARIABLE = "SLAMCLI_DATASETS_MIRROR"


def fetch(
    entry: DatasetEntry,
    mirror: str | None,
    *,
    policy: Policy | None = None,
    progress: Callable[[str, int, int], None] = lambda path, done, size: None,
) -> tuple[Path, int]:
    """Bring a data set into the user's cache, unless it is in the search path already.

    Parameters
    ----------
    entry
        What to fetch.
    mirror
        The address of a folder that holds the files under the paths of the registry; not needed for what is there.
    policy
        How patient to be.
    progress
        Called with the path of a file, the bytes that are there, and the bytes that it has.

    Returns
    -------
    Path
        The file or folder.
    int
        Bytes of the files that were fetched; 0 if it was there.

    Raises
    ------
    UsageError
        If there is no mirror, or it is no address.
    InputError
        If a file cannot be fetched, is another one than in the registry, or cannot be written; or if a wrong file
        stands earlier in the search path and would hide it.
    """
    cache = cache_folder()
    folder = locate(entry)
    if folder is not None:
        wrong = [file for file in entry.files if check_file(folder / file.path, file)]
        if not wrong:
            return folder / entry.path, 0
        if folder != cache:
            raise InputError(
                f"{folder / wrong[0].path}: is not the file of the data set {entry.name}",
                ("  it would hide the right one, since its folder comes first: remove it",),
            )
    if mirror is None:
        raise UsageError(
            f"the data set {entry.name} is not here, and no mirror is named",
            (
                "  slamcli brings no data and knows no mirror of its own: --mirror URL (or " + VARIABLE + ")",
                f"  names a folder on a web server that holds {entry.files[0].path}",
                f"  the original is in {entry.source.repository}: {entry.source.path}",
            ),
        )
    missing = [file for file in entry.files if check_file(cache / file.path, file)]
    for file in missing:
        _fetch_file(file, mirror, cache, policy or Policy(), progress)
    return cache / entry.path, sum(file.bytes for file in missing)


def _fetch_file(
    file: FileEntry, mirror: str, cache: Path, policy: Policy, progress: Callable[[str, int, int], None]
) -> None:
    """Bring one file into the cache; a wrong ``.part`` of an earlier time is thrown away once."""
    import pooch

    pooch.get_logger().setLevel(logging.ERROR)  # what is fetched is told by whoever asked
    target = cache / file.path
    part = target.with_name(target.name + ".part")
    resumed = part.exists()

    def bring(url: str, output: str, caller: Any) -> None:
        download(url, part, file.bytes, policy, lambda done: progress(file.path, done, file.bytes))
        part.replace(output)

    url = mirror_url(mirror, file.path)
    folder = pooch.create(cache, base_url=mirror, registry={file.path: file.sha256}, urls={file.path: url})
    try:
        try:
            folder.fetch(file.path, downloader=bring)
        except ValueError:
            if not resumed:
                raise
            folder.fetch(file.path, downloader=bring)
    except ValueError:  # pooch's word for another hash
        raise InputError(
            f"{without_password(url)}: is another file: it has the size but not the sha256 of the registry",
            (f"  expected {file.sha256}", "  it was not kept"),
        ) from None
    except PermissionError as error:  # whose text pooch writes
        raise InputError(f"{target}: cannot be written: {error.strerror or 'Permission denied'}") from None
    except OSError as error:
        raise InputError(f"{target}: cannot be written: {error.strerror}") from None
