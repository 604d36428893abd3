"""The pages of docs/ name every exit code, tag and JSON key that exists, and what they tell the reader to run works."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from slamcli.cli.commands import COMMANDS
from slamcli.errors import ExitCode
from slamcli.formats import DIALECTS
from slamcli.solver.options import OptimizeOptions

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs").glob("*.md"))
TEXT = {page.name: page.read_text(encoding="utf-8") for page in PAGES}
SHELL = [
    pytest.param(block, id=f"{name}: {block.splitlines()[0][:50]}")
    for name, text in TEXT.items()
    for block in re.findall(r"^```sh\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
]
BASH = shutil.which("bash")
#: Keys whose value is a table by tag or by kind: its keys are data.
_TABLES = {"by_tag", "skipped", "created", "scenario", "readings_by_kind", "versions", "parameters"}


@pytest.fixture
def checkout(tmp_path):
    shutil.copytree(ROOT / "datasets", tmp_path / "datasets")
    return tmp_path


def run(words, folder, **settings):
    kept = {name: value for name, value in os.environ.items() if not name.startswith("SLAMCLI_")}
    path = os.pathsep.join([str(Path(sys.executable).parent), kept["PATH"]])
    environment = {**kept, "PATH": path, **settings}
    return subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, timeout=120)


def keys(document):
    """All keys of a JSON document, at any depth."""
    if isinstance(document, dict):
        for key, value in document.items():
            yield key
            if key not in _TABLES:
                yield from keys(value)
    elif isinstance(document, list):
        for item in document:
            yield from keys(item)


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES, *ROOT.glob("[a-z]*/README.md")], ids=str)
def test_links_lead_somewhere(page):
    targets = re.findall(r"\]\(([^)]+)\)", page.read_text(encoding="utf-8"))
    local = [target for target in targets if not target.startswith(("http:", "https:"))]
    for target in local:
        name, _, anchor = target.partition("#")
        file = (page.parent / name) if name else page
        assert file.exists(), target
        if anchor:
            titles = re.findall(r"^#+ (.*)$", file.read_text(encoding="utf-8"), re.MULTILINE)
            assert anchor in [re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles], target


def test_index_lists_every_page():
    for page in PAGES:
        assert page.name == "README.md" or f"]({page.name})" in TEXT["README.md"]


@pytest.mark.parametrize("code", list(ExitCode))
def test_every_exit_code_is_explained(code):
    assert re.search(rf"^\| {int(code)} \| .*\w", TEXT["exit-codes.md"], re.MULTILINE)


@pytest.mark.parametrize("name", sorted(DIALECTS))
def test_every_tag_is_listed(name):
    dialect = DIALECTS[name]
    for tag in dialect.tags | ({dialect.fix} if dialect.fix else set()):
        assert f"`{tag} id" in TEXT["formats.md"] or re.search(rf"`{re.escape(tag)} \w", TEXT["formats.md"]), tag


@pytest.mark.parametrize(
    "words",
    [
        "optimize datasets/landmarks_small.g2o --method lm --worst 2 --json",
        "info datasets/landmarks_small.g2o --worst 2 --json",
        "optimize datasets/manhattan_small.g2o --quiet --trace -",
        "simulate circle --poses 30 --set landmarks.count=5 --json",
        "simulate square --poses 41 --set landmarks.count=5 --sweep robot.turn_bias=0,0.01 --runs 2 --json",
        "ekf circle --set poses=30 --set landmarks.count=5 --json",
        "ekf datasets/landmarks_small.g2o --truth datasets/truth/landmarks_small.g2o --trace - --quiet",
        "ekf circle --set poses=30 --set landmarks.count=5 --runs 2 --json",
        "compare datasets/landmarks_small.g2o --truth datasets/truth/landmarks_small.g2o --json",
        "compare --scaling 30,40,50 --json",
        "datasets list --json",
        "datasets show square_toro --json",
        "datasets verify --deep --json",
        "inject datasets/manhattan_small.g2o -o x.g2o --false-closures 5 --corrupt-odometry 2 --perturb 0.1 --json",
        "evaluate datasets/landmarks_small.g2o --truth datasets/truth/landmarks_small.g2o --dead-reckoning --json",
        "predict --pose 2,1,30deg --landmark 5,5 --reading 5.2,21deg --noise 0.1,2deg --json",
        "covariance datasets/landmarks_small.g2o --of 5,102 --cross --joint 5,102 --relative 5,102 --json",
        "graph datasets/landmarks_small.g2o --ids 5 --hops 1 --eliminate natural --json",
        "marginalize datasets/landmarks_small.g2o --keep every:10 --sparsify chow-liu --json",
        "sparsity datasets/landmarks_small.g2o --orderings auto,natural --add-closure 3,90 --json",
        "bench datasets/landmarks_small.g2o --param method=gn --runs 1 --json",
    ],
)
def test_every_json_key_is_explained(words, checkout):
    done = run(["slamcli", *words.split()], checkout)
    assert done.returncode == 0, done.stderr
    documents = [json.loads(done.stdout)] if "--json" in words else [json.loads(x) for x in done.stdout.splitlines()]
    found = set(keys(documents))
    assert "schema_version" in found and len(found) > 8
    assert [key for key in sorted(found) if f"`{key}`" not in TEXT["json.md"].replace("[]`", "`")] == []


def test_every_option_key_is_explained():
    assert all(f"`{name}`" in TEXT["json.md"] for name in OptimizeOptions.names())


@pytest.mark.skipif(BASH is None, reason="needs bash")
@pytest.mark.parametrize("block", SHELL)
def test_commands_of_the_pages_run(block, checkout):
    done = run([BASH, "-e", "-c", block], checkout)
    assert done.returncode == 0, done.stderr
    assert "error" not in done.stderr.lower()


def test_environment_sets_options(checkout):
    words = ["slamcli", "optimize", "datasets/manhattan_small.g2o", "--quiet"]
    limited = {"SLAMCLI_OPTIMIZE_MAX_ITERATIONS": "1"}
    assert run(words, checkout, **limited).returncode == ExitCode.NOT_CONVERGED
    assert run([*words, "--max-iterations", "50"], checkout, **limited).returncode == ExitCode.SUCCESS


@pytest.mark.skipif(BASH is None, reason="needs bash")
@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        (["op"], ["optimize"]),
        ([""], sorted(COMMANDS)),
        (["optimize", "--lin"], ["--linear-solver"]),
        (["optimize", "--linear-solver", ""], ["cholmod", "superlu", "pardiso"]),
        (["convert", "a", "b", "--to", "t"], ["toro"]),
    ],
)
def test_bash_completes(typed, offered, checkout):
    script = """
        if ((BASH_VERSINFO[0] * 100 + BASH_VERSINFO[1] < 404)); then exit 77; fi
        eval "$(_SLAMCLI_COMPLETE=bash_source slamcli)"
        COMP_WORDS=(slamcli "$@") COMP_CWORD=$#
        _slamcli_completion slamcli
        printf '%s\\n' "${COMPREPLY[@]}"
        """
    done = run([BASH, "-c", script, "bash", *typed], checkout)
    if done.returncode == 77:
        pytest.skip("needs bash 4.4")
    assert done.stdout.split() == offered, done.stderr


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_scripts_are_printed(shell, checkout):
    done = run(["slamcli"], checkout, _SLAMCLI_COMPLETE=f"{shell}_source")
    assert done.returncode == 0
    assert f"{shell}_complete" in done.stdout
