"""A YAML file as a tree whose values know their lines, so that a message can name the place."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from slamcli.errors import UsageError
from slamcli.formats.configuration import suggestion

_TEXT = "tag:yaml.org,2002:str"
#: Signs that no terminal shows and no command line takes; YAML has ways to write them.
_UNSEEN = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff]")


@dataclass(frozen=True, eq=False)
class Node:
    """A value of a YAML file.

    Attributes
    ----------
    path, line
        Of the file; from 1.
    value
        A dict of words to nodes, a list of nodes, or a plain value.
    written
        A plain value as the file has it: names such as ``1e3`` and ``yes`` are words there.
    """

    path: str
    line: int
    value: Any
    written: str = ""

    def error(self, message: str, *details: str) -> UsageError:
        """An error at this place."""
        return UsageError(f"{self.path}:{self.line}: {message}", details)

    def mapping(self, what: str) -> dict[str, Node]:
        """Its values by key."""
        if not isinstance(self.value, dict):
            raise self.error(f"{what}: expected keys with values, found {self._shown()}")
        return self.value

    def fields(self, what: str, known: Iterable[str], required: Iterable[str] = ()) -> dict[str, Node]:
        """The same of which every key must be among those known, and those required must be there."""
        names = (*required, *known)
        found = self.mapping(what)
        for name, node in found.items():
            if name not in names:
                raise node.error(f"unknown key {name!r} of {what}", suggestion(name, names))
        for name in required:
            if name not in found:
                raise self.error(f"the key {name!r} of {what} is missing")
        return found

    def items(self, what: str) -> list[Node]:
        """Its items."""
        if not isinstance(self.value, list):
            raise self.error(f"{what}: expected a list, found {self._shown()}")
        return self.value

    def text(self, what: str) -> str:
        """A word or a text that is not empty."""
        if not isinstance(self.value, str) or not self.value.strip():
            raise self.error(f"{what}: expected a word, found {self._shown()}")
        return self.value

    def word(self, what: str) -> str:
        """A plain value as it is written, which may be a number."""
        if isinstance(self.value, dict | list) or not self.written.strip():
            raise self.error(f"{what}: expected a word or a text, found {self._shown()}")
        return self.written

    def flag(self, what: str) -> bool:
        """True or false."""
        if not isinstance(self.value, bool):
            raise self.error(f"{what}: expected true or false, found {self._shown()}")
        return self.value

    def count(self, what: str, least: int) -> int:
        """An integer."""
        if type(self.value) is not int or self.value < least:
            raise self.error(f"{what}: expected an integer from {least} on, found {self._shown()}")
        return self.value

    def number(self, what: str, least: float = float("-inf")) -> float:
        """A finite number."""
        try:  # YAML takes 1e-6 for a word
            value = float("nan") if isinstance(self.value, bool | dict | list) else float(self.value)
        except (TypeError, ValueError, OverflowError):
            value = float("nan")
        if not least <= value < float("inf") or value == float("-inf"):
            wanted = "a number" if least == float("-inf") else f"a number from {least:g} on"
            raise self.error(f"{what}: expected {wanted}, found {self._shown()}")
        return value

    def choice(self, what: str, known: Iterable[str]) -> str:
        """One of several words."""
        names = tuple(known)
        text = self.word(what)
        if text not in names:
            raise self.error(f"{what}: unknown word {text!r}", suggestion(text, names))
        return text

    def plain(self) -> Any:
        """The value without places."""
        if isinstance(self.value, dict):
            return {name: node.plain() for name, node in self.value.items()}
        if isinstance(self.value, list):
            return [node.plain() for node in self.value]
        return self.value

    def _shown(self) -> str:
        if isinstance(self.value, dict):
            return "keys with values"
        if isinstance(self.value, list):
            return "a list"
        if self.value is None:
            return "nothing"
        return repr(self.value) if isinstance(self.value, str) else self.written


def load(path: Path) -> Node:
    """The tree of a file.

    Raises
    ------
    UsageError
        If it cannot be read, is not YAML, is empty, or has a key twice.
    """
    import yaml

    base = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # the one in C is ten times as fast
    if path.exists() and not path.is_file():  # a device may have no end
        raise UsageError(f"{path}: is no file")
    try:
        with open(path, "rb") as stream:
            loader = base(stream)
            try:
                root = loader.get_single_node()
                if root is None:
                    raise UsageError(f"{path}: is empty")
                return _Tree(str(path), loader).node(root)
            finally:
                loader.dispose()
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise UsageError(f"{path}: is not valid YAML", (f"  {error}".replace("\n", "\n  "),)) from None


class _Tree:
    """Makes nodes of PyYAML's, which have ``id`` (scalar, sequence, mapping), ``tag``, ``value`` and ``start_mark``."""

    def __init__(self, path: str, loader: Any) -> None:
        self.path = path
        self.loader = loader
        #: What is there by another name (``*name``) is made once, else a few lines could ask for more than fits.
        self.made: dict[int, Node] = {}

    def node(self, found: Any) -> Node:
        """The node of one of PyYAML's."""
        if id(found) not in self.made:
            self.made[id(found)] = self._made(found)
        return self.made[id(found)]

    def _made(self, found: Any) -> Node:
        line = found.start_mark.line + 1
        if found.id == "mapping":
            return Node(self.path, line, self._mapping(found))
        if found.id == "sequence":
            return Node(self.path, line, [self.node(item) for item in found.value])
        return Node(self.path, line, self._plain(found), str(found.value))

    def _plain(self, found: Any) -> Any:
        if unseen := _UNSEEN.search(found.value):
            line = found.start_mark.line + 1
            raise UsageError(f"{self.path}:{line}: {unseen[0]!r} can be in no name, option or path")
        return found.value if found.tag == _TEXT else self.loader.construct_object(found, deep=True)

    def _mapping(self, found: Any) -> dict[str, Node]:
        values: dict[str, Node] = {}
        for key, value in found.value:
            line = key.start_mark.line + 1
            if key.id != "scalar":
                raise UsageError(f"{self.path}:{line}: expected a word as a key")
            name = str(key.value)
            self._plain(key)
            if name in values:
                raise UsageError(f"{self.path}:{line}: the key {name!r} stands twice")
            # the line of the key: that of a value may be the next one
            values[name] = replace(self.node(value), line=line)
        return values
