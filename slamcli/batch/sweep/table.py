"""The table of a sweep: a row for each task, in the order of the tasks, whatever the order in which they were run.

Nothing in it depends on when, where or how long a task was run: the same tasks give the same bytes.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Any

from slamcli.batch.sweep.run import State
from slamcli.errors import UsageError

#: A column: its name and its cells.
Column = tuple[str, list[Any]]
STEPS = ("simulate", "inject", "command", "evaluate")


def columns(state: State) -> list[Column]:
    """The columns: task, axes, seed, exit code, the step that failed, metrics, the message of a failure."""
    ended = state.ended
    names = list(state.tasks[0].labels)
    return [
        ("task", [task.index for task, _ in ended]),
        *((name, [task.labels[name] for task, _ in ended]) for name in names),
        ("seed", [task.seed for task, _ in ended]),
        ("exit_code", [record.exit_code for _, record in ended]),
        ("failed", [record.failed for _, record in ended]),
        *((name, [record.figures.get(name) for _, record in ended]) for name in state.tasks[0].metrics),
        ("message", [record.message or None for _, record in ended]),
    ]


def times(state: State) -> list[Column]:
    """Wall-clock seconds of each step, and of all."""
    ended = state.ended
    out: list[Column] = [("task", [task.index for task, _ in ended])]
    for step in STEPS:
        cells = [record.seconds.get(task.case.command if step == "command" else step) for task, record in ended]
        out.append((step, cells))
    out.append(("total", [sum(record.seconds.values()) for _, record in ended]))
    return out


def csv_bytes(table: Sequence[Column]) -> bytes:
    """As CSV; numbers with all their digits, nothing for what there is not."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow([name for name, _ in table])
    writer.writerows(zip(*(map(_cell, cells) for _, cells in table), strict=True))
    return stream.getvalue().encode()


def parquet_bytes(table: Sequence[Column]) -> bytes:
    """As Parquet: whole numbers, numbers, truth values or text by column.

    Raises
    ------
    UsageError
        If pyarrow is not installed.
    """
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise UsageError("a table in Parquet needs pyarrow", ("  pip install 'slamcli[parquet]'",)) from None
    arrays = {name: pyarrow.array(_typed(cells), _type(cells, pyarrow)) for name, cells in table}
    stream = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.table(arrays), stream)
    return stream.getvalue()


def check_parquet() -> None:
    """Say before anything is run that pyarrow is missing.

    Raises
    ------
    UsageError
        If it is.
    """
    parquet_bytes([("task", [0])])


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value) if isinstance(value, float) else str(value)


def _kinds(cells: list[Any]) -> set[type]:
    return {type(cell) for cell in cells if cell is not None}


def _typed(cells: list[Any]) -> list[Any]:
    """Cells of different kinds as text, unless all are numbers."""
    if _kinds(cells) <= {int, float} or len(_kinds(cells)) <= 1:
        return cells
    return [None if cell is None else _cell(cell) for cell in cells]


def _type(cells: list[Any], pyarrow: Any) -> Any:
    kinds = _kinds(cells)
    if kinds == {bool}:
        return pyarrow.bool_()
    if kinds == {int}:
        return pyarrow.int64()
    if kinds <= {int, float} and kinds:
        return pyarrow.float64()
    return pyarrow.string()
