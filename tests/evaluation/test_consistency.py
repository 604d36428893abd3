"""NEES: the bands of published tables, errors drawn from the covariances, and files of covariances."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from noisy_paths import moved, planar, spatial
from support import write_file

from slamcli.errors import InputError, UsageError
from slamcli.evaluation import EvaluateOptions, evaluate
from slamcli.evaluation.consistency import chi2_band, chi2_quantile
from slamcli.formats.covariances import Covariances, read_covariances
from slamcli.graph.trajectory import Trajectory

UNALIGNED = EvaluateOptions(align="none")


def test_quantiles_of_tables() -> None:
    """As printed in every table of the chi-square distribution."""
    assert chi2_quantile(1, 0.95) == pytest.approx(3.841, abs=5e-4)
    assert chi2_quantile(3, 0.99) == pytest.approx(11.345, abs=5e-4)
    assert chi2_quantile(6, 0.95) == pytest.approx(12.592, abs=5e-4)
    assert chi2_band(10, 0.95) == pytest.approx((3.247, 20.483), abs=5e-4)


def test_nees_by_hand() -> None:
    """Errors of 1, 2 and 0.1 along axes with variances 1, 4 and 0.01: three times one."""
    truth = planar(4)
    error = np.array([[1.0, 2.0, 0.1]])
    estimate = replace(truth, poses=truth.kind.compose(truth.poses, truth.kind.inverse(np.tile(error, (4, 1)))))
    covariances = Covariances(truth.ids, np.tile(np.diag([1.0, 4.0, 0.01]), (4, 1, 1)))
    found = evaluate([estimate], truth, options=UNALIGNED, covariances=covariances).estimates[0].consistency
    assert found is not None
    np.testing.assert_allclose(found.values, 3.0, rtol=1e-12)
    assert (found.mean, found.inside, found.count, found.dimension) == (pytest.approx(3.0), 1.0, 4, 3)


@pytest.mark.parametrize("make", [planar, spatial])
def test_errors_drawn_from_the_covariances_are_consistent(make: object) -> None:
    """Full matrices in the frame of each pose; half as large covariances are told apart."""
    truth: Trajectory = make(2000)  # type: ignore[operator]
    d = truth.kind.dimension
    rng = np.random.default_rng(5)
    factor = 0.02 * rng.normal(size=(2000, d, d))
    covariance = np.matmul(factor, factor.transpose(0, 2, 1)) + 1e-4 * np.eye(d)
    drawn = np.matvec(np.linalg.cholesky(covariance), rng.normal(size=(2000, d)))
    # the estimate is where retract(estimate, drawn) is the truth
    back = truth.kind.retract(np.tile(truth.kind.identity, (2000, 1)).astype(float), drawn)
    estimate = replace(truth, poses=truth.kind.compose(truth.poses, truth.kind.inverse(back)))
    for scale, consistent in ((1.0, True), (0.5, False)):
        covariances = Covariances(truth.ids, scale * covariance)
        found = evaluate([estimate], truth, options=UNALIGNED, covariances=covariances).estimates[0].consistency
        assert found is not None and found.band is not None and found.mean is not None and found.inside is not None
        assert (found.band[0] <= found.mean <= found.band[1]) == consistent
        assert (abs(found.inside - 0.95) < 0.02) == consistent
    # a rigid motion of the whole estimate leaves covariances in local frames as they are
    shifted = moved(estimate, truth.kind.inverse(estimate.poses[:1])[0])
    covariances = Covariances(truth.ids, covariance)
    at_origin = EvaluateOptions(align="origin")
    before = evaluate([estimate], truth, options=at_origin, covariances=covariances).estimates[0].consistency
    after = evaluate([shifted], truth, options=at_origin, covariances=covariances).estimates[0].consistency
    assert before is not None and after is not None
    np.testing.assert_allclose(before.values, after.values, rtol=1e-6, atol=1e-9)


def test_held_poses_and_poses_without_covariance_are_counted() -> None:
    truth = planar(10)
    covariance = np.tile(0.01 * np.eye(3), (6, 1, 1))
    covariance[0] = 0.0  # the pose that the gauge holds
    found = (
        evaluate([planar(10, noise=0.05)], truth, options=UNALIGNED, covariances=Covariances(truth.ids[:6], covariance))
        .estimates[0]
        .consistency
    )
    assert found is not None
    assert (found.count, found.singular, found.without_covariance) == (5, 1, 4)
    assert np.isnan(found.values).sum() == 5


def test_what_does_not_go_together() -> None:
    truth = planar(10)
    good = Covariances(truth.ids, np.tile(np.eye(3), (10, 1, 1)))
    for align in ("se", "sim"):
        with pytest.raises(UsageError, match="NEES does not go with"):
            evaluate([truth], truth, options=EvaluateOptions(align=align), covariances=good)
    cases = (
        (truth, truth, Covariances(truth.ids, np.tile(np.eye(6), (10, 1, 1))), "3 dimensions"),
        (truth, truth, Covariances(truth.ids + 50, good.covariance), "no covariance has the id"),
        (truth, truth, Covariances(truth.ids, -good.covariance), "negative eigenvalue"),
        (replace(truth, ids=None), truth, good, "no ids"),
        (truth, spatial(10), good, "one kind"),
    )
    for estimate, true, covariances, message in cases:
        with pytest.raises(InputError, match=message):
            evaluate([estimate], true, options=UNALIGNED, covariances=covariances)


def test_files(tmp_path: Path) -> None:
    matrices = np.array([[[4.0, 1.0, 0.5], [1.0, 3.0, 0.2], [0.5, 0.2, 2.0]], np.eye(3)])
    archive = tmp_path / "covariances.npz"
    np.savez(archive, ids=np.array([7, 3]), covariance=matrices, frame="local")
    rows = "7,4,1,0.5,3,0.2,2\n3,1,0,0,1,0,1\n"
    plain = write_file(tmp_path, rows, "plain.csv")
    headed = write_file(tmp_path, "id,c11,c12,c13,c22,c23,c33\n" + rows, "headed.csv")
    for path in (archive, plain, headed):
        found = read_covariances(str(path))
        assert found.ids.tolist() == [7, 3]
        np.testing.assert_array_equal(found.covariance, matrices)
    spatial_row = "0," + ",".join("1" for _ in range(21)) + "\n"
    assert read_covariances(str(write_file(tmp_path, spatial_row, "spatial.csv"))).covariance.shape == (1, 6, 6)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "holds no covariance"),
        ("hello\n", "holds no covariance"),
        ("1,2,3\n", ":1:1: expected 4, 7 or 22 numbers"),
        ("1,4,1,0.5,3,0.2,2\n2,4,1,x,3,0.2,2\n", r":2:7: expected a finite number, found 'x'"),
        ("1,4,1,0.5,3,0.2,2\n1,4,1,0,3,0.2,2\n", "an id occurs twice"),
        ("1.5,4,1,0.5,3,0.2,2\n", ":1:1: expected an id, found"),
        ({"ids": [1], "covariance": np.eye(3)[None]}, "lacks frame"),
        ({"ids": [1], "covariance": np.eye(3)[None], "frame": "world"}, "frame is 'world'"),
        ({"ids": [1.5], "covariance": np.eye(3)[None], "frame": "local"}, "whole numbers"),
        ({"ids": [1, 2], "covariance": np.eye(3)[None], "frame": "local"}, "must be"),
        ({"ids": [1], "covariance": np.full((1, 3, 3), np.nan), "frame": "local"}, "not finite"),
        ({"ids": [1], "covariance": np.arange(9.0).reshape(1, 3, 3), "frame": "local"}, "not symmetric"),
    ],
)
def test_broken_files(content: str | dict[str, object], message: str, tmp_path: Path) -> None:
    path = tmp_path / "covariances"
    if isinstance(content, str):
        path.write_text(content)
    else:
        with open(path, "wb") as stream:
            np.savez(stream, **content)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=message):
        read_covariances(str(path))


def test_a_damaged_archive(tmp_path: Path) -> None:
    path = tmp_path / "covariances.npz"
    np.savez(path, ids=np.array([object()], dtype=object), covariance=np.eye(3)[None], frame="local")
    with pytest.raises(InputError, match="not a readable npz archive"):
        read_covariances(str(path))
