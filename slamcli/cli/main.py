"""Entry point: turns errors into messages and exit codes, and loads subcommands when they are called."""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING

from slamcli.cli.commands import COMMANDS, help_text, version_text
from slamcli.errors import ExitCode, SlamcliError

if TYPE_CHECKING:
    import click


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit code.

    Parameters
    ----------
    arguments
        Words behind ``slamcli``; those of the process if None.
    """
    words = sys.argv[1:] if arguments is None else arguments
    # closed by the caller, who wants no output
    if sys.stdout is None:
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115
    _encode_everything()
    try:
        return _run(words)
    except SlamcliError as error:
        _say_error(error.message, error.details)
        return int(error.exit_code)
    except MemoryError:
        _say_error("out of memory", ("  the input, or what was asked for, is too large for this machine",))
        return int(ExitCode.NUMERICAL_FAILURE)
    except BrokenPipeError:
        _silence_stdout()
        return int(ExitCode.BROKEN_PIPE)
    except OSError as error:  # files have messages of their own: this is standard output, on a full disk
        _silence_stdout()
        _say_error(f"standard output cannot be written: {error.strerror}", ())
        return int(ExitCode.INVALID_INPUT)
    except KeyboardInterrupt:
        print("slamcli: interrupted", file=sys.stderr)
        return int(ExitCode.INTERRUPTED)


def _run(words: list[str]) -> int:
    if "_SLAMCLI_COMPLETE" not in os.environ:  # the shell asks click for completions
        if not words or words in (["--help"], ["-h"]):
            print(help_text(), flush=True)
            return int(ExitCode.SUCCESS if words else ExitCode.USAGE)
        if words == ["--version"]:
            print(version_text(), flush=True)
            return int(ExitCode.SUCCESS)
    import click

    group = build_group()
    if "_SLAMCLI_COMPLETE" in os.environ:
        group.main(args=words, prog_name="slamcli")  # answers the shell and exits
    try:
        # not group.main(): it would swallow broken pipes
        with group.make_context("slamcli", list(words)) as context:
            code = group.invoke(context)
        sys.stdout.flush()
        return int(code or 0)
    except click.exceptions.Exit as end:
        sys.stdout.flush()
        return int(end.exit_code)
    except click.exceptions.Abort:
        raise KeyboardInterrupt from None
    except click.UsageError as error:
        usage = [error.ctx.get_usage()] if error.ctx else []
        print(*usage, f"error: {error.format_message()}", sep="\n", file=sys.stderr)
        return int(ExitCode.USAGE)


def build_group() -> click.Group:
    """The click group of all subcommands; each is imported when it is asked for."""
    import click

    class LazyGroup(click.Group):
        """Loads subcommands from the table on demand."""

        def list_commands(self, ctx: click.Context) -> list[str]:
            return sorted(COMMANDS)

        def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
            if cmd_name not in COMMANDS:
                return None
            from importlib import import_module

            command: click.Command = import_module(COMMANDS[cmd_name][0]).command
            return command

        def resolve_command(
            self, ctx: click.Context, args: list[str]
        ) -> tuple[str | None, click.Command | None, list[str]]:
            try:
                return super().resolve_command(ctx, args)
            except click.UsageError as error:
                raise click.UsageError(error.message + _suggestion(args[0]), ctx) from None

        def get_help(self, ctx: click.Context) -> str:
            return help_text()

    def show_version(ctx: click.Context, parameter: click.Parameter, value: bool) -> None:
        if value:
            click.echo(version_text())
            ctx.exit()

    return LazyGroup(
        name="slamcli",
        context_settings={
            "help_option_names": ["-h", "--help"],
            "auto_envvar_prefix": "SLAMCLI",
            "max_content_width": 100,
        },
        params=[click.Option(["--version"], is_flag=True, is_eager=True, expose_value=False, callback=show_version)],
    )


def _encode_everything() -> None:
    """Let standard output take any character: as UTF-8, or with a mark in its place on a terminal that has none."""
    stream = sys.stdout
    if (getattr(stream, "encoding", None) or "utf-8").lower().replace("-", "") != "utf8" and hasattr(
        stream, "reconfigure"
    ):
        stream.reconfigure(**({"errors": "replace"} if stream.isatty() else {"encoding": "utf-8"}))


def _suggestion(word: str) -> str:
    import difflib

    close = difflib.get_close_matches(word, COMMANDS, n=1)
    return f" Did you mean {close[0]!r}?" if close and "mean" not in word else ""


def _say_error(message: str, details: tuple[str, ...]) -> None:
    print(f"error: {message}", *details, sep="\n", file=sys.stderr)


def _silence_stdout() -> None:
    """Point standard output to nowhere, so that Python's own flush at exit stays quiet."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
