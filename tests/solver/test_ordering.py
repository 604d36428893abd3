"""Elimination orders: permutations all, with the properties that each is made for."""

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from graphs import BUNDLED_NAMES, bundled, dense, make_problem, mixed_graph, variables
from numpy.testing import assert_array_equal
from numpy.typing import NDArray
from orderings import skip_without_library
from support import write_file

import slamcli
from slamcli import models
from slamcli.errors import InputError, UsageError
from slamcli.graph import FactorGraph, Factors
from slamcli.graph.columns import IndexArray
from slamcli.solver import gauge, ordering, symbolic
from slamcli.solver import pattern as patterns
from slamcli.solver.options import ORDERINGS
from slamcli.solver.ordering import automatic
from slamcli.solver.ordering.calibration import Calibration, laplacian
from slamcli.solver.ordering.changes import change, factor_counts, hessian_counts
from slamcli.solver.ordering.comparison import compare, names_of
from slamcli.solver.ordering.constrained import in_groups
from slamcli.solver.ordering.reduction import reduced_edges
from slamcli.solver.pattern import BlockPattern
from slamcli.solver.symbolic.cells import CLOSURE, LANDMARK, POSE, hessian_kinds

seeds = pytest.mark.parametrize("seed", range(6))


def pattern_of(count: int, pairs: list[tuple[int, int]], sizes: list[int] | None = None) -> BlockPattern:
    """A pattern with these blocks off the diagonal."""
    keys = np.unique([max(p) * count + min(p) for p in pairs] + [k * (count + 1) for k in range(count)])
    columns, rows = np.divmod(keys, count)
    return BlockPattern(np.array(sizes or [1] * count), rows, columns)


def grid(side: int) -> BlockPattern:
    """The graph of a square lattice."""
    number = np.arange(side * side).reshape(side, side)
    pairs = np.concatenate(
        [
            np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], axis=1),
            np.stack([number[:-1].ravel(), number[1:].ravel()], axis=1),
        ]
    )
    return pattern_of(side * side, [(int(a), int(b)) for a, b in pairs])


@seeds
@pytest.mark.parametrize("name", ORDERINGS)
def test_orders_are_permutations(seed: int, name: str) -> None:
    skip_without_library(name)
    graph, held = mixed_graph(seed)
    pattern, _ = patterns.build(graph, held)
    assert_array_equal(np.sort(ordering.order(name, pattern)), np.arange(len(pattern.sizes)))


@pytest.mark.parametrize("name", ORDERINGS)
@pytest.mark.parametrize("pattern", [pattern_of(1, []), pattern_of(4, []), pattern_of(2, [(0, 1)])])
def test_orders_of_next_to_nothing(name: str, pattern: BlockPattern) -> None:
    skip_without_library(name)
    assert_array_equal(np.sort(ordering.order(name, pattern)), np.arange(len(pattern.sizes)))


@pytest.mark.parametrize("name", ["amd", "colamd", "metis", "rcm"])
def test_orders_that_fill_less_than_the_natural_one(name: str) -> None:
    """Reverse Cuthill-McKee on a lattice that is numbered at random, the others on any."""
    skip_without_library(name)
    lattice = grid(30)
    mixed = np.random.default_rng(0).permutation(900)
    found = symbolic.analyze(lattice, ordering.order(name, lattice))
    assert found.nnz_factor < symbolic.analyze(lattice, mixed).nnz_factor / 3


def test_dissection_beats_minimum_degree_on_a_large_lattice_and_is_flatter() -> None:
    pytest.importorskip("pymetis")
    lattice = grid(60)
    dissected, degree = (symbolic.analyze(lattice, ordering.order(name, lattice)) for name in ("metis", "amd"))
    assert dissected.flops < degree.flops
    assert dissected.height < degree.height


def test_a_bandwidth_by_hand() -> None:
    """A path that is numbered at random becomes a path again: no block but the neighbours'."""
    mixed = np.random.default_rng(1).permutation(20).tolist()
    path = pattern_of(20, list(pairwise(mixed)))
    order = ordering.order("rcm", path)
    position = np.empty(20, dtype=np.intp)
    position[order] = np.arange(20)
    assert np.abs(position[path.rows] - position[path.columns]).max() == 1


def test_columns_of_a_tree_fill_nothing() -> None:
    """COLAMD, like any minimum degree order, eliminates the leaves of a tree first."""
    rng = np.random.default_rng(2)
    tree = pattern_of(50, [(int(rng.integers(0, k)), k) for k in range(1, 50)])
    for name in ("amd", "colamd"):
        assert symbolic.analyze(tree, ordering.order(name, tree)).nnz_factor == tree.nnz


