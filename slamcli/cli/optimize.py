"""``slamcli optimize``: read, optimize, report, write."""

from __future__ import annotations

import sys
import time
from typing import Any

import click

from slamcli.cli.options import (
    FILE,
    check_outputs,
    color_option,
    input_options,
    json_option,
    merge_config,
    use_color,
    warn,
    worst_option,
)
from slamcli.cli.process import interruptible, peak_memory
from slamcli.cli.solver_options import options_of, solver_options
from slamcli.errors import ExitCode
from slamcli.solver.options import OptimizeOptions

_EXAMPLES = """\b
Examples:
  slamcli optimize graph.g2o -o optimized.g2o
  slamcli optimize graph.g2o --method lm --trace trace.jsonl --json > result.json
  zcat graph.g2o.gz | slamcli optimize - --init spanning-tree -o - | gzip > out.g2o.gz

Every option can be set by an environment variable: SLAMCLI_OPTIMIZE_METHOD=lm.

\b
Exit codes: 0 converged, 2 usage, 3 invalid input, 4 not converged (the result is
written), 5 numerical failure (nothing is written), 130 interrupted (the result so far
is written).
"""


@click.command(name="optimize", epilog=_EXAMPLES)
@input_options
@click.option("-o", "--output", type=FILE, metavar="FILE", help="Write the optimized graph; - is standard output.")
@solver_options
@click.option("--config", type=FILE, metavar="FILE", help="YAML file with values for the options above; flags beat it.")
@click.option(
    "--trace", type=FILE, metavar="FILE", help="Write one JSON line for each iteration; - is standard output."
)
@click.option("--g2o-log", is_flag=True, help="Print g2o's line for each iteration on standard error.")
@worst_option
@click.option("-v", "--verbose", is_flag=True, help="Print the iterations also where standard error is no terminal.")
@click.option("-q", "--quiet", is_flag=True, help="Print neither iterations nor summary; warnings and errors remain.")
@json_option
@color_option
@click.pass_context
def command(context: click.Context, /, input: str, **given: Any) -> int:
    """Optimize the graph INPUT (g2o or TORO, - is standard input) and report chi2 and sparsity.

    Minimizes chi2, the sum of e^T Omega e over all edges in g2o's definitions (no factor of one half). The summary
    goes to standard output (to standard error where that carries a graph), iterations and warnings to standard error.
    """
    check_outputs(given, ("output", "trace"), json=given["json"])
    given = merge_config(context, given["config"], given, OptimizeOptions.names())
    options = options_of({name: given[name] for name in OptimizeOptions.names()})
    return _optimize(input, options, given)


def _optimize(path: str, options: OptimizeOptions, given: dict[str, Any]) -> int:
    from slamcli.formats import read
    from slamcli.graph import analyze
    from slamcli.reporting import summaries
    from slamcli.solver.optimize import optimize

    times: dict[str, float] = {}
    started = time.perf_counter()
    graph = read(path, dialect=given["dialect"], lenient=given["lenient"])
    times["load"] = time.perf_counter() - started
    warn(summaries.reading_warnings(graph.report))
    watcher = _watcher(graph.edges, given)
    with interruptible("iteration") as interrupted:
        result = optimize(graph, options=options, on_iteration=watcher, interrupted=interrupted)
    if watcher is not None and not given["g2o_log"]:
        print(file=sys.stderr)  # between the table and the summary
    times["iterate"] = sum(record.time for record in result.trace)
    times["setup"] = time.perf_counter() - started - times["load"] - times["iterate"]
    failed = result.exit_code == ExitCode.NUMERICAL_FAILURE
    if failed:
        print(f"error: {result.reason}", *(f"  {line}" for line in result.diagnosis), sep="\n", file=sys.stderr)
    before = time.perf_counter()
    written = _write(result, given)
    if given["trace"]:
        _write_trace(graph, result, given["trace"])
    times["write"] = time.perf_counter() - before if given["output"] or given["trace"] else 0.0
    topology = analyze(graph)
    worst = _worst(result, given["worst"])
    times["total"] = time.perf_counter() - started
    memory = peak_memory()
    if given["json"]:
        from slamcli.reporting import documents

        document = documents.optimize_document(graph, topology, result, worst, times, memory)
        print(documents.dumps(document))
    elif not given["quiet"]:
        out = sys.stderr if "-" in (given["output"], given["trace"]) else sys.stdout
        colour = use_color(given["color"], out)
        lines = summaries.optimize_summary(graph, topology, result, worst, times, memory, written, colour)
        print(*lines, sep="\n", file=out)
    return int(result.exit_code)


def _write(result: Any, given: dict[str, Any]) -> str:
    """Write the optimized graph if that was asked for and there is one; say what came of it."""
    from slamcli.formats import write
    from slamcli.formats.recognize import of_ending

    output = given["output"]
    if not output:
        return "nothing (-o FILE keeps the optimized graph)"
    if result.exit_code == ExitCode.NUMERICAL_FAILURE:
        print(f"  nothing is written to {output}", file=sys.stderr)
        return "nothing"
    losses = write(result.graph, output)
    own = result.graph.report.format
    if of_ending(output) not in (None, own):
        losses.append(f"{output} holds {own}, the format of the input: slamcli convert changes it")
    warn(losses)
    return "standard output" if output == "-" else str(output)


def _write_trace(graph: Any, result: Any, path: str) -> None:
    from slamcli.formats.source import write_bytes
    from slamcli.reporting import documents

    events = documents.trace_events(graph, result.options, result)
    write_bytes(path, "".join(documents.dumps(event, indent=None) + "\n" for event in events).encode())


def _worst(result: Any, count: int) -> list[Any]:
    if count == 0:
        return []
    from slamcli.graph.describe import worst_edges

    return worst_edges(result.graph, count)


def _watcher(edges: int, given: dict[str, Any]) -> Any:
    """What prints the iterations."""
    from slamcli.reporting import iterations

    if given["g2o_log"]:
        cumulated = 0.0

        def g2o(chi2: float, record: Any) -> None:
            nonlocal cumulated
            if record is not None:
                cumulated += record.time
                print(iterations.g2o_line(record, edges, cumulated), file=sys.stderr)

        return g2o
    if given["quiet"] or not (given["verbose"] or sys.stderr.isatty()):
        return None

    def rows(chi2: float, record: Any) -> None:
        if record is None:
            print(iterations.header(given["method"]), file=sys.stderr)
        print(iterations.line(chi2, record), file=sys.stderr)

    return rows
