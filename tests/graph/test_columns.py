"""Columns of variables: rows of ids, whatever the ids are."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from numpy.testing import assert_array_equal

from slamcli import models
from slamcli.errors import UsageError
from slamcli.graph import FactorGraph, Factors, Variables
from slamcli.graph.columns import finite_rows

signed = st.integers(-(2**63), 2**63 - 1)
unsigned = st.integers(0, 2**64 - 1)
neighbours = st.integers(2**63 - 40, 2**63 + 40)  # doubles cannot tell these apart
small = st.integers(-20, 20)


def points(ids: list[int], dtype: type = np.int64) -> Variables:
    """A column of planar points that all lie at the origin."""
    count = len(ids)
    return Variables(
        kind=models.XY,
        ids=np.array(ids, dtype=dtype),
        values=np.zeros((count, 2)),
        fixed=np.zeros(count, dtype=bool),
        known=np.ones(count, dtype=bool),
        lines=np.zeros(count, dtype=np.intp),
    )


def dtype_of(ids: list[int]) -> type:
    return np.uint64 if max(ids) >= 2**63 else np.int64


@given(st.one_of(*(st.lists(i, min_size=1, unique=True) for i in (small, signed, unsigned, neighbours))), st.data())
def test_rows_of_ids(ids: list[int], data: st.DataObject) -> None:
    dtype = dtype_of(ids)
    column = points(ids, dtype)
    limits = np.iinfo(dtype)
    wanted = data.draw(st.lists(st.one_of(st.sampled_from(ids), st.integers(int(limits.min), int(limits.max)))))
    expected = [ids.index(i) if i in ids else -1 for i in wanted]
    assert column.rows_of(np.array(wanted, dtype=dtype)).tolist() == expected
    assert [column.row_of(i) for i in wanted] == expected


@given(st.integers(-5, 5), st.permutations(range(6)), st.lists(st.integers(-9, 15)))
def test_rows_of_consecutive_ids_in_any_order(first: int, order: list[int], wanted: list[int]) -> None:
    """Without gaps, rows are found by subtracting; ids beside the range are missing all the same."""
    ids = [first + k for k in order]
    expected = [ids.index(i) if i in ids else -1 for i in wanted]
    assert points(ids).rows_of(np.array(wanted, dtype=np.int64)).tolist() == expected


@given(st.lists(st.one_of(small, signed), min_size=1, unique=True))
def test_rank_is_the_position_among_the_sorted_ids(ids: list[int]) -> None:
    assert points(ids).rank.tolist() == [sorted(ids).index(i) for i in ids]


@pytest.mark.parametrize("wanted", [-(2**70), -1, 2**63, 2**64 - 1, 2**64, 2**70])
def test_an_id_that_no_column_can_hold_is_missing(wanted: int) -> None:
    assert points([0, 1, 5]).row_of(wanted) == -1
    if not 0 <= wanted < 2**64:
        assert points([0, 2**63], np.uint64).row_of(wanted) == -1


def test_an_empty_column_has_no_rows() -> None:
    assert points([]).rows_of(np.array([0, 7])).tolist() == [-1, -1]
    assert points([]).row_of(0) == -1


@pytest.mark.parametrize("ids", [[3, 1, 2], [2**63 - 1, 2**63 - 3, 2**63 + 5], [-(2**63), 0, 2**63 - 1]])
def test_with_fixed_holds_exactly_the_named_variable(ids: list[int]) -> None:
    graph = FactorGraph({"XY": points(ids, dtype_of(ids))}, [])
    for k, wanted in enumerate(ids):
        held = graph.with_fixed([wanted]).variables["XY"].fixed
        assert_array_equal(held, np.arange(len(ids)) == k)
    assert graph.with_fixed(ids).variables["XY"].fixed.all()
    assert not graph.variables["XY"].fixed.any()


@pytest.mark.parametrize("wanted", [7, -1, 2**63, 2**65])
def test_with_fixed_refuses_an_unknown_id(wanted: int) -> None:
    graph = FactorGraph({"XY": points([3, 1, 12])}, [])
    with pytest.raises(UsageError, match=str(wanted)) as caught:
        graph.with_fixed([3, wanted])
    assert "XY 1 to 12" in caught.value.details[0]


def test_with_fixed_holds_a_pose_and_a_landmark_of_the_same_id() -> None:
    spatial = Variables(
        models.XYZ, np.array([3]), np.zeros((1, 3)), np.zeros(1, bool), np.ones(1, bool), np.zeros(1, np.intp)
    )
    graph = FactorGraph({"XY": points([1, 3]), "XYZ": spatial}, []).with_fixed([3])
    assert graph.variables["XY"].fixed.tolist() == [False, True]
    assert graph.variables["XYZ"].fixed.tolist() == [True]


def differences() -> Factors:
    return Factors(
        kind=models.POINT_DIFFERENCE_2D,
        indices=np.array([[0, 1], [1, 2], [2, 0]], dtype=np.intp),
        measurements=np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, -1.0]]),
        information=np.tile(np.eye(2), (3, 1, 1)),
    )


def test_degrees_of_freedom_are_residuals_minus_free_dimensions() -> None:
    graph = FactorGraph({"XY": points([10, 20, 30])}, [differences()])
    assert graph.degrees_of_freedom() == 3 * 2 - 3 * 2
    assert graph.with_fixed([20]).degrees_of_freedom() == 3 * 2 - 2 * 2
    assert graph.degrees_of_freedom({"XY": np.array([True, True, False])}) == 3 * 2 - 2


def test_with_values_moves_a_copy_and_makes_everything_known() -> None:
    column = points([10, 20, 30])
    graph = FactorGraph({"XY": column}, [differences()])
    square = {"XY": np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])}
    moved = graph.with_values(square)
    assert moved.chi2() == graph.chi2(square) == 0.0
    assert graph.chi2() == 1.0 + 1.0 + 2.0
    assert moved.variables["XY"].known.all()


def test_counts_and_ids_of_factors() -> None:
    graph = FactorGraph({"XY": points([10, 20, 30])}, [differences()])
    assert (graph.poses, graph.landmarks, graph.edges, graph.space) == (0, 3, 3, 2)
    assert graph.factors[0].variable_ids(graph.variables).tolist() == [[10, 20], [20, 30], [30, 10]]


@given(st.lists(st.tuples(st.floats(), st.floats()), min_size=1))
def test_finite_rows(rows: list[tuple[float, float]]) -> None:
    expected = [bool(np.isfinite(a) and np.isfinite(b)) for a, b in rows]
    assert finite_rows(np.array(rows)).tolist() == expected
    assert finite_rows(np.array(rows)[:, None, :]).tolist() == expected
