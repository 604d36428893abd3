"""What ``slamcli optimize`` prints for people at its end."""

from __future__ import annotations

from typing import TYPE_CHECKING

from slamcli.graph import FactorGraph, Topology
from slamcli.reporting import certificate, landmarks
from slamcli.reporting.summaries import counts, listed, reading_rows, worst_table
from slamcli.reporting.text import coloured, count, plural, seconds, table
from slamcli.solver.certificate import CertifiedRun
from slamcli.solver.result import Result, Status
from slamcli.solver.symbolic import Sparsity

if TYPE_CHECKING:
    from slamcli.graph.describe import WorstEdge

_STATUS_COLOUR = {
    Status.CONVERGED: "green",
    Status.NOT_CONVERGED: "yellow",
    Status.INTERRUPTED: "yellow",
    Status.FAILED: "red",
}
_PHASES = ("order", "analyze", "linearize", "assemble", "factorize", "solve")


def optimize_summary(
    source: FactorGraph,
    topology: Topology,
    run: CertifiedRun,
    worst: list[WorstEdge],
    time: dict[str, float],
    memory: float,
    written: str,
    colour: bool,
) -> list[str]:
    """What ``slamcli optimize`` prints at the end."""
    result = run.result
    held = result.gauge.held
    ids = listed(held)
    status = coloured(result.status.value.replace("_", " "), _STATUS_COLOUR[result.status], colour)
    rows = [
        ("graph", counts(source, topology.loop_closure_count, topology.component_count)),
        *reading_rows(source.report),
        ("gauge", f"{result.gauge.reason}: {ids}" if held else result.gauge.reason),
        ("start", _start(result)),
        *_doubt_rows(result),
        *landmarks.landmark_rows(result),
        ("status", f"{status}: {result.reason}"),
        *certificate.objective_rows(run),
        *_chi2_rows(result, "chi2" if run.objective == "g2o" else "cost"),
    ]
    if result.dof > 0 and result.options.kernel == "none":
        rows.append((f"{rows[-1][0]}/dof", f"{result.final_chi2 / result.dof:.6g} ({result.dof} degrees of freedom)"))
    if result.sparsity is not None:
        rows += _sparsity_rows(result, result.sparsity)
    rows += [
        *certificate.certificate_rows(run, colour),
        ("written", written),
        ("time", f"{seconds(time['total'])}: {_listed_times(time, ('load', 'setup', 'iterate', 'certify', 'write'))}"),
        ("phases", _listed_times(result.time, _PHASES)),
        ("memory", f"{memory:.0f} MB at the peak"),
    ]
    return table(rows, "<<") + worst_table(worst)


def _chi2_rows(result: Result, name: str) -> list[tuple[str, str]]:
    """What was minimized and, where a kernel makes a difference, chi2 as well."""
    text = f"{result.initial_chi2:.6f} -> {result.final_chi2:.6f} in {plural(result.iterations, 'iteration')}"
    options = result.options
    if options.kernel == "none":
        return [(name, text)]
    where = "loop closures" if options.kernel_on == "closures" else "all edges"
    edges = plural(result.kernel_edges, "edge")
    widths = ", ".join(f"{width:.6g}" for width in result.kernel_widths)
    return [
        ("kernel", f"{options.kernel} of width {widths or '-'} on {where}: {edges} of {result.graph.edges}"),
        ("cost", text),
        ("chi2", f"{result.plain_chi2:.6f} at the end, over all edges as they are"),
    ]


def _start(result: Result) -> str:
    """Where the run started, with chi2 of all starts where there was a choice."""
    if len(result.starts) < 2:
        return result.start
    costs = ", ".join(f"{start.name} {start.initial_chi2:.6g}" for start in result.starts)
    return f"{result.start} (chi2 of the starts: {costs})"


def _doubt_rows(result: Result) -> list[tuple[str, str]]:
    """Why there was more than one run, and what each came to."""
    if result.doubt is None:
        return []
    runs = [
        f"{start.name} {start.final_chi2:.6f} after {plural(len(start.trace), 'iteration')}"
        for start in result.starts
        if start.final_chi2 is not None
    ]
    rows = [("in doubt", f"of the first run: {result.doubt}")]
    return [*rows, ("", "ended at: " + ", ".join(runs) if len(runs) > 1 else "no other start is worth a run")]


def _listed_times(times: dict[str, float], names: tuple[str, ...]) -> str:
    return ", ".join(f"{name} {seconds(times[name])}" for name in names if times.get(name))


def _sparsity_rows(result: Result, sparsity: Sparsity) -> list[tuple[str, str]]:
    rows = [
        (
            "hessian",
            f"{sparsity.dimension} x {sparsity.dimension}, {sparsity.nnz_hessian} nonzeros in the triangle, "
            f"density {sparsity.density:.3%}",
        ),
    ]
    if (reduced := sparsity.reduced) is not None:
        how = _iterated(result) if reduced.nnz is None else f"factorized as a {reduced.solver} matrix"
        entries = "never formed" if reduced.nnz is None else f"{reduced.nnz} nonzeros in the triangle"
        size = f"{reduced.dimension} x {reduced.dimension} without {reduced.eliminated}"
        rows.append(("reduced", f"{size}, {entries}, {how}"))
    if sparsity.nnz_factor is not None and sparsity.factor_flops is not None:
        rows.append(
            (
                "factor",
                f"{sparsity.nnz_factor} nonzeros, fill-in {sparsity.fill_in:.2f}, "
                f"{count(sparsity.factor_flops, 'flop')}, ordering {sparsity.ordering}",
            )
        )
    return rows


def _iterated(result: Result) -> str:
    """How far conjugate gradients came."""
    text = f"solved by conjugate gradients: {plural(result.linear_iterations or 0, 'iteration')} in all"
    return f"{text}, {plural(result.unfinished, 'solution')} left unfinished" if result.unfinished else text
