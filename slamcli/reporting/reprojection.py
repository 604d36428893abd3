"""Reprojection errors before and after, as text and as a section of JSON."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from slamcli.reporting.text import table

if TYPE_CHECKING:
    from slamcli.evaluation.reprojection import Reprojection

_WORST = 3


def reprojection_lines(
    before: Reprojection | None, after: Reprojection | None, names: tuple[str, str] = ("before", "after")
) -> list[str]:
    """A table of the errors in pixels, and the cameras with the largest; nothing for a graph without cameras."""
    if before is None or after is None:
        return []
    rows: list[tuple[str, ...]] = [("reprojection, pixels", "rms", "mean", "median", "largest", "behind")]
    for name, one in zip(names, (before, after), strict=True):
        numbers = (one.rms, one.mean, one.median, one.largest)
        rows.append((name, *(f"{number:.4g}" for number in numbers), str(one.behind)))
    worst = np.argsort(-np.nan_to_num(after.camera_rms, nan=np.inf), kind="stable")[:_WORST].tolist()
    start = dict(zip(before.cameras.tolist(), before.camera_rms.tolist(), strict=True))
    named = [f"{after.cameras[k]}: {start[int(after.cameras[k])]:.4g} -> {after.camera_rms[k]:.4g}" for k in worst]
    out = ["", *table(rows, "<>>>>>"), f"cameras with the largest rms  {', '.join(named)}"]
    if after.behind:
        share = f"{after.behind} of {int(after.camera_observations.sum())}"
        out.append(
            f"{share} observations are of points behind their camera, where no camera sees: their images are mirrored"
        )
    return out


def reprojection_section(before: Reprojection | None, after: Reprojection | None) -> dict[str, Any] | None:
    """The same for JSON, with all cameras; None for a graph without cameras."""
    if before is None or after is None:
        return None
    return {"before": _section(before), "after": _section(after)}


def _section(one: Reprojection) -> dict[str, Any]:
    overall = {name: _number(getattr(one, name)) for name in ("sigma", "rms", "mean", "median", "largest")}
    cameras = [
        {"id": i, "observations": n, "behind": b, "rms": _number(rms), "largest": _number(largest)}
        for i, n, b, rms, largest in zip(
            one.cameras.tolist(),
            one.camera_observations.tolist(),
            one.camera_behind.tolist(),
            one.camera_rms.tolist(),
            one.camera_largest.tolist(),
            strict=True,
        )
    ]
    return {"observations": one.observations, "behind": one.behind, **overall, "cameras": cameras}


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
