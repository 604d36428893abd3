"""From a figure to the bytes of a file."""

from __future__ import annotations

import io
import os
import warnings
from typing import Any

from matplotlib.figure import Figure

from slamcli.errors import UsageError

FORMATS = ("png", "svg", "pdf")


def format_of(path: str, option: str = "--output") -> str:
    """Format by the ending of the path that an option gave; ``-`` is PNG.

    Raises
    ------
    UsageError
        If the ending is not one of ``FORMATS``.
    """
    if path == "-":
        return "png"
    ending = os.path.splitext(path)[1].removeprefix(".").lower()
    if ending not in FORMATS:
        found = f"ends in .{ending}" if ending else "has no ending"
        raise UsageError(f"{option} {path} {found}", ("  expected .png, .svg or .pdf: the ending decides the format",))
    return ending


def render(figure: Figure, kind: str, dpi: int) -> tuple[bytes, list[str]]:
    """The bytes of a picture and what matplotlib had to say about it.

    No date and no random id goes into them: the same figure gives the same bytes.
    """
    metadata: dict[str, Any] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind, {})
    stream = io.BytesIO()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        figure.savefig(stream, format=kind, dpi=dpi, metadata=metadata)
    missing = sum("missing from font" in str(warning.message) for warning in caught)
    notes = [f"{missing} characters of titles or names are not in the font: boxes stand for them"] if missing else []
    return stream.getvalue(), notes
