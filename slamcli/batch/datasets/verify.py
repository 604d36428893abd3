"""Checks the files of data sets: size and hash, and what a reader counts in them."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from slamcli.batch.datasets.entries import DatasetEntry
from slamcli.batch.datasets.files import check_file
from slamcli.batch.datasets.search import locate
from slamcli.errors import SlamcliError


@dataclass(frozen=True)
class Check:
    """What came of checking one data set.

    Attributes
    ----------
    name
        Of the data set.
    status
        ``ok``, ``wrong`` or ``missing``.
    path
        The file or folder that was checked, None if it is missing.
    problems
        What is wrong, one sentence each.
    counts
        What was counted, empty unless that was asked for.
    """

    name: str
    status: str
    path: str | None
    problems: tuple[str, ...] = ()
    counts: dict[str, int] = field(default_factory=dict)


def verify(entry: DatasetEntry, *, deep: bool = False) -> Check:
    """Check the files of a data set in the first folder of the search path that holds them.

    Parameters
    ----------
    entry
        What is known about it.
    deep
        Also read it and compare what it holds.
    """
    folder = locate(entry)
    if folder is None:
        return Check(entry.name, "missing", None)
    path = folder / entry.path
    found = [(file.path, check_file(folder / file.path, file)) for file in entry.files]
    problems = [f"{name}: {problem}" if entry.is_folder else problem for name, problem in found if problem]
    counts: dict[str, int] = {}
    if deep and not problems:
        try:
            counts = count(path, entry.reader)
        except SlamcliError as error:
            problems = [f"cannot be read: {error.message}"]
        else:
            problems = [
                f"expected {expected} {name.replace('_', ' ')}, found {counts.get(name, 'none')}"
                for name, expected in entry.counts.items()
                if counts.get(name) != expected
            ]
    return Check(entry.name, "wrong" if problems else "ok", str(path), tuple(problems), counts)


def count(path: Path, reader: str) -> dict[str, int]:
    """What a data set holds, by the names of ``registry.COUNTS``, counted by one of ``entries.READERS``.

    Raises
    ------
    SlamcliError
        If the reader refuses it.
    """
    if reader == "graph":
        from slamcli.formats import read
        from slamcli.graph import analyze

        graph = read(str(path))
        closures = analyze(graph).loop_closure_count
        return {"poses": graph.poses, "landmarks": graph.landmarks, "edges": graph.edges, "loop_closures": closures}
    if reader == "log":
        from slamcli.formats.logs.read import read_log

        log = read_log(str(path))
        return {"steps": len(log.times), "readings": sum(len(readings) for readings in log.observations)}
    from slamcli.formats.source import read_bytes

    return {"lines": len(read_bytes(str(path))[1].splitlines())}
