"""One table for the whole command line: arguments and input, exit code, what is said. Its rows are in ``rows``."""

from __future__ import annotations

import importlib
import io
import json
import os
from pathlib import Path

import click
import pytest
from command_line import LINE
from row import INDEFINITE, Case

from slamcli.cli.commands import COMMANDS
from slamcli.cli.main import build_group, main

#: One file for each command, and one for what comes without any.
FILES = sorted(path.stem for path in (Path(__file__).parent / "rows").glob("*.py"))
CASES = [case for name in FILES for case in importlib.import_module(f"rows.{name}").ROWS]


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.code} {case.words}")
def test_command(
    case: Case, tmp_path: Path, capfdbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    names = {"{in}": "graph.g2o", "{out}": "out.g2o", "{config}": "config.yaml"}
    monkeypatch.chdir(tmp_path)
    for name in list(os.environ):
        if name.startswith("SLAMCLI_") or name == "NO_COLOR":
            monkeypatch.delenv(name)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))  # no data set that the user has fetched
    Path("graph.g2o").write_text(case.content)
    Path("config.yaml").write_text(case.config)
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(case.content.encode())))
    words = [names.get(word, word) for word in case.words.split()]
    code = main(words)
    streams = [stream.decode() for stream in capfdbinary.readouterr()]
    for parts, found in zip((case.out, case.err), streams, strict=True):
        for part in (parts,) if isinstance(parts, str) else parts:
            for name, file in names.items():
                part = part.replace(name, file)
            assert part in found
    assert code == case.code
    assert "Traceback" not in streams[1]
    if case.code in (2, 3):
        assert streams[0] == "" or not words
        assert "error" in streams[1].lower() or not words
    written = Path("out.g2o").exists()
    assert written == ("out.g2o" in words and case.code in (0, 4))


def test_the_table_knows_every_command_and_option() -> None:
    """Whoever adds an option adds a line here."""
    used = {word for case in CASES for word in case.words.split()}
    known = {name: build_group().get_command(None, name) for name in COMMANDS}  # type: ignore[arg-type]
    for group in [command for command in known.values() if isinstance(command, click.Group)]:
        known |= group.commands
    for name, command in known.items():
        assert name in used
        assert command is not None
        for parameter in command.params:
            if parameter.param_type_name == "option":
                assert used & set(parameter.opts), f"{name} {parameter.opts[-1]} has no line in the table"


def test_quiet_is_quiet(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "graph.g2o"
    path.write_text(LINE)
    assert main(["optimize", str(path), "-q"]) == 0
    assert capsys.readouterr() == ("", "")


def test_json_is_one_document(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Also of a failed run, with null for what there is not."""
    path = tmp_path / "graph.g2o"
    for content, code, status in ((LINE, 0, "converged"), (INDEFINITE, 5, "numerical_failure")):
        path.write_text(content)
        assert main(["optimize", str(path), "--json"]) == code
        document = json.loads(capsys.readouterr().out)
        assert (document["status"], document["exit_code"]) == (status, code)
        assert document["input"]["path"] == str(path)
        assert (document["sparsity"] is None) == (code == 5)
