"""Marginalization: what is exact is exact, the optimum stays, and recovered factors are optimal."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from support import BUNDLED, write_file

from slamcli.formats import read, render
from slamcli.geometry import se2, se3
from slamcli.graph import FactorGraph
from slamcli.graph.topology import node_pairs
from slamcli.models.base import Array
from slamcli.solver import gauge
from slamcli.solver.gauge import Held
from slamcli.solver.linear_system import Linearizer
from slamcli.solver.marginalization import Reduction, compare, marginalize, removed_by
from slamcli.solver.marginalization import descent as descents
from slamcli.solver.marginalization import topology as topologies
from slamcli.solver.marginalization.links import between
from slamcli.solver.marginalization.nodes import Nodes
from slamcli.solver.marginalization.quadratics import Quadratics, of_factors
from slamcli.solver.optimize import optimize
from slamcli.solver.stopwatch import Stopwatch


def optimum(name: str) -> FactorGraph:
    result = optimize(read(str(BUNDLED / name)), tolerance=1e-14, max_iterations=30)
    return result.graph


def reduce(graph: FactorGraph, keep: str | None = None, remove: str | None = None, **options: object) -> Reduction:
    return marginalize(graph, removed_by(graph, keep, remove)[0], **options)  # type: ignore[arg-type]


def dense(graph: FactorGraph, held: Held) -> tuple[Array, Array]:
    """H of the free variables and the gradient."""
    linearizer = Linearizer(graph, held, Stopwatch())
    system, pattern = linearizer.linearize(graph.values), linearizer.pattern
    hessian = np.zeros((pattern.dimension, pattern.dimension))
    hessian[pattern.scalar_rows, pattern.scalar_columns] = system.hessian
    hessian[pattern.scalar_columns, pattern.scalar_rows] = system.hessian
    return hessian, system.gradient


def kept_rows(graph: FactorGraph, held: Held, reduction: Reduction) -> Array:
    """Scalar rows of H that stay."""
    parts = []
    for name, column in graph.variables.items():
        free = ~held[name]
        parts.append(np.repeat(~reduction.removed[name][free], column.kind.dimension))
    return np.flatnonzero(np.concatenate(parts))


def gradient_of(reduction: Reduction) -> float:
    return float(np.abs(dense(reduction.graph, gauge.choose(reduction.graph)[1])[1]).max())


def points(information: str, prior: str) -> str:
    """A ring of eight points with chords, whose differences and one prior are linear."""
    rng = np.random.default_rng(3)
    place = rng.standard_normal((8, 2)) * 5.0
    lines = [f"VERTEX_XY {k} {x} {y}" for k, (x, y) in enumerate(rng.standard_normal((8, 2)))]
    lines.append(f"EDGE_PRIOR_XY 0 1 2 {prior}")
    for k, (a, b) in enumerate([*((k, (k + 1) % 8) for k in range(8)), (0, 4), (2, 6)]):
        x, y = place[b] - place[a] + 0.1 * rng.standard_normal(2)
        lines.append(f"EDGE_POINTXY {a} {b} {x} {y} {information.format(1 + k, 2 + k % 3)}")
    return "".join(f"{line}\n" for line in lines)


@pytest.mark.parametrize(
    ("information", "keep"),
    [("{0} 0.5 {1}", "0,2,4,6"), ("{0} 0 {0}", "0,5"), ("{0} 0 {1}", "0,4,5"), ("{0} 0 {1}", "3,6,7")],
)
def test_linear_graphs_keep_their_solution_and_covariance(tmp_path: Path, information: str, keep: str) -> None:
    """Far from the optimum, too: nothing is linearized."""
    graph = read(str(write_file(tmp_path, points(information, "3 0 3"))))
    reduction = reduce(graph, keep)
    assert reduction.divergence == 0.0
    full, part = optimize(graph, tolerance=1e-15).graph, optimize(reduction.graph, tolerance=1e-15).graph
    kept = ~reduction.removed["XY"]
    np.testing.assert_allclose(part.variables["XY"].values, full.variables["XY"].values[kept], atol=1e-10)
    free = {"XY": np.zeros(8, dtype=bool)}
    covariance = np.linalg.inv(dense(graph, free)[0])
    rows = kept_rows(graph, free, reduction)
    own = np.linalg.inv(dense(reduction.graph, {"XY": np.zeros(int(kept.sum()), dtype=bool)})[0])
    np.testing.assert_allclose(own, covariance[np.ix_(rows, rows)], rtol=1e-10, atol=1e-12)


def test_a_chain_becomes_the_composition_of_its_odometry(tmp_path: Path) -> None:
    """Z = Z1 Z2 and Sigma = Ad(Z2^-1) Sigma1 Ad(Z2^-1)^T + Sigma2 (Smith and Cheeseman 1986), in frame j."""
    text = (
        "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0.5 0.7\nVERTEX_SE2 2 1.5 1.75 1.9\n"
        "EDGE_SE2 0 1 1 0.5 0.7 10 1 0.5 20 0.2 30\nEDGE_SE2 1 2 1.2 0.4 1.1 15 2 0.1 12 0.3 90\n"
    )
    graph = optimize(read(str(write_file(tmp_path, text))), tolerance=1e-15).graph
    (recovered,) = reduce(graph, remove="1").graph.factors
    first, second = (np.linalg.inv(x) for x in graph.factors[0].information)
    z = graph.factors[0].measurements
    carry = se2.adjoint(se2.inverse(z[1]))
    np.testing.assert_allclose(recovered.measurements[0], se2.compose(z[0], z[1]), atol=1e-12)
    expected = np.linalg.inv(carry @ first @ carry.T + second)
    np.testing.assert_allclose(recovered.information[0], expected, rtol=1e-9)


def test_a_chain_in_space_becomes_the_composition_of_its_odometry() -> None:
    graph = read(str(BUNDLED / "sphere_small.g2o"))
    chain = reduce(graph, "0-2").graph  # joins poses 0 to 2 by more than odometry
    assert chain.poses == 3
    odometry = graph.factors[0]
    rows = np.flatnonzero((odometry.indices <= 2).all(axis=1) & (np.diff(odometry.indices, axis=1)[:, 0] == 1))
    only = FactorGraph({"SE3": graph.variables["SE3"]}, [odometry.part(rows)], report=graph.report)
    (recovered,) = reduce(only, keep="0,2").graph.factors
    z = odometry.measurements[rows]
    np.testing.assert_allclose(recovered.measurements[0], se3.compose(z[0], z[1]), atol=1e-9)


def test_residuals_of_any_size_keep_hessian_and_gradient() -> None:
    """Poses: the measurement is moved so that J^T Omega J and J^T Omega e are what elimination says."""
    for name in ("manhattan_small.g2o", "sphere_small.g2o"):
        graph = read(str(BUNDLED / name))  # not optimized: residuals are large
        ids = [k for k in range(1, 60) if k % 2]
        reduction = reduce(graph, remove=",".join(map(str, ids)))
        held = gauge.choose(reduction.graph)[1]
        hessian, gradient = dense(reduction.graph, held)
        (kind,) = graph.variables
        full_held = {kind: np.zeros(len(graph.variables[kind]), dtype=bool)}
        full_held[kind][0] = True
        big, slope = dense(graph, full_held)
        rows = kept_rows(graph, full_held, reduction)
        rest = np.setdiff1d(np.arange(len(big)), rows)
        solved = np.linalg.solve(big[np.ix_(rest, rest)], np.column_stack([big[np.ix_(rest, rows)], slope[rest]]))
        marginal = np.column_stack([big[np.ix_(rows, rows)], slope[rows]]) - big[np.ix_(rows, rest)] @ solved
        np.testing.assert_allclose(gradient, marginal[:, -1], atol=1e-9 * np.abs(slope).max())
        if reduction.approximated == 0:
            np.testing.assert_allclose(hessian, marginal[:, :-1], atol=1e-9 * np.abs(big).max())


@pytest.mark.parametrize("sparsification", ["none", "chow-liu", "subgraph"])
@pytest.mark.parametrize(
    "name", ["manhattan_small.g2o", "sphere_small.g2o", "landmarks_small.g2o", "square_toro.graph"]
)
def test_the_optimum_stays(name: str, sparsification: str) -> None:
    """Also where groups are taken apart variable by variable."""
    graph = optimum(name)
    if sparsification == "none":
        reduction = reduce(graph, remove="5,10-12,20-25")
    else:
        largest = 32 if name == "landmarks_small.g2o" else 8
        rule = {"remove": "100-129"} if name == "sphere_small.g2o" else {"keep": "every:4"}
        reduction = reduce(graph, **rule, sparsification=sparsification, largest_blanket=largest)
    result = optimize(reduction.graph)
    moved = max(
        float(np.abs(column.values - result.graph.variables[kind].values).max())
        for kind, column in reduction.graph.variables.items()
    )
    tolerance = 0.05 if reduction.weak else 1e-4  # what a landmark pulls at headings is not in every set of edges
    assert moved < tolerance
    comparison = compare(graph, reduction)
    assert comparison is not None and comparison.shift < tolerance
    assert comparison.divergence < (0.005 if sparsification == "none" else 0.1) * comparison.dimension


def test_exact_marginals_have_the_covariance_of_the_full_graph() -> None:
    """Removing single poses of degree two: every blanket has two variables."""
    graph = optimum("manhattan_small.g2o")
    pairs = node_pairs(graph)
    degree = np.bincount(pairs.ravel(), minlength=graph.poses)
    ids = [k for k in range(1, 399) if degree[k] == 2]
    reduction = reduce(graph, remove=",".join(map(str, ids)))
    assert reduction.approximated == 0 and len(ids) > 30
    held = gauge.choose(graph)[1]
    rows = kept_rows(graph, held, reduction)
    full = np.linalg.inv(dense(graph, held)[0])[np.ix_(rows, rows)]
    own = np.linalg.inv(dense(reduction.graph, gauge.choose(reduction.graph)[1])[0])
    np.testing.assert_allclose(own, full, atol=1e-8 * np.abs(full).max())
    comparison = compare(graph, reduction)
    assert comparison is not None
    assert comparison.divergence < 1e-6
    np.testing.assert_allclose(comparison.sigma_ratio, 1.0, rtol=1e-8)


def test_the_divergence_is_that_of_dense_gaussians() -> None:
    graph = optimum("manhattan_small.g2o")
    reduction = reduce(graph, "every:20", sparsification="chow-liu")
    held, own_held = gauge.choose(graph)[1], gauge.choose(reduction.graph)[1]
    rows = kept_rows(graph, held, reduction)
    covariance = np.linalg.inv(dense(graph, held)[0])[np.ix_(rows, rows)]
    product = dense(reduction.graph, own_held)[0] @ covariance
    expected = 0.5 * (np.trace(product) - len(rows) - np.linalg.slogdet(product)[1])
    comparison = compare(graph, reduction)
    assert comparison is not None
    assert comparison.divergence == pytest.approx(expected, rel=1e-6)
    assert comparison.dimension == len(rows)


def test_more_links_say_more() -> None:
    graph = optimum("manhattan_small.g2o")
    found = [compare(graph, reduce(graph, "every:20", sparsification=s)) for s in ("chow-liu", "subgraph", "none")]
    divergences = [comparison.divergence for comparison in found if comparison is not None]
    assert divergences[0] > 2.0 * divergences[1] > 4.0 * divergences[2] > 0.0


def marginal_of_four() -> tuple[Nodes, list[int], Array]:
    """The marginal over four poses of a graph, and its nodes."""
    graph = optimum("manhattan_small.g2o")
    nodes = Nodes(graph)
    members = [0, 130, 260, 390]
    gone = np.ones(len(nodes), dtype=bool)
    gone[members] = False
    quadratics = Quadratics(nodes)
    for piece in of_factors(nodes, graph.values, gone, np.zeros(len(nodes), dtype=bool), False):
        quadratics.add(piece)
    return nodes, members, quadratics.eliminate([k for k in range(len(nodes)) if gone[k]]).information


def test_the_tree_is_the_best_of_all_trees() -> None:
    """Sixteen trees on four variables (Cayley)."""
    nodes, members, information = marginal_of_four()
    free = np.arange(3, 12)
    links = between(nodes, members, False)
    sigma = descents.padded_inverse(information, free)
    covariances = [part.covariance(sigma) for part in links]
    (tree,) = topologies.spanning_tree(nodes, members, links, covariances)
    weights = np.linalg.slogdet(covariances[0])[1]

    def connects(choice: tuple[int, ...]) -> bool:
        reached = {0}
        for _ in range(3):
            reached |= {
                k for link in choice for k in links[0].ends[link].tolist() if reached & set(links[0].ends[link])
            }
        return len(reached) == 4

    trees = [choice for choice in combinations(range(6), 3) if connects(choice)]
    assert len(trees) == 16
    assert weights[tree].sum() == pytest.approx(min(weights[list(choice)].sum() for choice in trees), abs=1e-9)


def test_descent_ends_at_an_optimum(monkeypatch: pytest.MonkeyPatch) -> None:
    """Karush-Kuhn-Tucker: T - J S^-1 J^T is positive semidefinite, and zero along X."""
    monkeypatch.setattr(descents, "_SWEEPS", 3000)
    monkeypatch.setattr(descents, "_TOLERANCE", 1e-14)
    nodes, members, information = marginal_of_four()
    free = np.arange(3, 12)
    links = between(nodes, members, False)
    covariances = [part.covariance(descents.padded_inverse(information, free)) for part in links]
    every = [np.ones(len(part), dtype=bool) for part in links]
    nothing = np.zeros_like(information)
    (found,) = descents.descend(links, covariances, [np.linalg.inv(c) for c in covariances], every, free, nothing)
    total = descents.total(links, [found], len(information))
    here = links[0].covariance(descents.padded_inverse(total, free))
    roots = np.linalg.cholesky(covariances[0])
    backs = np.linalg.inv(roots)
    slack = np.eye(3) - backs @ here @ backs.transpose(0, 2, 1)
    assert np.linalg.eigvalsh(slack).min() > -1e-5
    whitened = roots.transpose(0, 2, 1) @ found @ roots
    assert np.abs(whitened @ slack).max() < 1e-5


def test_removing_a_pose_joins_its_neighbours(tmp_path: Path) -> None:
    """k neighbours: up to k (k - 1) / 2 new pairs; here one of the ten is there already."""
    lines = [f"VERTEX_SE2 {k} {np.cos(k)} {np.sin(k)} 0" for k in range(6)]
    lines += [f"EDGE_SE2 0 {k} {np.cos(k) - 1} {np.sin(k)} 0 1 0 0 1 0 1" for k in range(1, 6)]
    lines.append(f"EDGE_SE2 1 2 {np.cos(2) - np.cos(1)} {np.sin(2) - np.sin(1)} 0 1 0 0 1 0 1")
    graph = read(str(write_file(tmp_path, "".join(f"{line}\n" for line in lines))))
    blocks = reduce(graph, remove="0").blocks
    assert (blocks.before, blocks.among_kept, blocks.dense, blocks.fill_in) == (6, 1, 10, 9)


def test_reduced_graphs_are_consistent_with_the_truth() -> None:
    """The joint NEES of the kept poses against its 99.9 % band, which holds for the full graph, too."""
    from slamcli.evaluation.consistency import chi2_band

    graph, truth = optimum("manhattan_small.g2o"), read(str(BUNDLED / "truth/manhattan_small.g2o"))
    for sparsification in ("none", "chow-liu", "subgraph"):
        reduced = optimize(reduce(graph, "every:10", sparsification=sparsification).graph).graph
        held = gauge.choose(reduced)[1]
        rows = truth.variables["SE2"].rows_of(reduced.variables["SE2"].ids)
        step = se2.local(reduced.variables["SE2"].values, truth.variables["SE2"].values[rows])[1:].ravel()
        low, high = chi2_band(len(step), 0.999)
        assert low < step @ dense(reduced, held)[0] @ step < high


def test_landmarks_alone_are_in_the_frame_of_the_pose_that_would_be_held() -> None:
    graph = optimum("landmarks_small.g2o")
    reduction = reduce(graph, "landmarks-only")
    assert reduction.conditioned == (0,)
    assert set(reduction.graph.variables) == {"XY"}
    assert gradient_of(reduction) < 1e-4
    comparison = compare(graph, reduction)
    assert comparison is not None and comparison.shift < 1e-4


def test_poses_alone() -> None:
    graph = optimum("landmarks_small.g2o")
    reduction = reduce(graph, "poses-only")
    comparison = compare(graph, reduction)
    assert set(reduction.graph.variables) == {"SE2"}
    assert comparison is not None and comparison.shift < 0.3
    assert comparison.sigma_ratio[0] > 0.95 and comparison.sigma_ratio[2] < 1.05


def test_kept_records_keep_their_bytes(tmp_path: Path) -> None:
    text = (
        "# a comment\r\nVERTEX_SE2 0 0.000 0 0\r\nFIX 0 1\r\nVERTEX_SE2 1 1.00 0 0\r\nROBOTLASER1 1 2 3\r\n"
        "VERTEX_SE2 2 2.0 +0 0\r\nVERTEX_SE2 3 3 0 0 # last\r\n"
        "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\r\nEDGE_SE2 1 2 1 0 0 1 0 0 1 0 1\r\nEDGE_SE2 2 3 1.000 0 0 1 0 0 1 0 1\r\n"
    )
    graph = read(str(write_file(tmp_path, text)))
    reduction = reduce(graph, remove="1")
    assert reduction.conditioned == (1,)  # its odometry is a prior of pose 2 now
    lines = render(reduction.graph).data.decode().split("\r\n")
    assert lines[:5] == [
        "# a comment",
        "VERTEX_SE2 0 0.000 0 0",
        "FIX 0",
        "VERTEX_SE2 2 2.0 +0 0",
        "VERTEX_SE2 3 3 0 0 # last",
    ]
    assert lines[5] == "EDGE_SE2 2 3 1.000 0 0 1 0 0 1 0 1"
    assert [line.split()[:2] for line in lines[6:-1]] == [["EDGE_PRIOR_SE2", "0"], ["EDGE_PRIOR_SE2", "2"]]
    assert reduction.kept_edges == 1


def test_a_prior_in_space_gets_a_sensor_at_the_origin(tmp_path: Path) -> None:
    pose = "0 0 0 0 0 0 1"
    unit = " ".join("1" if a == b else "0" for a in range(6) for b in range(a, 6))
    text = (
        "PARAMS_SE3OFFSET 4 0.1 0 0 0 0 0 1\n"
        f"VERTEX_SE3:QUAT 0 {pose}\nVERTEX_SE3:QUAT 1 1 0 0 0 0 0 1\n"
        f"EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1 {unit}\nEDGE_SE3_PRIOR 0 4 0.1 0 0 0 0 0 1 {unit}\n"
    )
    reduction = reduce(read(str(write_file(tmp_path, text))), remove="0")
    written = write_file(tmp_path, render(reduction.graph).data, "out.g2o")
    again = read(str(written))
    assert again.report is not None and again.report.by_tag["EDGE_SE3_PRIOR"] == 1
    assert again.parameters[5].tolist() == [0, 0, 0, 0, 0, 0, 1]
    assert again.chi2() == pytest.approx(0.0, abs=1e-12)
    information = again.factors[-1].information[0]
    assert information[3, 3] == pytest.approx(0.5)  # two rotations of variance 1 about the same axis
