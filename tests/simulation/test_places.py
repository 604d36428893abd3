import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamcli.simulation.places import meetings


def all_pairs(positions, reach, gap):
    """By comparing every pose with every other."""
    distance2 = np.square(positions[:, None] - positions[None]).sum(axis=2)
    earlier, later = np.nonzero(distance2 <= reach * reach)
    return {(i, j) for i, j in zip(earlier.tolist(), later.tolist(), strict=True) if j - i >= gap}


@settings(max_examples=60, deadline=None)
@given(
    space=st.sampled_from([2, 3]),
    poses=st.integers(2, 80),
    reach=st.floats(0.1, 5.0),
    gap=st.integers(1, 30),
    seed=st.integers(0, 1000),
)
def test_finds_exactly_the_pairs_within_reach(space, poses, reach, gap, seed):
    rng = np.random.default_rng(seed)
    positions = rng.normal(scale=3.0, size=(poses, space))
    found = meetings(positions, reach, gap, 1000, rng)
    assert len(found) == len(set(map(tuple, found.tolist())))
    assert set(map(tuple, found.tolist())) == all_pairs(positions, reach, gap)
    assert (np.diff(found[:, 1]) >= 0).all()


def test_lattice_points_at_the_very_reach_are_found():
    x, y = np.meshgrid(np.arange(10.0), np.arange(10.0))
    positions = np.stack([x.ravel(), y.ravel()], axis=1)
    assert len(meetings(positions, 1.0, 1, 100, np.random.default_rng(0))) == 2 * 10 * 9


@pytest.mark.parametrize("per_pose", [1, 5])
def test_a_place_visited_often_is_sampled(per_pose):
    positions = np.zeros((3000, 2))
    found = meetings(positions, 1.0, 10, per_pose, np.random.default_rng(0))
    counts = np.bincount(found[:, 1], minlength=3000)
    assert counts.max() <= per_pose
    assert counts[10:].min() >= 1
    assert (found[:, 1] - found[:, 0] >= 10).all()
    # uniform over the earlier poses: the mean earlier pose is half way
    late = found[found[:, 1] > 1000]
    assert abs((late[:, 0] / (late[:, 1] - 9)).mean() - 0.5) < 4 * np.sqrt(1 / 12 / len(late))
