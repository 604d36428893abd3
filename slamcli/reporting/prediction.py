"""``slamcli predict``: its tables and its document."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from slamcli.reporting.documents import head
from slamcli.reporting.text import plural, table

if TYPE_CHECKING:
    from slamcli.filtering.innovation import Prediction

_SIGNS = {
    1: "z - h, reading minus prediction, as g2o's EDGE_BEARING_SE2_XY has it",
    -1: "z - h, reading minus prediction; the residual of g2o's EDGE_SE2_XY has the opposite sign, h - z",
}
_FRAMES = {
    "world": "of the pose along the axes of the world",
    "local": "of the pose along its own axes: ahead, to the left, turn",
}


def prediction_summary(p: Prediction) -> list[str]:
    """What ``slamcli predict`` prints."""
    names, units = p.sensor.kind.components, p.sensor.units
    rows = [
        ("pose", _quantities(("x", "y", "theta"), p.pose, ("m", "m", "rad"))),
        ("landmark", _quantities(("x", "y"), p.landmark, ("m", "m"))),
        ("prediction h", _quantities(names, p.predicted, units)),
    ]
    if p.reading is not None and p.innovation is not None:
        rows += [
            ("reading z", _quantities(names, p.reading, units)),
            ("innovation z - h", _quantities(names, p.innovation, units, sign="+")),
            ("sign", _SIGNS[p.sensor.sign]),
        ]
    return table(rows, "<<") + _jacobian_table(p) + _covariance_table(p)


def prediction_document(p: Prediction) -> dict[str, Any]:
    """The document of ``slamcli predict --json``."""
    return {
        **head("predict"),
        "sensor": p.sensor.name,
        "components": list(p.sensor.kind.components),
        "units": list(p.sensor.units),
        "frame": p.frame,
        "pose": p.pose.tolist(),
        "landmark": p.landmark.tolist(),
        "prediction": p.predicted.tolist(),
        "reading": None if p.reading is None else p.reading.tolist(),
        "innovation": None if p.innovation is None else p.innovation.tolist(),
        "innovation_sign": "z - h",
        "factor": p.sensor.tag,
        "factor_sign": "z - h" if p.sensor.sign > 0 else "h - z",
        "jacobian_pose": p.jacobian_pose.tolist(),
        "jacobian_landmark": p.jacobian_landmark.tolist(),
        "innovation_covariance": None if p.covariance is None else p.covariance.tolist(),
        "nis": p.nis,
        "probability": p.probability,
    }


def _jacobian_table(p: Prediction) -> list[str]:
    rows = [("", "x", "y", "theta", "landmark x", "landmark y")]
    for name, by_pose, by_landmark in zip(p.sensor.kind.components, p.jacobian_pose, p.jacobian_landmark, strict=True):
        rows.append((name, *(_number(value) for value in (*by_pose, *by_landmark))))  # type: ignore[arg-type]
    return ["", f"Jacobians of h, by a step {_FRAMES[p.frame]}, and by the landmark:", *table(rows, "<>>>>>")]


def _covariance_table(p: Prediction) -> list[str]:
    if p.covariance is None:
        return []
    names = p.sensor.kind.components
    deviations = [math.sqrt(p.covariance[k, k]) for k in range(len(names))]
    rows = [("", *names)]
    for name, row, deviation in zip(names, p.covariance, deviations, strict=True):
        # what is only the rounding error of a zero is printed as one
        floors = [1e-14 * deviation * other for other in deviations]
        cells = (_number(value if abs(value) > floor else 0.0) for value, floor in zip(row, floors, strict=True))
        rows.append((name, *cells))
    facts = [("standard deviations", _quantities(names, deviations, p.sensor.units))]
    if p.nis is not None and p.probability is not None:
        freedom = plural(len(names), "degree") + " of freedom"
        facts += [
            ("NIS", f"{p.nis:.6g} (squared Mahalanobis distance, {freedom})"),
            ("probability", f"{p.probability:.4g} that a reading of this landmark has a NIS as large or larger"),
        ]
    elif p.innovation is not None:
        facts.append(("NIS", "undefined: S is singular, so some combination of readings would have no error at all"))
    title = "covariance of the innovation, S = Hx P Hx^T + Hl L Hl^T + Q, in m and rad:"
    return ["", title, *table(rows, "<" + ">" * len(names)), "", *table(facts, "<<")]


def _quantities(names: Sequence[str], values: Sequence[float] | Any, units: Sequence[str], sign: str = "") -> str:
    """Named numbers with their units; angles in radians and degrees."""
    return ", ".join(
        f"{name} {_number(value, sign)} {unit}"
        + (f" ({_number(math.degrees(value), sign)} deg)" if unit == "rad" else "")
        for name, value, unit in zip(names, values, units, strict=True)
    )


def _number(value: float, sign: str = "") -> str:
    return f"{value + 0.0:{sign}.6g}"  # + 0.0: no minus zero
