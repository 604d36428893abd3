"""What ``slamcli evaluate`` prints and writes: text, JSON, and the CSV of errors by pose."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

import numpy as np

from slamcli.evaluation.alignment import Alignment
from slamcli.evaluation.errors import Statistics
from slamcli.evaluation.result import EstimateResult, Evaluation, RelativeErrors
from slamcli.reporting.documents import head
from slamcli.reporting.text import coloured, plural, table

CSV_COLUMNS = (
    "estimate",
    "id",
    "time_s",
    "distance_m",
    "x_m",
    "y_m",
    "z_m",
    "translation_error_m",
    "rotation_error_deg",
)
_STATISTICS = ("rmse", "mean", "median", "std", "min", "max")
_UNITS = {"translation": "m", "rotation": "deg", "full": "-"}
_ALIGNMENTS = {
    "none": "none: the files as they are",
    "origin": "origin: the first matched poses coincide",
    "se": "se: rotation and translation that fit the positions best (Umeyama)",
    "sim": "sim: rotation, translation and scale that fit the positions best (Umeyama)",
}

# -- text --------------------------------------------------------------------------------------------------------------


def evaluation_summary(evaluation: Evaluation, colour: bool) -> list[str]:
    """The summary for people: facts with one column for each estimate, then the statistics."""
    results = evaluation.estimates
    truth = evaluation.truth
    opening = []
    if truth is not None:
        opening = [
            ("truth", f"{truth.source}: {plural(len(truth), 'pose')}, {truth.length:.6g} m"),
            ("alignment", _ALIGNMENTS[evaluation.options.align]),
        ]
    lines = table(opening, "<<") if opening else []
    names = ["", *(coloured(name, "bold", colour) for name in _headings([result.name for result in results]))]
    facts = [_fact_cells(label, function, results) for label, function in _FACTS]
    rows = [names, *(row for row in facts if any(row[1:]))]
    lines += [""] * bool(lines) + table(rows, "<" + ("<" if len(results) == 1 else ">") * len(results))
    blocks = _blocks(results)
    if blocks:
        lines += ["", *(_wide(blocks) if len(results) == 1 else _side_by_side(blocks, names))]
    return lines


def _headings(names: list[str]) -> list[str]:
    """Names without their folders, where there are several and that keeps them apart."""
    short = [name.replace(path, os.path.basename(path)) for name in names for path in name.split()[-1:]]
    return short if len(names) > 1 and len(set(short)) == len(names) else names


def _fact_cells(label: str, function: Any, results: list[EstimateResult]) -> list[str]:
    return [label, *(function(result) for result in results)]


def _matched(result: EstimateResult) -> str:
    return "" if result.association is None else f"{result.pairs} by {result.association.method}"


def _unmatched(result: EstimateResult) -> str:
    pairs = result.association
    return "" if pairs is None else f"{pairs.unmatched_estimate}, of the truth {pairs.unmatched_truth}"


def _time_difference(result: EstimateResult) -> str:
    pairs = result.association
    return "" if pairs is None or pairs.largest_time_difference is None else f"{pairs.largest_time_difference:.4g} s"


def _scale(result: EstimateResult) -> str:
    return f"{result.alignment.scale:.6g}" if result.alignment and result.alignment.method == "sim" else ""


def _closing(result: EstimateResult) -> str:
    return f"{result.gap.closing_distance:.6g} m, {result.gap.closing_rotation:.4g} deg"


def _end(result: EstimateResult) -> str:
    gap = result.gap
    return "" if gap.translation is None else f"{gap.translation:.6g} m, {gap.rotation:.4g} deg"


def _drift(result: EstimateResult) -> str:
    gap = result.gap
    if gap.drift_translation is None or gap.drift_rotation is None:
        return ""
    return f"{gap.drift_translation:.4g} %, {gap.drift_rotation:.4g} deg/m"


def _landmarks(result: EstimateResult) -> str:
    found = result.landmarks
    if found is None:
        return ""
    if found.error is None:
        return "none matched"
    return f"rmse {found.error.rmse:.6g} m, max {found.error.max:.6g} m"


def _landmark_counts(result: EstimateResult) -> str:
    found = result.landmarks
    if found is None:
        return ""
    return f"{found.matched}, unmatched {found.unmatched_estimate}, of the truth {found.unmatched_truth}"


def _nees(result: EstimateResult) -> str:
    found = result.consistency
    if found is None:
        return ""
    if found.mean is None or found.band is None:
        return "no pose with a regular covariance"
    return f"{found.mean:.4g}, expected {found.band[0]:.4g} to {found.band[1]:.4g} ({found.confidence:.0%})"


def _nees_inside(result: EstimateResult) -> str:
    found = result.consistency
    if found is None or found.inside is None:
        return ""
    left_out = [
        f"{number} {what}"
        for number, what in ((found.without_covariance, "without covariance"), (found.singular, "held"))
        if number
    ]
    more = f"; left out: {', '.join(left_out)}" if left_out else ""
    return f"{found.inside:.1%} of {plural(found.count, 'pose')}{more}"


def _closures(result: EstimateResult) -> str:
    found = result.closures
    return "" if found is None else f"{_share(found.precision)} / {_share(found.recall)} / {_share(found.f1)}"


def _closure_counts(result: EstimateResult) -> str:
    found = result.closures
    if found is None:
        return ""
    more = f"; {found.absent} absent" if found.absent else ""
    more += f"; {found.unlabelled} without label" if found.unlabelled else ""
    counts = (found.true_positive, found.false_positive, found.false_negative, found.true_negative)
    return " / ".join(str(count) for count in counts) + more


def _share(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}"


_FACTS = (
    ("poses", lambda result: str(result.poses)),
    ("matched", _matched),
    ("unmatched", _unmatched),
    ("largest time difference", _time_difference),
    ("scale", _scale),
    ("path", lambda result: f"{result.length:.6g} m"),
    ("first to last pose", _closing),
    ("error at the end", _end),
    ("drift over the path", _drift),
    ("landmarks matched", _landmark_counts),
    ("landmark error", _landmarks),
    ("mean NEES", _nees),
    ("NEES inside its band", _nees_inside),
    ("closures: precision / recall / F1", _closures),
    ("closures: TP / FP / FN / TN", _closure_counts),
)

_Block = tuple[str, list[Statistics | None]]


def _blocks(results: list[EstimateResult]) -> list[_Block]:
    """Name and unit of each metric, and its statistics for each estimate."""
    if any(result.absolute is None for result in results):
        return []
    blocks: list[_Block] = []
    for name, unit in _UNITS.items():
        blocks.append((f"ATE {name} ({unit})", [result.absolute[name] for result in results if result.absolute]))
    for k, relative in enumerate(results[0].relative):
        for name, unit in _UNITS.items():
            found = [result.relative[k].statistics for result in results]
            label = f"RPE {name} ({unit}) over {_delta(relative)}"
            blocks.append((label, [statistics[name] if statistics else None for statistics in found]))
    return blocks


def _delta(relative: RelativeErrors) -> str:
    unit = relative.unit
    if unit == "frames":
        return plural(int(relative.delta), "frame")
    return f"{relative.delta:g} {unit}"


def _wide(blocks: list[_Block]) -> list[str]:
    """One estimate: a row for each metric."""
    rows = [["", *_STATISTICS]]
    rows += [[label, *(_number(found[0], name) for name in _STATISTICS)] for label, found in blocks]
    return table(rows, "<" + ">" * len(_STATISTICS))


def _side_by_side(blocks: list[_Block], names: list[str]) -> list[str]:
    """Several estimates: a column for each."""
    rows = [["", *names]]
    for label, found in blocks:
        rows += [
            [label if name == "rmse" else "", name, *(_number(one, name) for one in found)] for name in _STATISTICS
        ]
    return table(rows, "<<" + ">" * (len(names) - 1))


def _number(found: Statistics | None, name: str) -> str:
    return "-" if found is None else f"{getattr(found, name):.6g}"


# -- JSON --------------------------------------------------------------------------------------------------------------


def evaluation_document(evaluation: Evaluation) -> dict[str, Any]:
    """The document of ``slamcli evaluate --json``."""
    truth = evaluation.truth
    return {
        **head("evaluate"),
        "truth": None
        if truth is None
        else {"path": truth.source, "poses": len(truth), "length": truth.length, "kind": truth.kind.name},
        "options": asdict(evaluation.options),
        "estimates": [_estimate(result) for result in evaluation.estimates],
        "notes": evaluation.notes,
    }


def _estimate(result: EstimateResult) -> dict[str, Any]:
    pairs, found = result.association, result.consistency
    return {
        "name": result.name,
        "poses": result.poses,
        "length": result.length,
        "kind": result.kind,
        "association": None
        if pairs is None
        else {
            "method": pairs.method,
            "matched": len(pairs),
            "unmatched_estimate": pairs.unmatched_estimate,
            "unmatched_truth": pairs.unmatched_truth,
            "reused": pairs.reused,
            "largest_time_difference": pairs.largest_time_difference,
        },
        "alignment": _alignment(result.alignment),
        "ate": _statistics(result.absolute),
        "rpe": [
            {
                "delta": relative.delta,
                "delta_unit": relative.unit,
                "all_pairs": relative.all_pairs,
                "pairs": relative.pairs,
                "errors": _statistics(relative.statistics),
            }
            for relative in result.relative
        ],
        "gap": asdict(result.gap),
        "landmarks": None if result.landmarks is None else asdict(result.landmarks),
        "nees": None
        if found is None
        else {
            "mean": found.mean,
            "dimension": found.dimension,
            "count": found.count,
            "without_covariance": found.without_covariance,
            "singular": found.singular,
            "band": found.band,
            "pose_band": found.pose_band,
            "inside": found.inside,
            "confidence": found.confidence,
        },
        "closures": None if result.closures is None else asdict(result.closures),
    }


def _alignment(alignment: Alignment | None) -> dict[str, Any] | None:
    if alignment is None:
        return None
    return {
        "method": alignment.method,
        "rotation": alignment.rotation.tolist(),
        "translation": alignment.translation.tolist(),
        "scale": alignment.scale,
    }


def _statistics(found: dict[str, Statistics] | None) -> dict[str, Any] | None:
    return None if found is None else {name: asdict(one) for name, one in found.items()}


# -- CSV ---------------------------------------------------------------------------------------------------------------


def errors_csv(evaluation: Evaluation) -> bytes:
    """One row for each associated pose of each estimate, under a header that names the units.

    What an estimate does not have (ids, time stamps, NEES) is empty. The column ``nees`` is there if an estimate has
    covariances. Numbers are the shortest decimals that read back as the same doubles.
    """
    with_nees = any(result.consistency is not None for result in evaluation.estimates)
    rows = [",".join((*CSV_COLUMNS, "nees") if with_nees else CSV_COLUMNS)]
    for result in evaluation.estimates:
        rows += _csv_rows(result, with_nees)
    return "".join(f"{row}\n" for row in rows).encode()


def _csv_rows(result: EstimateResult, with_nees: bool) -> Iterable[str]:
    poses = result.table
    if poses is None:
        return []
    nothing = [""] * result.pairs
    columns: list[list[Any]] = [
        [_quoted(result.name)] * result.pairs,
        nothing if poses.ids is None else poses.ids.tolist(),
        nothing if poses.stamps is None else poses.stamps.tolist(),
        poses.distance.tolist(),
        *poses.positions.T.tolist(),
        poses.errors.translation.tolist(),
        poses.errors.rotation.tolist(),
    ]
    if with_nees:
        found = result.consistency
        columns.append(nothing if found is None else ["" if np.isnan(v) else v for v in found.values.tolist()])
    return [",".join(map(str, row)) for row in zip(*columns, strict=True)]


def _quoted(name: str) -> str:
    """A CSV cell (RFC 4180)."""
    return '"' + name.replace('"', '""') + '"' if any(c in name for c in ',"\r\n') else name
