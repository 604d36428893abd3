"""The examples of README.md work as they stand, in a copy of what the reader of a checkout has."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(text, language):
    """Fenced blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)


def section(title):
    """The text under a heading of the second level."""
    return re.search(rf"^## {title}\n(.*?)(?=^## |\Z)", README, re.DOTALL | re.MULTILINE)[1]


EXAMPLES = blocks(section("Examples"), "sh")


@pytest.fixture
def checkout(tmp_path):
    """The data of a checkout."""
    for folder in ("datasets", "configs"):
        shutil.copytree(ROOT / folder, tmp_path / folder)
    return tmp_path


def run(words, folder):
    """Run a program with the slamcli of this environment first on the path, and without the user's settings."""
    settings = {name: value for name, value in os.environ.items() if not name.startswith("SLAMCLI_")}
    settings["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), settings["PATH"]])
    return subprocess.run(words, cwd=folder, env=settings, capture_output=True, text=True, timeout=120)


def test_there_are_examples():
    assert len(EXAMPLES) >= 5
    shown = "".join(EXAMPLES)
    for word in ("optimize", "info", "convert", "gzip", " - ", "--json", "--method lm", "--trace"):
        assert word in shown


@pytest.mark.parametrize("example", EXAMPLES, ids=[example.split("\n")[0][:60] for example in EXAMPLES])
def test_example_runs(example, checkout):
    done = run(["sh", "-e", "-c", example], checkout)
    assert done.returncode == 0, done.stderr
    assert "error" not in done.stderr.lower() and "Traceback" not in done.stderr


def test_gate_fails_when_it_should(checkout):
    (gate,) = [example for example in EXAMPLES if "1.2" in example]
    assert run(["sh", "-e", "-c", gate.replace("1.2 *", "0.2 *")], checkout).returncode == 1
    assert run(["sh", "-e", "-c", gate.replace("--max-iterations 20", "--max-iterations 1")], checkout).returncode == 4


def test_python_example_prints_what_the_readme_says(checkout):
    text = section("Python")
    (program,) = blocks(text, "python")
    (expected,) = blocks(text, "text")
    done = run([sys.executable, "-c", program], checkout)
    assert done.returncode == 0, done.stderr
    assert done.stdout == expected
    assert (checkout / "optimized.g2o").stat().st_size > 0


def test_picture_shows_what_the_command_prints(checkout):
    picture = (ROOT / "docs" / "images" / "optimize.svg").read_text(encoding="utf-8")
    done = run(["slamcli", "optimize", "datasets/manhattan_small.g2o"], checkout)
    words = [line.split()[0] for line in done.stdout.splitlines()]
    assert len(words) > 5
    assert [word for word in words if f">{word}&#160;" not in picture] == [], "run: python docs/make_picture.py"
    assert "877.048409" in done.stdout and "877.048409" in picture
