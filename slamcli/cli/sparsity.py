"""``slamcli sparsity``: elimination orders beside each other."""

from __future__ import annotations

import math
import sys
import time
from typing import Any

import click

from slamcli.cli.options import FILE, check_outputs, input_options, json_option, warn
from slamcli.errors import UsageError

_EXAMPLES = """\b
Examples:
  slamcli sparsity graph.g2o
  slamcli sparsity graph.g2o --orderings natural,amd --spy spy.png
  slamcli sparsity graph.g2o --orderings amd --add-closure 3,420 --spy closure.svg
  slamcli sparsity graph.g2o --marginalize 17 --json | jq .changed
  slamcli sparsity graph.g2o --tree tree.png --time-limit 0

\b
Exit codes: 0 success, 2 usage, 3 invalid input; pictures are written when all of
them are drawn.
"""


@click.command(name="sparsity", epilog=_EXAMPLES)
@input_options
@click.option(
    "--orderings",
    default="all",
    show_default=True,
    metavar="LIST",
    help="Elimination orders with commas: natural, rcm, amd, colamd, metis, amd-landmarks-first, amd-last-pose-last, "
    "auto; or all.",
)
@click.option(
    "--time-limit",
    type=click.FloatRange(min=0.0),
    default=10.0,
    show_default=True,
    metavar="S",
    help="Leave out factorizations that are predicted to take longer; 0 measures none.",
)
@click.option("--fix", type=int, multiple=True, metavar="ID", help="Hold this variable; may be given several times.")
@click.option(
    "--add-closure",
    "add_closure",
    multiple=True,
    metavar="I,J",
    help="Show which blocks a loop closure between two variables would add; may be given several times.",
)
@click.option(
    "--marginalize",
    type=int,
    multiple=True,
    metavar="ID",
    help="Show which blocks appear when this variable is marginalized out; may be given several times.",
)
@click.option("--spy", type=FILE, metavar="FIG", help="Draw H and L under each order: .png, .svg or .pdf.")
@click.option("--tree", type=FILE, metavar="FIG", help="Draw the elimination tree under each order.")
@click.option("--title", metavar="TEXT", help="Title of the figures; an empty one for none.")
@click.option(
    "--dpi",
    type=click.IntRange(min=20, max=600),
    default=150,
    show_default=True,
    help="Pixels per inch of the figures.",
)
@json_option
def command(input: str, **given: Any) -> int:
    """Compare elimination orders of the graph INPUT: fill-in, flops, trees, time, pictures.

    Only the structure of the graph counts, no values. Heights are in block columns, fronts in scalar rows. The
    measured times are CHOLMOD's on a matrix with the pattern of H.
    """
    check_outputs(given, ("spy", "tree"), json=given["json"], inputs=[input])
    if math.isnan(given["time_limit"]):  # which no range excludes
        raise UsageError("--time-limit must be a number of seconds, got nan")
    closures = [_pair(text) for text in given["add_closure"]]
    formats = _formats(given)
    from slamcli.cli.process import progress
    from slamcli.formats import read
    from slamcli.graph import analyze
    from slamcli.reporting import documents, summaries
    from slamcli.reporting import sparsity as reporting
    from slamcli.solver.ordering.comparison import compare, names_of

    names, _ = names_of(given["orderings"])
    times: dict[str, float] = {}
    started = time.perf_counter()
    graph = read(input, dialect=given["dialect"], lenient=given["lenient"])
    times["load"] = time.perf_counter() - started
    warn(summaries.reading_warnings(graph.report))
    graph = graph.with_fixed(given["fix"])
    with progress("ordering", len(names)) as tick:
        comparison = compare(
            graph,
            given["orderings"],
            time_limit=given["time_limit"],
            closures=closures,
            marginalized=given["marginalize"],
            tick=tick,
        )
    times["compare"] = time.perf_counter() - started - times["load"]
    files = _draw(comparison, formats, given)
    if files:
        times["draw"] = time.perf_counter() - started - times["load"] - times["compare"]
    topology = analyze(graph)
    if given["json"]:
        print(documents.dumps(reporting.sparsity_document(graph, topology, comparison, files, times)))
    else:
        out = sys.stderr if "-" in files.values() else sys.stdout
        print(*reporting.sparsity_summary(graph, topology, comparison, files), sep="\n", file=out)
    return 0


def _formats(given: dict[str, Any]) -> dict[str, str]:
    """Format of each figure that was asked for."""
    wanted = {name: given[name] for name in ("spy", "tree") if given[name]}
    if not wanted:
        return {}
    from slamcli.reporting.plots.files import format_of

    return {name: format_of(path, f"--{name}") for name, path in wanted.items()}


def _draw(comparison: Any, formats: dict[str, str], given: dict[str, Any]) -> dict[str, str]:
    """Draw and write the figures; say what went where."""
    if not formats:
        return {}
    from slamcli.formats.source import write_bytes
    from slamcli.reporting.plots.elimination_trees import draw_trees
    from slamcli.reporting.plots.files import render
    from slamcli.reporting.plots.spy import draw_spy
    from slamcli.reporting.plots.style import FigureOptions, house_style

    options = FigureOptions(title=given["title"], dpi=given["dpi"])
    drawn: dict[str, bytes] = {}
    for name, kind in formats.items():
        with house_style():
            figure = {"spy": draw_spy, "tree": draw_trees}[name](comparison, options)
            drawn[name], notes = render(figure, kind, given["dpi"])
        warn(notes)
    for name, data in drawn.items():
        write_bytes(given[name], data)
    return {name: given[name] for name in formats}


def _pair(text: str) -> tuple[int, int]:
    parts = text.split(",")
    try:
        low, high = (int(part) for part in parts)
    except ValueError:
        raise UsageError(f"--add-closure {text!r}: expected two ids, I,J") from None
    if low == high:
        raise UsageError(f"--add-closure {text!r}: a loop closure joins two variables")
    return low, high
