"""What ``slamcli evaluate`` prints and writes, apart from the figures themselves."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from slamcli.evaluation import EvaluateOptions, Evaluation, evaluate
from slamcli.formats.covariances import Covariances
from slamcli.graph.trajectory import Trajectory
from slamcli.models import SE2
from slamcli.reporting import documents
from slamcli.reporting.evaluation import errors_csv, evaluation_document, evaluation_summary

TRUTH = Trajectory(
    SE2, np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]]), ids=np.array([4, 5, 6]), source="truth.g2o"
)
#: The second pose is 3 m and 4 m off and turned by 90 degrees.
ESTIMATE = replace(
    TRUTH, poses=np.add(TRUTH.poses, [[0, 0, 0], [3, 4, np.pi / 2], [0, 0, 0]]), source="folder/estimate.g2o"
)
NONE = EvaluateOptions(align="none")


def rows_of(evaluation: Evaluation) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(errors_csv(evaluation).decode())))


def text_of(evaluation: Evaluation) -> str:
    return "\n".join(evaluation_summary(evaluation, colour=False))


def test_csv() -> None:
    rows = rows_of(evaluate([ESTIMATE], TRUTH, options=NONE))
    assert ",".join(rows[0]) == "estimate,id,time_s,distance_m,x_m,y_m,z_m,translation_error_m,rotation_error_deg"
    assert [row["id"] for row in rows] == ["4", "5", "6"]
    assert [row["time_s"] for row in rows] == ["", "", ""]
    assert [float(row["distance_m"]) for row in rows] == [0.0, 1.0, 2.0]  # along the truth
    assert [float(row["translation_error_m"]) for row in rows] == [0.0, 5.0, 0.0]
    np.testing.assert_allclose([float(row["rotation_error_deg"]) for row in rows], [0.0, 90.0, 0.0], atol=1e-12)
    assert (rows[1]["x_m"], rows[1]["y_m"], rows[1]["z_m"]) == ("4.0", "4.0", "0.0")


def test_csv_of_several_estimates() -> None:
    other = replace(TRUTH, source='a "b", c', stamps=np.array([0.5, 1.5, 2.5]))
    covariances = Covariances(np.array([5]), np.eye(3)[None])
    rows = rows_of(evaluate([ESTIMATE, other], TRUTH, options=NONE, covariances=covariances))
    assert [row["estimate"] for row in rows] == ["folder/estimate.g2o"] * 3 + ['a "b", c'] * 3
    assert [row["time_s"] for row in rows[3:]] == ["0.5", "1.5", "2.5"]
    assert [row["nees"] for row in rows[::2]] == ["", "", ""]
    assert float(rows[1]["nees"]) == np.float64(25.0 + (np.pi / 2) ** 2)


def test_text_of_one_estimate() -> None:
    """Statistics go across, the alignment is always said."""
    text = text_of(evaluate([ESTIMATE], TRUTH, options=NONE))
    assert "truth      truth.g2o: 3 poses, 2 m" in text
    assert "none: the files as they are" in text
    assert "3 by id" in text
    header, line = (line for line in text.splitlines() if "rmse" in line or line.startswith("ATE translation"))
    assert header.split() == ["rmse", "mean", "median", "std", "min", "max"]
    assert line.split()[3:] == ["2.88675", "1.66667", "0", "2.35702", "0", "5"]
    assert "RPE rotation (deg) over 1 frame" in text


def test_text_of_several_estimates() -> None:
    """A column for each, named without its folder where that keeps them apart."""
    text = text_of(evaluate([ESTIMATE, TRUTH], TRUTH))
    assert any(line.split() == ["estimate.g2o", "truth.g2o"] for line in text.splitlines())
    twins = text_of(evaluate([ESTIMATE, replace(TRUTH, source="other/estimate.g2o")], TRUTH))
    assert any(line.split() == ["folder/estimate.g2o", "other/estimate.g2o"] for line in twins.splitlines())
    assert "se: rotation and translation" in text


def test_text_without_truth() -> None:
    text = text_of(evaluate([ESTIMATE]))
    assert "truth" not in text and "ATE" not in text and "alignment" not in text
    assert "first to last pose" in text


def test_document() -> None:
    """Everything plain, every number that exists; null where there is nothing."""
    covariances = Covariances(TRUTH.ids, np.tile(np.eye(3), (3, 1, 1)))
    evaluation = evaluate([ESTIMATE], TRUTH, options=NONE, covariances=covariances)
    document = json.loads(documents.dumps(evaluation_document(evaluation)))
    assert document["command"] == "evaluate"
    assert document["options"]["align"] == "none"
    assert document["truth"] == {"path": "truth.g2o", "poses": 3, "length": 2.0, "kind": "SE2"}
    (found,) = document["estimates"]
    assert found["ate"]["translation"]["max"] == 5.0
    assert found["association"]["matched"] == 3
    assert found["rpe"][0]["pairs"] == 2
    assert found["gap"]["translation"] == 0.0
    assert found["nees"]["count"] == 3
    assert (found["landmarks"], found["closures"]) == (None, None)
    bare = json.loads(documents.dumps(evaluation_document(evaluate([ESTIMATE]))))
    assert bare["truth"] is None
    assert [bare["estimates"][0][name] for name in ("ate", "alignment", "association", "nees")] == [None] * 4


def test_every_json_key_is_documented() -> None:
    page = (Path(__file__).parents[2] / "docs" / "json.md").read_text()
    section = page.partition("## `evaluate`")[2].partition("\n## ")[0].replace("[]`", "`")
    covariances = Covariances(TRUTH.ids, np.tile(np.eye(3), (3, 1, 1)))
    document = evaluation_document(evaluate([ESTIMATE], TRUTH, options=NONE, covariances=covariances))

    def keys(value: object) -> set[str]:
        if isinstance(value, dict):
            return set(value) | {key for item in value.values() for key in keys(item)}
        if isinstance(value, list):
            return {key for item in value for key in keys(item)}
        return set()

    from dataclasses import fields

    from slamcli.evaluation.closures import ClosureScores
    from slamcli.evaluation.landmarks import LandmarkErrors

    names = keys(document) - {"schema_version", "command", "version"}
    names |= {field.name for kind in (ClosureScores, LandmarkErrors) for field in fields(kind)}
    assert not {name for name in names if f"`{name}`" not in section}
