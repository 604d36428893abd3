"""What ``slamcli optimize`` says of landmarks that were held back, or that could as well be elsewhere."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from slamcli.reporting.text import plural
from slamcli.solver.result import Result

_LISTED = 8


def landmark_rows(result: Result) -> list[tuple[str, str]]:
    """Rows of the summary."""
    rows = []
    if found := result.under_observed:
        edges = plural(sum(landmark.edges for landmark in found), "edge")
        ids = _listed([f"{landmark.id} ({landmark.reason})" for landmark in found])
        rows.append(("held back", f"{plural(len(found), 'landmark')} with {edges}, under-observed: {ids}"))
    if result.ambiguous:
        ids = _listed([str(landmark.id) for landmark in result.ambiguous])
        rows.append(("two places", f"fit {plural(len(result.ambiguous), 'landmark')} alike: {ids}"))
    return rows


def landmark_warnings(result: Result) -> list[str]:
    """What standard error says of them."""
    out = []
    if found := result.under_observed:
        ids = _listed([str(landmark.id) for landmark in found])
        one = len(found) == 1
        what = "1 landmark is" if one else f"{len(found)} landmarks are"
        out.append(f"{what} not determined by {'its' if one else 'their'} edges and held back: {ids}")
        lost = [landmark for landmark in found if not landmark.has_value]
        if lost:
            ids = _listed([str(landmark.id) for landmark in lost])
            out.append(f"no value is written for {plural(len(lost), 'landmark')} that had none: {ids}")
    if result.ambiguous:
        ids = _listed([str(landmark.id) for landmark in result.ambiguous])
        out.append(
            f"{plural(len(result.ambiguous), 'landmark')} could as well be elsewhere, their edges do not tell: {ids}"
        )
    return out


def landmark_section(result: Result) -> dict[str, Any]:
    """Keys of the document."""
    return {
        "under_observed": [asdict(landmark) for landmark in result.under_observed],
        "ambiguous": [asdict(landmark) for landmark in result.ambiguous],
    }


def _listed(items: list[str]) -> str:
    return ", ".join(items[:_LISTED]) + (", ..." if len(items) > _LISTED else "")
