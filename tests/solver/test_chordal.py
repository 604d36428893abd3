"""The chordal start: exact without noise, the minima that it claims, and what must not matter."""

from dataclasses import replace

import numpy as np
import pytest
from chordal_graphs import PLANE, SPACE, assert_truth, each_space, spoiled, start
from graphs import bundled, exact_graph, information, mixed_graph, reordered, variables
from numpy.testing import assert_allclose, assert_array_equal
from support import dataset

import slamcli
from slamcli import models
from slamcli.geometry import se2, se3, so3
from slamcli.graph import FactorGraph, Factors
from slamcli.graph.columns import Values
from slamcli.models.base import Array
from slamcli.solver import gauge
from slamcli.solver.initialization import chordal, initialize, positions, rotations

# --- exact without noise ---------------------------------------------------------------------------------------------


@each_space
@pytest.mark.parametrize("seed", range(5))
def test_exact_edges_give_the_truth_from_any_values(kind, relative, seed: int) -> None:
    truth = exact_graph(kind, relative, 40, seed)
    wrong = spoiled(truth)
    assert wrong.chi2() > 1.0
    found = start(wrong)
    assert_truth(truth, found)
    assert_array_equal(found[kind.name][0], truth.values[kind.name][0])


@each_space
def test_half_turns(kind, relative) -> None:
    """Rotations by 180 degrees, where angles wrap and quaternions change sign."""
    truth = exact_graph(kind, relative, 12, 1, extra=8)
    value = truth.values[kind.name].copy()
    value[:] = kind.identity
    value[:, 0] = np.arange(12)
    if kind is models.SE2:
        value[::2, 2] = -np.pi
    else:
        value[::2, 3:] = [1.0, 0.0, 0.0, 0.0]
        value[::3, 3:] = [0.0, 0.6, 0.8, 0.0]
    truth = truth.with_values({kind.name: value})
    i, j = truth.factors[0].indices.T
    measured = kind.normalize(kind.compose(kind.inverse(value[i]), value[j]))
    truth = replace(truth, factors=[replace(truth.factors[0], measurements=measured)])
    assert_truth(truth, start(spoiled(truth)))


@each_space
def test_a_single_edge_and_a_chain(kind, relative) -> None:
    """No loop at all: the start is the integrated odometry."""
    for count in (2, 30):
        truth = exact_graph(kind, relative, count, count, extra=0)
        assert_truth(truth, start(spoiled(truth)))


@each_space
def test_two_components_keep_their_own_held_pose(kind, relative) -> None:
    one, two = exact_graph(kind, relative, 10, 1), exact_graph(kind, relative, 15, 2)
    edges = replace(two.factors[0], indices=two.factors[0].indices + 10)
    column = one.variables[kind.name].followed_by(replace(two.variables[kind.name], ids=np.arange(10, 25)))
    truth = FactorGraph({kind.name: column}, [*one.factors, edges])
    assert_truth(truth, start(spoiled(truth, {kind.name: [0, 10]})))


@each_space
def test_fixed_poses_keep_their_values(kind, relative) -> None:
    truth = exact_graph(kind, relative, 20, 3).with_fixed([4, 11])
    found = start(spoiled(truth, {kind.name: [4, 11]}))
    assert_truth(truth, found)
    contradicting = spoiled(truth, {kind.name: []})
    assert_array_equal(start(contradicting)[kind.name][[4, 11]], contradicting.values[kind.name][[4, 11]])


@each_space
def test_an_edge_without_information_on_rotation_still_turns(kind, relative) -> None:
    truth = exact_graph(kind, relative, 10, 4, extra=0)
    weights = np.zeros_like(truth.factors[0].information)
    weights[:, np.arange(kind.space), np.arange(kind.space)] = 1.0
    truth = replace(truth, factors=[replace(truth.factors[0], information=weights)])
    assert_truth(truth, start(spoiled(truth)))


