"""Golden chi2 values on the standard and the bundled data sets (see golden.py for the numbers and their sources)."""

from pathlib import Path

import numpy as np
import pytest
from golden import BELOW_LISTED, BUNDLED, DEFAULTS, G2O_GAUSS_NEWTON, G2O_LEVENBERG, GOLDEN, Golden
from numpy.typing import NDArray
from scipy.optimize import least_squares
from support import BUNDLED as BUNDLED_FOLDER
from support import dataset

import slamcli
from slamcli.solver.result import Result, Status


def cases(table: tuple[Golden, ...]) -> list[object]:
    """The rows of a table as parameters of a test."""
    return [
        pytest.param(row, id=f"{row.path}-{row.method}-{row.init}", marks=[pytest.mark.slow] if row.slow else [])
        for row in table
    ]


def run(row: Golden, path: object) -> Result:
    """The start's chi2 is checked at the file's values, wherever the run starts."""
    graph = slamcli.read(str(path))
    if row.start is not None:
        assert all(column.known.all() for column in graph.variables.values())
        assert graph.chi2() == pytest.approx(row.start, rel=1e-8)
    return slamcli.optimize(graph, method=row.method, init=row.init, max_iterations=row.max_iterations)


@pytest.mark.datasets
@pytest.mark.parametrize("row", cases(GOLDEN))
def test_reaches_the_best_known_optimum(row: Golden) -> None:
    result = run(row, dataset(row.path))
    if row.best is None:
        assert result.final_chi2 < result.initial_chi2
        return
    assert result.status is Status.CONVERGED
    assert result.final_chi2 == pytest.approx(row.best, rel=1e-6)
    assert result.graph.chi2() == pytest.approx(result.final_chi2, rel=1e-12)


@pytest.mark.datasets
@pytest.mark.parametrize(("path", "best"), DEFAULTS.items())
def test_defaults_reach_the_best_known_optimum(path: str, best: float) -> None:
    result = slamcli.optimize(slamcli.read(str(dataset(path))))
    assert result.status is Status.CONVERGED
    assert result.final_chi2 == pytest.approx(best, rel=1e-6)


@pytest.mark.parametrize("row", cases(BUNDLED))
@pytest.mark.parametrize("method", ["auto", "gn", "lm", "dogleg"])
@pytest.mark.parametrize("init", ["file", "odometry", "spanning-tree", "chordal", "auto"])
def test_bundled(row: Golden, method: str, init: str) -> None:
    wanted = Golden(row.path, row.start, row.best, row.source, method, init)
    result = run(wanted, BUNDLED_FOLDER / row.path)
    assert result.status is Status.CONVERGED
    assert result.final_chi2 == pytest.approx(row.best, rel=1e-8)


def test_numbers_of_the_toro_file() -> None:
    """They are those of a general solver that shares no line with slamcli, the reading included."""
    row = next(row for row in BUNDLED if row.source == "scipy")
    assert toro_by_scipy(BUNDLED_FOLDER / row.path) == pytest.approx((row.start, row.best), rel=1e-10)


