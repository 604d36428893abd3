"""The types of INPUT arguments: a file, or the name of a data set of the registry."""

from __future__ import annotations

import os
import sys
from typing import Any

import click


class Input(click.Path):
    """A path; where nothing exists under it, the name of a data set, which becomes the path of its file.

    Parameters
    ----------
    worlds
        Whether the command also takes the name of a simulated world, which then comes before a data set's.
    """

    def __init__(self, *, worlds: bool = False) -> None:
        super().__init__(allow_dash=True)
        self.worlds = worlds

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path as it was given if it exists or names no data set: the reader says that it is not there."""
        text = str(super().convert(value, param, ctx))
        if text in ("", "-") or os.path.exists(text) or (ctx is not None and ctx.resilient_parsing):
            return text
        if self.worlds:
            from slamcli.simulation.worlds import WORLDS

            if text in WORLDS:
                return text
        from slamcli.batch.datasets.search import checked, find, nearest
        from slamcli.errors import InputError

        found = find(text)
        if found is None:
            close = nearest(text)
            if close:
                details = (f"  did you mean the data set {' or '.join(close)}?",)
                raise InputError(f"{text}: cannot be read: No such file or directory", details)
            return text
        path = str(checked(found))
        print(f"reading the data set {found.name}: {path}", file=sys.stderr)
        return path


INPUT = Input()
INPUT_OR_WORLD = Input(worlds=True)
