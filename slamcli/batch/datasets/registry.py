"""Reads the registry: the YAML files of ``datasets/registry``, one for each group, strictly."""

from __future__ import annotations

import functools
import re
from pathlib import Path
from typing import Any

from slamcli.batch.datasets.entries import CONVENTIONS, READERS, DatasetEntry, FileEntry, Optimum, Source
from slamcli.errors import UsageError
from slamcli.formats.configuration import suggestion

_REQUIRED = ("about", "path", "format", "reader", "source")
_OPTIONAL = ("aliases", "dialect", "sha256", "bytes", "files", "counts", "start", "optimum", "chordal_optimum")
_SOURCE = ("repository", "path", "licence", "obtained")
_OPTIMUM = ("chi2", "convention", "source")
_FILE = ("path", "sha256", "bytes")
#: What may be counted: of a graph, of a sensor log, of any text.
COUNTS = ("poses", "landmarks", "edges", "loop_closures", "steps", "readings", "lines")

#: A node of PyYAML: with ``id`` (scalar, sequence, mapping), ``value`` and ``start_mark``.
Node = Any

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
        If two have the same name or path.
    """
    for what in ("name", "path"):
        seen: dict[str, DatasetEntry] = {}
        for entry in entries:
            other = seen.setdefault(getattr(entry, what).casefold(), entry)
            if other is not entry:
                raise UsageError(
                    f"registry: {entry.name} ({entry.group}) has the {what} of {other.name} ({other.group})"
                )
    return {entry.name: entry for entry in entries}


def read_file(path: Path) -> list[DatasetEntry]:
    """The data sets of one registry file, whose stem is their group.

    Raises
    ------
    UsageError
        If it cannot be read or breaks a rule; the message names file and line.
    """
    import yaml

    base = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # the one in C is ten times as fast
    try:
        with open(path, "rb") as stream:
            loader = base(stream)
            try:
                root = loader.get_single_node()
                return _Reader(str(path), loader).entries(root, path.stem)
            finally:
                loader.dispose()
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}") from None
    except (yaml.YAMLError, RecursionError) as error:
        raise UsageError(f"{path}: is not valid YAML", (f"  {error}".replace("\n", "\n  "),)) from None


class _Reader:
    """Makes entries of YAML nodes, which know their lines."""

    def __init__(self, path: str, loader: Any) -> None:
        self.path = path
        self.loader = loader

    def entries(self, root: Node | None, group: str) -> list[DatasetEntry]:
        """The entries of a file: a mapping of names."""
        if root is None:
            raise UsageError(f"{self.path}: is empty, expected names with what is known about them")
        return [self._entry(key, name, node, group) for name, (key, node) in self._mapping(root).items()]

    def _entry(self, key: Node, name: str, node: Node, group: str) -> DatasetEntry:
        if not _NAME.fullmatch(name):
            raise self._error(key, f"{name!r} cannot be a name", "  letters, digits and _ . + - can be in one")
        fields = self._fields(node, _REQUIRED, _OPTIONAL, f"of {name}")
        path = self._path(fields["path"])
        if ("files" in fields) == ("sha256" in fields) or ("sha256" in fields) != ("bytes" in fields):
            raise self._error(key, f"{name} needs either sha256 and bytes, or files")
        if "files" in fields:
            files = tuple(self._file(item, path) for item in self._items(fields["files"]))
        else:
            files = (FileEntry(path, self._hash(fields["sha256"]), self._count(fields["bytes"])),)
        return DatasetEntry(
            name=name,
            group=group,
            about=self._text(fields["about"]),
            path=path,
            files=files,
            format=self._text(fields["format"]),
            reader=self._choice(fields["reader"], READERS),
            source=self._source(fields["source"]),
            aliases=tuple(self._text(item) for item in self._items(fields.get("aliases"))),
            dialect=self._text(fields["dialect"]) if "dialect" in fields else "",
            counts=self._counts(fields.get("counts")),
            start=self._number(fields["start"]) if "start" in fields else None,
            optimum=self._optimum(fields.get("optimum")),
            chordal_optimum=self._optimum(fields.get("chordal_optimum")),
        )

    def _source(self, node: Node) -> Source:
        fields = self._fields(node, _SOURCE, (), "of a source")
        return Source(**{key: self._text(value) for key, value in fields.items()})

    def _optimum(self, node: Node | None) -> Optimum | None:
        if node is None:
            return None
        fields = self._fields(node, _OPTIMUM, (), "of an optimum")
        convention = self._choice(fields["convention"], tuple(CONVENTIONS))
        return Optimum(self._number(fields["chi2"]), convention, self._text(fields["source"]))

    def _file(self, node: Node, folder: str) -> FileEntry:
        fields = self._fields(node, _FILE, (), "of a file")
        path = f"{folder}/{self._path(fields['path'])}"
        return FileEntry(path, self._hash(fields["sha256"]), self._count(fields["bytes"]))

    def _counts(self, node: Node | None) -> dict[str, int]:
        if node is None:
            return {}
        return {key: self._count(value) for key, value in self._fields(node, (), COUNTS, "of counts").items()}

    def _fields(self, node: Node, required: tuple[str, ...], optional: tuple[str, ...], what: str) -> dict[str, Node]:
        """The values of a mapping with just these keys."""
        found = self._mapping(node)
        known = required + optional
        for name, (key, _) in found.items():
            if name not in known:
                raise self._error(key, f"unknown key {name!r} {what}", suggestion(name, known))
        missing = [name for name in required if name not in found]
        if missing:
            raise self._error(node, f"the key {missing[0]!r} {what} is missing")
        return {name: value for name, (_, value) in found.items()}

    def _mapping(self, node: Node) -> dict[str, tuple[Node, Node]]:
        """Keys of a mapping with the nodes of key and value; a key that stands twice is refused."""
        if node.id != "mapping":
            raise self._error(node, f"expected keys with values, found a {node.id}")
        found: dict[str, tuple[Node, Node]] = {}
        for key, value in node.value:
            name = self._text(key)
            if name in found:
                raise self._error(key, f"the key {name!r} stands twice")
            found[name] = (key, value)
        return found

    def _items(self, node: Node | None) -> list[Node]:
        if node is None:
            return []
        if node.id != "sequence":
            raise self._error(node, f"expected a list, found a {node.id}")
        return list(node.value)

    def _text(self, node: Node) -> str:
        """A scalar as it is written: names such as 1e3 or yes stay words."""
        if node.id != "scalar":
            raise self._error(node, f"expected a word or a text, found a {node.id}")
        return str(node.value)

    def _path(self, node: Node) -> str:
        text = self._text(node)
        if not text or "\\" in text or any(part in ("", ".", "..") for part in text.split("/")):
            raise self._error(node, f"{text!r} is no relative path", "  with / between folders, and neither . nor ..")
        return text

    def _hash(self, node: Node) -> str:
        text = self._text(node)
        if not _SHA256.fullmatch(text):
            raise self._error(node, f"{text!r} is no sha256", "  64 digits of 0-9 and a-f")
        return text

    def _choice(self, node: Node, known: tuple[str, ...]) -> str:
        text = self._text(node)
        if text not in known:
            raise self._error(node, f"unknown word {text!r}", suggestion(text, known))
        return text

    def _count(self, node: Node) -> int:
        value = self.loader.construct_object(node, deep=True)
        if type(value) is not int or value < 0:
            raise self._error(node, f"expected a count, found {node.value!r}")
        return value

    def _number(self, node: Node) -> float:
        try:  # not YAML's own rule, for which 1e9 is a word
            value = float(self._text(node))
        except ValueError:
            value = float("nan")
        if not 0.0 <= value < float("inf"):
            raise self._error(node, f"expected a number from 0 on, found {node.value!r}")
        return value

    def _error(self, node: Node, message: str, *details: str) -> UsageError:
        return UsageError(f"{self.path}:{node.start_mark.line + 1}: {message}", details)
