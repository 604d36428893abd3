"""The summaries that commands print for people."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from slamcli.graph import FactorGraph, ReadingReport
from slamcli.reporting.text import plural, table

if TYPE_CHECKING:
    from slamcli.graph.describe import GraphDescription, WorstEdge

_LISTED = 8


def listed(items: Sequence[int]) -> str:
    """The first few of many."""
    return ", ".join(str(item) for item in items[:_LISTED]) + (", ..." if len(items) > _LISTED else "")


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
    sizes = listed(d.component_sizes)
    report = source.report
    rows = [("graph", counts(source, d.loop_closures, len(d.component_sizes))), *reading_rows(report)]
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


def reading_rows(report: ReadingReport | None) -> list[tuple[str, str]]:
    """What was read and what was skipped."""
    if report is None:
        return []
    rows = [("records", ", ".join(f"{tag} {number}" for tag, number in report.by_tag.items()))]
    if report.skipped or report.malformed:
        parts = [f"{tag} {number}" for tag, number in list(report.skipped.items())[:_LISTED]]
        if report.malformed:
            parts.append(f"{len(report.malformed)} malformed")
        rows.append(("skipped", ", ".join(parts)))
    return rows


def counts(graph: FactorGraph, loop_closures: int, components: int) -> str:
    """Poses, landmarks, edges, components in words."""
    parts = [plural(graph.poses, "pose")]
    if graph.landmarks:
        parts.append(plural(graph.landmarks, "landmark"))
    if graph.switches:
        parts.append(f"{graph.switches} switch" + "es" * (graph.switches != 1))
    parts.append(f"{plural(graph.edges, 'edge')} ({plural(loop_closures, 'loop closure')})")
    parts.append(plural(components, "component"))
    return f"{graph.space}-D, " + ", ".join(parts)


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
