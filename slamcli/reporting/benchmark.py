"""Tables and documents of ``slamcli bench``."""

from __future__ import annotations

import csv
import io
import textwrap
from dataclasses import asdict
from typing import Any

from slamcli.batch.benchmark.grid import shown
from slamcli.batch.benchmark.result import BenchResult, Data, Row
from slamcli.reporting.documents import dumps, head
from slamcli.reporting.text import plural, table

#: What ``--export`` offers.
EXPORTS = ("csv", "json", "markdown")
#: Columns of the tables; times are those of the optimization alone.
COLUMNS = ("data", "variant", "median ms", "spread", "ratio", "iterations", "chi2", "reached", "memory MB", "note")
_ALIGN = "<<>>>>><><"
#: Of the text below the table on a terminal.
_WIDTH = 118
_CSV = (
    "data",
    "sha256",
    "variant",
    "tool",
    "setting",
    "runs",
    "median_s",
    "mad_s",
    "min_s",
    "max_s",
    "ratio",
    "iterations",
    "chi2",
    "best_chi2",
    "reached",
    "memory_mb",
    "status",
    "note",
)
_INTERRUPTED = "Interrupted: the table holds what was measured until then."
_REACHED = {True: "yes", False: "no", None: "-"}


def benchmark_summary(result: BenchResult) -> list[str]:
    """Lines for a terminal."""
    lines = table([COLUMNS, *_cells(result)], _ALIGN) if result.rows else []
    for sentence in ("", *_explanation(result), _machine(result)):
        lines += textwrap.wrap(sentence, _WIDTH) or [""]
    if result.interrupted:
        lines.append(_INTERRUPTED)
    return lines


def _explanation(result: BenchResult) -> list[str]:
    """What the columns mean, in sentences."""
    sentences = [
        f"Times are those from the loaded graph to the converged one: median and range of "
        f"{plural(result.repeats, 'alternating run')}, each in a process of its own on "
        f"{plural(result.threads, 'thread')}, the second of two in it.",
        "Ratio: to the first variant, run by run. Reached: chi2 within 1e-6 of the lowest known.",
    ]
    if any(variant.is_peer for variant in result.variants):
        sentences.append(
            "A peer runs its fastest setting for the fewest iterations that reach the optimum, as if they were known; "
            "chi2 is slamcli's at its values."
        )
    return sentences


def _machine(result: BenchResult) -> str:
    where = result.provenance
    versions = where["versions"]
    tools = ["slamcli", *(variant.tool for variant in result.variants if variant.is_peer)]
    named = ", ".join(f"{name} {versions[name] or 'absent'}" for name in dict.fromkeys(tools))
    return f"{named}; Python {versions['python']}; {where['processor']} ({where['processors']} processors)"


def _cells(result: BenchResult) -> list[tuple[str, ...]]:
    return [_row_cells(result, row) for row in result.rows]


def _ms(value: float) -> str:
    """Milliseconds, with two digits at least."""
    return f"{value * 1e3:.1f}" if value >= 1e-3 else f"{value * 1e3:.2g}"


def _row_cells(result: BenchResult, row: Row) -> tuple[str, ...]:
    last, ratio, memory = row.last, result.ratio(row), row.peak("memory")
    median, times = row.median, row.times
    chi2 = None if last is None else last.chi2
    return (
        row.data.name,
        row.variant.label,
        "-" if median is None else _ms(median),
        f"{_ms(min(times))}..{_ms(max(times))}" if times else "-",
        "-" if ratio is None else f"{ratio:.2f}" if ratio >= 0.1 else f"{ratio:.1g}",
        str(last.iterations) if last is not None and last.solve is not None else "-",
        "-" if chi2 is None else f"{chi2:.9g}",
        _REACHED[result.reached(row)],
        "-" if memory is None else f"{memory:.0f}",
        result.notes(row),
    )


def benchmark_markdown(result: BenchResult) -> str:
    """Table and what it holds, without a heading."""
    machine = _machine(result)
    marks = {"<": ":--", ">": "--:"}
    rows = [COLUMNS, tuple(marks[side] for side in _ALIGN), *_cells(result)]
    lines = ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
    lines += ["", " ".join(_explanation(result)), "", f"{machine}; {result.provenance['date']}."]
    if result.interrupted:
        lines += ["", _INTERRUPTED]
    return "\n".join(lines) + "\n"


def benchmark_csv(result: BenchResult) -> str:
    """One line for each row; numbers with all digits, empty where there is none."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(_CSV)
    for row in result.rows:
        section = _row_section(result, row)
        seconds = section["seconds"]
        cells = {
            **section,
            "sha256": row.data.sha256,
            "runs": len(row.runs),
            **{f"{name}_s": seconds[name] for name in ("median", "mad", "min", "max")},
            "best_chi2": result.best(row.data),
            "status": row.last.status if row.last else "failed",
        }
        writer.writerow(["" if cells[name] is None else cells[name] for name in _CSV])
    return out.getvalue()


def benchmark_document(result: BenchResult) -> dict[str, Any]:
    """The document of ``slamcli bench --json``."""
    return {
        **head("bench"),
        "options": {"runs": result.repeats, "time_limit": result.time_limit, "threads": result.threads},
        "provenance": result.provenance,
        "interrupted": result.interrupted,
        "exit_code": int(result.exit_code),
        "data": [_data_section(result, data) for data in result.data],
        "variants": [
            {"label": one.label, "tool": one.tool, "parameters": {k: shown(v) for k, v in one.options.items()}}
            for one in result.variants
        ],
        "rows": [_row_section(result, row) for row in result.rows],
    }


def _data_section(result: BenchResult, data: Data) -> dict[str, Any]:
    return {**asdict(data), "best_chi2": result.best(data)}


def _row_section(result: BenchResult, row: Row) -> dict[str, Any]:
    times, last = row.times, row.last
    return {
        "data": row.data.name,
        "variant": row.variant.label,
        "tool": row.variant.tool,
        "setting": row.setting,
        "seconds": {
            "median": row.median,
            "mad": row.deviation,
            "min": min(times, default=None),
            "max": max(times, default=None),
        },
        "ratio": result.ratio(row),
        "iterations": last.iterations if last is not None and last.solve is not None else None,
        "chi2": last.chi2 if last is not None else None,
        "reached": result.reached(row),
        "memory_mb": row.peak("memory"),
        "note": result.notes(row),
        "runs": [
            {
                "solve": run.solve,
                "first": run.first,
                "process": run.process,
                "memory_mb": run.memory,
                "cores": run.cores,
                "iterations": run.iterations,
                "chi2": run.chi2,
                "polished_chi2": run.polished,
                "status": run.status,
                "note": run.note,
            }
            for run in row.runs
        ],
    }


def exported(result: BenchResult, kind: str) -> str:
    """The text of a format of ``EXPORTS``."""
    if kind == "csv":
        return benchmark_csv(result)
    return benchmark_markdown(result) if kind == "markdown" else dumps(benchmark_document(result)) + "\n"
