"""Which variables go: the rules of ``--keep`` and ``--remove``."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from slamcli.errors import UsageError
from slamcli.graph import FactorGraph
from slamcli.graph.columns import BoolArray

_RULES = "every:N, landmarks-only, poses-only, or ids such as 0,10,20-29"
_RANGE = re.compile(r"\d{1,20}-\d{1,20}", re.ASCII)
_ID = re.compile(r"-?\d{1,20}", re.ASCII)
_LONGEST_RANGE = 10_000_000


def removed_by(graph: FactorGraph, keep: str | None, remove: str | None) -> tuple[dict[str, BoolArray], int]:
    """The variables to remove, as one mask for each kind, and how many of them FIX lines save.

    Parameters
    ----------
    graph
        The graph.
    keep
        ``every:N`` keeps every Nth pose in the order of the ids, from the first on, and all landmarks;
        ``landmarks-only`` and ``poses-only`` keep one sort; ids and ranges of ids keep these.
    remove
        The same for what is removed; ``every:N`` removes every Nth pose. One of both is None.

    Raises
    ------
    UsageError
        If a rule cannot be read, an id does not exist, or nothing or everything would be removed.
    """
    option, rule = ("--keep", keep) if keep is not None else ("--remove", remove)
    if rule is None or (keep is not None and remove is not None):
        raise UsageError("say what goes: --keep RULE or --remove RULE, one of them", (f"  RULE is {_RULES}",))
    named = _named(graph, option, rule.strip())
    removed = {name: ~mask for name, mask in named.items()} if keep is not None else named
    saved = 0
    if keep is not None or not _ID.match(rule.strip()):  # who names an id means it
        for name, column in graph.variables.items():
            saved += int(np.count_nonzero(removed[name] & column.fixed))
            removed[name] &= ~column.fixed
    count = sum(int(mask.sum()) for mask in removed.values())
    total = sum(len(column) for column in graph.variables.values())
    if count == 0:
        raise UsageError(f"{option} {rule} removes nothing")
    if count == total:
        raise UsageError(f"{option} {rule} removes everything")
    return removed, saved


def _named(graph: FactorGraph, option: str, rule: str) -> dict[str, BoolArray]:
    """The variables that a rule names."""
    if rule.startswith("every:"):
        return _every(graph, option, rule)
    sorts = {"landmarks": False, "landmarks-only": False, "poses": True, "poses-only": True}
    if rule in sorts:
        return {
            name: np.full(len(column), column.kind.is_pose is sorts[rule]) for name, column in graph.variables.items()
        }
    return by_ids(graph, option, rule)


def _every(graph: FactorGraph, option: str, rule: str) -> dict[str, BoolArray]:
    text = rule.removeprefix("every:")
    if not (text.isascii() and text.isdigit() and int(text[:12]) >= 2 and len(text) <= 12):
        raise UsageError(f"{option} {rule}: expected every:N with a whole number N of 2 or more")
    landmarks = option == "--keep"
    return {
        name: column.rank % int(text) == 0 if column.kind.is_pose else np.full(len(column), landmarks)
        for name, column in graph.variables.items()
    }


def by_ids(graph: FactorGraph, option: str, rule: str) -> dict[str, BoolArray]:
    """The variables of a list of ids and ranges of ids such as ``0,10,20-29``, as one mask for each kind.

    Raises
    ------
    UsageError
        If the list cannot be read, or an id does not exist.
    """
    masks = {name: np.zeros(len(column), dtype=bool) for name, column in graph.variables.items()}
    for low, high in _ranges(option, rule):
        found = False
        for name, column in graph.variables.items():
            if low == high:
                row = column.row_of(low)
                hit = np.arange(len(column)) == row
            else:
                hit = (column.ids >= low) & (column.ids <= high)
            masks[name] |= hit
            found |= bool(hit.any())
        if not found:
            ids = ", ".join(f"{n} {c.ids.min()} to {c.ids.max()}" for n, c in graph.variables.items() if len(c))
            what = f"the id {low}" if low == high else f"an id from {low} to {high}"
            raise UsageError(f"{option}: no variable has {what}", (f"  ids in this graph: {ids}",))
    return masks


def _ranges(option: str, rule: str) -> Iterator[tuple[int, int]]:
    for part in rule.split(","):
        word = part.strip()
        if _RANGE.fullmatch(word):
            low, high = (int(bound) for bound in word.split("-"))
            if low > high or high - low > _LONGEST_RANGE:
                raise UsageError(f"{option} {rule}: {word} is no range of ids")
            yield low, high
        elif _ID.fullmatch(word):
            yield int(word), int(word)
        else:
            raise UsageError(f"{option} {rule}: {word!r} is no id", (f"  expected {_RULES}",))
