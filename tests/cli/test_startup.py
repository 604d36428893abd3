"""What is loaded when, and what the help says."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import click
import pytest
from command_line import LINE, environment

from slamcli.cli.commands import COMMANDS, help_text
from slamcli.cli.main import build_group, main

each_command = pytest.mark.parametrize("name", sorted(COMMANDS))


def loaded(words: list[str]) -> set[str]:
    """Top-level packages that a command has loaded when it ends."""
    program = (
        "import sys; from slamcli.cli.main import main; code = main(sys.argv[1:]); sys.stdout.flush()\n"
        "print(*sorted({name.split('.')[0] for name in sys.modules}), file=sys.stderr); sys.exit(code)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, *words], capture_output=True, text=True, check=True, env=environment()
    )
    return set(done.stderr.splitlines()[-1].split())


@pytest.mark.parametrize("words", [["--help"], ["-h"]])
def test_help_loads_nothing(words: list[str]) -> None:
    assert not loaded(words) & {"click", "numpy", "scipy", "rich", "yaml", "cvxopt", "matplotlib"}


def test_version_loads_nothing() -> None:
    assert not loaded(["--version"]) & {"click", "numpy", "scipy", "rich", "yaml", "cvxopt", "matplotlib"}


@each_command
def test_help_of_a_command_loads_no_solver(name: str) -> None:
    assert not loaded([name, "--help"]) & {"scipy", "rich", "matplotlib", "yaml", "cvxopt"}


def test_optimization_gets_by_with_numpy_and_cvxopt(tmp_path: Path) -> None:
    path = tmp_path / "graph.g2o"
    path.write_text(LINE)
    modules = loaded(["optimize", str(path), "-o", str(tmp_path / "out.g2o"), "--json"])
    assert modules >= {"numpy", "cvxopt", "click"}
    assert not modules & {"scipy", "rich", "matplotlib", "yaml", "pypardiso"}
    assert "scipy" in loaded(["optimize", str(path), "--linear-solver", "superlu"])


@pytest.mark.parametrize("words", [["info"], ["convert", "-"]])
def test_reading_needs_no_solver(words: list[str], tmp_path: Path) -> None:
    path = tmp_path / "graph.g2o"
    path.write_text(LINE)
    modules = loaded([words[0], str(path), *words[1:]])
    assert not modules & {"scipy", "rich", "matplotlib", "yaml", "cvxopt"}


def command(name: str) -> click.Command:
    found = build_group().get_command(click.Context(click.Command("slamcli")), name)
    assert found is not None
    return found


def test_top_level_help_lists_every_command() -> None:
    rows = [line.strip().split("  ", 1) for line in help_text().splitlines() if line.startswith("  ")]
    summaries = {row[0]: row[1].strip() for row in rows if len(row) == 2}
    for name, (_, summary) in COMMANDS.items():
        assert summaries[name] == summary
    group = build_group()
    assert group.list_commands(click.Context(group)) == sorted(COMMANDS)


def test_help_is_the_same_whoever_prints_it(capsys: pytest.CaptureFixture[str]) -> None:
    """--help behind another option goes through click."""
    assert main(["--help"]) == 0
    first = capsys.readouterr().out
    assert main(["--help", "optimize"]) == 0
    assert capsys.readouterr().out == first


@each_command
def test_summary_fits_the_help_of_the_command(name: str) -> None:
    """One line, a sentence, with the verb that the command's own help starts with."""
    summary = COMMANDS[name][1]
    assert re.fullmatch(r"[A-Z][^\n]*\.", summary)
    assert len(summary) <= 72
    help_of_command = command(name).help
    assert help_of_command is not None
    first = help_of_command.strip().split(". ")[0]
    assert first.split()[0] == summary.split()[0]


@each_command
def test_every_option_says_what_it_does(name: str) -> None:
    for parameter in command(name).params:
        if isinstance(parameter, click.Option):
            assert parameter.help and parameter.help[0].isupper() and "." in parameter.help
    epilog = command(name).epilog
    assert epilog is not None and f"slamcli {name} " in epilog


@each_command
def test_help_fits_the_terminal(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([name, "--help"]) == 0
    assert max(len(line) for line in capsys.readouterr().out.splitlines()) <= 100


@pytest.mark.parametrize(("shell", "mark"), [("bash", "complete"), ("zsh", "compdef"), ("fish", "complete")])
def test_completion(shell: str, mark: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "slamcli"],
        capture_output=True,
        text=True,
        env=environment(_SLAMCLI_COMPLETE=f"{shell}_source"),
        check=False,
    )
    assert done.returncode == 0
    assert mark in done.stdout and "Traceback" not in done.stderr


def test_module_and_script_are_the_same() -> None:
    module = subprocess.run([sys.executable, "-m", "slamcli", "--help"], capture_output=True, text=True, check=True)
    assert module.stdout == help_text() + "\n"
