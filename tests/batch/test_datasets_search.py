"""Finding data sets by name and path, and checking their files."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from support import BUNDLED, STANDARD

from slamcli.batch import datasets
from slamcli.batch.datasets import search
from slamcli.batch.datasets.registry import bundled_folder, load
from slamcli.batch.datasets.verify import count, verify
from slamcli.cli.main import main
from slamcli.errors import InputError, UsageError


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of the search path with one data set, and no user's cache."""
    folder = tmp_path / "own"
    folder.mkdir()
    shutil.copy(BUNDLED / "square_toro.graph", folder)
    monkeypatch.setenv("SLAMCLI_DATASETS", os.pathsep.join(["", str(tmp_path / "nowhere"), str(folder)]))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    return folder


def test_search_path(tmp_path: Path, own_folder: Path) -> None:
    folders = search.folders()
    assert folders == [tmp_path / "nowhere", own_folder, tmp_path / "cache/slamcli/datasets", bundled_folder()]


def test_a_user_that_there_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SLAMCLI_DATASETS", "~nobody-of-this-name/data")
    assert search.folders()[0] == Path("~nobody-of-this-name/data")
    assert datasets.available("square_toro")


@pytest.mark.parametrize(
    ("word", "meant"),
    [("square_tor", "square_toro"), ("M3500.g2o", "pose2d/M3500.g2o"), ("nosuch.g2o", None), ("./square_tor", None)],
)
def test_what_an_input_may_mean(capsys: pytest.CaptureFixture[str], word: str, meant: str | None) -> None:
    assert main(["info", word]) == 3
    said = capsys.readouterr().err
    assert f"{word}: cannot be read: No such file or directory" in said
    assert ("did you mean" in said) == (meant is not None)
    assert meant is None or f"did you mean the data set {meant}" in said


def test_first_folder_wins(tmp_path: Path, own_folder: Path) -> None:
    cached = tmp_path / "cache/slamcli/datasets/square_toro.graph"
    cached.parent.mkdir(parents=True)
    shutil.copy(own_folder / "square_toro.graph", cached)
    assert datasets.resolve("square_toro") == own_folder / "square_toro.graph"
    (own_folder / "square_toro.graph").unlink()
    assert datasets.resolve("square_toro") == cached
    cached.unlink()
    assert datasets.resolve("square_toro") == bundled_folder() / "square_toro.graph"


@pytest.mark.parametrize("name", ["square_toro", "Square-Toro", "square_toro.graph", "SQUARE_TORO.graph"])
def test_names_and_paths(name: str, own_folder: Path) -> None:
    assert datasets.resolve(name) == own_folder / "square_toro.graph"
    assert datasets.available(name)
    assert datasets.entry(name).name == "square_toro"


def test_alias() -> None:
    assert datasets.entry("ladybug").path == "bal/problem-49-7776-pre.txt"
    assert datasets.entry("W10000").name == "w10000_hogman"


def test_a_file_wins_over_a_name(tmp_path: Path) -> None:
    (tmp_path / "sphere2500").write_text("mine")
    assert datasets.resolve("sphere2500") == Path("sphere2500")
    assert datasets.available("sphere2500")


def test_a_folder_does_not_win_over_a_name(tmp_path: Path, own_folder: Path) -> None:
    """A folder of results is often called as the data set is."""
    (tmp_path / "square_toro").mkdir()
    (tmp_path / "results").mkdir()
    assert datasets.resolve("square_toro") == own_folder / "square_toro.graph"
    assert datasets.resolve("results") == Path("results")


def test_missing() -> None:
    assert not datasets.available("sphere2500")
    with pytest.raises(InputError, match="the data set sphere2500 is not here") as caught:
        datasets.resolve("sphere2500")
    text = "\n".join(caught.value.details)
    assert "looked for pose3d/sphere2500.g2o in " in text
    assert "slamcli datasets fetch sphere2500 --mirror URL" in text


def test_unknown() -> None:
    for call in (datasets.resolve, datasets.available, datasets.entry):
        with pytest.raises(UsageError, match="there is no data set 'torus3E'") as caught:
            call("torus3E")
        assert "did you mean torus3D" in caught.value.details[0]


def test_path_that_leads_nowhere() -> None:
    for name in ("nowhere/graph", "graph.g2o"):
        with pytest.raises(InputError, match=f"{name}: cannot be read: there is no such file"):
            datasets.resolve(name)


def test_damaged_file_is_refused(own_folder: Path) -> None:
    path = own_folder / "square_toro.graph"
    content = path.read_bytes()
    path.write_bytes(content[:-1])
    with pytest.raises(InputError, match="is not the file of the data set square_toro") as caught:
        datasets.resolve("square_toro")
    assert f"expected {len(content)} bytes, found {len(content) - 1}" in caught.value.details[0]
    path.write_bytes(content[:-1] + b" ")
    with pytest.raises(InputError) as caught:
        datasets.resolve("square_toro")
    assert "expected the sha256" in caught.value.details[0]


def test_verify(own_folder: Path) -> None:
    found = datasets.entry("square_toro")
    assert verify(found).status == "ok"
    deep = verify(found, deep=True)
    assert (deep.status, deep.problems) == ("ok", ())
    assert deep.counts == {"poses": 41, "landmarks": 0, "edges": 62, "loop_closures": 22}
    other = verify(replace(found, counts={"poses": 40, "edges": 62, "lines": 1}), deep=True)
    assert other.status == "wrong"
    assert other.problems == ("expected 40 poses, found 41", "expected 1 lines, found none")
    (own_folder / "square_toro.graph").write_text("short")
    assert verify(found).problems == ("expected 9036 bytes, found 5",)
    assert verify(datasets.entry("sphere2500")).status == "missing"