def toro_by_scipy(path: Path) -> tuple[float, float]:
    """chi2 of a TORO file with consecutive ids, at its vertices and at the optimum with the first pose held."""
    rows = [line.split() for line in path.read_text().splitlines()]
    start = np.array([row[2:] for row in rows if row[0] == "VERTEX2"], dtype=np.float64)
    edges = np.array([row[1:] for row in rows if row[0] == "EDGE2"], dtype=np.float64)
    i, j = edges[:, :2].astype(int).T
    xx, xy, yy, tt, xt, yt = edges[:, 5:].T  # TORO's order
    information = np.stack([xx, xy, xt, xy, yy, yt, xt, yt, tt], axis=1).reshape(-1, 3, 3)
    root = np.linalg.cholesky(information).transpose(0, 2, 1)

    def residuals(moving: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y, angle = np.concatenate([start[0], moving]).reshape(-1, 3).T
        dx, dy, cosine, sine = x[j] - x[i], y[j] - y[i], np.cos(angle[i]), np.sin(angle[i])
        seen = np.stack([cosine * dx + sine * dy, cosine * dy - sine * dx, angle[j] - angle[i]], axis=1)
        error = seen - edges[:, 2:5]
        error[:, 2] = np.arctan2(np.sin(error[:, 2]), np.cos(error[:, 2]))
        return np.asarray(np.einsum("nij,nj->ni", root, error).ravel())

    before = residuals(start[1:].ravel())
    found = least_squares(residuals, start[1:].ravel(), xtol=1e-15, ftol=1e-15, gtol=1e-12)
    return float(before @ before), float(found.fun @ found.fun)


@pytest.mark.datasets
@pytest.mark.parametrize("row", cases(tuple(BELOW_LISTED)))
def test_slow_tails_are_followed_below_the_listed_value(row: Golden) -> None:
    result = run(row, dataset(row.path))
    assert result.status is Status.CONVERGED
    assert result.final_chi2 < BELOW_LISTED[row]
    assert result.final_chi2 == pytest.approx(row.best, rel=1e-6)


@pytest.mark.datasets
def test_local_minimum_of_mit() -> None:
    """From the file's values g2o's Gauss-Newton ends there too."""
    result = slamcli.optimize(slamcli.read(str(dataset("pose2d/MIT_carlone.g2o"))), method="gn", init="file")
    assert result.status is Status.CONVERGED
    assert result.final_chi2 == pytest.approx(770.663502, rel=1e-8)


@pytest.mark.datasets
def test_marquardt_on_mit() -> None:
    """The damped path from the file's values ends in another local minimum."""
    result = slamcli.optimize(slamcli.read(str(dataset("pose2d/MIT_carlone.g2o"))), method="lm", init="file")
    assert result.final_chi2 == pytest.approx(526.331, rel=1e-6)


@pytest.mark.datasets
def test_cubicle_is_refused() -> None:
    """Its information matrices are indefinite: there is no minimum to find, and the edges are named."""
    result = slamcli.optimize(slamcli.read(str(dataset("pose3d/cubicle.g2o"))))
    assert result.status is Status.FAILED
    assert result.exit_code == 5
    assert result.initial_chi2 == pytest.approx(9665716.94, rel=1e-8)
    assert "5021 information matrices are indefinite" in result.reason
    assert any("EDGE_SE3:QUAT" in line and "(line" in line for line in result.diagnosis)


@pytest.mark.datasets
@pytest.mark.parametrize(("method", "lines"), [("gn", G2O_GAUSS_NEWTON), ("lm", G2O_LEVENBERG)])
def test_first_iterations_are_those_of_g2o(method: str, lines: tuple[tuple[float, float | None], ...]) -> None:
    result = slamcli.optimize(slamcli.read(str(dataset("pose2d/intel_sesync.g2o"))), method=method, init="file")
    for record, (chi2, damping) in zip(result.trace[:3], lines, strict=True):
        assert record.chi2 == pytest.approx(chi2, abs=5.1e-7)  # g2o prints six decimals
        assert record.damping == (None if damping is None else pytest.approx(damping, abs=5.1e-7))


@pytest.mark.datasets
def test_a_spanning_tree_ignores_the_values_of_the_file() -> None:
    """MIT without vertices is the same graph as MIT with them, and so is its tree."""
    with_vertices = slamcli.optimize(
        slamcli.read(str(dataset("pose2d/MIT_carlone.g2o"))), init="spanning-tree", max_iterations=0
    )
    without = slamcli.optimize(
        slamcli.read(str(dataset("pose2d/MIT_rome_novertices.g2o"))), init="spanning-tree", max_iterations=0
    )
    assert without.initial_chi2 == pytest.approx(with_vertices.initial_chi2, rel=1e-9)
