"""``slamcli ekf``: its summary, its documents and its trace."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from slamcli.reporting.documents import head
from slamcli.reporting.text import plural, seconds, table

if TYPE_CHECKING:
    from slamcli.evaluation.filter_run import FilterScores
    from slamcli.evaluation.monte_carlo import MonteCarlo
    from slamcli.evaluation.result import EstimateResult
    from slamcli.filtering.options import EkfOptions
    from slamcli.filtering.result import EkfResult, StepRecord
    from slamcli.graph.sensor_log import SensorLog


def ekf_summary(log: SensorLog, result: EkfResult, scores: FilterScores, written: str, memory: float) -> list[str]:
    """What ``slamcli ekf`` prints."""
    landmarks, updates = result.landmarks, result.updates
    readings = sum(len(entry) for entry in log.observations)
    rows = [
        ("log", f"{log.source}: {plural(len(log), 'step')}, {plural(readings, 'reading')}, motion {log.model}"),
        ("run", f"{plural(result.predictions, 'prediction')}, {plural(len(updates), 'update')}"),
        ("readings", ", ".join(f"{name} {count}" for name, count in result.counts.items() if count) or "none"),
        ("state", f"{plural(len(landmarks), 'landmark')}, dimension {3 + 2 * len(landmarks)}"),
    ]
    if result.interrupted:
        rows.insert(0, ("status", "interrupted"))
    rows += _association_rows(result)
    if scores.nis_mean is not None and scores.nis_band is not None:
        low, high = scores.nis_band
        rows.append(
            (
                "NIS",
                f"{scores.nis_mean:.4f} per degree of freedom, 95 % band {low:.4f} to {high:.4f}; "
                f"{100 * (scores.nis_inside or 0):.1f} % of the updates in their own",
            )
        )
    rows += _truth_rows(scores)
    rows += _uncertainty_rows(result)
    rows += [
        ("time", _time(result)),
        ("memory", f"{result.covariance_bytes / 2**20:.2f} MB covariance, {memory:.0f} MB at the peak"),
        *(("note", note) for note in dict.fromkeys([*log.notes, *result.notes])),
        ("written", written),
    ]
    return table(rows, "<<")


def ekf_document(
    log: SensorLog, options: EkfOptions, result: EkfResult, scores: FilterScores, memory: float
) -> dict[str, Any]:
    """The document of ``slamcli ekf --json``."""
    landmarks, updates = result.landmarks, result.updates
    return {
        **head("ekf"),
        "log": {
            "path": log.source,
            "steps": len(log),
            "motion": log.model,
            "readings_by_kind": {entry.kind.name: len(entry) for entry in log.observations},
            "notes": log.notes,
        },
        "options": _plain_options(options),
        "interrupted": result.interrupted,
        "predictions": result.predictions,
        "updates": len(updates),
        "counts": result.counts,
        "landmarks": len(landmarks),
        "dimension": 3 + 2 * len(landmarks),
        "association": asdict(result.association),
        "nis": {"mean": scores.nis_mean, "band": scores.nis_band, "inside": scores.nis_inside},
        "truth": _truth_document(scores.against_truth) or _landmarks_document(scores),
        "truth_aligned": _truth_document(scores.aligned),
        "final_pose": result.poses[-1].tolist(),
        "final_pose_covariance": result.covariances[-1].tolist(),
        "landmark_sigma": _landmark_sigmas(result),
        "coupling": result.coupling(),
        "time": {
            "prediction": result.prediction_seconds,
            "update": result.update_seconds,
            "association": result.association_seconds,
            "total": result.seconds,
        },
        "covariance_bytes": result.covariance_bytes,
        "reserved_bytes": result.reserved_bytes,
        "areas": result.areas,
        "peak_memory_mb": memory,
        "notes": result.notes,
    }


def trace_event(record: StepRecord) -> dict[str, Any]:
    """One line of ``slamcli ekf --trace``."""
    readings = [
        {
            "sensor": reading.sensor,
            "landmark": reading.landmark,
            "track": reading.track,
            "decision": reading.decision,
            "innovation": None if reading.innovation is None else reading.innovation.tolist(),
            "nis": reading.nis,
        }
        for reading in record.readings
    ]
    return {
        "event": "step",
        "step": record.step,
        "id": record.id,
        "time": record.time,
        "pose": record.pose.tolist(),
        "covariance": record.covariance.tolist(),
        "map_trace": record.map_trace,
        "landmarks": record.landmarks,
        "dimension": record.dimension,
        "nis": record.nis,
        "degrees_of_freedom": record.degrees_of_freedom,
        "readings": readings,
    }


def monte_carlo_table(runs: MonteCarlo) -> list[str]:
    """Mean errors over many runs, at some of the steps."""
    steps = np.unique(np.linspace(1, len(runs.nees) - 1, 11).round().astype(int)).tolist()
    low, high = runs.band
    rows = [("step", "NEES", "position error", "sigma", "heading error"), ("", "per number", "m rms", "m", "deg rms")]
    rows += [
        (
            str(step),
            f"{runs.nees[step]:.3f}" + ("" if low <= runs.nees[step] <= high else " *"),
            f"{runs.position_rmse[step]:.4g}",
            f"{runs.position_sigma[step]:.4g}",
            f"{runs.heading_rmse[step]:.4g}",
        )
        for step in steps
    ]
    rows = [(row[0], row[1].ljust(max(len(r[1].rstrip(" *")) for r in rows) + 2), *row[2:]) for row in rows]
    return [
        f"{runs.runs} runs; a NEES of 1 is expected, 95 % band of a step {low:.3f} to {high:.3f} (*: outside)",
        f"mean NEES {runs.mean:.3f}, {100 * runs.inside:.1f} % of the steps inside; "
        + (f"NIS {runs.nis:.3f}" if np.isfinite(runs.nis) else "no updates"),
        "",
        *table(rows, ">>>>>"),
    ]


def monte_carlo_document(options: EkfOptions, scenario: dict[str, Any], runs: MonteCarlo) -> dict[str, Any]:
    """The document of ``slamcli ekf --runs N --json``."""
    return {
        **head("ekf"),
        "scenario": scenario,
        "options": _plain_options(options),
        "runs": runs.runs,
        "nees_mean": runs.mean,
        "nees_inside": runs.inside,
        "nees_band": list(runs.band),
        "nis_mean": runs.nis,
        "nees": runs.nees.tolist(),
        "position_rmse": runs.position_rmse.tolist(),
        "position_sigma": runs.position_sigma.tolist(),
        "heading_rmse": runs.heading_rmse.tolist(),
    }


def _association_rows(result: EkfResult) -> list[tuple[str, str]]:
    found = result.association
    parts = [f"{found.made} made", f"{found.started} landmarks started"]
    if found.correct or found.wrong:
        share = 100.0 * found.correct / (found.correct + found.wrong)
        parts.insert(1, f"{found.correct} correct and {found.wrong} wrong by the log's ids ({share:.2f} %)")
    parts += [f"{found.deleted} deleted"] * bool(found.deleted)
    parts += [f"{found.duplicates} of them a second time"] * bool(found.duplicates)
    parts += [f"{found.cut_short} steps cut short"] * bool(found.cut_short)
    return [("association", ", ".join(parts))]


def _truth_rows(scores: FilterScores) -> list[tuple[str, str]]:
    against, aligned = scores.against_truth, scores.aligned
    if against is None or against.absolute is None:
        if scores.landmarks is not None and scores.landmarks.error is not None:
            error, matched = scores.landmarks.error.rmse, scores.landmarks.matched
            return [("map error", f"{error:.6g} m rmse over {matched} landmarks; the true path is not known")]
        if aligned is None or aligned.absolute is None:
            return []
        error = aligned.absolute["translation"].rmse
        return [("ATE", f"{error:.6g} m rmse over {aligned.pairs} positions, aligned; the truth has no headings")]
    ate = against.absolute
    text = f"{ate['translation'].rmse:.6g} m, {ate['rotation'].rmse:.4g} deg rmse over {against.pairs} poses; "
    if aligned is None or aligned.absolute is None:
        text += "the positions determine no alignment"
    else:
        fitted = aligned.absolute
        text += f"{fitted['translation'].rmse:.6g} m, {fitted['rotation'].rmse:.4g} deg aligned"
    rows = [("ATE", text)]
    before, after = against.landmarks, None if aligned is None else aligned.landmarks
    if before is not None and before.error is not None:
        text = f"{before.error.rmse:.6g} m rmse over {before.matched} landmarks"
        if after is not None and after.error is not None:
            text += f"; {after.error.rmse:.6g} m aligned"
        rows.append(("map error", text))
    if against.consistency is not None and against.consistency.mean is not None:
        nees = against.consistency
        rows.append(("NEES", f"{nees.mean:.4g} mean of {nees.count} poses, {nees.dimension} is expected"))
    return rows


def _truth_document(against: EstimateResult | None) -> dict[str, Any] | None:
    if against is None or against.absolute is None:
        return None
    landmarks, nees = against.landmarks, against.consistency
    return {
        "poses": against.pairs,
        "ate_translation": against.absolute["translation"].rmse,
        "ate_rotation": against.absolute["rotation"].rmse,
        "landmark_rmse": None if landmarks is None or landmarks.error is None else landmarks.error.rmse,
        "nees_mean": None if nees is None else nees.mean,
    }


def _landmarks_document(scores: FilterScores) -> dict[str, Any] | None:
    """The same where the truth has no path."""
    if scores.landmarks is None or scores.landmarks.error is None:
        return None
    nothing = dict.fromkeys(("ate_translation", "ate_rotation", "nees_mean"))
    return {"poses": 0, **nothing, "landmark_rmse": scores.landmarks.error.rmse}


def _uncertainty_rows(result: EkfResult) -> list[tuple[str, str]]:
    """Standard deviations at the end."""
    x, y, theta = np.sqrt(np.maximum(np.diag(result.covariances[-1]), 0.0))
    rows = [("pose", f"sigma {x:.4g} m ahead, {y:.4g} m aside, {np.degrees(theta):.4g} deg at the end")]
    sigma = _landmark_sigmas(result)
    if sigma["mean"] is not None:
        text = f"sigma {sigma['mean']:.4g} m mean, {sigma['min']:.4g} to {sigma['max']:.4g} m"
        if len(result.landmarks) > 1:
            text += f"; mean correlation of two landmarks {result.coupling():.4f}"
        rows.append(("map", text))
    return rows


def _landmark_sigmas(result: EkfResult) -> dict[str, float | None]:
    """Of the larger axis of each landmark's ellipse."""
    if len(result.landmarks) == 0:
        return {"min": None, "mean": None, "max": None}
    sigma = np.sqrt(np.maximum(np.linalg.eigvalsh(result.landmarks.covariances)[:, -1], 0.0))
    return {"min": float(sigma.min()), "mean": float(sigma.mean()), "max": float(sigma.max())}


def _time(result: EkfResult) -> str:
    def each(total: float, count: int) -> str:
        return f"{seconds(total)} ({1e6 * total / max(count, 1):.0f} us each)"

    return (
        f"{seconds(result.seconds)}: predictions {each(result.prediction_seconds, result.predictions)}, "
        f"updates {each(result.update_seconds, len(result.updates))}, association {seconds(result.association_seconds)}"
    )


def _plain_options(options: EkfOptions) -> dict[str, Any]:
    """Options as JSON can hold them."""
    motion = options.motion
    out = {name: getattr(options, name) for name in options.names() if name not in ("motion", "sensor_deviations")}
    out["sensor_deviations"] = {name: list(values) for name, values in options.sensor_deviations.items()}
    out["motion"] = None if motion is None else repr(motion)
    return out
