"""What ``slamcli compare`` prints and writes: text, JSON, and the CSV of corrections by pose."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

import numpy as np

from slamcli.batch.closing import MOVED, Closing, Correction
from slamcli.batch.compare import Comparison, Method
from slamcli.batch.scaling import FITTED, Fit, Scaling
from slamcli.evaluation.consistency import Consistency
from slamcli.reporting.documents import head
from slamcli.reporting.text import count, plural, seconds, table

_ALIGNMENTS = {
    "none": "none: the estimates as they are",
    "origin": "origin: the first matched poses coincide",
    "se": "se: rotation and translation that fit the positions best (Umeyama)",
}
_FITS = {
    "update_seconds": "filter, time of an update",
    "filter_seconds": "filter, time of the run",
    "filter_bytes": "filter, memory of the covariance",
    "iteration_seconds": "smoother, time of an iteration",
    "smoother_seconds": "smoother, time of the run",
    "smoother_bytes": "smoother, memory of the factor",
}
CSV_HEAD = "id,filter_m,smoother_m"

# -- text --------------------------------------------------------------------------------------------------------------


def comparison_summary(comparison: Comparison) -> list[str]:
    """The summary for people."""
    c = comparison
    readings = sum(c.run.counts[name] for name in ("used", "initialized"))
    rows = [
        ("log", f"{c.log.source}: {plural(len(c.log), 'step')}, {plural(readings, 'reading')} used"),
        ("landmarks", f"{len(c.run.landmarks)}, association {c.options.association}"),
    ]
    if c.truth is not None:
        rows.append(("truth", f"{c.truth.source}: {plural(len(c.truth), 'pose')}, {c.truth.length:.6g} m"))
        rows.append(("alignment", _ALIGNMENTS[c.align]))
    rows.append(("smoother", _smoother_text(c)))
    return [
        *table(rows, "<<"),
        "",
        *_methods(c),
        "",
        *_agreement_lines(c),
        *(["", *_closing_lines(c.closure)] if c.closure is not None else []),
        *(["", *(f"note: {note}" for note in c.notes)] if c.notes else []),
    ]


def scaling_summary(scaling: Scaling) -> list[str]:
    """The table of a scaling, and the fitted exponents."""
    rows = [
        (
            "landmarks",
            "poses",
            "readings",
            "update",
            "filter",
            "covariance",
            "smoother",
            "iterations",
            "nnz(L)",
            "factor",
        )
    ]
    rows += [
        (
            str(p.landmarks),
            str(p.poses),
            str(p.readings),
            f"{p.update_seconds * 1e3:.3g} ms",
            seconds(p.filter_seconds),
            count(p.filter_bytes, "B"),
            seconds(p.smoother_seconds),
            str(p.iterations),
            str(p.nnz_factor),
            count(p.smoother_bytes, "B"),
        )
        for p in scaling.points
    ]
    fits = [("grows with the number of landmarks as", "N to the power", "between the largest two")]
    fits += [(_FITS[name], _exponent(scaling.fits[name]), f"{scaling.fits[name].last:.2f}") for name in FITTED]
    return [*table(rows, ">" * 10), "", *table(fits, "<>>")]


def _exponent(fit: Fit) -> str:
    return f"{fit.exponent:.2f}" + ("" if fit.error is None else f" ± {fit.error:.2f}")


def _smoother_text(c: Comparison) -> str:
    result = c.smoothed.result
    sparsity = result.sparsity
    size = "" if sparsity is None else f", {sparsity.dimension} unknowns, {sparsity.nnz_factor} nonzeros in L"
    return (
        f"{plural(result.iterations, 'iteration')} of {c.smoothed.method} from the filter's poses, "
        f"chi2 {result.initial_chi2:.6g} -> {result.final_chi2:.6g} ({result.dof} degrees of freedom){size}"
    )


def _methods(c: Comparison) -> list[str]:
    """One row for each method; columns of which no row has a number are left out."""
    columns = [("", [method.name for method in c.methods])]
    columns += [(name, [function(method) for method in c.methods]) for name, function in _COLUMNS]
    if c.log.positions_only:
        columns = [(name, cells) for name, cells in columns if name != "ATE deg"]
    columns = [(name, cells) for name, cells in columns if any(cell not in ("", "-") for cell in cells)]
    rows = [tuple(name for name, _ in columns), *zip(*(cells for _, cells in columns), strict=True)]
    lines = table(rows, "<" + ">" * (len(columns) - 1))
    consistency = next((found for found in map(_consistency, c.methods) if found is not None), None)
    if consistency is not None and consistency.band is not None:
        low, high = consistency.band
        lines.append(
            f"NEES: mean over {consistency.count} poses, 3 expected; {low:.3g} to {high:.3g} where they are independent"
        )
    return lines


def _ate(method: Method) -> str:
    found = method.against_truth
    return "-" if found is None or found.absolute is None else f"{found.absolute['translation'].rmse:.4g}"


def _heading(method: Method) -> str:
    found = method.against_truth
    return "-" if found is None or found.absolute is None else f"{found.absolute['rotation'].rmse:.3g}"


def _landmark_error(method: Method) -> str:
    found = method.landmark_errors
    return "-" if found is None or found.error is None else f"{found.error.rmse:.4g}"


def _consistency(method: Method) -> Consistency | None:
    return None if method.against_truth is None else method.against_truth.consistency


def _nees(method: Method) -> str:
    found = _consistency(method)
    return "-" if found is None or found.mean is None else f"{found.mean:.3g}"


def _inside(method: Method) -> str:
    found = _consistency(method)
    return "-" if found is None or found.inside is None else f"{found.inside:.0%}"


_COLUMNS: tuple[tuple[str, Any], ...] = (
    ("ATE m", _ate),
    ("ATE deg", _heading),
    ("landmarks m", _landmark_error),
    ("NEES", _nees),
    ("inside 95 %", _inside),
    ("time", lambda method: seconds(method.seconds)),
    ("memory", lambda method: "-" if method.memory is None else count(method.memory, "B")),
)


def _agreement_lines(c: Comparison) -> list[str]:
    a = c.agreement
    text = f"filter and smoother differ by {a.last_pose:.4g} m in the last pose, {a.path:.4g} m (rms) in the path"
    if a.landmarks is None or a.inside is None:
        return [text]
    return [
        text,
        f"and {a.landmarks:.4g} m (rms) in the landmarks, of which the filter's 95 % regions hold {a.inside:.0%}",
    ]


def _closing_lines(closing: Closing) -> list[str]:
    """The closure and what it does."""
    after = f", after {plural(closing.absence, 'step')} without one of their landmarks" if closing.absence else ""
    rows: list[tuple[str, ...]] = [("correction of the poses", "largest m", "mean m", "before it m", "moved")]
    for name, correction in (("filter", closing.filter), ("smoother", closing.smoother)):
        numbers = (correction.largest, correction.mean, correction.earlier)
        rows.append((name, *(f"{number:.4g}" for number in numbers), f"{correction.moved:.1%}"))
    return [
        f"loop closure at pose {closing.ids[-1]} (step {closing.step}): {plural(closing.readings, 'reading')}{after}",
        *table(rows, "<>>>>"),
        f"moved: poses that move by more than {MOVED:.0%} of the largest correction",
    ]


# -- CSV ---------------------------------------------------------------------------------------------------------------


def corrections_csv(closing: Closing) -> bytes:
    """One row for each pose up to the closing one: its id, and metres by which filter and smoother move it."""
    rows = zip(closing.ids.tolist(), closing.filter.metres.tolist(), closing.smoother.metres.tolist(), strict=True)
    lines = [CSV_HEAD, *(f"{number},{moved!r},{spread!r}" for number, moved, spread in rows)]
    return ("\n".join(lines) + "\n").encode()


# -- JSON --------------------------------------------------------------------------------------------------------------


def comparison_document(comparison: Comparison) -> dict[str, Any]:
    """The document of ``slamcli compare --json``."""
    c, result = comparison, comparison.smoothed.result
    return {
        **head("compare"),
        "source": c.log.source,
        "steps": len(c.log),
        "readings": dict(c.run.counts),
        "landmarks": len(c.run.landmarks),
        "association": c.options.association,
        "truth": None if c.truth is None else c.truth.source,
        "align": c.align,
        "methods": [_method_section(method) for method in c.methods],
        "smoother": {
            "method": c.smoothed.method,
            "status": result.status.value,
            "iterations": result.iterations,
            "initial_chi2": result.initial_chi2,
            "final_chi2": result.final_chi2,
            "dof": result.dof,
            "poses": len(c.smoothed.built.kept),
            "sparsity": None if result.sparsity is None else asdict(result.sparsity),
            "covariance_seconds": c.covariance_seconds,
        },
        "agreement": asdict(c.agreement),
        "closure": None if c.closure is None else _closing_section(c.closure),
        "notes": c.notes,
    }


def scaling_document(scaling: Scaling) -> dict[str, Any]:
    """The document of ``slamcli compare --scaling --json``."""
    return {
        **head("compare"),
        "scaling": [asdict(point) for point in scaling.points],
        "fits": {name: asdict(fit) for name, fit in scaling.fits.items()},
    }


def _method_section(method: Method) -> dict[str, Any]:
    found = method.against_truth
    consistency = _consistency(method)
    return {
        "name": method.name,
        "absolute": None if found is None or found.absolute is None else _statistics(found.absolute),
        "landmark_errors": None if method.landmark_errors is None else asdict(method.landmark_errors),
        "nees": None if consistency is None else _nees_section(consistency),
        "time": method.seconds,
        "memory_bytes": method.memory,
        "position_deviation": _final_deviation(method),
    }


def _statistics(absolute: dict[str, Any]) -> dict[str, Any]:
    return {name: asdict(values) for name, values in absolute.items()}


def _nees_section(consistency: Consistency) -> dict[str, Any]:
    names: Iterable[str] = ("count", "singular", "dimension", "mean", "band", "pose_band", "inside", "confidence")
    return {name: getattr(consistency, name) for name in names}


def _final_deviation(method: Method) -> float:
    """Root of the summed variances of the last position, in metres."""
    return float(np.sqrt(max(method.covariances[-1, 0, 0] + method.covariances[-1, 1, 1], 0.0)))


def _closing_section(closing: Closing) -> dict[str, Any]:
    return {
        "step": closing.step,
        "id": int(closing.ids[-1]),
        "absence": closing.absence,
        "readings": closing.readings,
        "filter": _correction_section(closing.filter),
        "smoother": _correction_section(closing.smoother),
    }


def _correction_section(correction: Correction) -> dict[str, float]:
    return {name: getattr(correction, name) for name in ("largest", "mean", "earlier", "moved")}
