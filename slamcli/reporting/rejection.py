"""The loop closures that a robust run rejected, in summaries and documents."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from slamcli.reporting.text import plural, table

if TYPE_CHECKING:
    from slamcli.solver.robust.rejection import RejectedEdge, Rejection


def rejection_rows(rejection: Rejection) -> list[tuple[str, str]]:
    """Rows of the summary: what was rejected, under which noise, and the fit of the rest."""
    share = f" ({rejection.count / rejection.closures:.1%})" if rejection.closures else ""
    closures = plural(rejection.closures, "loop closure")
    rows = [("rejected", f"{rejection.count} of {closures}{share} by {rejection.method}")]
    if rejection.noise_scale is not None:
        rows.append(("noise", f"{rejection.noise_scale:.4g} times the stated one (standard deviation)"))
    fit = (
        f", {rejection.inlier_chi2 / rejection.inlier_dof:.6g} per degree of freedom"
        if rejection.inlier_dof > 0
        else ""
    )
    rows.append(("kept", f"chi2 {rejection.inlier_chi2:.6f} of what is not rejected{fit}"))
    return rows


def rejection_lines(rejection: Rejection | None, edges: list[RejectedEdge], limit: int) -> list[str]:
    """What the summary of a robust run ends with."""
    if rejection is None:
        return []
    return ["", *table(rejection_rows(rejection), "<<"), *rejected_table(edges, limit)]


def rejected_table(edges: list[RejectedEdge], limit: int) -> list[str]:
    """The first rejected closures; how many more there are is said."""
    if not edges or limit == 0:
        return []
    rows = [("chi2", "weight", "line", "edge")]
    rows += [
        (f"{e.chi2:.6g}", f"{e.weight:.3g}", str(e.line or "-"), f"{e.tag} {' '.join(str(i) for i in e.ids)}")
        for e in edges[:limit]
    ]
    more = len(edges) - limit
    tail = [f"... and {more} more; --rejected {len(edges)} lists all"] if more > 0 else []
    return ["", "rejected loop closures:", *table(rows, ">>><"), *tail]


def rejection_section(rejection: Rejection | None, edges: list[RejectedEdge]) -> dict[str, Any] | None:
    """The key ``rejection`` of the document, with all rejected closures."""
    if rejection is None:
        return None
    return {
        "method": rejection.method,
        "closures": rejection.closures,
        "rejected": rejection.count,
        "probability": rejection.probability,
        "noise_scale": rejection.noise_scale,
        "inlier_chi2": rejection.inlier_chi2,
        "inlier_dof": rejection.inlier_dof,
        "edges": [asdict(edge) for edge in edges],
    }
