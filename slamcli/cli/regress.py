"""``slamcli regress``: a suite of cases against its baseline."""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING, Any

import click

from slamcli.cli.options import FILE, check_outputs, color_option, use_color, warn
from slamcli.errors import InputError, SlamcliError, UsageError

if TYPE_CHECKING:
    from slamcli.batch.regression.result import RegressionReport
    from slamcli.batch.regression.state import State

_FORMATS = ("table", "json", "junit", "github", "markdown", "html")
#: Format of a report whose name ends so, unless --format says another one.
_ENDINGS = {".json": "json", ".xml": "junit", ".md": "markdown", ".html": "html", ".htm": "html"}

_EXAMPLES = """\b
Examples:
  slamcli regress configs/suites/bundled.yaml
  slamcli regress suite.yaml --only 'sphere*' --verbose
  slamcli regress suite.yaml --format junit -o report.xml --jobs 2
  slamcli regress suite.yaml --update-baseline

\b
Exit codes: 0 nothing is worse, 1 a regression, 2 usage, bad suite or bad baseline,
3 data missing or a file cannot be written, 130 interrupted (finished cases are
reported). docs/regress.md describes suites and baselines.
"""


@click.command(name="regress", epilog=_EXAMPLES)
@click.argument("suite", metavar="SUITE", type=FILE)
@click.option(
    "--baseline",
    type=FILE,
    metavar="FILE",
    help="Figures that the suite is held to.  [default: SUITE.baseline.json beside the suite]",
)
@click.option(
    "--update-baseline",
    is_flag=True,
    help="Make what is measured now the baseline, and show what changes. Cases that break a limit of the suite keep "
    "their old figures.",
)
@click.option(
    "--only", multiple=True, metavar="GLOB", help="Run the cases with such names; may be given several times."
)
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    metavar="N",
    help="Cases at a time. Times are measured with 1 only.",
)
@click.option(
    "--format",
    "form",
    type=click.Choice(_FORMATS),
    help="Of the report: github is annotations for GitHub Actions.  [default: by the ending of -o, else table]",
)
@click.option("-o", "--output", type=FILE, metavar="FILE", help="Write the report; the table then goes to stdout.")
@click.option(
    "--state", type=FILE, metavar="FILE", help="Keep finished cases here until the run ends.  [default: OUTPUT.state]"
)
@click.option("--resume", is_flag=True, help="Take finished cases of an interrupted run from the state file.")
@click.option("-v", "--verbose", is_flag=True, help="List every figure in the table, not only those that changed.")
@color_option
def command(suite: str, **given: Any) -> int:
    """Run the cases of SUITE and compare their figures with a baseline.

    A case is a data set or a simulation, a command, and figures with a direction and a tolerance. What is worse than
    the baseline, or beyond a limit of the suite, is a regression. Times gate only where the suite says so.
    """
    check_outputs(given, ("output", "state", "baseline"), json=False, inputs=[suite])
    plain = (given["output"] or "").removesuffix(".gz").removesuffix(".bz2")
    form = given["form"] or _ENDINGS.get(os.path.splitext(plain)[1].lower(), "table")
    from slamcli.batch.regression import baseline as baselines
    from slamcli.batch.regression.reading import read
    from slamcli.batch.regression.run import this_machine
    from slamcli.batch.regression.session import regress, selected
    from slamcli.cli.process import progress, terminable

    found = read(suite)
    if given["baseline"] == "-":
        raise UsageError("--baseline needs a file")
    path = given["baseline"] or baselines.default_path(found.path)
    check_outputs(given, ("output", "state"), json=False, inputs=[path])
    baseline = baselines.read(path)
    if baseline is None and given["baseline"] and not given["update_baseline"]:
        raise UsageError(f"{path}: there is no such baseline", ("  --update-baseline writes one",))
    count = len(selected(found, given["only"]))
    for name in (given["output"], path if given["update_baseline"] else None):
        _check_folder(name)
    state = _state(given)
    done = False
    try:
        with progress(found.name, count) as tick, terminable():
            report = regress(
                found,
                this_machine(),
                baseline=baseline,
                baseline_path=path,
                only=given["only"],
                update=given["update_baseline"],
                jobs=given["jobs"],
                finished=state,
                tick=lambda run: tick(),
            )
        _write(report, form, given)
        done = not report.interrupted
    finally:
        if state is not None:
            warn([state.problem] if state.problem else [])
            if state.close(keep=not done):
                print(f"--resume goes on from {state.path}", file=sys.stderr)
    if report.update is not None and report.update.failed:
        raise InputError(report.update.reason)
    return int(report.exit_code)


def _state(given: dict[str, Any]) -> State | None:
    """The state file: as named, else beside the report."""
    path = given["state"]
    if path is None and given["output"] not in (None, "-"):
        path = f"{given['output']}.state"
    if path is None:
        if given["resume"]:
            raise UsageError("--resume needs --state FILE or -o FILE, beside which the state is")
        return None
    if path == "-":
        raise UsageError("--state needs a file")
    from slamcli.batch.regression.state import State

    return State(path, resume=given["resume"])


def _check_folder(path: str | None) -> None:
    """A file that cannot be written is said before the run, which may take long."""
    if path is not None and os.path.isdir(path):
        raise InputError(f"{path}: cannot be written: is a folder")
    if path is None or path == "-" or (os.path.exists(path) and not os.path.isfile(path)):
        return
    folder = os.path.dirname(os.path.realpath(path))
    if not os.path.isdir(folder):
        raise InputError(f"{path}: cannot be written: there is no folder {folder}")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f"{path}: cannot be written: the folder {folder} may not be written to")


def _write(report: RegressionReport, form: str, given: dict[str, Any]) -> None:
    """The report, to where it belongs; to standard output where that fails."""
    from slamcli.formats.source import write_bytes
    from slamcli.reporting.regression import render, table

    text = table.render(report, verbose=given["verbose"], colour=use_color(given["color"], sys.stdout))
    if form == "github":
        _summarize(report)
    if given["output"] in (None, "-"):
        print(text if form == "table" else render(report, form), end="")
        return
    plain = table.render(report, verbose=given["verbose"]) if form == "table" else render(report, form)
    try:
        write_bytes(given["output"], plain.encode())
    except SlamcliError:
        print(plain, end="")
        raise
    print(text, end="")


def _summarize(report: RegressionReport) -> None:
    """The summary of the job, where GitHub asks for one."""
    path = os.environ.get("GITHUB_STEP_SUMMARY")
    if not path:
        return
    from slamcli.reporting.regression import render

    try:
        with open(path, "a", encoding="utf-8") as stream:
            stream.write(render(report, "markdown"))
    except OSError as error:
        warn([f"{path}: cannot be written: {error.strerror}: no summary of the job"])
