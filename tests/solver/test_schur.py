"""The Schur complement against the whole system, and where it is taken."""

from dataclasses import replace

import numpy as np
import pytest
from bundle_scenes import perturbed, ring
from numpy.testing import assert_allclose
from support import BUNDLED

import slamcli
from slamcli import models
from slamcli.errors import UsageError
from slamcli.graph import FactorGraph, Factors, Variables
from slamcli.models.base import Array
from slamcli.solver import gauge, schur
from slamcli.solver.backends import NotPositiveDefiniteError
from slamcli.solver.linear_system import LinearSystem
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.pattern import BlockPattern
from slamcli.solver.problem import Problem
from slamcli.solver.schur import complement
from slamcli.solver.stopwatch import Stopwatch


def dense(pattern: BlockPattern, values: Array) -> Array:
    """The whole symmetric matrix; both triangles of diagonal blocks are stored."""
    out = np.zeros((pattern.dimension, pattern.dimension))
    out[pattern.scalar_rows, pattern.scalar_columns] = values
    out[pattern.scalar_columns, pattern.scalar_rows] = values
    return out


def problem(graph: FactorGraph, elimination: str = "schur", **options: str) -> Problem:
    _, held = gauge.choose(graph)
    return Problem(graph, held, OptimizeOptions(elimination=elimination, **options), Stopwatch())


def mixed() -> FactorGraph:
    """Cameras of nine dimensions and poses of six see the same points; one point and one camera are held."""
    scene = perturbed(ring(cameras=4, points=30))
    rng = np.random.default_rng(3)
    count = 5
    poses = Variables(
        kind=models.SE3,
        ids=np.arange(1000, 1000 + count),
        values=models.SE3.normalize(rng.normal(size=(count, 7))),
        fixed=np.zeros(count, dtype=bool),
        known=np.ones(count, dtype=bool),
        lines=np.zeros(count, dtype=np.intp),
    )
    rows = np.argwhere(rng.random((count, 30)) < 0.6)
    seen = Factors(
        kind=models.POINT_OBSERVATION_3D,
        indices=rows,
        measurements=rng.normal(size=(len(rows), 3)),
        information=np.tile(np.diag([1.0, 2.0, 3.0]), (len(rows), 1, 1)),
        parameters=np.tile(models.SE3.identity, (len(rows), 1)),
    )
    fixed = np.arange(30) == 7
    points = replace(scene.variables["XYZ"], fixed=fixed)
    return FactorGraph({"SE3": poses, **scene.variables, "XYZ": points}, [*scene.factors, seen])


def landmarks() -> FactorGraph:
    return slamcli.read(str(BUNDLED / "landmarks_small.g2o"))


