"""What a sweep prints: its differences at the same seed, its notes, and JSON keys that docs/json.md explains."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from slamcli.batch.sweep.journal import Record
from slamcli.batch.sweep.paired import differences
from slamcli.batch.sweep.plan import tasks_of
from slamcli.batch.sweep.read import read_sweep
from slamcli.batch.sweep.run import State
from slamcli.batch.sweep.summary import summarize
from slamcli.errors import UsageError
from slamcli.reporting.documents import dumps
from slamcli.reporting.sweep import Findings, Ran, failure_notes, sweep_document, sweep_summary

STUDY = """\
name: study
seeds: 3
case: {simulate: square}
axes:
  world: {small: {simulation.poses: 10}, large: {simulation.poses: 20}}
  options.method: [gn, lm]
metrics: [ate]
summary: {by: [options.method, world], compare: {options.method: gn}}
"""
#: By world: of gn and lm, for seeds 0 to 2. What the seeds do cancels in the difference.
FIGURES = {"small": ([1.0, 5.0, 9.0], [1.5, 5.5, 9.5]), "large": ([2.0, 4.0, 7.0], [3.0, 6.0, None])}


def study(tmp_path, content=STUDY):
    path = tmp_path / "study.yaml"
    path.write_text(content)
    return read_sweep(str(path))


def test_a_metric_that_no_task_has_is_told(tmp_path):
    sweep = study(tmp_path, STUDY.replace("[ate]", '[ate, recall, "optimize:no.such.key"]'))
    tasks = tasks_of(sweep)
    figures = {"ate": 1.0, "recall": None, "optimize:no.such.key": None}
    state = State(tasks, {task.key: Record(task.key, 0, None, "", figures, {}) for task in tasks})
    assert failure_notes(state) == ["no task has a value of recall, optimize:no.such.key"]


@pytest.fixture
def found(tmp_path):
    sweep = study(tmp_path)
    tasks = tasks_of(sweep)
    records = {}
    for task in tasks:
        value = FIGURES[task.labels["world"]][task.labels["options.method"] == "lm"][task.seed]
        failed = (5, "optimize", "it went wrong") if value is None else (0, None, "")
        records[task.key] = Record(task.key, *failed, {"ate": value}, {"optimize": 0.1})
    state = State(tasks, records, others=2)
    findings = Findings(
        summarize(state, sweep.summary, sweep.metrics), differences(state, sweep.summary, sweep.metrics)
    )
    return sweep, state, findings


def test_differences_at_the_same_seed_by_hand(found):
    _, _, findings = found
    small, large = findings.differences
    assert small.labels == {"world": "small", "options.method": "lm"}
    # 0.5 for each seed: no spread, where the means have one of 8/sqrt(3)
    assert (small.statistics["ate"].count, small.statistics["ate"].mean.value) == (3, 0.5)
    assert small.statistics["ate"].deviation == 0.0
    # seed 2 has no value of lm, so only seeds 0 and 1 make pairs
    assert (large.statistics["ate"].count, large.statistics["ate"].mean.value) == (2, 1.5)


def test_summary_has_groups_differences_and_notes(found):
    sweep, state, findings = found
    text = "\n".join(sweep_summary(sweep, state, findings, Ran(12, 0, 1.0, {"table": "t.csv"}, failure_notes(state))))
    assert "12 tasks (2 world × 2 options.method × 3 seeds)" in text
    assert "11 without a failure, 1 numerical failure" in text
    assert "difference to options.method gn at the same seed" in text
    assert "note: task 11: optimize ended with 5: it went wrong" in text
    assert "the journal has 2 results of other tasks" in text
    assert "tasks without a value of a metric do not count" in text


def test_every_key_is_explained(found):
    sweep, state, findings = found
    document = sweep_document(sweep, state, findings, Ran(12, 0, 1.0, {"table": "t.csv"}, failure_notes(state)))
    explained = (Path(__file__).parents[2] / "docs" / "json.md").read_text()
    data = {"axes", "exit_codes", "levels", "compare", "files"}

    def keys(value, inside=True):
        if isinstance(value, dict):
            for key, item in value.items():
                if inside:
                    yield key
                yield from keys(item, inside=key not in data and key != "statistics")
        elif isinstance(value, list):
            for item in value:
                yield from keys(item)

    found_keys = set(keys(json.loads(dumps(document))))
    assert {"groups", "levels", "low", "deviation"} <= found_keys
    assert [key for key in sorted(found_keys) if f"`{key}`" not in explained] == []


@pytest.mark.parametrize(
    ("compare", "said"),
    [
        ("{method: gn}", "no axis 'method'"),
        ("{options.method: gm}", "options.method has no value gm"),
        ("{options.method: gn, world: small}", "expected one axis with one of its values"),
        ("[options.method]", "expected keys with values, found list"),
    ],
)
def test_what_cannot_be_compared(tmp_path, compare, said):
    with pytest.raises(UsageError, match="summary") as caught:
        study(tmp_path, STUDY.replace("{options.method: gn}", compare))
    assert said in caught.value.message
