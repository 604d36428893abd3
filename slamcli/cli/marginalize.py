"""``slamcli marginalize``: remove variables and keep what they say about the others."""

from __future__ import annotations

import sys
import time
from typing import Any

import click

from slamcli.cli.options import FILE, check_outputs, input_options, json_option, warn
from slamcli.cli.process import progress

_EXAMPLES = """\b
Examples:
  slamcli optimize graph.g2o -o best.g2o
  slamcli marginalize best.g2o -o keyframes.g2o --keep every:10 --sparsify chow-liu
  slamcli marginalize best.g2o -o poses.g2o --keep poses-only
  slamcli marginalize best.g2o -o less.g2o --remove 17,20-29

\b
RULE is every:N (every Nth pose in the order of the ids; with --keep all landmarks as
well), poses-only, landmarks-only, or ids and ranges of ids such as 0,10,20-29. FIXed
variables are kept unless --remove names their ids.

\b
Exit codes: 0 success, 2 usage (also: a group that joins too many variables), 3
invalid input, 5 numerical failure, 130 interrupted. No graph is written but with 0.
"""


@click.command(name="marginalize", epilog=_EXAMPLES)
@input_options
@click.option("-o", "--output", type=FILE, metavar="FILE", help="Write the reduced graph; - is standard output.")
@click.option("--keep", metavar="RULE", help="What stays.")
@click.option("--remove", metavar="RULE", help="What goes; one of --keep and --remove.")
@click.option(
    "--sparsify",
    type=click.Choice(["none", "chow-liu", "subgraph"]),
    default="none",
    show_default=True,
    help="Write each marginal as all pairs of its variables, as the best tree, or as that and as many edges again.",
)
@click.option(
    "--largest-blanket",
    type=click.IntRange(min=2),
    metavar="N",
    help="Largest number of variables of one marginal. Beyond it, none refuses, and the others remove one variable "
    "after the other.  [default: 80 with none, else 32]",
)
@click.option("-q", "--quiet", is_flag=True, help="Print no summary; warnings and errors remain.")
@json_option
def command(input: str, **given: Any) -> int:
    """Marginalize variables out of the graph INPUT at the values that it holds (optimize it first).

    What the removed variables say about the kept ones, the Schur complement of H, becomes edges between these: exactly
    where files can say it, else with the least Kullback-Leibler divergence, which is told. Kept edges stay as they are.
    """
    check_outputs(given, ("output",), json=given["json"], inputs=[input])
    from slamcli.formats import read, write
    from slamcli.graph import analyze
    from slamcli.reporting import marginalization as report
    from slamcli.reporting import summaries
    from slamcli.reporting.documents import dumps
    from slamcli.solver import marginalization

    started = time.perf_counter()
    graph = read(input, dialect=given["dialect"], lenient=given["lenient"])
    warn(summaries.reading_warnings(graph.report))
    removed, saved = marginalization.removed_by(graph, given["keep"], given["remove"])
    with progress("marginalizing", sum(int(mask.sum()) for mask in removed.values())) as advance:
        reduction = marginalization.marginalize(
            graph,
            removed,
            sparsification=given["sparsify"],
            largest_blanket=given["largest_blanket"],
            on_removed=advance,
        )
    marginalized = time.perf_counter() - started
    comparison = marginalization.compare(graph, reduction)
    warn(report.marginalize_warnings(graph, reduction, comparison, saved))
    marginalization.require_same_optimum(graph, comparison)
    if given["output"]:
        warn([f"not carried over: {loss}" for loss in write(reduction.graph, given["output"])])
    times = {"marginalize": marginalized, "total": time.perf_counter() - started}
    if given["json"]:
        print(dumps(report.marginalize_document(graph, analyze(graph), reduction, comparison, times)))
    elif not given["quiet"]:
        out = sys.stderr if given["output"] == "-" else sys.stdout
        print(
            *report.marginalize_summary(graph, reduction, comparison, given["output"], times),
            sep="\n",
            file=out,
        )
    return 0