def test_one_pose() -> None:
    """With a prior it goes there; a prior on its position alone leaves its orientation."""
    poses = {"SE2": variables(models.SE2, [7], np.array([[1.0, 2.0, 3.0]]))}
    prior = Factors(models.POSE_PRIOR_2D, np.array([[0]]), np.array([[4.0, 5.0, -1.0]]), np.eye(3)[None])
    assert_allclose(start(FactorGraph(poses, [prior]))["SE2"], [[4.0, 5.0, -1.0]], atol=1e-12)
    position = Factors(models.POSITION_PRIOR_2D, np.array([[0]]), np.array([[4.0, 5.0]]), np.eye(2)[None])
    assert_allclose(start(FactorGraph(poses, [position]))["SE2"], [[4.0, 5.0, 3.0]], atol=1e-12)


def test_a_pose_without_edges_stays() -> None:
    truth = exact_graph(*PLANE, 5, 1)
    alone = variables(models.SE2, [9], np.array([[1.0, 2.0, 0.5]]))
    graph = replace(truth, variables={"SE2": truth.variables["SE2"].followed_by(alone)})
    assert_allclose(start(graph)["SE2"][5], [1.0, 2.0, 0.5])


@each_space
def test_edges_alone_start_at_the_origin(kind, relative) -> None:
    truth = exact_graph(kind, relative, 10, 5)
    origin = np.tile(kind.inverse(truth.values[kind.name][:1]), (10, 1))
    truth = truth.with_values({kind.name: kind.normalize(kind.compose(origin, truth.values[kind.name]))})
    unknown = replace(
        truth.variables[kind.name], known=np.zeros(10, dtype=bool), values=np.full((10, kind.size), np.nan)
    )
    assert_truth(truth, start(replace(truth, variables={kind.name: unknown})))


@pytest.mark.parametrize("seed", range(20))
def test_every_kind_in_one_graph(seed: int) -> None:
    """Self edges, parallel edges, plane and space beside each other, variables held at random."""
    graph, held = mixed_graph(seed)
    values, placed, _ = chordal.relax(graph, held)
    for name, column in graph.variables.items():
        assert np.isfinite(values[name]).all()
        assert_array_equal(values[name][held[name]], column.values[held[name]])
        assert placed[name].all() or not column.kind.is_pose


# --- the minima ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["manhattan_small.g2o", "sphere_small.g2o", "landmarks_small.g2o"])
def test_positions_are_the_minimum_for_their_rotations(name: str) -> None:
    """No component of the gradient of chi2 along a position is left, whatever the information matrices are."""
    graph = bundled(name)
    rng = np.random.default_rng(1)
    affine = [f for f in graph.factors if "bearing" not in f.kind.components]
    weighted = [replace(f, information=information(rng, len(f), f.kind.dimension)) for f in affine]
    graph = replace(graph, factors=weighted)
    held = gauge.choose(graph)[1]
    values = start(graph)

    def gradient(state: Values) -> Array:
        total = {kind: np.zeros((len(c), c.kind.space)) for kind, c in graph.variables.items()}
        for f in graph.factors:
            residual, jacobians = f.linearize(state)
            for slot, kind in enumerate(f.kind.variables):
                part = np.vecmat(np.matvec(f.information, residual), jacobians[slot])[:, : kind.space]
                np.add.at(total[kind.name], f.indices[:, slot], part)
        return np.concatenate([total[kind][~held[kind]].ravel() for kind in total])

    assert np.abs(gradient(values)).max() < 1e-9 * np.abs(gradient(graph.values)).max()


