"""docs/cli.md says what the code says, and the code leaves no command and no option without help."""

import importlib.util
from pathlib import Path

import click
import pytest

from slamcli.cli.main import COMMANDS, build_group

SCRIPT = Path(__file__).parents[2] / "docs" / "generate_cli.py"


def load_generator():
    spec = importlib.util.spec_from_file_location("generate_cli", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


generator = load_generator()
contexts = {context.command_path.removeprefix("slamcli "): context for context in generator.contexts()}
#: Commands, and their subcommands: ``datasets list``.
each_command = pytest.mark.parametrize("name", sorted(set(contexts) - {"slamcli"}))


def test_page_is_up_to_date():
    assert generator.PAGE.read_text(encoding="utf-8") == generator.page(), "run: make docs"


@pytest.mark.parametrize("columns", ["20", "300"])
def test_page_does_not_depend_on_the_terminal(monkeypatch, columns):
    page = generator.page()
    monkeypatch.setenv("COLUMNS", columns)
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert generator.page() == page


def test_help_keeps_to_the_width():
    helps = [line for context in contexts.values() for line in context.get_help().splitlines()]
    assert max(map(len, helps)) <= generator.WIDTH


def test_page_has_every_command():
    page = generator.page()
    assert all(f"\n## slamcli {name}\n" in page for name in contexts if name != "slamcli")
    assert contexts.keys() > COMMANDS.keys()


@each_command
def test_every_command_has_help(name):
    command = contexts[name].command
    assert command.name == name.split()[-1]
    assert name not in COMMANDS or COMMANDS[name][1].endswith(".")
    assert len(command.help) > 40
    assert command.epilog and f"slamcli {name} " in command.epilog, "examples"


@each_command
def test_every_option_has_help(name):
    help_text = contexts[name].get_help()
    for parameter in contexts[name].command.params:
        if isinstance(parameter, click.Option):
            assert parameter.help and parameter.help.endswith((".", "]")), parameter.opts
            assert not parameter.hidden
            assert all(word in help_text for word in parameter.opts)
        else:
            assert parameter.metavar and parameter.metavar in contexts[name].command.help


def test_group_lists_every_command_and_option():
    group = build_group()
    help_text = contexts["slamcli"].get_help()
    assert all(f"  {name} " in help_text and summary in help_text for name, (_, summary) in COMMANDS.items())
    assert all(word in help_text for parameter in group.params for word in parameter.opts)
