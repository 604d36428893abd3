"""The registry: strict reading with lines in its messages, and what it says about the data sets."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from support import write_file

from slamcli.batch.datasets.entries import CONVENTIONS, READERS, DatasetEntry, FileEntry, Optimum
from slamcli.batch.datasets.registry import COUNTS, bundled_folder, load, merge, read_file
from slamcli.batch.datasets.search import entry
from slamcli.errors import UsageError

HASH = "0" * 64
TEXT = f"""\
world:
  aliases: [earth, "2e3"]
  about: >-
    A world
    of two lines.
  path: pose2d/world.g2o
  format: g2o
  reader: graph
  sha256: "{HASH}"
  bytes: 12
  counts: {{ poses: 3, edges: 2 }}
  source:
    repository: nobody/nothing
    path: world.g2o
    licence: none
    obtained: as it is
  start: 1e3
  optimum:
    chi2: 2.5
    convention: g2o
    source: nobody
"""
LOG = TEXT.replace(
    f'  sha256: "{HASH}"\n  bytes: 12\n', f"  files:\n    - {{ path: a.txt, sha256: {HASH!r}, bytes: 7 }}\n"
)


def parse(tmp_path: Path, text: str) -> list[DatasetEntry]:
    return read_file(write_file(tmp_path, text, "group.yaml"))


def test_an_entry(tmp_path: Path) -> None:
    (found,) = parse(tmp_path, TEXT)
    assert (found.name, found.group, found.aliases) == ("world", "group", ("earth", "2e3"))
    assert found.about == "A world of two lines."
    assert found.files == (FileEntry("pose2d/world.g2o", HASH, 12),)
    assert (found.sha256, found.bytes, found.is_folder) == (HASH, 12, False)
    assert found.counts == {"poses": 3, "edges": 2}
    assert found.summary() == "3 poses, 2 edges"
    assert found.source.repository == "nobody/nothing"
    assert (found.start, found.optimum) == (1000.0, Optimum(2.5, "g2o", "nobody"))
    assert found.dialect == "" and found.chordal_optimum is None


def test_a_folder(tmp_path: Path) -> None:
    (found,) = parse(tmp_path, LOG)
    assert found.is_folder
    assert found.files == (FileEntry("pose2d/world.g2o/a.txt", HASH, 7),)
    # printf '%064d  pose2d/world.g2o/a.txt\n' 0 | sha256sum
    assert found.sha256 == "7023f85380048419f8778828101c5eff9f9adff517655c121a424cb86c9e8ab9"
    assert found.bytes == 7


@pytest.mark.parametrize(
    ("old", "new", "line", "message", "detail"),
    [
        ("  format:", "  formt:", 7, "unknown key 'formt' of world", "did you mean format?"),
        ("    licence:", "    license:", 15, "unknown key 'license' of a source", "did you mean licence?"),
        ("poses: 3", "pose: 3", 11, "unknown key 'pose' of counts", "did you mean poses?"),
        ("    chi2: 2.5\n", "", 18, "the key 'chi2' of an optimum is missing", ""),
        ("  reader: graph\n", "", 1, "the key 'reader' of world is missing", ""),
        ("reader: graph", "reader: grph", 8, "unknown word 'grph'", "did you mean graph?"),
        ("convention: g2o", "convention: g3o", 20, "unknown word 'g3o'", "did you mean g2o?"),
        ("  bytes: 12", "  path: b.g2o", 10, "the key 'path' stands twice", ""),
        ("  bytes: 12\n", "", 1, "world needs either sha256 and bytes, or files", ""),
        ("bytes: 12", "bytes: -12", 10, "expected an integer from 0 on, found -12", ""),
        ("bytes: 12", "bytes: 12.5", 10, "expected an integer from 0 on, found 12.5", ""),
        ("bytes: 12", "bytes: true", 10, "expected an integer from 0 on, found true", ""),
        ("chi2: 2.5", "chi2: nan", 19, "expected a number from 0 on, found 'nan'", ""),
        ("start: 1e3", "start: -1", 17, "expected a number from 0 on, found -1", ""),
        (HASH, HASH[1:], 9, f"'{HASH[1:]}' is no sha256", "64 digits"),
        ("path: pose2d/world.g2o", "path: ../world.g2o", 6, "'../world.g2o' is no relative path", ""),
        ("path: pose2d/world.g2o", "path: /world.g2o", 6, "'/world.g2o' is no relative path", ""),
        ("path: pose2d/world.g2o", r"path: a\world.g2o", 6, "is no relative path", ""),
        ('[earth, "2e3"]', "earth", 2, "expected a list, found 'earth'", ""),
        ("world:", "wor ld:", 1, "'wor ld' cannot be a name", ""),
        ("about: >-\n    A world\n    of two lines.", "about: [a]", 3, "expected a word or a text, found a list", ""),
        ("optimum:\n", "optimum: none\n#", 18, "", ""),
    ],
)
def test_mistakes_are_named_with_their_line(
    tmp_path: Path, old: str, new: str, line: int, message: str, detail: str
) -> None:
    assert TEXT.count(old) == 1
    with pytest.raises(UsageError) as caught:
        parse(tmp_path, TEXT.replace(old, new))
    if message:
        assert caught.value.message.startswith(f"{tmp_path / 'group.yaml'}:{line}: ")
    assert message in caught.value.message
    assert detail in "".join(caught.value.details)


@pytest.mark.parametrize("text", ["", "- a\n", "a: [\n", "a\n", "a: 1\n", "\t", "a: &a [*a]\n"])
def test_what_is_no_registry(tmp_path: Path, text: str) -> None:
    with pytest.raises(UsageError, match=r"group\.yaml"):
        parse(tmp_path, text)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be read"):
        read_file(tmp_path / "absent.yaml")


def test_names_and_paths_are_unique(tmp_path: Path) -> None:
    (first,) = parse(tmp_path, TEXT)
    second = replace(first, name="World2", path="pose2d/world2.g2o")
    assert list(merge([first, second])) == ["world", "World2"]
    with pytest.raises(UsageError, match="has the name of world"):
        merge([first, replace(second, name="WORLD")])
    with pytest.raises(UsageError, match="has the path of world"):
        merge([first, replace(second, path="pose2d/World.g2o")])


def test_aliases_are_no_names(tmp_path: Path) -> None:
    (first,) = parse(tmp_path, TEXT)
    second = replace(first, name="other", path="pose2d/other.g2o", aliases=("WORLD",))
    with pytest.raises(UsageError, match=r"the alias WORLD of other is a data set's name"):
        merge([first, second])
    with pytest.raises(UsageError, match="is its own name"):
        merge([replace(first, name="wor_ld", aliases=("wor-ld",))])
    with pytest.raises(UsageError, match="the alias a-b of world stands twice"):
        merge([replace(first, aliases=("a-b", "A_B"))])
    with pytest.raises(UsageError, match="a_b has the name of a-b"):
        merge([replace(first, name="a-b"), replace(second, name="a_b")])


def test_a_clash_is_told_with_file_and_line() -> None:
    found = entry("sphere2500")
    with pytest.raises(UsageError, match=r"pose3d\.yaml:\d+: sphere2500 has the path of other"):
        merge([replace(found, name="other"), found])


def test_no_alias_is_the_name_of_another() -> None:
    """Such a name would be taken for one of two things."""
    registry = load()
    for found in registry.values():
        for name in (found.name, found.path):
            assert entry(name) is found


def test_every_entry_is_complete() -> None:
    for found in load().values():
        assert found.about.endswith(".") and len(found.about) > 20, found.name
        assert found.source.licence and found.source.obtained, found.name
        assert found.counts and found.counts.keys() <= set(COUNTS), found.name
        assert found.reader in READERS
        assert found.optimum is None or (found.start is None or found.optimum.chi2 <= found.start), found.name
        assert all(o is None or o.convention in CONVENTIONS for o in (found.optimum, found.chordal_optimum))


def test_registry_and_folder_hold_the_same_bundled_files() -> None:
    folder = bundled_folder()
    files = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.suffix in (".g2o", ".graph")}
    assert files == {found.path for found in load().values() if found.group == "bundled"}


def test_three_data_sets_are_called_intel() -> None:
    with pytest.raises(UsageError, match="data sets are called 'intel'") as caught:
        entry("intel")
    names = [line.split()[0] for line in caught.value.details]
    assert {"INTEL_carlone", "intel_openslam", "intel_sesync"} < set(names)
    assert any("943 poses, 1837 edges" in line for line in caught.value.details)
