"""What ``slamcli optimize`` says for programs: the JSON document and the lines of the trace."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from slamcli.graph import FactorGraph, Topology
from slamcli.reporting import certificate, landmarks
from slamcli.reporting.documents import gauge_section, head, input_section
from slamcli.solver.certificate import CertifiedRun
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.result import Result, StartRecord

if TYPE_CHECKING:
    from slamcli.graph.describe import WorstEdge


def optimize_document(
    source: FactorGraph,
    topology: Topology,
    run: CertifiedRun,
    worst: list[WorstEdge],
    time: dict[str, float],
    memory: float,
) -> dict[str, Any]:
    """The document of ``slamcli optimize --json``."""
    result = run.result
    return {
        **head("optimize"),
        "input": input_section(source, topology.loop_closure_count, topology.component_count),
        "options": asdict(result.options),
        "gauge": gauge_section(result.gauge),
        "start": result.start,
        "starts": [_start_entry(start, result) for start in result.starts],
        "doubt": result.doubt,
        "status": result.status.value,
        "reason": result.reason,
        "diagnosis": list(result.diagnosis),
        "exit_code": int(run.exit_code),
        "iterations": result.iterations,
        "linear_iterations": result.linear_iterations,
        "linear_unfinished": result.unfinished,
        "initial_chi2": result.initial_chi2,
        "final_chi2": result.final_chi2,
        "plain_chi2": result.plain_chi2,
        "kernel_edges": result.kernel_edges,
        "kernel_widths": list(result.kernel_widths),
        **certificate.certificate_section(run),
        "dof": result.dof,
        **landmarks.landmark_section(result),
        "trace": [asdict(record) for record in result.trace],
        "sparsity": None if result.sparsity is None else asdict(result.sparsity),
        "worst": [asdict(edge) for edge in worst],
        "time": time,
        "phases": result.time,
        "peak_memory_mb": memory,
    }


def _start_entry(start: StartRecord, result: Result) -> dict[str, Any]:
    """An entry of ``starts``; the iterations of the run that was taken are the document's own ``trace``."""
    taken = start.words == result.start and start.final_chi2 == result.final_chi2
    return {
        **asdict(start),
        "status": None if start.status is None else start.status.value,
        "taken": taken,
        "iterations": len(start.trace),
        "trace": [] if taken else [asdict(record) for record in start.trace],
    }


def trace_events(source: FactorGraph, options: OptimizeOptions, result: Result) -> Iterable[dict[str, Any]]:
    """The JSON Lines of ``slamcli optimize --trace``: start, iterations, end."""
    path = source.report.path if source.report else None
    start = {"event": "start", "input": path, "options": asdict(options), "chi2": result.initial_chi2}
    yield {**head("optimize"), **start, "start": result.start, "doubt": result.doubt}
    for tried in result.starts:
        yield {"event": "tried", **_start_entry(tried, result)}
    for record in result.trace:
        yield {"event": "iteration", **asdict(record)}
    yield {
        "event": "end",
        "status": result.status.value,
        "reason": result.reason,
        "iterations": result.iterations,
        "final_chi2": result.final_chi2,
    }
