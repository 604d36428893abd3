"""The summaries that commands print for people."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from slamcli.graph import FactorGraph, ReadingReport, Topology
from slamcli.reporting.text import coloured, count, plural, seconds, table
from slamcli.solver.result import Result, Status
from slamcli.solver.symbolic import Sparsity

if TYPE_CHECKING:
    from slamcli.graph.describe import GraphDescription, WorstEdge

_STATUS_COLOUR = {
    Status.CONVERGED: "green",
    Status.NOT_CONVERGED: "yellow",
    Status.INTERRUPTED: "yellow",
    Status.FAILED: "red",
}
_PHASES = ("order", "analyze", "linearize", "assemble", "factorize", "solve")
_LISTED = 8


def optimize_summary(
    source: FactorGraph,
    topology: Topology,
    result: Result,
    worst: list[WorstEdge],
    time: dict[str, float],
    memory: float,
    written: str,
    colour: bool,
) -> list[str]:
    """What ``slamcli optimize`` prints at the end."""
    held = result.gauge.held
    ids = _listed(held)
    status = coloured(result.status.value.replace("_", " "), _STATUS_COLOUR[result.status], colour)
    rows = [
        ("graph", _counts(source, topology.loop_closure_count, topology.component_count)),
        *_reading_rows(source.report),
        ("gauge", f"{result.gauge.reason}: {ids}" if held else result.gauge.reason),
        ("start", result.start),
        ("status", f"{status}: {result.reason}"),
        ("chi2", f"{result.initial_chi2:.6f} -> {result.final_chi2:.6f} in {plural(result.iterations, 'iteration')}"),
    ]
    if result.dof > 0:
        rows.append(("chi2/dof", f"{result.final_chi2 / result.dof:.6g} ({result.dof} degrees of freedom)"))
    if result.sparsity is not None:
        rows += _sparsity_rows(result.sparsity)
    rows += [
        ("written", written),
        ("time", f"{seconds(time['total'])}: {_listed_times(time, ('load', 'setup', 'iterate', 'write'))}"),
        ("phases", _listed_times(result.time, _PHASES)),
        ("memory", f"{memory:.0f} MB at the peak"),
    ]
    return table(rows, "<<") + worst_table(worst)


def _listed(items: Sequence[int]) -> str:
    """The first few of many."""
    return ", ".join(str(item) for item in items[:_LISTED]) + (", ..." if len(items) > _LISTED else "")


def _listed_times(times: dict[str, float], names: tuple[str, ...]) -> str:
    return ", ".join(f"{name} {seconds(times[name])}" for name in names if times.get(name))


def worst_table(worst: list[WorstEdge]) -> list[str]:
    """The edges with the largest chi2."""
    if not worst:
        return []
    rows = [("chi2", "line", "edge", "residual")]
    rows += [
        (
            f"{edge.chi2:.6g}",
            str(edge.line or "-"),
            f"{edge.tag} {' '.join(str(i) for i in edge.ids)}",
            " ".join(f"{value:.3g}" for value in edge.residual),
        )
        for edge in worst
    ]
    return ["", f"the {plural(len(worst), 'edge')} with the largest chi2:", *table(rows, ">><<")]


def info_summary(source: FactorGraph, description: GraphDescription) -> list[str]:
    """What ``slamcli info`` prints."""
    d = description
    sizes = _listed(d.component_sizes)
    report = source.report
    rows = [("graph", _counts(source, d.loop_closures, len(d.component_sizes))), *_reading_rows(report)]
    if report is not None:
        text = f"{report.format}, {plural(report.lines, 'line')}, {report.comments} of comments, {report.blank} blank"
        rows.insert(1, ("file", text))
    if source.document is not None:
        rows.insert(2, ("sha256", source.document.sha256))
    rows += [
        ("dimension", f"{d.dimension} unknowns, {d.residuals} residuals"),
        ("components", f"{len(d.component_sizes)} of {sizes} variables; {d.isolated} isolated"),
        ("degrees", f"{d.degree_min} to {d.degree_max}, mean {d.degree_mean:.2f}"),
        ("edges", f"{d.loop_closures} loop closures, {d.parallel_edges} parallel, {d.self_edges} to themselves"),
    ]
    if d.path_length is not None:
        rows.append(("path", f"{d.path_length:.6g} m along the poses in the order of their ids"))
    if d.bounding_box is not None:
        box = ", ".join(
            f"{axis} {low:.6g} to {high:.6g}" for axis, (low, high) in zip("xyz", d.bounding_box, strict=False)
        )
        rows.append(("extent", f"{box} (metres)"))
    rows.append(
        ("chi2", "unknown: not every variable has an estimate" if d.chi2 is None else f"{d.chi2:.6f} at these values")
    )
    return table(rows, "<<") + _variable_table(d) + _factor_table(d)


def reading_warnings(report: ReadingReport | None) -> list[str]:
    """What a reader skipped or assumed: for standard error."""
    if report is None:
        return []
    out = [
        f"{plural(number, f'{tag} record')} skipped: {report.reasons.get(tag, 'unknown tag')}"
        for tag, number in list(report.skipped.items())[:_LISTED]
    ]
    if len(report.skipped) > _LISTED:
        out.append(f"... and records of {len(report.skipped) - _LISTED} more unknown tags skipped")
    out += [f"skipped: {message}" for message in report.malformed[:_LISTED]]
    if len(report.malformed) > _LISTED:
        out.append(f"... and {len(report.malformed) - _LISTED} more malformed records skipped")
    out += [f"vertices that only edges name: {len(ids)} {kind}" for kind, ids in report.created.items()]
    return out + report.notes


def _reading_rows(report: ReadingReport | None) -> list[tuple[str, str]]:
    if report is None:
        return []
    rows = [("records", ", ".join(f"{tag} {number}" for tag, number in report.by_tag.items()))]
    if report.skipped or report.malformed:
        parts = [f"{tag} {number}" for tag, number in list(report.skipped.items())[:_LISTED]]
        if report.malformed:
            parts.append(f"{len(report.malformed)} malformed")
        rows.append(("skipped", ", ".join(parts)))
    return rows


def _counts(graph: FactorGraph, loop_closures: int, components: int) -> str:
    parts = [plural(graph.poses, "pose")]
    if graph.landmarks:
        parts.append(plural(graph.landmarks, "landmark"))
    parts.append(f"{plural(graph.edges, 'edge')} ({plural(loop_closures, 'loop closure')})")
    parts.append(plural(components, "component"))
    return f"{graph.space}-D, " + ", ".join(parts)


def _sparsity_rows(sparsity: Sparsity) -> list[tuple[str, str]]:
    return [
        (
            "hessian",
            f"{sparsity.dimension} x {sparsity.dimension}, {sparsity.nnz_hessian} nonzeros in the triangle, "
            f"density {sparsity.density:.3%}",
        ),
        (
            "factor",
            f"{sparsity.nnz_factor} nonzeros, fill-in {sparsity.fill_in:.2f}, {count(sparsity.factor_flops, 'flop')}, "
            f"ordering {sparsity.ordering}",
        ),
    ]


def _variable_table(description: GraphDescription) -> list[str]:
    rows = [("variables", "count", "ids", "", "fixed", "no estimate")]
    rows += [
        (
            v.kind,
            str(v.count),
            f"{v.lowest_id} to {v.highest_id}",
            "" if v.consecutive_ids else "with gaps",
            str(v.fixed),
            str(v.without_estimate),
        )
        for v in description.variables
    ]
    return ["", *table(rows, "<><<>>")]


def _factor_table(description: GraphDescription) -> list[str]:
    if not description.factors:
        return []
    rows = [("edges", "count", "closures", "chi2", "information eigenvalues", "indefinite")]
    rows += [
        (
            f.tag,
            str(f.count),
            str(f.loop_closures),
            "-" if f.chi2 is None else f"{f.chi2:.6f}",
            f"{f.smallest_eigenvalue:.4g} to {f.largest_eigenvalue:.4g}",
            str(f.indefinite),
        )
        for f in description.factors
    ]
    return ["", *table(rows, "<>>><>")]
