"""``slamcli sweep``: Monte-Carlo and parameter studies."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from slamcli.cli.options import FILE, check_outputs, json_option, warn
from slamcli.errors import ExitCode, InputError, UsageError

_EXAMPLES = """\b
Examples:
  slamcli sweep robust.yaml -o robust --jobs 4
  slamcli sweep robust.yaml -o robust --dask tcp://head:8786 --table robust.parquet
  slamcli sweep robust.yaml --only '*robust=auto*seed=0'
  slamcli sweep robust.yaml --show 17

\b
Exit codes: 0 each task has a result, 1 some task has none (its command was ended, or
refused its input), 2 usage or a bad sweep file, 3 a file cannot be read or written,
130 interrupted.
"""


@click.command(name="sweep", epilog=_EXAMPLES)
@click.argument("sweep", metavar="SWEEP", type=FILE)
@click.option("-o", "--output", type=FILE, metavar="DIR", help="Folder of the results.  [default: NAME.sweep]")
@click.option("--jobs", type=click.IntRange(min=1), metavar="N", help="Tasks at a time.  [default: one per processor]")
@click.option("--dask", metavar="ADDRESS", help="Run on a dask cluster: its scheduler, or local:N for N workers here.")
@click.option("--isolate", is_flag=True, help="A new process for each step: slower, the same results.")
@click.option(
    "--resume/--no-resume", default=True, show_default=True, help="Whether results that DIR has are not made again."
)
@click.option("--retry-failed", is_flag=True, help="Run tasks again whose exit code was not 0.")
@click.option("--only", metavar="GLOB", help="Only the tasks whose name matches, such as '*robust=auto*'.")
@click.option("--table", type=FILE, metavar="FILE", help="Write the table there, too: .csv, .parquet, or - for CSV.")
@click.option("--times", is_flag=True, help="Write DIR/times.csv: seconds of each step of each task.")
@click.option("--show", type=click.IntRange(min=0), metavar="TASK", help="Run nothing; print the commands of a task.")
@click.option("--no-run", is_flag=True, help="Run nothing; write and summarize the results that DIR has.")
@json_option
def command(sweep: str, **given: Any) -> int:
    """Run a case for all values of its axes and all seeds: the study that the YAML file SWEEP describes.

    Writes one table, DIR/table.csv, and prints means with confidence intervals. Each finished task is in
    DIR/journal.jsonl: after an interruption the same command goes on. The table has the same bytes however and
    wherever the tasks were run.
    """
    from slamcli.batch.sweep.plan import command_levels, input_files, tasks_of
    from slamcli.batch.sweep.read import read_sweep

    if given["dask"] is not None and given["jobs"] is not None:
        raise UsageError("--jobs is for this machine: with --dask the cluster decides")
    if given["no_run"] and not given["resume"]:
        raise UsageError("--no-run shows the results that there are, --no-resume puts them aside")
    study = read_sweep(sweep)
    tasks = tasks_of(study, given["only"])
    inputs = {path for task in command_levels(tasks) for _, path in input_files(task.case)}
    check_outputs(given, ("output", "table"), json=given["json"], inputs=[sweep, *inputs])
    _check_table(given["table"])
    _check_command_lines(study, tasks)
    if given["show"] is not None:
        return _show(tasks, given["show"])
    return _run(study, tasks, given)


def _run(study: Any, tasks: Any, given: dict[str, Any]) -> int:
    from slamcli.batch.sweep import run as running
    from slamcli.batch.sweep.paired import differences
    from slamcli.batch.sweep.summary import summarize
    from slamcli.cli.process import progress, terminable
    from slamcli.reporting import documents
    from slamcli.reporting import sweep as reporting

    folder = Path(given["output"] or f"{study.name}.sweep")
    with running.opened(folder, resume=given["resume"], make=not given["no_run"]) as journal:
        warn(journal.notes)
        pending = running.pending(tasks, journal, retry_failed=given["retry_failed"])
        started = time.perf_counter()
        try:
            if pending and not given["no_run"]:
                with progress("running tasks", len(pending)) as tick, terminable():
                    running.run(pending, journal, _engine(given), tick)
        except KeyboardInterrupt:
            print(reporting.interrupted_text(running.state_of(tasks, journal), folder), file=sys.stderr)
            return int(ExitCode.INTERRUPTED)
        seconds = time.perf_counter() - started
        state = running.state_of(tasks, journal)
        files = _write(state, folder, given)
    ran = 0 if given["no_run"] else len(pending)
    done = reporting.Ran(ran, len(state.ended) - ran, seconds, files, reporting.failure_notes(state))
    found = reporting.Findings(
        summarize(state, study.summary, study.metrics), differences(state, study.summary, study.metrics)
    )
    if given["json"]:
        print(documents.dumps(reporting.sweep_document(study, state, found, done)))
    else:
        out = sys.stderr if given["table"] == "-" else sys.stdout
        print(*reporting.sweep_summary(study, state, found, done), sep="\n", file=out)
    return int(ExitCode.SUCCESS if state.complete or given["no_run"] else ExitCode.CHECK_FAILED)


def _engine(given: dict[str, Any]) -> Any:
    from slamcli.batch.sweep.cluster import cluster
    from slamcli.batch.sweep.local import local, processors
    from slamcli.batch.sweep.perform import Performer

    performer = Performer(given["isolate"])
    if given["dask"] is not None:
        return lambda tasks: cluster(tasks, performer, given["dask"])
    return lambda tasks: local(tasks, performer, given["jobs"] or processors())


def _write(state: Any, folder: Path, given: dict[str, Any]) -> dict[str, str]:
    """Write the tables; say what went where."""
    from slamcli.batch.sweep import table as tables
    from slamcli.formats.source import write_bytes

    table = tables.columns(state)
    files = {"table": str(folder / "table.csv")}
    write_bytes(files["table"], tables.csv_bytes(table))
    if given["table"] is not None:
        parquet = given["table"].endswith(".parquet")
        write_bytes(given["table"], tables.parquet_bytes(table) if parquet else tables.csv_bytes(table))
        files["copy"] = given["table"]
    if given["times"]:
        files["times"] = str(folder / "times.csv")
        write_bytes(files["times"], tables.csv_bytes(tables.times(state)))
    return files


def _check_table(path: str | None) -> None:
    """The format of the table and its folder, told before anything is run."""
    if path is None or path == "-":
        return
    if not Path(path).parent.is_dir():
        raise InputError(f"{path}: cannot be written: there is no folder {Path(path).parent}")
    if path.endswith(".parquet"):
        from slamcli.batch.sweep.table import check_parquet

        check_parquet()
    elif not path.removesuffix(".gz").removesuffix(".bz2").endswith(".csv"):
        raise UsageError(f"--table {path}: expected a name that ends in .csv or .parquet, or -")


def _check_command_lines(study: Any, tasks: Any) -> None:
    """Options that do not exist, told before anything is run.

    Raises
    ------
    UsageError
        If the command line of a step would be refused.
    """
    from slamcli.batch.sweep.plan import command_levels, command_lines
    from slamcli.cli.main import build_group
    from slamcli.reporting.sweep import usage_details

    group = build_group()
    for task in command_levels(tasks):
        for words in command_lines(task):
            problem = _problem(group, words, task.case)
            if problem is not None:
                details = usage_details(task, words, problem)
                raise UsageError(f"{study.source}: a command line of this sweep is wrong", details)


def _problem(group: click.Group, words: Sequence[str], case: Any) -> str | None:
    """What is wrong with the command line of a step, None if nothing is."""
    from slamcli.batch.sweep.plan import options_of

    context = click.Context(group, info_name="slamcli", **group.context_settings)
    step = group.get_command(context, words[0])
    if step is None:
        return f"there is no command {words[0]!r}"
    if isinstance(step, click.Group):
        return f"{words[0]} takes no graph"
    try:
        step.make_context(words[0], list(words[1:]), parent=context)
    except click.UsageError as error:
        return error.format_message()
    except click.exceptions.Exit:
        return "has an option that is none for a task"
    for name, value in options_of(case, words[0]).items():
        for parameter in step.params:
            if isinstance(parameter.type, click.Path) and f"--{name}" in parameter.opts and not _absolute(value):
                return f"--{name} {value}: must be an absolute path, since each task runs in a folder of its own"
    return None


def _absolute(value: Any) -> bool:
    """Whether a value, or each of a list, is an absolute path."""
    return all(os.path.isabs(str(item)) for item in (value if isinstance(value, list) else [value]))


def _show(tasks: Any, number: int) -> int:
    from slamcli.batch.sweep.plan import command_lines
    from slamcli.reporting.sweep import command_text

    found = next((task for task in tasks if task.index == number), None)
    if found is None:
        numbers = f"from {tasks[0].index} to {tasks[-1].index}"
        raise UsageError(f"--show {number}: there is no such task; there are {len(tasks)}, {numbers}")
    print(*command_text(found, command_lines(found)), sep="\n")
    return 0