SCENES = {"ring": lambda: perturbed(ring()), "mixed": mixed, "landmarks": landmarks}


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("long", [1, 4, 10**9])
def test_the_step_is_that_of_the_whole_system(scene: str, long: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(complement, "_LONG", long)
    monkeypatch.setattr(complement, "_CHUNK", 100)
    own = problem(SCENES[scene]())
    assert own.schur is not None
    system = own.linearize(own.schur and SCENES[scene]().values)
    damping = 1e-3 * own.diagonal(system) + 1e-9
    expected = np.linalg.solve(dense(own.pattern, system.hessian) + np.diag(damping), -system.gradient)
    assert_allclose(own.solve(system, damping), expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    assert_allclose(own.solve_again(system), expected, rtol=0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("linear_solver", ["cholmod", "superlu"])
def test_a_sparse_complement(linear_solver: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(schur.selection, "_SMALL", 0)
    monkeypatch.setattr(schur.selection, "_DENSE", 2.0)
    graph = landmarks()
    own, whole = problem(graph, linear_solver=linear_solver), problem(graph, "none")
    assert own.schur is not None
    assert not own.schur.dense
    system = own.linearize(graph.values)
    expected = whole.solve(system)
    assert_allclose(own.solve(system), expected, rtol=0, atol=1e-10 * np.abs(expected).max())


def test_the_complement_has_the_pattern_that_elimination_leaves() -> None:
    graph = mixed()
    own = problem(graph)
    assert own.schur is not None
    structure = own.schur.structure
    matrix = dense(own.pattern, (np.arange(own.pattern.stored) >= 0).astype(float))
    matrix += 1e3 * np.eye(len(matrix))
    kept, gone = structure.kept_rows, structure.gone_rows.ravel()
    left = matrix[np.ix_(kept, kept)] - matrix[np.ix_(kept, gone)] @ np.linalg.solve(
        matrix[np.ix_(gone, gone)], matrix[np.ix_(gone, kept)]
    )
    reduced = structure.reduced
    stored = dense(reduced, np.ones(reduced.stored))
    assert (stored[left != 0.0] == 1.0).all()
    blocks = set(zip(reduced.rows.tolist(), reduced.columns.tolist(), strict=True))
    assert blocks == {
        (i, j)
        for j in range(len(reduced.sizes))
        for i in range(j + 1)
        if left[reduced.offsets[i] : reduced.offsets[i + 1], reduced.offsets[j] : reduced.offsets[j + 1]].any()
    }


def test_the_order_of_elimination_is_a_permutation_and_its_factor_no_smaller_than_the_matrix() -> None:
    own = problem(landmarks())
    assert sorted(own.elimination.order.tolist()) == list(range(len(own.pattern.sizes)))
    assert own.elimination.name.startswith("Schur complement of XY")
    assert own.sparsity.nnz_factor >= own.sparsity.nnz_hessian


@pytest.mark.parametrize("damaged", ["point", "camera"])
def test_what_is_not_positive_definite_is_refused(damaged: str) -> None:
    graph = perturbed(ring())
    own = problem(graph)
    assert own.schur is not None
    system = own.linearize(graph.values)
    rows = own.schur.structure.gone_rows[3] if damaged == "point" else own.schur.structure.kept_rows[:9]
    damping = 1e-3 * own.diagonal(system)
    damping[rows] = -0.5 * own.diagonal(system)[rows]
    with pytest.raises(NotPositiveDefiniteError):
        own.solve(system, damping)


def test_the_free_gauge_of_a_scene_is_found_singular() -> None:
    graph = ring(noise=0.0)
    own = problem(graph)
    assert own.full_step(own.linearize(graph.values)).singular


@pytest.mark.parametrize("scene", ["landmarks", "ring"])
def test_optima_with_and_without_are_the_same(scene: str) -> None:
    graph = SCENES[scene]()
    results = [slamcli.optimize(graph, elimination=name, tolerance=1e-13) for name in ("schur", "none")]
    assert results[0].final_chi2 == pytest.approx(results[1].final_chi2, rel=1e-9)
    if scene == "landmarks":  # the other one is free to float
        for name in graph.variables:
            assert_allclose(results[0].graph.values[name], results[1].graph.values[name], rtol=0, atol=1e-9)


@pytest.mark.parametrize("method", ["gn", "lm", "dogleg", "auto"])
def test_all_methods_run_on_it(method: str) -> None:
    result = slamcli.optimize(landmarks(), elimination="schur", method=method)
    assert result.exit_code == 0
    assert result.final_chi2 == pytest.approx(slamcli.optimize(landmarks(), elimination="none").final_chi2, rel=1e-8)


def test_where_there_are_no_points_it_is_refused_or_left_alone() -> None:
    graph = slamcli.read(str(BUNDLED / "manhattan_small.g2o"))
    assert problem(graph, "auto").schur is None
    with pytest.raises(UsageError, match="points that no edge joins"):
        problem(graph, "schur")


def test_points_that_an_edge_joins_are_not_eliminated() -> None:
    graph = landmarks()
    joined = Factors(models.POINT_DIFFERENCE_2D, np.array([[0, 1]]), np.zeros((1, 2)), np.eye(2)[None])
    graph = replace(graph, factors=[*graph.factors, joined])
    assert problem(graph, "auto").schur is None
    with pytest.raises(UsageError):
        problem(graph, "schur")


def test_scenes_are_solved_with_it_by_default() -> None:
    assert problem(perturbed(ring(cameras=12, points=10)), "auto").schur is not None
    own = problem(perturbed(ring(cameras=5, points=400)), "auto")
    assert own.schur is not None
    assert own.schur.dense
    assert problem(perturbed(ring()), "none").schur is None


def test_the_right_hand_side_is_not_changed() -> None:
    graph = landmarks()
    own = problem(graph)
    system = own.linearize(graph.values)
    before = LinearSystem(system.values, system.chi2, system.hessian.copy(), system.gradient.copy())
    own.solve(system, np.ones_like(system.gradient))
    np.testing.assert_array_equal(system.hessian, before.hessian)
    np.testing.assert_array_equal(system.gradient, before.gradient)


def test_both_systems_are_reported() -> None:
    own = problem(perturbed(ring(cameras=4, points=30)))
    reduced = own.sparsity.reduced
    assert reduced is not None
    assert (reduced.eliminated, reduced.dimension, reduced.dense) == ("XYZ", 36, True)
    assert reduced.nnz == 36 * 37 // 2
    assert problem(perturbed(ring()), "none").sparsity.reduced is None
