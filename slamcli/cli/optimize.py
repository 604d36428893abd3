"""``slamcli optimize``: read, optimize, report, write."""

from __future__ import annotations

import sys
import time
from typing import Any

import click

from slamcli.cli.certificate_options import CERTIFICATE_OPTIONS, certificate_options, check_certificate
from slamcli.cli.covariance import check_covariances, write_covariances
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
from slamcli.cli.robust_options import check_robust, robust_options, write_rejection
from slamcli.cli.solver_options import options_of, solver_options
from slamcli.errors import ExitCode
from slamcli.solver.options import OptimizeOptions

_EXAMPLES = """\b
Examples:
  slamcli optimize graph.g2o -o optimized.g2o
  slamcli optimize graph.g2o --method lm --trace trace.jsonl --json > result.json
  slamcli optimize graph.g2o --certify
  zcat graph.g2o.gz | slamcli optimize - --init spanning-tree -o - | gzip > out.g2o.gz

Every option can be set by an environment variable: SLAMCLI_OPTIMIZE_METHOD=lm.

\b
Exit codes: 0 converged, 1 no certificate (--certify; the result is written), 2 usage,
3 invalid input, 4 not converged (the result is written), 5 numerical failure (nothing
is written), 130 interrupted (the result so far is written).
"""


#: What is no graph; a graph may take the place of the input.
_REPORTS = ("trace", "covariances", "labels_out", "ply")
_OUTPUTS = ("output", "drop_rejected", *_REPORTS)


@click.command(name="optimize", epilog=_EXAMPLES)
@input_options
@click.option("-o", "--output", type=FILE, metavar="FILE", help="Write the optimized graph; - is standard output.")
@solver_options
@robust_options
@certificate_options
@click.option("--config", type=FILE, metavar="FILE", help="YAML file with values for the options above; flags beat it.")
@click.option(
    "--trace", type=FILE, metavar="FILE", help="Write one JSON line for each iteration; - is standard output."
)
@click.option(
    "--covariances", type=FILE, metavar="FILE", help="Write the covariances at the end: npz, csv or json by its name."
)
@click.option("--ply", type=FILE, metavar="FILE", help="Write points and poses at the end as PLY, for MeshLab.")
@click.option("--g2o-log", is_flag=True, help="Print g2o's line for each iteration on standard error.")
@worst_option
@click.option("-v", "--verbose", is_flag=True, help="Print the iterations also where standard error is no terminal.")
@click.option("-q", "--quiet", is_flag=True, help="Print neither iterations nor summary; warnings and errors remain.")
@json_option
@color_option
@click.pass_context
def command(context: click.Context, /, input: str, **given: Any) -> int:
    """Optimize the graph INPUT (g2o, TORO, BAL or Bundler, - is standard input) and report chi2 and sparsity.

    Minimizes chi2, the sum of e^T Omega e over all edges in g2o's definitions (no factor of one half). The summary
    goes to standard output (to standard error where that carries a graph), iterations and warnings to standard error.
    """
    check_outputs(given, _OUTPUTS, json=given["json"], inputs=[given["config"]])
    check_outputs(given, _REPORTS, json=False, inputs=[input])
    given = merge_config(context, given["config"], given, OptimizeOptions.names() + CERTIFICATE_OPTIONS)
    check_certificate(given)
    check_robust(given)
    options = options_of({name: given[name] for name in OptimizeOptions.names()})
    return _optimize(input, options, given)


def _optimize(path: str, options: OptimizeOptions, given: dict[str, Any]) -> int:
    from slamcli.formats import read
    from slamcli.reporting import summaries
    from slamcli.reporting.landmarks import landmark_warnings
    from slamcli.solver.certificate import run

    times: dict[str, float] = {}
    started = time.perf_counter()
    graph = read(path, dialect=given["dialect"], lenient=given["lenient"])
    times["load"] = time.perf_counter() - started
    warn(summaries.reading_warnings(graph.report))
    check_covariances(given["covariances"], graph)
    watcher = _watcher(graph.edges, given)
    with interruptible("iteration") as interrupted:
        outcome = run(
            graph,
            objective=given["objective"],
            certified=given["certify"],
            **({} if given["restart"] else {"restarts": ()}),
            options=options,
            on_iteration=watcher,
            interrupted=interrupted,
        )
    result = outcome.result
    if watcher is not None and not given["g2o_log"]:
        print(file=sys.stderr)  # between the table and the summary
    times["iterate"] = sum(record.time for record in result.trace)
    times["certify"] = outcome.time
    times["setup"] = time.perf_counter() - started - times["load"] - times["iterate"] - times["certify"]
    if result.exit_code == ExitCode.NUMERICAL_FAILURE:
        print(f"error: {result.reason}", *(f"  {line}" for line in result.diagnosis), sep="\n", file=sys.stderr)
    warn(landmark_warnings(result))
    before = time.perf_counter()
    rejection = _rejection(result)
    written = _write_all(graph, result, rejection, given)
    times["write"] = time.perf_counter() - before if given["output"] or given["trace"] else 0.0
    _report(graph, outcome, rejection, times, started, written, given)
    if given["covariances"]:
        write_covariances(result, given["covariances"])
    return int(outcome.exit_code)