def test_colamd_fills_like_that_of_gtsam() -> None:
    """GTSAM has COLAMD itself, from the same library: on the same columns the fill-in agrees within 5 %."""
    gtsam = pytest.importorskip("gtsam")
    pattern = make_problem(bundled("manhattan_small.g2o")).pattern
    graph = gtsam.NonlinearFactorGraph()
    noise = gtsam.noiseModel.Isotropic.Sigma(3, 1.0)
    off = pattern.rows != pattern.columns
    for i, j in zip(pattern.rows[off].tolist(), pattern.columns[off].tolist(), strict=True):
        graph.add(gtsam.BetweenFactorPose2(i, j, gtsam.Pose2(), noise))
    theirs = gtsam.Ordering.ColamdNonlinearFactorGraph(graph)
    order = np.array([theirs.at(k) for k in range(theirs.size())], dtype=np.intp)
    ours = symbolic.analyze(pattern, ordering.order("colamd", pattern)).nnz_factor
    assert ours == pytest.approx(symbolic.analyze(pattern, order).nnz_factor, rel=0.05)


# -- constraints -------------------------------------------------------------------------------------------------------


def test_landmarks_first_and_last_pose_last() -> None:
    graph = bundled("landmarks_small.g2o")
    pattern = make_problem(graph).pattern
    assert pattern.pose_rank is not None
    is_pose = pattern.pose_rank >= 0
    first = ordering.order("amd-landmarks-first", pattern)
    assert_array_equal(is_pose[first], np.sort(is_pose))
    last = ordering.order("amd-last-pose-last", pattern)
    assert last[-1] == pattern.pose_rank.argmax()
    ids = graph.variables["SE2"].ids
    assert ids[~gauge.choose(graph)[1]["SE2"]][last[-1]] == ids.max()


def test_the_last_pose_is_that_of_the_highest_id_wherever_it_stands(tmp_path: Path) -> None:
    text = "".join(f"VERTEX_SE2 {i} 0 0 0\n" for i in (7, 90, 3, 12))
    text += "".join(f"EDGE_SE2 {i} {j} 1 0 0 1 0 0 1 0 1\n" for i, j in ((3, 7), (7, 12), (12, 90)))
    pattern = make_problem(slamcli.read(str(write_file(tmp_path, text)))).pattern
    assert ordering.order("amd-last-pose-last", pattern)[-1] == 1, "3 is held, so 90 is the second block"


def test_poses_alone_have_no_landmarks_to_put_first() -> None:
    pattern = make_problem(bundled("manhattan_small.g2o")).pattern
    assert_array_equal(ordering.order("amd-landmarks-first", pattern), ordering.order("amd", pattern))


