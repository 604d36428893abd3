"""A YAML file as a tree whose values know their lines, so that a message can name the place."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slamcli.errors import UsageError
from slamcli.formats.configuration import suggestion


@dataclass(frozen=True, eq=False)
class Node:
    """A value of a YAML file.

    Attributes
    ----------
    path, line
        Of the file; from 1.
    value
        A dict of words to nodes, a list of nodes, or a plain value.
    """

    path: str
    line: int
    value: Any

    def error(self, message: str, *details: str) -> UsageError:
        """An error at this place."""
        return UsageError(f"{self.path}:{self.line}: {message}", details)

    def mapping(self, what: str) -> dict[str, Node]:
        """Its values by key."""
        if not isinstance(self.value, dict):
            raise self.error(f"{what}: expected keys with values, found {self._shown()}")
        return self.value

    def fields(self, what: str, known: Iterable[str]) -> dict[str, Node]:
        """The same of which every key must be among those known."""
        names = tuple(known)
        found = self.mapping(what)
        for name, node in found.items():
            if name not in names:
                raise node.error(f"unknown key {name!r} of {what}", suggestion(name, names))
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
        text = str(self.value)
        if text not in names:
            raise self.error(f"{what}: {text!r} is none of {', '.join(names)}")
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
        return "nothing" if self.value is None else repr(self.value)


def load(path: Path) -> Node:
    """The tree of a file.

    Raises
    ------
    UsageError
        If it cannot be read, is not YAML, is empty, or has a key twice.
    """
    import yaml

    if path.exists() and not path.is_file():  # a device may have no end
        raise UsageError(f"{path}: is no file")
    try:
        with open(path, encoding="utf-8") as stream:
            loader = yaml.SafeLoader(stream)
            try:
                root = loader.get_single_node()
                if root is None:
                    raise UsageError(f"{path}: is empty")
                return _node(str(path), root, loader)
            finally:
                loader.dispose()
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise UsageError(f"{path}: is not valid YAML", (f"  {error}".replace("\n", "\n  "),)) from None


def _node(path: str, found: Any, loader: Any) -> Node:
    line = found.start_mark.line + 1
    if found.id == "mapping":
        values: dict[str, Node] = {}
        for key, value in found.value:
            if key.id != "scalar":
                raise UsageError(f"{path}:{key.start_mark.line + 1}: expected a word as a key")
            name = str(key.value)
            if name in values:
                raise UsageError(f"{path}:{key.start_mark.line + 1}: the key {name!r} stands twice")
            # the line of the key: that of a value may be the next one
            values[name] = Node(path, key.start_mark.line + 1, _node(path, value, loader).value)
        return Node(path, line, values)
    if found.id == "sequence":
        return Node(path, line, [_node(path, item, loader) for item in found.value])
    return Node(path, line, loader.construct_object(found, deep=True))
