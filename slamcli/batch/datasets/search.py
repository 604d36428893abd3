"""Finds data sets: by name in the registry, by path in the folders of the search path."""

from __future__ import annotations

import os
import re
from pathlib import Path

from slamcli.batch.datasets.entries import DatasetEntry
from slamcli.batch.datasets.files import check_file
from slamcli.batch.datasets.registry import bundled_folder, load, plain
from slamcli.errors import InputError, UsageError

#: Folders with data sets, as in PATH.
VARIABLE = "SLAMCLI_DATASETS"


def resolve(name_or_path: str | Path) -> Path:
    """The file, or folder, of a data set; what exists under this path wins over a name.

    Parameters
    ----------
    name_or_path
        A path, a name, an alias, or a path of the registry such as ``pose3d/sphere2500.g2o``.

    Returns
    -------
    Path
        Exists. If it was found by name, sizes and hashes are those of the registry.

    Raises
    ------
    UsageError
        If there is no data set of this name, or several.
    InputError
        If it is in no folder of the search path, its file there is another one, or what looks like a path leads
        nowhere.
    """
    if os.path.isfile(name_or_path):
        return Path(name_or_path)
    found = find(name_or_path)
    if found is None and os.path.isdir(name_or_path):
        return Path(name_or_path)
    if found is None and _is_path(str(name_or_path)):
        details = ("  and no data set has this path", *suggestions(name_or_path))
        raise InputError(f"{name_or_path}: cannot be read: there is no such file", details)
    return checked(entry(name_or_path) if found is None else found)


def available(name: str | Path) -> bool:
    """Whether all files of a data set are in the search path (or the file exists); they are not checked.

    Raises
    ------
    UsageError
        If there is no such data set, or several.
    """
    return os.path.isfile(name) or locate(entry(name)) is not None


def entry(name: str | Path) -> DatasetEntry:
    """What the registry knows about a data set, by name, alias or path; the case of letters does not count.

    Raises
    ------
    UsageError
        If there is no such data set, or several.
    """
    found = find(name)
    if found is None:
        raise UsageError(f"there is no data set {str(name)!r}", suggestions(name))
    return found


def find(name: str | Path) -> DatasetEntry | None:
    """The same, but None if there is no such data set.

    Raises
    ------
    UsageError
        If there are several.
    """
    text = _plain(name)
    registry = load().values()
    found = [e for e in registry if text in (_plain(e.name), _plain(e.path))]
    found = found or [e for e in registry if text in map(_plain, e.aliases)]
    if len(found) > 1:
        width = max(len(e.name) for e in found)
        lines = (f"  {e.name:{width}}  {e.format}, {e.summary()}" for e in found)
        raise UsageError(f"{len(found)} data sets are called {str(name)!r}", (*lines, "  give the name of one of them"))
    return found[0] if found else None


def checked(found: DatasetEntry) -> Path:
    """The file or folder of a data set, its files checked.

    Raises
    ------
    InputError
        If it is in no folder of the search path, or has another size or hash than in the registry.
    """
    folder = locate(found)
    if folder is None:
        raise InputError(f"the data set {found.name} is not here", missing_details(found))
    for file in found.files:
        problem = check_file(folder / file.path, file)
        if problem:
            raise InputError(
                f"{folder / file.path}: is not the file of the data set {found.name}",
                (f"  {problem}", f"  remove it, or get the right one with slamcli datasets fetch {found.name}"),
            )
    return folder / found.path


def locate(found: DatasetEntry) -> Path | None:
    """The first folder of the search path that holds all files of a data set, None if there is none."""
    for folder in folders():
        if all(os.path.isfile(folder / file.path) for file in found.files):  # False, too, where it is not allowed
            return folder
    return None


def location(found: DatasetEntry) -> Path | None:
    """The file or folder of a data set in the search path, None if it is not there; it is not checked."""
    folder = locate(found)
    return None if folder is None else folder / found.path


def folders() -> list[Path]:
    """The search path: those of SLAMCLI_DATASETS, the user's cache, the bundled ones."""
    # os.path's: a user that there is not leaves the name as it is
    given = [Path(os.path.expanduser(part)) for part in os.environ.get(VARIABLE, "").split(os.pathsep) if part]
    return [*given, cache_folder(), bundled_folder()]


def cache_folder() -> Path:
    """Where fetched data sets go."""
    import platformdirs

    return Path(platformdirs.user_cache_dir("slamcli", appauthor=False)) / "datasets"


def missing_details(found: DatasetEntry) -> tuple[str, ...]:
    """What to do about a data set that is in no folder: where it was looked for, and how to get it."""
    return (
        f"  looked for {found.path} in {', '.join(map(str, folders()))}",
        f"  from {found.source.repository}" + (f": {found.source.path}" if found.source.path else ""),
        f"  name a folder that holds it in {VARIABLE}, or get it from a mirror:",
        f"  slamcli datasets fetch {found.name} --mirror URL",
    )


def nearest(name: str | Path) -> list[str]:
    """Names, aliases or paths of data sets that are spelt like a name which there is not; none for a path."""
    import difflib

    if os.sep in str(name) or os.path.lexists(name):
        return []
    words = {_plain(word): word for e in load().values() for word in (e.path, *e.aliases, e.name)}
    # M3500.g2o: the path without its folder
    files = [word for plain, word in words.items() if plain.endswith(f"/{_plain(name)}")]
    if files or _is_path(str(name)):
        return files[:3]
    return [words[word] for word in difflib.get_close_matches(_plain(name), words, n=3, cutoff=0.75)]


def suggestions(name: str | Path) -> tuple[str, ...]:
    """Lines about the data sets that a name which there is not may mean."""
    import difflib

    text = _plain(name)
    registry = load().values()
    words = {_plain(word): word for e in registry for word in (e.path, *e.aliases, e.name)}
    close = nearest(name) or [words[word] for word in difflib.get_close_matches(text, words, n=3)]
    # names that hold the word, where nothing is spelt like it
    close = close or [e.name for e in registry if len(text) > 2 and text in _plain(e.name)][:3]
    meant = (f"  did you mean {' or '.join(close)}?",) if close else ()
    return (*meant, "  slamcli datasets list shows all of them")


def _is_path(name: str) -> bool:
    """Whether a word is meant as the path of a file: it has a folder or an ending such as .g2o."""
    return os.sep in name or re.search(r"\.[A-Za-z]\w*$", name) is not None


def _plain(name: str | Path) -> str:
    return plain(str(name).replace(os.sep, "/"))