@seeds
def test_reduced_graph_is_that_of_dense_elimination(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count = 14
    full = np.triu(rng.random((count, count)) < 0.15, 1)
    low, high = np.nonzero(full)
    gone = rng.random(count) < 0.5
    dense = full | full.T
    for k in np.flatnonzero(gone):
        joined = np.flatnonzero(dense[k])
        dense[np.ix_(joined, joined)] = True
        dense[k] = dense[:, k] = False
    np.fill_diagonal(dense, False)
    found = np.zeros_like(dense)
    found[reduced_edges(low, high, gone)] = True
    assert_array_equal(found | found.T, dense)


@seeds
def test_groups_come_one_after_the_other(seed: int) -> None:
    graph, held = mixed_graph(seed)
    pattern, _ = patterns.build(graph, held)
    group = np.random.default_rng(seed).integers(0, 3, len(pattern.sizes))
    order = in_groups(pattern, group)
    assert_array_equal(np.sort(order), np.arange(len(group)))
    assert_array_equal(group[order], np.sort(group))


# -- the choice --------------------------------------------------------------------------------------------------------


def test_auto_takes_the_fewest_flops_of_what_it_looks_at(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pymetis")
    monkeypatch.setattr(automatic, "_WORTH_A_LOOK", 0.0)
    for lattice, wanted in ((grid(60), "metis"), (pattern_of(30, [(k, k + 1) for k in range(29)]), "amd")):
        found = automatic.choose(lattice)
        flops = {n: symbolic.analyze(lattice, ordering.order(n, lattice)).flops for n in ("amd", "metis")}
        assert (found.name, found.analysis(lattice).flops) == (wanted, min(flops.values()))


def test_auto_does_not_look_beyond_minimum_degree_on_small_graphs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pymetis", None)  # it cannot be imported
    for name in BUNDLED_NAMES:
        problem = make_problem(bundled(name), ordering="auto")
        assert problem.sparsity.ordering == "amd"


def test_an_order_is_found_once_for_a_pattern(monkeypatch: pytest.MonkeyPatch) -> None:
    pattern = make_problem(bundled("manhattan_small.g2o")).pattern
    again = BlockPattern(pattern.sizes.copy(), pattern.rows.copy(), pattern.columns.copy(), pattern.pose_rank)
    found = ordering.find("auto", pattern)
    assert ordering.find("auto", again) is found
    assert found.analysis(again) is found.analysis(pattern)
    other = BlockPattern(pattern.sizes[:-1], pattern.rows[:-5], pattern.columns[:-5])
    assert ordering.find("amd", other) is not ordering.find("amd", pattern)
    for k in range(2, 30):  # and it does not remember for ever
        ordering.find("natural", pattern_of(k, []))
    assert ordering.find("auto", again) is not found


def test_orders_that_do_not_exist(monkeypatch: pytest.MonkeyPatch) -> None:
    pattern = pattern_of(3, [(0, 1)])
    with pytest.raises(UsageError, match="'mmd' does not exist"):
        ordering.order("mmd", pattern)
    monkeypatch.setitem(sys.modules, "pymetis", None)
    with pytest.raises(UsageError, match="pymetis, which is not installed") as caught:
        ordering.order("metis", pattern_of(5, [(0, 1)]))
    assert any("pip install pymetis" in line for line in caught.value.details)
    with pytest.raises(UsageError, match="'mmd' does not exist"):
        names_of("amd,mmd")
    with pytest.raises(UsageError, match="names no ordering"):
        names_of(" , ")
    assert names_of("amd, natural,amd") == (["amd", "natural"], True)


# -- comparison and changes --------------------------------------------------------------------------------------------


def test_comparison_has_the_numbers_of_the_analysis() -> None:
    graph = bundled("landmarks_small.g2o")
    found = compare(graph, "natural,amd,amd-landmarks-first,auto")
    pattern = make_problem(graph).pattern
    for cost in found.costs:
        analysis = symbolic.analyze(pattern, ordering.order(cost.name, pattern))
        assert (cost.nnz_factor, cost.flops, cost.tree_height) == (analysis.nnz_factor, analysis.flops, analysis.height)
        assert cost.fill_in == cost.nnz_factor / pattern.nnz
        assert cost.measured_time is not None and cost.measured_time > 0.0
        assert cost.predicted_time is not None and cost.predicted_time > 0.0
    assert [cost.found for cost in found.costs] == ["natural", "amd", "amd-landmarks-first", "amd"]
    assert found.auto == "amd" and found.left_out == []
    assert found.calibration is not None and found.calibration.reference == "amd"
    assert found.reduced is not None
    first = symbolic.analyze(pattern, found.orders[2].order)
    rows = found.reduced.landmark_dimension
    assert found.reduced.dimension + rows == pattern.dimension
    # what L holds of the poses covers the reduced matrix
    assert found.reduced.nnz <= first.nnz_factor - rows


def test_comparison_leaves_out_what_takes_too_long() -> None:
    graph = bundled("sphere_small.g2o")
    found = compare(graph, "natural,amd", time_limit=1e-9)
    assert [cost.measured_time is None for cost in found.costs] == [True, False], "the reference is measured"
    assert found.left_out[0].startswith("factorization under natural: predicted to take")
    none = compare(graph, "natural,amd", time_limit=0.0)
    assert none.calibration is None and all(cost.measured_time is None for cost in none.costs)


def test_comparison_of_nothing() -> None:
    graph = bundled("square_toro.graph")
    every = [int(i) for i in graph.variables["SE2"].ids]
    with pytest.raises(InputError, match="all variables are held"):
        compare(graph.with_fixed(every))


def test_prediction_is_a_sum_of_two_terms() -> None:
    pattern = grid(8)
    analysis = symbolic.analyze(pattern, np.arange(64))
    model = Calibration(rate=1e9, per_nonzero=1e-8, reference="natural", supernodal=True)
    assert model.predict(analysis) == pytest.approx(analysis.flops / 1e9 + analysis.nnz_factor * 1e-8)


@seeds
def test_laplacian_is_positive_definite_and_has_the_pattern(seed: int) -> None:
    graph, held = mixed_graph(seed)
    pattern, _ = patterns.build(graph, held)
    matrix = dense(pattern, laplacian(pattern))
    assert np.linalg.eigvalsh(matrix)[0] > 0.9e-6
    np.testing.assert_allclose(matrix.sum(axis=1), 1e-6, atol=1e-12)


def chain_with(pairs: list[tuple[int, int]], count: int = 6) -> FactorGraph:
    """Poses 0 to count - 1 in a row, and closures between these."""
    indices = np.array([(k, k + 1) for k in range(count - 1)] + pairs, dtype=np.intp)
    factors = Factors(
        kind=models.RELATIVE_POSE_2D,
        indices=indices,
        measurements=np.tile([1.0, 0.0, 0.0], (len(indices), 1)),
        information=np.tile(np.eye(3), (len(indices), 1, 1)),
    )
    poses = variables(models.SE2, range(count), np.zeros((count, 3)))
    return FactorGraph({models.SE2.name: poses}, [factors])


def structure(graph: FactorGraph) -> tuple[dict[str, NDArray[np.bool_]], BlockPattern]:
    _, held = gauge.choose(graph)
    return held, patterns.build(graph, held)[0]


def test_kinds_of_blocks() -> None:
    """Pose 0 is held; block k is pose k + 1. The closure (0, 4) has no block off the diagonal."""
    graph = chain_with([(2, 5), (0, 4)])
    held, pattern = structure(graph)
    kinds = hessian_kinds(graph, held, pattern)
    found = dict(zip(zip(pattern.rows.tolist(), pattern.columns.tolist(), strict=True), kinds.tolist(), strict=True))
    assert found == {
        **{(k, k): POSE for k in range(5)},
        **{(k, k + 1): POSE for k in range(4)},
        (1, 4): CLOSURE,
    }
    landmarks = bundled("landmarks_small.g2o")
    held, pattern = structure(landmarks)
    kinds = hessian_kinds(landmarks, held, pattern)
    assert pattern.pose_rank is not None
    with_landmark = (pattern.pose_rank[pattern.rows] < 0) | (pattern.pose_rank[pattern.columns] < 0)
    assert_array_equal(kinds == LANDMARK, with_landmark)


def test_a_closure_fills_the_way_between_its_ends() -> None:
    """In a chain in natural order, the closure (1, 5) adds its block to H, and to L the row of 5 from 1 on."""
    graph = chain_with([], count=7)
    held, pattern = structure(graph)
    after = change(graph, held, pattern, [(5, 1)], [])
    assert hessian_counts(pattern, after) == type(hessian_counts(pattern, after))(11, 12, 1)
    analysis = symbolic.analyze(pattern, np.arange(6))
    counts = factor_counts(pattern, analysis, after)
    assert (counts.before, counts.after, counts.appeared) == (11, 14, 3)
    already = change(graph, held, pattern, [(2, 3), (0, 4)], [])
    assert hessian_counts(pattern, already).appeared == 0, "what is there, and what is held, adds nothing"


def test_marginalizing_joins_the_neighbours() -> None:
    """Out of a chain with the closure (2, 5) goes pose 3: its neighbours 2 and 4 are joined."""
    graph = chain_with([(2, 5)])
    held, pattern = structure(graph)
    after = change(graph, held, pattern, [], [3])
    assert_array_equal(np.flatnonzero(after.gone), [2])
    counts = hessian_counts(pattern, after)
    assert (counts.before, counts.after, counts.appeared) == (10, 10 - 3 + 1, 1)
    hub = change(graph, held, pattern, [], [2, 5])
    assert hessian_counts(pattern, hub).appeared == 2, "the neighbours 1, 3 and 4 of what goes become a clique"
    order: IndexArray = np.arange(5)
    wanted = symbolic.analyze(after.pattern, order).nnz_factor
    assert wanted < symbolic.analyze(pattern, order).nnz_factor
    found = factor_counts(pattern, symbolic.analyze(pattern, order), after)
    assert (found.before, found.after, found.appeared) == (11, 8, 1)


def test_changes_that_make_no_sense() -> None:
    graph = chain_with([])
    held, pattern = structure(graph)
    with pytest.raises(UsageError, match="no variable has the id 99"):
        change(graph, held, pattern, [(1, 99)], [])
    with pytest.raises(UsageError, match="variable 0 is held"):
        change(graph, held, pattern, [], [0])


def test_an_id_of_two_variables_is_refused(tmp_path: Path) -> None:
    text = "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nVERTEX_XY 1 2 0\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n"
    graph = slamcli.read(str(write_file(tmp_path, text + "EDGE_SE2_XY 0 1 2 0 1 0 1\n")))
    held, pattern = structure(graph)
    with pytest.raises(UsageError, match="2 variables have the id 1: SE2, XY"):
        change(graph, held, pattern, [], [1])
