"""The deliberate bugs of ``benchmarks.mutations`` still find their places in the sources."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT))
from benchmarks.mutations import MUTATIONS, Mutation  # noqa: E402


@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda mutation: mutation.name)
def test_mutation_applies_once_and_leaves_python(mutation: Mutation, tmp_path: Path) -> None:
    target = tmp_path / mutation.path
    target.parent.mkdir(parents=True)
    before = (ROOT / mutation.path).read_text(encoding="utf-8")
    target.write_text(before, encoding="utf-8")
    mutation.apply(tmp_path)
    after = target.read_text(encoding="utf-8")
    assert after != before
    compile(after, mutation.path, "exec")


def test_names_are_unique_and_many() -> None:
    assert len({mutation.name for mutation in MUTATIONS}) == len(MUTATIONS) >= 12
