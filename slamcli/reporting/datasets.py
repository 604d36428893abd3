"""Tables and documents of ``slamcli datasets``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slamcli.reporting.documents import head
from slamcli.reporting.text import plural, table

if TYPE_CHECKING:
    from slamcli.batch.datasets.entries import DatasetEntry, Optimum
    from slamcli.batch.datasets.verify import Check

_SHOWN = ("poses", "landmarks", "edges")


def list_table(entries: Sequence[DatasetEntry], found: dict[str, Path | None]) -> list[str]:
    """Lines of ``slamcli datasets list``: a row for each data set, and how many are here."""
    rows = [["name", "group", "format", *_SHOWN, "optimum", "here"]]
    for entry in entries:
        counts = [str(entry.counts[name]) if entry.counts.get(name) else "" for name in _SHOWN]
        optimum = f"{entry.optimum.chi2:.9g}" if entry.optimum else ""
        rows.append([entry.name, entry.group, entry.format, *counts, optimum, "yes" if found[entry.name] else "no"])
    here = sum(path is not None for path in found.values())
    total = plural(len(entries), "data set")
    return [*(table(rows, "<<<>>>><") if entries else []), f"{total}, {here} of them here"]


def show_lines(entry: DatasetEntry, conventions: dict[str, str], path: Path | None) -> list[str]:
    """Lines of ``slamcli datasets show``."""
    rows = [("name", entry.name), ("also", ", ".join(entry.aliases)), ("is", entry.about), ("group", entry.group)]
    rows += [("format", entry.format + (f"; {entry.dialect}" if entry.dialect else ""))]
    rows += [("holds", ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in entry.counts.items() if count))]
    rows += [("from", ": ".join(filter(None, (entry.source.repository, entry.source.path))))]
    rows += [("obtained", entry.source.obtained), ("licence", entry.source.licence)]
    if entry.start is not None:
        rows += [("chi2", f"{entry.start:.12g} at the values of the file")]
    for optimum in (entry.optimum, entry.chordal_optimum):
        if optimum is not None:
            rows += [("optimum", f"{optimum.chi2:.12g} by {optimum.source}"), ("", conventions[optimum.convention])]
    for file in entry.files:
        rows += [("file", f"{file.path}, {file.bytes} bytes"), ("sha256", file.sha256)]
    rows += [("here", str(path) if path else f"no; slamcli datasets fetch {entry.name} --mirror URL gets it")]
    return [f"{name:8}  {text}".rstrip() for name, text in rows if text]


def verify_lines(checks: Sequence[Check], named: bool) -> list[str]:
    """Lines of ``slamcli datasets verify``: what is wrong, what is missing if it was named, and the counts."""
    lines = []
    for check in checks:
        if check.status == "wrong":
            lines += [f"wrong    {check.name}: {check.path}", *(f"         {problem}" for problem in check.problems)]
        elif check.status == "ok" and named:
            lines.append(f"ok       {check.name}: {check.path}")
        elif named:
            lines.append(f"missing  {check.name}")
    numbers = [sum(check.status == status for check in checks) for status in ("ok", "wrong", "missing")]
    ok, wrong, missing = numbers
    return [*lines, f"{plural(len(checks), 'data set')}: {ok} as they should be, {wrong} wrong, {missing} not here"]


def list_document(entries: Sequence[DatasetEntry], found: dict[str, Path | None]) -> dict[str, Any]:
    """The document of ``slamcli datasets list --json``."""
    return {**head("datasets list"), "datasets": [_section(entry, found[entry.name]) for entry in entries]}


def show_document(entry: DatasetEntry, path: Path | None) -> dict[str, Any]:
    """The document of ``slamcli datasets show --json``."""
    return {**head("datasets show"), "dataset": _section(entry, path)}


def verify_document(checks: Sequence[Check], exit_code: int) -> dict[str, Any]:
    """The document of ``slamcli datasets verify --json``."""
    return {**head("datasets verify"), "exit_code": exit_code, "checks": [asdict(check) for check in checks]}


def _section(entry: DatasetEntry, path: Path | None) -> dict[str, Any]:
    return {
        "name": entry.name,
        "aliases": list(entry.aliases),
        "group": entry.group,
        "about": entry.about,
        "path": entry.path,
        "format": entry.format,
        "dialect": entry.dialect,
        "reader": entry.reader,
        "sha256": entry.sha256,
        "bytes": entry.bytes,
        "files": [asdict(file) for file in entry.files],
        "counts": entry.counts,
        "source": asdict(entry.source),
        "initial_chi2": entry.start,
        "optimum": _optimum(entry.optimum),
        "chordal_optimum": _optimum(entry.chordal_optimum),
        "available": path is not None,
        "location": None if path is None else str(path),
    }


def _optimum(optimum: Optimum | None) -> dict[str, Any] | None:
    return None if optimum is None else asdict(optimum)
