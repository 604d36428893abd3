"""What ``slamcli covariance`` prints and writes, against the numbers that it was given."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from support import BUNDLED

import slamcli
from slamcli.cli.main import main
from slamcli.graph import analyze
from slamcli.reporting import documents
from slamcli.reporting.covariance import covariance_document, covariance_summary, optimum_warning, write_covariances
from slamcli.solver.covariance import CovarianceRecovery, CovarianceRequest, recover
from slamcli.solver.options import OptimizeOptions

QUANTILES = {2: 5.991464547107979, 3: 7.814727903251179}


def result_of(name: str, fix: tuple[int, ...] = (), **request: object):
    graph = slamcli.optimize(slamcli.read(str(BUNDLED / name)), method="gn", init="file").graph
    return recover(CovarianceRecovery(graph, OptimizeOptions(fix=fix)), CovarianceRequest(**request))


def summary_of(result: object, rows: int = 3) -> list[str]:
    return covariance_summary(result, QUANTILES, 0.95, rows, 0.5, "cov.npz")


def test_the_summary_names_frame_gauge_and_scale() -> None:
    lines = summary_of(result_of("landmarks_small.g2o"))
    text = "\n".join(lines)
    assert lines[0] == "covariances  100 SE2, 35 XY"
    assert "gauge        lowest id held: 0; covariances are relative to what is held, whose own are zero" in text
    assert "tangent      SE2: x [m], y [m], theta [rad]; frame of the pose" in text
    assert "tangent      XY: x [m], y [m]; axes of the world" in text
    assert "scale        none: as the information matrices state the noise" in text
    assert "the 3 SE2 of largest uncertainty, and regions of 0.95 probability" in text
    half = "\n".join(summary_of(result_of("sphere_small.g2o")))
    assert "SE3: x [m], y [m], z [m], qx, qy, qz; frame of the pose; qx, qy, qz are half the rotation vector" in half


def test_the_largest_come_first_and_named_ones_in_their_order() -> None:
    result = result_of("landmarks_small.g2o", of="poses")
    total = np.sqrt(np.trace(result.marginals[0].covariance[:, :2, :2], axis1=1, axis2=2))
    wanted = result.marginals[0].ids[np.argsort(-total)[:3]].tolist()
    table = summary_of(result)
    start = next(k for k, line in enumerate(table) if line.lstrip().startswith("id "))
    assert [int(line.split()[0]) for line in table[start + 1 : start + 4]] == wanted
    named = summary_of(result_of("landmarks_small.g2o", ids=(50, 3, 0, 50)), rows=1)
    start = next(k for k, line in enumerate(named) if line.lstrip().startswith("id "))
    assert [line.split()[0] for line in named[start + 1 : start + 4]] == ["50", "3", "0"]
    assert named[start + 3].split()[-2:] == ["-", "held"]


def test_a_document_has_everything_in_its_convention() -> None:
    result = result_of(
        "sphere_small.g2o", ids=(7, 8), joint=(7, 300), relative=((7, 300),), cross=True, convention="gtsam"
    )
    made = covariance_document(result, analyze(result.graph), QUANTILES, 0.95, {"recover": 0.5})
    document = json.loads(documents.dumps(made))
    (marginals,) = document["marginals"]
    assert marginals["tangent"] == ["rx", "ry", "rz", "x", "y", "z"] and marginals["ids"] == [7, 8]
    np.testing.assert_array_equal(np.array(marginals["covariance"]), result.marginals[0].covariance)
    # degrees of the rotation itself, whatever the convention: rotation vectors have them as they stand
    sigma = np.degrees(np.sqrt(np.diagonal(result.marginals[0].covariance, axis1=1, axis2=2)[:, :3]))
    np.testing.assert_allclose(marginals["sigma_rotation_deg"], sigma, rtol=1e-12)
    assert document["joint"]["names"][6] == "300 rx" and np.shape(document["joint"]["covariance"]) == (12, 12)
    (cross,) = document["cross"]
    assert cross["ids"] == [[7, 8]] and np.shape(cross["covariance"]) == (1, 6, 6)
    (relative,) = document["relative"]
    assert relative["ids"] == [7, 300] and len(relative["value"]) == 7 and len(relative["semi_axes_m"]) == 3
    assert document["at_optimum"] is True and document["gauge"]["held"] == [0]


def test_an_archive_has_joint_cross_and_relative_covariances(tmp_path: Path) -> None:
    result = result_of("landmarks_small.g2o", joint=(3, 102), relative=((3, 4), (3, 102)), cross=True)
    path = str(tmp_path / "all.npz")
    write_covariances(path, result, {})
    with np.load(path) as archive:
        np.testing.assert_array_equal(archive["joint_covariance"], result.joint.covariance)
        assert archive["joint_names"].tolist() == ["3 x", "3 y", "3 theta", "102 x", "102 y"]
        assert archive["relative_SE2_ids"].tolist() == [[3, 4]] and archive["relative_XY_ids"].tolist() == [[3, 102]]
        assert archive["cross_SE2_XY_covariance"].shape[1:] == (3, 2)
        assert archive["held"].tolist() == [0] and float(archive["factor"]) == 1.0


def test_the_frame_in_the_world_is_stated(tmp_path: Path) -> None:
    path = str(tmp_path / "world.npz")
    write_covariances(path, result_of("manhattan_small.g2o", convention="g2o"), {})
    with np.load(path) as archive:
        assert (str(archive["frame"]), str(archive["convention"])) == ("world", "g2o")


def test_a_warning_where_the_values_are_no_optimum(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert optimum_warning(result_of("manhattan_small.g2o")) == []
    graph = str(BUNDLED / "manhattan_small.g2o")
    assert main(["covariance", graph, "--rows", "0"]) == 0
    said = capsys.readouterr().err
    assert "not at an optimum: optimize first. A step would lower chi2 from" in said
    optimum, path = str(tmp_path / "optimum.g2o"), str(tmp_path / "c.npz")
    begin = ["optimize", graph, "--method", "gn", "--init", "file", "--max-iterations", "0"]
    assert main([*begin, "-o", optimum, "--covariances", path, "-q"]) == 4
    assert "not at an optimum" in capsys.readouterr().err and Path(path).exists()


def test_covariances_of_a_failed_run_are_not_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    graph = tmp_path / "graph.g2o"
    graph.write_text("VERTEX_SE2 0 0 0 0\nVERTEX_XY 77 5 5\nEDGE_BEARING_SE2_XY 0 77 0.8 10\n")
    path = tmp_path / "c.npz"
    assert main(["optimize", str(graph), "--covariances", str(path), "-q"]) == 5
    assert "no covariances are written" in capsys.readouterr().err and not path.exists()
    # damped steps end somewhere, too; the covariances are those of the undamped H, which has no inverse
    assert main(["optimize", str(graph), "--method", "lm", "--covariances", str(path), "-q"]) == 5
    assert not path.exists()
