"""What is said of landmarks that were held back, or that could as well be elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from slamcli.reporting.text import plural
from slamcli.solver.result import Result

if TYPE_CHECKING:
    from slamcli.solver.under_observed import UnderObserved

_LISTED = 8


def landmark_rows(result: Result) -> list[tuple[str, str]]:
    """Rows of the summary."""
    rows = []
    if result.under_observed:
        assert result.held_back is not None
        rows.append(held_back_row(result.under_observed, result.held_back.edges))
    if result.ambiguous:
        ids = _listed([str(landmark.id) for landmark in result.ambiguous])
        rows.append(("two places", f"fit {plural(len(result.ambiguous), 'landmark')} alike: {ids}"))
    return rows


def held_back_row(found: Sequence[UnderObserved], edges: int) -> tuple[str, str]:
    """Row of a summary about landmarks that are left out with their edges."""
    ids = _listed([f"{landmark.id} ({landmark.reason})" for landmark in found])
    return "held back", f"{plural(len(found), 'landmark')} with {plural(edges, 'edge')}, under-observed: {ids}"


def held_back_warning(found: Sequence[UnderObserved]) -> list[str]:
    """What standard error says of them, if there are any."""
    if not found:
        return []
    ids = _listed([str(landmark.id) for landmark in found])
    one = len(found) == 1
    what = "1 landmark is" if one else f"{len(found)} landmarks are"
    return [f"{what} not determined by {'its' if one else 'their'} edges and held back: {ids}"]


def landmark_warnings(result: Result) -> list[str]:
    """What standard error says of them."""
    out = held_back_warning(result.under_observed)
    if lost := [landmark for landmark in result.under_observed if not landmark.has_value]:
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