@each_space
def test_rotations_are_the_projected_minimum_of_the_relaxation(kind, relative) -> None:
    """Against dense least squares on the matrices themselves."""
    graph = exact_graph(kind, relative, 8, 3)
    edges = graph.factors[0]
    noisy = kind.retract(
        edges.measurements, 0.2 * np.random.default_rng(0).standard_normal((len(edges), kind.dimension))
    )
    graph = replace(graph, factors=[replace(edges, measurements=noisy)])
    d = kind.space
    r0 = rotations.rotation_matrices(kind, graph.values[kind.name])[0]
    design, right = [], []
    for (i, j), z, omega in zip(
        edges.indices, rotations.rotation_matrices(kind, noisy), edges.information, strict=True
    ):
        root = np.sqrt(np.trace(omega[d:, d:]))
        row = np.zeros((d, 8 * d))  # R_j^T - Z^T R_i^T
        row[:, d * j : d * j + d] += np.eye(d)
        row[:, d * i : d * i + d] -= z.T
        design.append(root * row)
    stacked = np.concatenate(design)
    right = -stacked[:, :d] @ r0.T
    free = np.linalg.lstsq(stacked[:, d:], right, rcond=None)[0].reshape(7, d, d).transpose(0, 2, 1)
    u, _, v = np.linalg.svd(free)
    assert (np.linalg.det(u @ v) > 0.0).all()
    held = gauge.choose(graph)[1][kind.name]
    found = rotations.relax(graph, graph.variables[kind.name], held, share=0.0)  # the lowest id, as above
    assert_allclose(found.matrices[1:], u @ v, atol=1e-9)


def test_the_projection_is_the_nearest_rotation_of_either_determinant() -> None:
    """No rotation is nearer than it, for matrices that contain a reflection either."""
    rng = np.random.default_rng(0)
    matrices = rng.standard_normal((50, 3, 3))
    assert (np.linalg.det(matrices) < 0).any()
    found = rotations.projected(matrices)
    assert_allclose(np.linalg.det(found), 1.0, atol=1e-12)
    others = so3.to_matrix(so3.normalize(rng.standard_normal((2000, 1, 4))))
    near = found @ so3.to_matrix(so3.exp(0.01 * rng.standard_normal((2000, 1, 3))))
    distance = np.linalg.norm(found - matrices, axis=(1, 2))
    for tried in (others, near):
        assert (np.linalg.norm(tried - matrices, axis=(2, 3)) >= distance - 1e-12).all()


# --- what must not matter --------------------------------------------------------------------------------------------

NOISY = ("manhattan_small.g2o", "sphere_small.g2o", "landmarks_small.g2o", "square_toro.graph")


@pytest.mark.parametrize("name", NOISY)
def test_values_of_free_variables_do_not_count(name: str) -> None:
    graph = bundled(name)
    found, wanted = start(spoiled(graph)), start(graph)
    for kind in graph.variables:
        assert_allclose(found[kind], wanted[kind], atol=1e-9)


@pytest.mark.parametrize("name", NOISY)
def test_a_motion_of_the_held_pose_moves_everything(name: str) -> None:
    graph = bundled(name)
    if graph.space == 2:
        move, act = np.array([[3.0, -4.0, 2.5]]), se2.act
    else:
        move, act = se3.normalize(np.array([[3.0, -4.0, 5.0, 0.3, -0.5, 0.2, 0.7]])), se3.act
    moved = {}
    for key, column in graph.variables.items():
        motion = np.tile(move, (len(column), 1))
        moved[key] = column.kind.compose(motion, column.values) if column.kind.is_pose else act(motion, column.values)
    wanted, found = start(graph), start(graph.with_values(moved))
    assert graph.chi2(found) == pytest.approx(graph.chi2(wanted), rel=1e-9)
    for key, column in graph.variables.items():
        points = wanted[key][:, : graph.space]
        assert_allclose(found[key][:, : graph.space], act(np.tile(move, (len(column), 1)), points), atol=1e-8)


