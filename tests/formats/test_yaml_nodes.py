"""YAML files whose values know their lines."""

from __future__ import annotations

from pathlib import Path

import pytest
from support import write_file

from slamcli.errors import UsageError
from slamcli.formats import yaml_nodes
from slamcli.formats.yaml_nodes import Node


def parse(folder: Path, text: str) -> Node:
    return yaml_nodes.load(Path(write_file(folder, text, "file.yaml")))


def test_values_know_their_lines_and_how_they_are_written(tmp_path: Path) -> None:
    root = parse(tmp_path, "a:\n  b: 1e3\nc: [yes, 0x10]\nd: ~\ne:\n  text\n")
    found = root.fields("a file", "abcde")
    assert [found[name].line for name in "acde"] == [1, 3, 4, 5]
    assert found["a"].mapping("a")["b"].line == 2
    assert (found["a"].value["b"].number("b"), found["a"].value["b"].word("b")) == (1000.0, "1e3")
    yes, number = found["c"].items("c")
    assert (yes.flag("yes"), yes.word("yes"), number.count("number", 0), number.written) == (True, "yes", 16, "0x10")
    assert found["d"].value is None
    assert root.plain() == {"a": {"b": "1e3"}, "c": [True, 16], "d": None, "e": "text"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: 1\nb: 2\na: 3\n", "file.yaml:3: the key 'a' stands twice"),
        ("a: 1\n? [b]\n: 2\n", "file.yaml:2: expected a word as a key"),
        ('a: 1\nb: "x\\ay"\n', r"file.yaml:2: '\x07' can be in no name, option or path"),
        ('a: 1\n"b\\0": 1\n', r"file.yaml:2: '\x00' can be in no name, option or path"),
        ("a: 1\nb: !!python/name:os.system\n", "file.yaml: is not valid YAML"),
        ("a: &a [*a]\n", "file.yaml: is not valid YAML"),
        ("", "file.yaml: is empty"),
        ("a: 1\n---\nb: 2\n", "file.yaml: is not valid YAML"),
    ],
)
def test_mistakes_are_named_with_their_line(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError) as caught:
        parse(tmp_path, text)
    assert caught.value.message.endswith(message)


def test_what_is_not_utf8(tmp_path: Path) -> None:
    (tmp_path / "latin.yaml").write_bytes(b"a: \xe4\n")
    with pytest.raises(UsageError, match="is not valid YAML"):
        yaml_nodes.load(tmp_path / "latin.yaml")


def test_names_for_names_for_names_are_no_billion_values(tmp_path: Path) -> None:
    """Each line stands for ten of the line before: 10^30 values, of which 31 are different."""
    lines = ["a0: &a0 [x]", *(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]" for k in range(1, 31))]
    root = parse(tmp_path, "\n".join(lines))
    assert len(root.mapping("a file")["a30"].items("a30")) == 10


def test_required_keys(tmp_path: Path) -> None:
    root = parse(tmp_path, "a:\n  b: 1\n")
    with pytest.raises(UsageError, match=r"file.yaml:1: the key 'c' of an a is missing"):
        root.fields("a file", ["a"])["a"].fields("an a", ["b"], ["c"])
    with pytest.raises(UsageError, match=r"file.yaml:2: unknown key 'b' of an a") as caught:
        root.fields("a file", ["a"])["a"].fields("an a", (), ["bb"])
    assert caught.value.details == ("  did you mean bb?",)
