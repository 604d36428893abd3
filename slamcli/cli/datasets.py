"""``slamcli datasets``: the registry of standard data sets."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import click

from slamcli.cli.options import json_option
from slamcli.errors import ExitCode, InputError, SlamcliError, UsageError

_EXAMPLES = """\b
Examples:
  slamcli datasets list --available
  slamcli datasets show sphere2500
  slamcli datasets fetch sphere2500 torus3D --mirror https://example.org/slam
  slamcli optimize $(slamcli datasets path sphere2500)
  slamcli datasets verify --deep

\b
Exit codes: 0 success, 1 a file is not the one of the registry, 2 usage (a name that
does not exist, or that several data sets carry), 3 a data set is not here.
"""


@click.group(name="datasets", epilog=_EXAMPLES, subcommand_metavar="SUBCOMMAND ...", no_args_is_help=False)
def command() -> None:
    """List, show, find, fetch and verify the standard data sets.

    The registry says of each data set what it is, where it comes from, under which licence, its size and sha256, what
    it holds, and its known optimum. Files are looked for in the folders of SLAMCLI_DATASETS, in the user's cache and
    among those that come with slamcli. Every command that reads a graph takes the name of a data set, too.
    """


@command.command(
    name="list", epilog="\b\nExamples:\n  slamcli datasets list intel\n  slamcli datasets list --group bal"
)
@click.argument("word", metavar="[WORD]", required=False)
@click.option("--group", metavar="G", help="Only this group: bal, bundled, exotic, landmark2d, outliers, pose2d, ...")
@click.option("--available", is_flag=True, help="Only what is here.")
@json_option
def list_(word: str | None, group: str | None, available: bool, json: bool) -> int:
    """List the data sets, or those with [WORD] in their name, path or description."""
    from slamcli.batch.datasets.registry import load
    from slamcli.batch.datasets.search import location
    from slamcli.reporting import datasets as reporting

    entries = list(load().values())
    if group is not None:
        _check_group(group, {entry.group for entry in entries})
        entries = [entry for entry in entries if entry.group == group]
    if word is not None:
        entries = [entry for entry in entries if entry.mentions(word)]
        if not entries:
            raise UsageError(f"no data set has {word!r} in its name, path or description")
    found = {entry.name: location(entry) for entry in entries}
    if available:
        entries = [entry for entry in entries if found[entry.name]]
        found = {entry.name: found[entry.name] for entry in entries}
    _print(reporting.list_document(entries, found) if json else reporting.list_table(entries, found))
    return 0


@command.command(epilog="\b\nExamples:\n  slamcli datasets show sphere2500 --json | jq .dataset.optimum.chi2")
@click.argument("name", metavar="NAME")
@json_option
def show(name: str, json: bool) -> int:
    """Print what the registry knows about the data set NAME."""
    from slamcli.batch.datasets.entries import CONVENTIONS
    from slamcli.batch.datasets.search import entry, location
    from slamcli.reporting import datasets as reporting

    found = entry(name)
    path = location(found)
    _print(reporting.show_document(found, path) if json else reporting.show_lines(found, CONVENTIONS, path))
    return 0


@command.command(epilog="\b\nExamples:\n  slamcli info $(slamcli datasets path sphere2500)")
@click.argument("name", metavar="NAME")
def path(name: str) -> int:
    """Print the path of the data set NAME, after checking its size and sha256."""
    from slamcli.batch.datasets.search import checked, entry

    print(checked(entry(name)))
    return 0


@command.command(epilog="\b\nExamples:\n  slamcli datasets verify\n  slamcli datasets verify sphere2500 --deep --json")
@click.argument("names", metavar="[NAME]...", nargs=-1)
@click.option("--deep", is_flag=True, help="Also read them, and compare what they hold with the registry.")
@json_option
def verify(names: tuple[str, ...], deep: bool, json: bool) -> int:
    """Check sizes and sha256 of each data set [NAME]..., or of all that are here."""
    from slamcli.batch.datasets import verify as checking
    from slamcli.batch.datasets.registry import load
    from slamcli.cli.process import progress
    from slamcli.reporting import datasets as reporting

    entries = _entries(names) if names else list(load().values())
    checks = []
    with progress("verifying", len(entries)) as tick:
        for entry in entries:
            checks.append(checking.verify(entry, deep=deep))
            tick()
    statuses = {check.status for check in checks}
    code = ExitCode.SUCCESS
    if "wrong" in statuses:
        code = ExitCode.CHECK_FAILED
    elif names and "missing" in statuses:
        code = ExitCode.INVALID_INPUT
    _print(reporting.verify_document(checks, int(code)) if json else reporting.verify_lines(checks, bool(names)))
    if names and "missing" in statuses:
        absent = [check.name for check in checks if check.status == "missing"]
        print(f"error: not here: {', '.join(absent)}; slamcli datasets fetch gets them from a mirror", file=sys.stderr)
    return int(code)


@command.command(epilog="\b\nExamples:\n  slamcli datasets fetch sphere2500 --mirror https://example.org/slam")
@click.argument("names", metavar="NAME...", nargs=-1, required=True)
@click.option(
    "--mirror",
    metavar="URL",
    envvar="SLAMCLI_DATASETS_MIRROR",
    help="A folder on a web server that holds the files under their paths in the registry. Also "
    "SLAMCLI_DATASETS_MIRROR.",
)
@click.option(
    "--retries",
    type=click.IntRange(min=0),
    default=4,
    show_default=True,
    metavar="N",
    help="Try N times again when a connection fails, from where it broke off.",
)
@click.option(
    "--timeout",
    type=click.FloatRange(min=0.0, min_open=True),
    default=30.0,
    show_default=True,
    metavar="S",
    help="Give up waiting for an answer after S seconds.",
)
def fetch(names: tuple[str, ...], mirror: str | None, retries: int, timeout: float) -> int:
    """Fetch each data set NAME... from a mirror into the user's cache.

    What is in the search path already is not fetched. There is no mirror of slamcli's own. What is interrupted stays as
    a .part file, and the same command goes on from there. A file is put in its place when its size and sha256 are those
    of the registry.
    """
    from slamcli.batch.datasets import fetch as fetching
    from slamcli.batch.datasets.download import Policy

    failed: list[SlamcliError] = []
    entries = _entries(names)
    with _bars() as advance:
        for entry in entries:
            try:
                path, size = fetching.fetch(
                    entry, mirror, policy=Policy(retries=retries, timeout=timeout), progress=advance
                )
            except InputError as error:  # the others may still come
                failed.append(error)
                print(f"error: {error.message}", *error.details, sep="\n", file=sys.stderr)
            else:
                print(f"{entry.name}: {f'fetched {size} bytes' if size else 'was here'}: {path}", flush=True)
    return int(failed[0].exit_code) if failed else 0


def _entries(names: tuple[str, ...]) -> list[Any]:
    """The data sets of these names, each once."""
    from slamcli.batch.datasets.search import entry

    return list({found.name: found for found in map(entry, names)}.values())


def _check_group(group: str, known: set[str]) -> None:
    if group not in known:
        from slamcli.formats.configuration import suggestion

        raise UsageError(f"there is no group {group!r}", (suggestion(group, sorted(known), "groups"),))


def _print(what: list[str] | dict[str, Any]) -> None:
    """A document as JSON, lines as they are."""
    if isinstance(what, dict):
        from slamcli.reporting.documents import dumps

        print(dumps(what))
    else:
        print(*what, sep="\n")


@contextmanager
def _bars() -> Iterator[Callable[[str, int, int], None]]:
    """A progress bar for each file on standard error, if that is a terminal."""
    if not sys.stderr.isatty():
        yield lambda path, done, size: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TransferSpeedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TransferSpeedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, Any] = {}

        def advance(path: str, done: int, size: int) -> None:
            if path not in tasks:
                tasks[path] = bars.add_task(path, total=size)
            bars.update(tasks[path], completed=done)

        yield advance
