"""Reprojection errors of scenes whose errors are known."""

from dataclasses import replace

import numpy as np
import pytest
from bundle_scenes import ring
from numpy.testing import assert_allclose
from support import BUNDLED

import slamcli
from slamcli.evaluation.reprojection import reprojection
from slamcli.graph import FactorGraph
from slamcli.models.base import Array
from slamcli.reporting.reprojection import reprojection_lines, reprojection_section


def shifted(offset: Array) -> FactorGraph:
    """A scene without noise whose measured pixels are off by (m, 2)."""
    scene = ring(cameras=3, points=10, noise=0.0, share=1.0)
    factors = scene.factors[0]
    return replace(scene, factors=[replace(factors, measurements=factors.measurements + offset)])


def test_known_errors() -> None:
    offset = np.zeros((30, 2))
    offset[:10] = [3.0, 4.0]
    offset[10:20] = [0.0, 1.0]
    found = reprojection(shifted(offset))
    assert found is not None
    assert (found.observations, found.behind) == (30, 0)
    assert_allclose(found.camera_rms, [5.0, 1.0, 0.0], atol=1e-9)
    assert_allclose(found.camera_largest, [5.0, 1.0, 0.0], atol=1e-9)
    assert found.cameras.tolist() == [0, 1, 2]
    assert found.camera_observations.tolist() == [10, 10, 10]
    assert found.mean == pytest.approx(2.0)
    assert found.median == pytest.approx(1.0)
    assert found.largest == pytest.approx(5.0)
    assert found.rms == pytest.approx(np.sqrt(26.0 / 3.0))
    assert found.sigma == pytest.approx(np.sqrt(26.0 / 6.0))


def test_behind_and_without_an_image() -> None:
    scene = shifted(np.zeros((30, 2)))
    values = {name: value.copy() for name, value in scene.values.items()}
    values["XYZ"][4] = 1.5 * values["CAMERA"][1, :3]  # behind camera 1
    values["XYZ"][5] = values["CAMERA"][2, :3]  # at camera 2
    found = reprojection(scene.with_values(values))
    assert found is not None
    assert found.observations == 29
    assert found.camera_behind.tolist()[1:] == [1, 1]
    assert np.isfinite(found.camera_rms).all()


def test_graphs_without_cameras_have_none() -> None:
    graph = slamcli.read(str(BUNDLED / "landmarks_small.g2o"))
    assert reprojection(graph) is None
    assert reprojection_lines(None, None) == []
    assert reprojection_section(None, None) is None


def test_reports() -> None:
    offset = np.zeros((30, 2))
    offset[:10] = [3.0, 4.0]
    before, after = reprojection(shifted(offset)), reprojection(shifted(np.zeros((30, 2))))
    lines = reprojection_lines(before, after)
    assert lines[2].split()[:2] == ["before", "2.887"]
    assert "0: 5 -> " in lines[-1]
    section = reprojection_section(before, after)
    assert section is not None
    assert section["before"]["cameras"][0] == pytest.approx(
        {"id": 0, "observations": 10, "behind": 0, "rms": 5.0, "largest": 5.0}
    )