def test_verify_says_what_its_reader_refuses(own_folder: Path) -> None:
    check = verify(replace(datasets.entry("square_toro"), reader="log"), deep=True)
    assert check.status == "wrong"
    assert check.problems[0].startswith("cannot be read: ")


def test_incomplete_folder_is_not_here(own_folder: Path) -> None:
    found = datasets.entry("plaza1_log")
    for file in found.files[1:]:
        path = own_folder / file.path
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("x")
    assert search.locate(found) is None
    (own_folder / found.files[0].path).write_text("x")
    assert search.location(found) == own_folder / "raw/plaza"
    assert [problem.split(":")[0] for problem in verify(found).problems] == [file.path for file in found.files]


def test_lines_are_counted(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_bytes(b"1\r\n2\n3")
    assert count(tmp_path / "a.txt", "lines") == {"lines": 3}


def test_bundled_data_sets_hold_what_the_registry_says() -> None:
    for found in load().values():
        if found.group == "bundled":
            assert verify(found, deep=True).problems == (), found.name


@pytest.mark.skipif(STANDARD is None, reason="SLAMCLI_DATASETS does not name the folder of the standard data sets")
def test_standard_data_sets_are_those_of_the_registry(monkeypatch: pytest.MonkeyPatch) -> None:
    """All with their hashes; the small ones are also read."""
    monkeypatch.setenv("SLAMCLI_DATASETS", str(STANDARD))
    here = [found for found in load().values() if datasets.available(found.name)]
    assert len(here) > 8
    for found in here:
        assert verify(found, deep=found.bytes < 100_000).problems == (), found.name


def golden() -> dict[str, float]:
    """chi2 at the optimum by path, of the table that the tests of the solver use."""
    path = Path(__file__).parents[1] / "solver" / "golden.py"
    spec = importlib.util.spec_from_file_location("golden_of_the_solver", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # where dataclasses look
    spec.loader.exec_module(module)
    return module.DEFAULTS | {row.path: row.best for row in module.BUNDLED}


def test_optima_are_those_of_the_golden_table() -> None:
    table = golden()
    assert len(table) > 40
    for path, chi2 in table.items():
        optimum = datasets.entry(path).optimum
        assert optimum is not None, path
        assert optimum.chi2 == pytest.approx(chi2, rel=1e-9), path


def test_commands_take_names(capsys: pytest.CaptureFixture[str], own_folder: Path, tmp_path: Path) -> None:
    assert main(["info", "square_toro", "--json"]) == 0
    assert f'"path": "{own_folder / "square_toro.graph"}"' in capsys.readouterr().out
    (tmp_path / "square_toro").write_text("VERTEX_SE2 0 0 0 0\n")
    assert main(["info", "square_toro", "--json"]) == 0
    assert '"path": "square_toro"' in capsys.readouterr().out


def test_worlds_come_before_data_sets(monkeypatch: pytest.MonkeyPatch) -> None:
    """Aliases such as manhattan are names of worlds, too."""
    import click

    from slamcli.cli.inputs import INPUT, INPUT_OR_WORLD
    from slamcli.simulation.worlds import WORLDS

    for world in WORLDS:
        assert INPUT_OR_WORLD.convert(world, None, None) == world
    with pytest.raises(UsageError, match="data sets are called 'manhattan'"):
        INPUT.convert("manhattan", None, None)
    assert INPUT.convert("manhattan", None, click.Context(click.Command("x"), resilient_parsing=True)) == "manhattan"
    assert not set(WORLDS) & {found.name.casefold() for found in load().values()}


def test_verify_command(capsys: pytest.CaptureFixture[str], own_folder: Path) -> None:
    assert main(["datasets", "verify", "square_toro", "sphere2500"]) == 3
    out, err = capsys.readouterr()
    assert "ok       square_toro: " in out
    assert "missing  sphere2500" in out
    assert err == "error: not here: sphere2500; slamcli datasets fetch gets them from a mirror\n"
    (own_folder / "square_toro.graph").write_text("short")
    assert main(["datasets", "verify"]) == 1
    out, err = capsys.readouterr()
    assert out.splitlines()[:2] == [
        f"wrong    square_toro: {own_folder / 'square_toro.graph'}",
        "         expected 9036 bytes, found 5",
    ]
    assert "7 as they should be, 1 wrong" in out
    assert err == ""
    assert main(["datasets", "path", "square_toro"]) == 3


def test_nothing_is_read_where_the_file_exists(tmp_path: Path) -> None:
    (tmp_path / "graph.g2o").write_text("VERTEX_SE2 0 0 0 0\n")
    program = (
        "import sys; from slamcli.cli.main import main; main(['info', sys.argv[1]]);"
        "print(sorted({'yaml', 'platformdirs', 'pooch', 'requests', 'slamcli.batch.datasets'} & sys.modules.keys()))"
    )
    for word, loaded in (("graph.g2o", "[]"), ("square_toro", "['platformdirs', 'slamcli.batch.datasets', 'yaml']")):
        done = subprocess.run([sys.executable, "-c", program, word], capture_output=True, text=True, check=True)
        assert done.stdout.splitlines()[-1] == loaded