def _report(
    graph: Any,
    outcome: Any,
    rejection: Any,
    times: dict[str, float],
    started: float,
    written: str,
    given: dict[str, Any],
) -> None:
    """Print the document or the summary."""
    from slamcli.graph import analyze
    from slamcli.reporting import rejection as rejections
    from slamcli.reporting import reprojection

    topology = analyze(graph)
    worst = _worst(outcome.minimized, given["worst"])
    rejected = _rejected_edges(outcome.result, rejection)
    seen = _reprojections(graph, outcome.result.optimized)
    times["total"] = time.perf_counter() - started
    memory = peak_memory()
    if given["json"]:
        from slamcli.reporting import documents, optimization_documents

        document = optimization_documents.optimize_document(graph, topology, outcome, worst, times, memory)
        document["rejection"] = rejections.rejection_section(rejection, rejected)
        document["reprojection"] = reprojection.reprojection_section(*seen)
        print(documents.dumps(document))
    elif not given["quiet"]:
        from slamcli.reporting import optimization

        out = sys.stderr if "-" in [given[name] for name in _OUTPUTS] else sys.stdout
        colour = use_color(given["color"], out)
        lines = optimization.optimize_summary(graph, topology, outcome, worst, times, memory, written, colour)
        lines += rejections.rejection_lines(rejection, rejected, given["rejected"])
        lines += reprojection.reprojection_lines(*seen)
        print(*lines, sep="\n", file=out)


def _write_all(graph: Any, result: Any, rejection: Any, given: dict[str, Any]) -> str:
    """Write what was asked for but covariances; say what came of the graph."""
    written = _write(result, given)
    if given["trace"]:
        _write_trace(graph, result, given["trace"])
    if given["ply"] and result.exit_code != ExitCode.NUMERICAL_FAILURE:
        from slamcli.formats.ply import write_ply

        write_ply(result.graph, given["ply"])
    if rejection is not None:
        warn(write_rejection(result, rejection, given))
    return written


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
    from slamcli.reporting import documents, optimization_documents

    events = optimization_documents.trace_events(graph, result.options, result)
    write_bytes(path, "".join(documents.dumps(event, indent=None) + "\n" for event in events).encode())


def _rejection(result: Any) -> Any:
    """Which loop closures a robust run rejected; None for other runs and where there is no result."""
    if result.exit_code == ExitCode.NUMERICAL_FAILURE:
        return None
    if result.rejection is None and result.options.kernel != "none":
        from slamcli.solver.robust import rejection

        found = rejection.of_kernel(result.optimized, result.options, result.dof)
        return found if result.held_back is None else result.held_back.expanded(found)
    return result.rejection


def _rejected_edges(result: Any, rejection: Any) -> list[Any]:
    if rejection is None:
        return []
    from slamcli.solver.robust.rejection import rejected_edges

    return rejected_edges(result.graph, rejection)


def _reprojections(before: Any, after: Any) -> tuple[Any, Any]:
    """Statistics of the pixels before and after; None for graphs without cameras."""
    from slamcli.solver.bundle import has_projections

    if not has_projections(before):
        return None, None
    from slamcli.evaluation.reprojection import reprojection

    return reprojection(before), reprojection(after)


def _worst(minimized: Any, count: int) -> list[Any]:
    if count == 0:
        return []
    from slamcli.graph.describe import worst_edges

    return worst_edges(minimized, count)


def _watcher(edges: int, given: dict[str, Any]) -> Any:
    """What prints the iterations."""
    from slamcli.reporting import iterations

    if given["g2o_log"]:
        cumulated = 0.0

        def g2o(start: str, chi2: float, record: Any) -> None:
            nonlocal cumulated
            if record is not None:
                cumulated += record.time
                print(iterations.g2o_line(record, edges, cumulated), file=sys.stderr)

        return g2o
    if given["quiet"] or not (given["verbose"] or sys.stderr.isatty()):
        return None

    def rows(start: str, chi2: float, record: Any) -> None:
        if record is None:
            print(f"start: {start}", file=sys.stderr)
            print(iterations.header(given["method"]), file=sys.stderr)
        print(iterations.line(chi2, record), file=sys.stderr)

    return rows
