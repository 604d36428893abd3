"""Configuration files: YAML mappings, and what to say about keys that do not exist."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any

from slamcli.errors import UsageError


def load_mapping(path: str) -> dict[str, Any]:
    """Content of a YAML file of keys with values; an empty file has none.

    Raises
    ------
    UsageError
        If it cannot be read, is not YAML or is something else than a mapping.
    """
    import yaml  # only where there is a file

    try:
        with open(path, encoding="utf-8") as stream:
            content = yaml.load(stream, Loader=_strict(yaml))
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise UsageError(f"{path}: is not valid YAML", (f"  {error}".replace("\n", "\n  "),)) from None
    if content is None:
        return {}
    if not isinstance(content, dict):
        raise UsageError(f"{path}: expected keys with values, found {type(content).__name__}")
    return content


def _strict(yaml: Any) -> Any:
    """A loader of plain YAML that refuses a key that stands twice: the first would be lost in silence."""

    class Loader(yaml.SafeLoader):  # type: ignore[misc]
        def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
            words = [str(key.value).replace("-", "_") for key, _ in node.value]
            for (key, _), word in zip(node.value, words, strict=True):
                if words.count(word) > 1:
                    raise yaml.constructor.ConstructorError(None, None, f"the key {word} stands twice", key.start_mark)
            return super().construct_mapping(node, deep)

    return Loader


def line_of(path: str, where: str) -> int | None:
    """Line of a dotted key of a YAML file, from 1; of as much of it as is there, None of nothing.

    For messages: the file is read again. Keys may have dots themselves (``axes.options.method``), and ``-`` is as good
    as ``_``.
    """
    import yaml

    try:
        with open(path, encoding="utf-8") as stream:
            node: Any = yaml.compose(stream, Loader=yaml.SafeLoader)
    except (OSError, yaml.YAMLError, ValueError, RecursionError):
        return None
    line, rest = None, where.replace("-", "_")
    while rest and node is not None and node.id == "mapping":
        words = {str(key.value).replace("-", "_"): (key, value) for key, value in node.value}
        found = max((word for word in words if f"{rest}.".startswith(f"{word}.")), key=len, default=None)
        if found is None:
            break
        key, node = words[found]
        line, rest = key.start_mark.line + 1, rest[len(found) + 1 :]
    return line


def suggestion(name: str, known: Iterable[str], what: str = "known") -> str:
    """A line that names the nearest of the known words, or all of them."""
    words = list(known)
    close = difflib.get_close_matches(name, words, n=1)
    return f"  did you mean {close[0]}?" if close else f"  {what}: {', '.join(words)}"
