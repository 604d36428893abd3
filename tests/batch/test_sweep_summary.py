"""Means and medians with their intervals, and the table: hand-worked numbers, coverage, bytes."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest
from sweeps import record_of, sweep_of, tasks_in

from slamcli.batch.sweep.plan import SummaryOptions, tasks_of
from slamcli.batch.sweep.run import State
from slamcli.batch.sweep.summary import mean_interval, median_interval, statistics, summarize
from slamcli.batch.sweep.table import columns, csv_bytes, parquet_bytes, times


def test_student_interval_by_hand():
    """Four values: mean 2.5, s = sqrt(5/3), t(3; 0.975) = 3.182446."""
    found = mean_interval(np.array([1.0, 2.0, 3.0, 4.0]), 0.95)
    half = 3.182446305284263 * math.sqrt(5.0 / 3.0) / 2.0
    assert (found.value, found.low, found.high) == pytest.approx((2.5, 2.5 - half, 2.5 + half), rel=1e-12)


@pytest.mark.parametrize(
    ("n", "ranks"),
    # 1 - 2 P(B < k) for B binomial (n, 1/2): the tables of order statistics
    [(1, None), (5, None), (6, (1, 6)), (8, (1, 8)), (9, (2, 8)), (20, (6, 15)), (100, (40, 61))],
)
def test_median_interval_by_the_tables(n, ranks):
    found = median_interval(np.arange(1.0, n + 1.0), 0.95)
    assert found.value == (n + 1) / 2
    assert (found.low, found.high) == ((None, None) if ranks is None else ranks)


def test_intervals_cover_what_they_say():
    generator = np.random.default_rng(1)
    samples = np.sort(generator.standard_normal((4000, 12)) + 3.0, axis=1)
    for interval, least, most in ((mean_interval, 0.94, 0.96), (median_interval, 0.95, 0.975)):
        found = [interval(row, 0.95) for row in samples]
        share = np.mean([item.low <= 3.0 <= item.high for item in found])
        assert least < share < most


def test_many_values():
    numbers = np.arange(100_000.0)
    found = median_interval(numbers, 0.95)
    # normal approximation: n/2 -+ 1.96 sqrt(n)/2
    assert found.low == pytest.approx(50_000 - 1.96 * math.sqrt(100_000) / 2, abs=2)


def test_one_value_and_none():
    found = statistics([2.0], 0.95)
    assert found is not None
    assert (found.mean.value, found.mean.low, found.deviation) == (2.0, None, None)
    assert statistics([], 0.95) is None


def state(tmp_path):
    tasks = tasks_in(tmp_path)
    records = [record_of(tasks[0], 1.0), record_of(tasks[1], 3.0), record_of(tasks[3], 0.1 + 0.2, code=4)]
    return State(tasks, {record.key: record for record in records})


def test_groups_count_failures_and_leave_gaps_out(tmp_path):
    found = state(tmp_path)
    gn, lm = summarize(found, SummaryOptions(("options.method",)), ("ate",))
    assert (gn.labels, gn.tasks, gn.failed, gn.codes) == ({"options.method": "gn"}, 2, 0, {0: 2})
    assert gn.statistics["ate"].mean.value == 2.0
    assert (lm.tasks, lm.failed, lm.codes, lm.statistics["ate"].count) == (1, 1, {4: 1}, 1)
    (everything,) = summarize(found, SummaryOptions(()), ("ate",))
    assert (everything.tasks, everything.failed) == (3, 1)
    assert found.missing == 1 and not found.complete


def test_groups_are_in_the_order_of_by(tmp_path):
    axes = "axes:\n  options.robust: [none, auto]\n  inject.false-closures: [10, 2]\nmetrics: [ate]\n"
    content = "seeds: 1\ncase: {simulate: square}\n" + axes + "summary: {by: [inject.false-closures, options.robust]}\n"
    sweep = sweep_of(tmp_path, content)
    tasks = tasks_of(sweep)
    found = summarize(State(tasks, {t.key: record_of(t) for t in tasks}), sweep.summary, ("ate",))
    assert [tuple(group.labels.values()) for group in found] == [(10, "none"), (10, "auto"), (2, "none"), (2, "auto")]


def test_table_has_rows_in_task_order_and_all_digits(tmp_path):
    lines = csv_bytes(columns(state(tmp_path))).decode().splitlines()
    assert lines == [
        "task,options.method,seed,exit_code,failed,ate,chi2,message",
        "0,gn,0,0,,1.0,1.0,",
        "1,gn,1,0,,3.0,3.0,",
        "3,lm,1,4,optimize,0.30000000000000004,0.30000000000000004,it went wrong",
    ]


def test_times_are_in_a_table_of_their_own(tmp_path):
    lines = csv_bytes(times(state(tmp_path))).decode().splitlines()
    assert lines[:2] == ["task,simulate,inject,command,evaluate,total", "0,,,0.25,,0.25"]
    assert "0.25" not in csv_bytes(columns(state(tmp_path))).decode()


def test_parquet_has_the_same_table_with_types(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    data = parquet_bytes(columns(state(tmp_path)))
    assert data == parquet_bytes(columns(state(tmp_path)))
    found = parquet.read_table(io.BytesIO(data))
    assert found.column_names == ["task", "options.method", "seed", "exit_code", "failed", "ate", "chi2", "message"]
    assert [str(field.type) for field in found.schema] == [
        "int64", "string", "int64", "int64", "string", "double", "double", "string",
    ]  # fmt: skip
    assert found.column("ate").to_pylist() == [1.0, 3.0, 0.1 + 0.2]
    assert found.column("failed").to_pylist() == [None, None, "optimize"]


def test_parquet_columns_of_several_kinds():
    parquet = pytest.importorskip("pyarrow.parquet")
    table = [("a", [1, 2.5, None]), ("b", [1, "x", True]), ("c", [True, None, False]), ("d", [None, None, None])]
    found = parquet.read_table(io.BytesIO(parquet_bytes(table)))
    assert found.to_pydict() == {
        "a": [1.0, 2.5, None],
        "b": ["1", "x", "true"],
        "c": [True, None, False],
        "d": [None, None, None],
    }