@pytest.mark.parametrize("name", NOISY)
def test_order_and_numbers_do_not_count(name: str) -> None:
    graph = bundled(name)
    rng = np.random.default_rng(3)
    columns, place = {}, {}
    for key, column in reversed(graph.variables.items()):
        order = rng.permutation(len(column))
        place[key] = np.argsort(order)
        rows = {n: getattr(column, n)[order] for n in ("values", "fixed", "known", "lines")}
        columns[key] = replace(column, ids=3 * column.ids[order] + 1000, **rows)
    factors = []
    for old in reversed(graph.factors):
        slots = [place[kind.name][old.indices[:, s]] for s, kind in enumerate(old.kind.variables)]
        factors.append(reordered(replace(old, indices=np.stack(slots, axis=1)), rng.permutation(len(old))))
    wanted, found = start(graph), start(FactorGraph(columns, factors))
    for key, rows in place.items():
        space = graph.variables[key].kind.space
        assert_allclose(found[key][rows][:, :space], wanted[key][:, :space], atol=1e-7)


@each_space
def test_the_scale_of_all_weights_does_not_count(kind, relative) -> None:
    graph = bundled("manhattan_small.g2o" if kind is models.SE2 else "sphere_small.g2o")
    for scale in (1e-9, 1e9):
        scaled = replace(graph, factors=[replace(f, information=scale * f.information) for f in graph.factors])
        assert_allclose(start(scaled)[kind.name], start(graph)[kind.name], atol=1e-7)


# --- information that is none ----------------------------------------------------------------------------------------


def test_indefinite_information_counts_by_its_positive_part() -> None:
    truth = exact_graph(*SPACE, 20, 9)
    bad = truth.factors[0].information.copy()
    bad[:3] = np.diag([1.0, -2.0, 1.0, 1.0, -1.0, 1.0])
    graph = spoiled(replace(truth, factors=[replace(truth.factors[0], information=bad)]))
    values, words = initialize(graph, "chordal", gauge.choose(graph)[1])
    assert words == "chordal relaxation; of 3 indefinite information matrices the positive part"
    assert_truth(truth, values)


def test_numbers_that_overflow_fall_back_to_a_tree() -> None:
    truth = exact_graph(*PLANE, 10, 9)
    weights = np.full_like(truth.factors[0].information, np.inf)
    graph = replace(truth, factors=[replace(truth.factors[0], information=weights)])
    values, words = initialize(graph, "chordal", gauge.choose(graph)[1])
    assert words == "spanning tree, since the chordal relaxation cannot be solved"
    assert_truth(truth, values)


@pytest.mark.datasets
def test_cubicle() -> None:
    """5 021 of its matrices are indefinite; the start is far below that of the file all the same."""
    graph = slamcli.read(str(dataset("pose3d/cubicle.g2o")))
    values, words = initialize(graph, "chordal", gauge.choose(graph)[1])
    assert "5021 indefinite" in words
    sound = [replace(f, information=np.tile(np.eye(6), (len(f), 1, 1))) for f in graph.factors]
    assert replace(graph, factors=sound).chi2(values) < 0.1 * replace(graph, factors=sound).chi2()
    assert_allclose(so3.normalize(values["SE3"][:, 3:]), values["SE3"][:, 3:], atol=1e-12)


@pytest.mark.datasets
@pytest.mark.parametrize(
    ("path", "chi2"),
    [
        ("pose2d/city10000.g2o", 607.044),
        ("pose2d/M3500b.g2o", 7743.03),
        ("pose2d/MIT_carlone.g2o", 71.5448),
        ("pose3d/parking-garage.g2o", 1.41041),
        ("pose3d/sphere_bignoise_vertex3.g2o", 790290),
        ("pose3d/torus3D.g2o", 15466.4),
    ],
)
def test_chi2_of_an_independent_implementation(path: str, chi2: float) -> None:
    """The same two stages with the lowest id held, written without slamcli."""
    graph = slamcli.read(str(dataset(path)))
    ((name, poses),) = graph.variables.items()
    held = gauge.choose(graph)[1]
    found = rotations.relax(graph, poses, held[name], share=0.0)
    values, _ = positions.solve(graph, poses.kind.space, held, found)
    assert graph.chi2(values) == pytest.approx(chi2, rel=1e-5)
