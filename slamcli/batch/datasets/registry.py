"""Reads the registry: the YAML files of ``datasets/registry``, one for each group, strictly."""

from __future__ import annotations

import functools
import re
from pathlib import Path

from slamcli.batch.datasets.entries import CONVENTIONS, READERS, DatasetEntry, FileEntry, Optimum, Source
from slamcli.errors import UsageError
from slamcli.formats import yaml_nodes
from slamcli.formats.configuration import line_of
from slamcli.formats.yaml_nodes import Node

_REQUIRED = ("about", "path", "format", "reader", "source")
_OPTIONAL = ("aliases", "dialect", "sha256", "bytes", "files", "counts", "start", "optimum", "chordal_optimum")
_SOURCE = ("repository", "path", "licence", "obtained")
_OPTIMUM = ("chi2", "convention", "source")
_FILE = ("path", "sha256", "bytes")
#: What may be counted: of a graph, of a sensor log, of any text.
COUNTS = ("poses", "landmarks", "edges", "loop_closures", "steps", "readings", "lines")

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+-]*")
_SHA256 = re.compile(r"[0-9a-f]{64}")


def bundled_folder() -> Path:
    """The folder of the registry and of the bundled data sets: in the package, or beside it in a checkout."""
    package = Path(__file__).parents[2]
    installed = package / "_datasets"
    return installed if installed.is_dir() else package.parent / "datasets"


@functools.cache
def load() -> dict[str, DatasetEntry]:
    """All data sets by name, in the order of the files; read once in a process.

    Raises
    ------
    UsageError
        If a registry file cannot be read or breaks a rule; the message names file and line.
    """
    folder = bundled_folder() / "registry"
    files = sorted(folder.glob("*.yaml"))
    if not files:
        raise UsageError(f"{folder}: holds no registry of data sets", ("  slamcli is not completely installed",))
    return merge([entry for file in files for entry in read_file(file)])


def merge(entries: list[DatasetEntry]) -> dict[str, DatasetEntry]:
    """Entries by name.

    Raises
    ------
    UsageError
        If two have the same name or path, or an alias is a name already.
    """
    seen: dict[str, DatasetEntry] = {}
    for entry in entries:
        for what in ("name", "path"):
            other = seen.setdefault(plain(getattr(entry, what)), entry)
            if other is not entry:
                raise UsageError(
                    f"{_place(entry)}: {entry.name} has the {what} of {other.name}", (f"  {_place(other)}",)
                )
    for entry in entries:
        aliases = list(map(plain, entry.aliases))
        for alias in entry.aliases:
            owner = seen.get(plain(alias))
            if owner is not None:
                whose = "its own" if owner is entry else "a data set's"
                raise UsageError(f"{_place(entry)}: the alias {alias} of {entry.name} is {whose} name")
            if aliases.count(plain(alias)) > 1:
                raise UsageError(f"{_place(entry)}: the alias {alias} of {entry.name} stands twice")
    return {entry.name: entry for entry in entries}


def plain(name: str) -> str:
    """As names are compared: the case of letters does not count, a hyphen is as good as an underscore."""
    return name.casefold().replace("-", "_")


def _place(entry: DatasetEntry) -> str:
    """File and line of an entry."""
    path = str(bundled_folder() / "registry" / f"{entry.group}.yaml")
    return f"{path}:{line_of(path, entry.name) or '?'}"


def read_file(path: Path) -> list[DatasetEntry]:
    """The data sets of one registry file, whose stem is their group.

    Raises
    ------
    UsageError
        If it cannot be read or breaks a rule; the message names file and line.
    """
    return [_entry(name, node, path.stem) for name, node in yaml_nodes.load(path).mapping("a registry").items()]


def _entry(name: str, node: Node, group: str) -> DatasetEntry:
    if not _NAME.fullmatch(name):
        raise node.error(f"{name!r} cannot be a name", "  letters, digits and _ . + - can be in one")
    fields = node.fields(name, _OPTIONAL, _REQUIRED)
    path = _path(fields["path"])
    if ("files" in fields) == ("sha256" in fields) or ("sha256" in fields) != ("bytes" in fields):
        raise node.error(f"{name} needs either sha256 and bytes, or files")
    if "files" in fields:
        files = tuple(_file(item, path) for item in fields["files"].items("files"))
    else:
        files = (FileEntry(path, _hash(fields["sha256"]), fields["bytes"].count("bytes", 0)),)
    return DatasetEntry(
        name=name,
        group=group,
        about=fields["about"].word("about"),
        path=path,
        files=files,
        format=fields["format"].word("format"),
        reader=fields["reader"].choice("reader", READERS),
        source=_source(fields["source"]),
        aliases=_aliases(fields.get("aliases")),
        dialect=fields["dialect"].word("dialect") if "dialect" in fields else "",
        counts=_counts(fields.get("counts")),
        start=fields["start"].number("start", 0.0) if "start" in fields else None,
        optimum=_optimum(fields.get("optimum")),
        chordal_optimum=_optimum(fields.get("chordal_optimum")),
    )


def _source(node: Node) -> Source:
    fields = node.fields("a source", (), _SOURCE)
    # a source without a path is one that the project made itself
    return Source(**{key: value.written if key == "path" else value.word(key) for key, value in fields.items()})


def _optimum(node: Node | None) -> Optimum | None:
    if node is None:
        return None
    fields = node.fields("an optimum", (), _OPTIMUM)
    convention = fields["convention"].choice("convention", CONVENTIONS)
    return Optimum(fields["chi2"].number("chi2", 0.0), convention, fields["source"].word("source"))


def _file(node: Node, folder: str) -> FileEntry:
    fields = node.fields("a file", (), _FILE)
    path = f"{folder}/{_path(fields['path'])}"
    return FileEntry(path, _hash(fields["sha256"]), fields["bytes"].count("bytes", 0))


def _aliases(node: Node | None) -> tuple[str, ...]:
    return tuple(item.word("an alias") for item in node.items("aliases")) if node is not None else ()


def _counts(node: Node | None) -> dict[str, int]:
    if node is None:
        return {}
    return {key: value.count(key, 0) for key, value in node.fields("counts", COUNTS).items()}


def _path(node: Node) -> str:
    text = node.word("path")
    if "\\" in text or any(part in ("", ".", "..") for part in text.split("/")):
        raise node.error(f"{text!r} is no relative path", "  with / between folders, and neither . nor ..")
    return text


def _hash(node: Node) -> str:
    text = node.word("sha256")
    if not _SHA256.fullmatch(text):
        raise node.error(f"{text!r} is no sha256", "  64 digits of 0-9 and a-f")
    return text
