"""Which poses belong together, and what is said when nothing tells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from noisy_paths import planar

from slamcli.errors import InputError, UsageError
from slamcli.evaluation import evaluate
from slamcli.evaluation.association import associate, match_ids, nearest_in_time
from slamcli.graph.trajectory import Trajectory


def bare(trajectory: Trajectory, *, ids: bool = False, stamps: bool = False) -> Trajectory:
    """A trajectory with only what is asked for."""
    return replace(
        trajectory, ids=trajectory.ids if ids else None, stamps=trajectory.stamps if stamps else None, source="bare"
    )


@pytest.mark.parametrize(
    ("estimate", "truth", "method"),
    [
        ({"ids": True, "stamps": True}, {"ids": True, "stamps": True}, "time"),
        ({"ids": True, "stamps": True}, {"ids": True}, "id"),
        ({"ids": True}, {"ids": True}, "id"),
        ({}, {"ids": True}, "index"),
        ({}, {"stamps": True}, "index"),
        ({}, {}, "index"),
    ],
)
def test_what_auto_chooses(estimate: dict[str, bool], truth: dict[str, bool], method: str) -> None:
    pairs = associate(bare(planar(9), **estimate), bare(planar(9), **truth))
    assert (pairs.method, len(pairs)) == (method, 9)
    np.testing.assert_array_equal(pairs.estimate, pairs.truth)


def test_ids_against_stamps_is_refused() -> None:
    with pytest.raises(InputError, match="nothing tells") as error:
        associate(bare(planar(9), ids=True), bare(planar(9), stamps=True))
    assert "--timestamps" in "".join(error.value.details)
    assert "9 poses with ids; bare has 9 poses with time stamps" in error.value.details[0]


def test_different_numbers_of_nameless_poses_are_refused() -> None:
    with pytest.raises(InputError, match="nothing tells") as error:
        associate(bare(planar(9)), bare(planar(8)))
    assert "--associate index" in "".join(error.value.details)
    pairs = associate(bare(planar(9)), bare(planar(8)), "index")
    assert (len(pairs), pairs.unmatched_estimate, pairs.unmatched_truth) == (8, 1, 0)


def test_whole_stamps_stand_in_for_ids() -> None:
    """A graph without stamps is written as TUM with its ids in their place."""
    written = replace(planar(5), ids=None, stamps=np.array([10.0, 11.0, 12.0, 14.0, 13.0]))
    graph = replace(planar(5), ids=np.array([14, 10, 99, 11, 12]), stamps=None)
    pairs = associate(graph, written)
    assert pairs.method == "id"
    assert list(zip(pairs.estimate.tolist(), pairs.truth.tolist(), strict=True)) == [(0, 3), (1, 0), (3, 1), (4, 2)]
    assert (pairs.unmatched_estimate, pairs.unmatched_truth) == (1, 1)


def test_nearest_in_time_by_hand() -> None:
    long = np.array([1.0, 2.0, 3.0, 10.0])
    rows, near = nearest_in_time(np.array([0.5, 1.5, 2.9, 3.2, 7.0, 10.5, 11.0]), long, 0.5)
    assert rows.tolist() == [0, 1, 2, 3, 5]  # 7 and 11 are too far from everything
    assert near.tolist() == [0, 0, 2, 2, 3]  # 1.5 is as near to 1 as to 2
    backward = nearest_in_time(np.array([2.9, 0.5]), long[::-1], 0.5)
    assert [rows.tolist() for rows in backward] == [[0, 1], [1, 3]]


def test_what_is_matched_twice_is_counted() -> None:
    estimate = replace(planar(4), stamps=np.array([0.0, 0.004, 5.0, 6.0]))
    truth = replace(planar(5), stamps=np.array([0.002, 5.0, 6.0, 7.0, 8.0]))
    pairs = associate(estimate, truth)
    assert (len(pairs), pairs.reused, pairs.unmatched_truth, pairs.unmatched_estimate) == (4, 1, 2, 0)
    assert pairs.largest_time_difference == pytest.approx(0.002)
    assert "share a pose" in evaluate([estimate], truth).notes[0]


def test_nothing_in_common() -> None:
    truth = planar(5)
    for method, change, words in (
        ("id", {"ids": truth.ids + 100}, ("no id in common", "ids 100 to 104")),
        ("time", {"stamps": truth.stamps + 3.6e3}, ("no time stamps within 0.01 s", "--max-time-difference")),
    ):
        with pytest.raises(InputError) as error:
            associate(replace(truth, **change), truth, method)
        said = " ".join([error.value.message, *error.value.details])
        assert all(word in said for word in words)


def test_few_partners_are_said() -> None:
    truth = planar(20)
    estimate = replace(truth, stamps=truth.stamps + np.where(np.arange(20) < 5, 0.0, 0.05))
    assert "only 5 of 20 poses have a partner by time" in evaluate([estimate], truth).notes[0]


def test_ids_of_64_bits() -> None:
    """Symbols of GTSAM differ in bits that a float does not hold."""
    large = np.array([2**63 + 1, 2**63, 7], dtype=np.uint64)
    rows, others = match_ids(large, np.array([2**63, 2**63 + 2, 7], dtype=np.uint64))
    assert (rows.tolist(), others.tolist()) == ([1, 2], [0, 2])
    rows, others = match_ids(np.array([-1, 7], dtype=np.int64), large)
    assert (rows.tolist(), others.tolist()) == ([1], [2])
    assert match_ids(large, large[:0])[0].tolist() == []


def test_options_that_do_not_exist() -> None:
    with pytest.raises(UsageError, match="nearest"):
        associate(planar(3), planar(3), "nearest")
    with pytest.raises(UsageError, match="at least 0"):
        associate(planar(3), planar(3), "time", -1.0)
    for name in ("estimate", "truth"):
        bare_one = bare(planar(3), ids=True)
        pair = (bare_one, planar(3)) if name == "estimate" else (planar(3), bare_one)
        with pytest.raises(InputError, match="no time stamps"):
            associate(*pair, "time")
    with pytest.raises(InputError, match="no ids"):
        associate(bare(planar(3), stamps=True), planar(3), "id")
