"""docs/benchmarks.md has the sections, commands and tables of its generator; its figures are not looked at."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

from slamcli.batch.benchmark import grid
from slamcli.batch.benchmark.peers.settings import PEERS
from slamcli.batch.datasets import entry
from slamcli.cli.bench import command
from slamcli.reporting.benchmark import COLUMNS

ROOT = Path(__file__).parents[2]


def _generator() -> ModuleType:
    spec = importlib.util.spec_from_file_location("publish", ROOT / "benchmarks" / "publish.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["publish"] = module  # where its dataclass looks for its types
    spec.loader.exec_module(module)
    return module


publish = _generator()
PAGE = publish.PAGE.read_text(encoding="utf-8")
#: Title, command line and the rest of each section of the page.
SECTIONS = re.findall(r"^## (.*)\n\n(?:.*\n)+?\n?```text\n(.*)\n```\n((?:(?!## ).*\n)*)", PAGE, re.MULTILINE)


def parsed(words: str) -> dict[str, object]:
    return command.make_context("bench", words.split(), help_option_names=["-h", "--help"]).params


def test_the_page_has_the_sections_of_its_generator() -> None:
    found = {title: line for title, line, _ in SECTIONS}
    runs = re.search(r"--runs (\d+)", PAGE)
    assert runs is not None
    assert found == {one.title: one.command(int(runs[1])) for one in publish.SECTIONS}, "run: make benchmarks"
    for name in ("date", "processor", "platform", "slamcli", "python", *PEERS):
        assert re.search(rf"^\| {name} \| .*\w", PAGE, re.MULTILINE)
    assert PAGE.startswith(publish.page.__globals__["_HEAD"])


@pytest.mark.parametrize("section", publish.SECTIONS, ids=lambda one: one.title)
def test_each_table_has_the_rows_of_its_command(section: object) -> None:
    given = parsed(section.command(5).removeprefix("slamcli bench "))  # type: ignore[attr-defined]
    (text,) = (rest for title, _, rest in SECTIONS if title == section.title)  # type: ignore[attr-defined]
    table = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in text.splitlines() if line[:1] == "|"]
    assert tuple(table[0]) == COLUMNS
    names = given["peers"]
    peers = [name for words in names for name in words.split(",")]  # type: ignore[attr-defined]
    labels = [one.label for one in grid.variants(grid.parameters(given["param"]), peers)]  # type: ignore[arg-type]
    stems = [Path(entry(name).path).stem for name in given["data"]]  # type: ignore[attr-defined]
    assert [(row[0], row[1]) for row in table[2:]] == [(stem, label) for stem in stems for label in labels]


def test_a_page_is_made_of_its_tables() -> None:
    tables = {one.title: f"| {one.title} |\n" for one in publish.SECTIONS}
    found = {"date": "today", "processor": "P", "processors": 2, "platform": "L", "versions": {"slamcli": "0"}}
    page = publish.page(tables, found, 3)
    order = [page.index(f"## {one.title}\n") for one in publish.SECTIONS]
    assert order == sorted(order)
    assert all(f"--runs 3 --export markdown\n```\n\n| {one.title} |\n" in page for one in publish.SECTIONS)
