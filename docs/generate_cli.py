"""Write docs/cli.md, the reference of all commands and options: ``python docs/generate_cli.py``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import click

from slamcli.cli.main import COMMANDS, build_group

PAGE = Path(__file__).with_name("cli.md")
WIDTH = 88  # columns, whatever the terminal

_HEAD = """\
<!-- Written by docs/generate_cli.py: run "make docs", do not edit. -->

# Command-line reference

What `slamcli --help` and `slamcli COMMAND --help` print. The exit codes are explained in
[exit-codes.md](exit-codes.md), the documents of `--json` and `--trace` in [json.md](json.md).

Every option can also be given by an environment variable, `SLAMCLI_COMMAND_OPTION`: for instance
`SLAMCLI_OPTIMIZE_METHOD=lm` for `slamcli optimize --method lm`. A flag beats the variable, which beats the
file of `--config`, which beats the default.
"""


def contexts() -> Iterator[click.Context]:
    """The context of the group, then of each command and of its subcommands, with our width."""
    group = build_group()
    with group.make_context("slamcli", [], resilient_parsing=True, terminal_width=WIDTH) as parent:
        yield parent
        yield from below(parent, sorted(COMMANDS))


def below(parent: click.Context, names: Iterable[str]) -> Iterator[click.Context]:
    """The contexts of the commands of a group, each before those of its own commands."""
    assert isinstance(parent.command, click.Group)
    for name in names:
        command = parent.command.get_command(parent, name)
        assert command is not None, name
        with click.Context(command, info_name=name, parent=parent) as context:
            yield context
            if isinstance(command, click.Group):
                yield from below(context, command.list_commands(context))


def page() -> str:
    """The text of docs/cli.md."""
    parts = [_HEAD]
    for context in contexts():
        help_text = click.unstyle(context.get_help()).rstrip()
        parts.append(f"\n## {context.command_path}\n\n```text\n{help_text}\n```\n")
    return "".join(parts)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
