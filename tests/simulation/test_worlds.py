import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamcli.geometry import se2, se3
from slamcli.simulation.worlds import PLANAR, WORLDS

LOOPS = ("square", "circle", "figure-eight")
LATTICES = ("square", "corridor", "manhattan", "city", "garage")


def world(name, poses, **parameters):
    return WORLDS[name](poses, np.random.default_rng(0), **parameters)


def relative(path):
    group = se2 if path.space == 2 else se3
    poses = np.asarray(path.poses)
    return group.between(poses[:-1], poses[1:])


@pytest.mark.parametrize("name", WORLDS)
@pytest.mark.parametrize("poses", [2, 3, 7, 64, 1000])
def test_any_size(name, poses):
    path = world(name, poses)
    assert path.poses.shape == (poses, 3 if name in PLANAR else 7)
    assert np.isfinite(path.poses).all()
    if poses > 3 or name != "figure-eight":  # three poses on two circles are at one place
        assert path.steps().min() > 0.0
    if path.space == 3:
        assert np.allclose(np.square(np.asarray(path.poses[:, 3:])).sum(axis=1), 1.0, atol=1e-15)


@pytest.mark.parametrize("name", WORLDS)
def test_the_robot_drives_forward(name):
    # the poles of the sphere and the changes of level of the grid aside, a step leads ahead
    path = world(name, 2000)
    step = relative(path)
    assert np.median(step[:, 0] / path.steps()) > 0.99


@pytest.mark.parametrize("name", LOOPS)
def test_loops_end_where_they_began(name):
    path = world(name, 401)
    assert np.allclose(path.poses[-1], path.poses[0], atol=1e-9)
    assert np.abs(path.steps() - 1.0).max() < 2e-3


@pytest.mark.parametrize("name", LATTICES)
def test_lattices_are_exact(name):
    poses = np.asarray(world(name, 3000).poses)
    assert (poses[:, :2] == np.round(poses[:, :2])).all()
    assert np.isin(poses[:, 2], np.array([0.0, 0.5, -1.0, -0.5]) * np.pi).all()
    assert (np.abs(np.diff(poses[:, :2], axis=0)).sum(axis=1) == 1.0).all()


@pytest.mark.parametrize("name", ["corridor", "garage"])
def test_rounds_repeat(name):
    poses = np.asarray(world(name, 3000).poses)
    first = np.flatnonzero((poses == poses[0]).all(axis=1))
    assert len(first) > 3
    lap = first[1]
    assert (poses[lap:] == poses[:-lap]).all()


@settings(max_examples=30, deadline=None)
@given(half=st.integers(2, 20), block=st.integers(1, 4), seed=st.integers(0, 99))
def test_the_walk_stays_in_its_square(half, block, seed):
    half = max(half, block)
    path = WORLDS["manhattan"](500, np.random.default_rng(seed), half=half, block=block)
    assert np.abs(path.positions).max() <= half
    turns = np.flatnonzero(np.diff(np.asarray(path.poses[:, 2])))
    assert ((turns + 1) % block == 0).all()


@pytest.mark.parametrize(
    ("name", "parameters", "apart"),
    [
        ("grid", {}, 1.0),
        ("grid", {"side": 5}, 1.0),
        ("helix", {"per_turn": 30, "rise": 2.5}, 2.5),
        ("lawnmower", {"line": 20, "swath": 3}, 3.0),
        ("sphere", {"per_ring": 20, "radius": 10.0}, None),
        ("torus", {"per_ring": 20, "minor": 3.0, "major": 9.0}, None),
    ],
)
def test_neighbours_are_near(name, parameters, apart):
    path = world(name, 1000, **parameters)
    first, second = path.neighbours.T
    assert (first < second).all() and (first >= 0).all() and (second < 1000).all()
    distance = np.sqrt(np.square(np.asarray(path.positions[first] - path.positions[second])).sum(axis=1))
    if apart:
        assert distance.max() <= apart * (1.0 + 1e-9)
    everywhere = np.asarray(path.positions)
    assert distance.mean() < 0.25 * np.sqrt(np.square(everywhere - everywhere.mean(axis=0)).sum(axis=1)).mean()


def test_the_grid_has_all_edges_of_its_lattice():
    path = world("grid", 125)
    assert len(path.neighbours) + 124 == 3 * 5 * 5 * 4


def test_poses_of_the_sphere_lie_on_it():
    path = world("sphere", 900, per_ring=30, radius=4.0)
    assert np.allclose(np.square(np.asarray(path.positions)).sum(axis=1), 16.0)


def test_poses_of_the_torus_lie_on_it():
    x, y, z = np.asarray(world("torus", 900, per_ring=30, minor=1.0, major=4.0).positions).T
    assert np.allclose((np.sqrt(x * x + y * y) - 4.0) ** 2 + z * z, 1.0)


def test_a_grid_wider_than_its_path_takes_no_more_memory():
    assert len(WORLDS["grid"](50, np.random.default_rng(0), side=100_000).neighbours) == 0
