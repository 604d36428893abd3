"""Where figures are found in the documents of real commands."""

from __future__ import annotations

from pathlib import Path

import pytest
from support import BUNDLED

from slamcli.batch.execution import Execution, execute
from slamcli.batch.metrics import EXIT_CODE, METRICS, SECONDS, TIME_RATIO, value
from slamcli.batch.pipeline import Case, Outcome, run

CASES = (
    Case(
        "smoother",
        options={"robust": "gnc"},
        data=str(BUNDLED / "manhattan_small.g2o"),
        truth=str(BUNDLED / "truth" / "manhattan_small.g2o"),
        inject={"false_closures": 5},
    ),
    Case(
        "filter",
        command="ekf",
        options={"covariances": "c.npz"},
        data=str(BUNDLED / "landmarks_small.g2o"),
        truth=str(BUNDLED / "truth" / "landmarks_small.g2o"),
        evaluate={"covariances": "c.npz"},
    ),
    Case("certificate", options={"certify": True}, data=str(BUNDLED / "square_toro.graph")),
    Case("cameras", simulate="camera-ring", simulation={"poses": 4}, evaluate={"align": "sim"}),
)


def test_every_figure_has_its_place_in_a_document(tmp_path: Path) -> None:
    """Keys are renamed sometimes; a figure that no command prints any more is found here."""
    found: dict[str, float] = {}
    for case in CASES:
        folder = tmp_path / case.name
        folder.mkdir()
        outcome = run(case, folder, execute)
        assert (outcome.failed, outcome.exit_code) == (None, 0), outcome.steps
        for name in METRICS:
            number = value(outcome, name)
            if number is not None:
                found[f"{case.name} {name}"] = number
    names = {key.split()[1] for key in found}
    assert names == set(METRICS) - {TIME_RATIO}
    assert found["certificate certified"] == 1.0
    # per dimension: far below the three of a pose's NEES
    assert 0.3 < found["filter nees"] < 1.0
    assert found["smoother precision"] == 1.0
    assert 0.0 < found["smoother solve_seconds"] < found["smoother seconds"]


def _outcome(document: dict[str, object]) -> Outcome:
    return Outcome({"optimize": Execution(("optimize",), 4, document, "", 2.5)}, "optimize")


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("optimize:a.b", 2.0),
        ("optimize:list.1", 7.0),
        ("optimize:a.b+list.1", 9.0),
        ("optimize:list.1/a.b", 3.5),
        ("optimize:a.b/zero", None),
        ("optimize:word=yes", 1.0),
        ("optimize:word=no", 0.0),
        ("optimize:nothing=no", None),
        ("optimize:word", None),
        ("optimize:flag", 1.0),
        ("optimize:list", None),
        ("optimize:list.9", None),
        ("evaluate:a.b", None),
        (EXIT_CODE, 4.0),
        (SECONDS, 2.5),
        ("ate", None),
        ("iterations", None),
    ],
)
def test_keys(name: str, expected: float | None) -> None:
    document = {"a": {"b": 2}, "list": [6, 7.0], "zero": 0, "word": "yes", "flag": True, "iterations": None}
    assert value(_outcome(document), name) == expected
