"""Options that several subcommands share, and where their values come from."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import click

from slamcli.cli.inputs import INPUT
from slamcli.errors import UsageError

F = TypeVar("F", bound=Callable[..., Any])

DIALECTS = ("g2o", "toro", "bal", "bal-pinhole", "bundler")

#: A file name, completed as such by the shell; whether it can be read is for the reader to say.
FILE = click.Path(allow_dash=True)


def input_options(function: F) -> F:
    """``INPUT --dialect --lenient``."""
    function = click.option(
        "--lenient", is_flag=True, help="Skip, count and show malformed records instead of stopping at them."
    )(function)
    function = click.option(
        "--dialect", type=click.Choice(DIALECTS), help="Format of INPUT.  [default: recognized by content]"
    )(function)
    return click.argument("input", metavar="INPUT", type=INPUT)(function)


def json_option(function: F) -> F:
    """``--json``."""
    return click.option("--json", is_flag=True, help="Print one JSON document instead of text.")(function)


def worst_option(function: F) -> F:
    """``--worst``."""
    return click.option(
        "--worst",
        type=click.IntRange(min=0),
        default=0,
        metavar="N",
        help="List the N edges with the largest chi2, with their lines.",
    )(function)


def color_option(function: F) -> F:
    """``--color``."""
    return click.option(
        "--color",
        type=click.Choice(["auto", "always", "never"]),
        default="auto",
        show_default=True,
        help="Colour the output. auto: on a terminal, unless NO_COLOR is set.",
    )(function)


def use_color(choice: str, stream: Any) -> bool:
    """Whether to colour what goes to a stream."""
    if choice == "auto":
        return bool(stream.isatty()) and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
    return choice == "always"


def check_outputs(
    given: dict[str, Any], names: tuple[str, ...], *, json: bool, inputs: Iterable[str | None] = ()
) -> None:
    """Standard output carries one thing, and each output file, too. ``/dev/stdout`` becomes ``-``.

    Raises
    ------
    UsageError
        If two outputs want one place, or one has no name or that of one of the ``inputs``.
    """
    sources = {os.path.realpath(path) for path in inputs if path not in (None, "-")}
    seen: dict[str, str] = {}
    for name in names:
        if given[name] in ("/dev/stdout", "/dev/fd/1"):
            given[name] = "-"
        if given[name] == "" or (given[name] or "").endswith("/"):
            raise UsageError(f"--{name.replace('_', '-')} needs the name of a file, got {given[name]!r}")
        if given[name] not in (None, "-"):
            shown = name.replace("_", "-")
            other = seen.setdefault(os.path.realpath(given[name]), shown)
            if other != shown:
                raise UsageError(f"--{other} and --{shown} name the same file")
            if os.path.realpath(given[name]) in sources:
                raise UsageError(f"--{shown} {given[name]} is an input and would be overwritten")
    takers = [name.replace("_", "-") for name in names if given[name] == "-"] + ["json"] * json
    if len(takers) > 1:
        raise UsageError(
            f"--{takers[0]} and --{takers[1]} both want standard output", ("  write one of them to a file",)
        )


def warn(lines: list[str]) -> None:
    """Print warnings on standard error."""
    for line in lines:
        print(f"warning: {line}", file=sys.stderr)


def merge_config(
    context: click.Context, path: str | None, given: dict[str, Any], names: tuple[str, ...]
) -> dict[str, Any]:
    """Values of options: flags beat environment beat the config file beat defaults.

    Parameters
    ----------
    context
        Knows where each value came from.
    path
        A YAML file with option names as keys, or None.
    given
        Values as click parsed them.
    names
        The options that a config file may set.

    Raises
    ------
    UsageError
        If the file cannot be read, is not a mapping or has unknown keys.
    """
    if path is None:
        return given
    defaults = (None, click.core.ParameterSource.DEFAULT)
    config = _load_config(path, names)
    return given | {key: value for key, value in config.items() if context.get_parameter_source(key) in defaults}


def _load_config(path: str, names: tuple[str, ...]) -> dict[str, Any]:
    from slamcli.formats.configuration import load_mapping, suggestion

    out = {}
    for key, value in load_mapping(path).items():
        name = str(key).replace("-", "_")
        if name not in names:
            raise UsageError(f"{path}: unknown option {key!r}", (suggestion(name, names),))
        out[name] = value
    return out
