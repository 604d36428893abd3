"""``slamcli simulate``: its summary, its table of drift and its documents."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from slamcli.reporting.documents import head
from slamcli.reporting.text import plural, seconds, table

if TYPE_CHECKING:
    from slamcli.evaluation.drift import Gap
    from slamcli.evaluation.drift_sweep import DriftPoint
    from slamcli.simulation.scenario import Scenario
    from slamcli.simulation.simulate import Simulation


def simulation_summary(
    simulation: Simulation, gap: Gap, files: dict[str, str], time: dict[str, float], memory: float
) -> list[str]:
    """What ``slamcli simulate`` prints."""
    scenario, graph = simulation.scenario, simulation.graph
    false = sum(int(mask.sum()) for mask in simulation.outliers)
    chi2, dimensions = simulation.chi2_at_truth(), simulation.measured_dimensions()
    rows = [
        ("world", f"{scenario.world}, seed {scenario.seed}"),
        ("path", f"{plural(graph.poses, 'pose')}, {simulation.path_length:.6g} m"),
        ("edges", _edges(simulation)),
    ]
    if graph.landmarks:
        rows.append(("landmarks", f"{graph.landmarks} seen"))
    if false:
        rows.append(("outliers", f"{plural(false, 'edge')} on purpose"))
    rows += [
        ("noise", f"chi2 at the truth {chi2:.6f}, {chi2 / max(dimensions, 1):.4f} of {dimensions} dimensions"),
        *([("drift", _drift(gap))] if scenario.guess != "none" else []),  # one vertex is no path
        *(("note", note) for note in simulation.notes),
        *((name, path) for name, path in files.items()),
        ("time", ", ".join(f"{name} {seconds(value)}" for name, value in time.items()) + f"; {memory:.0f} MB peak"),
    ]
    return table(rows, "<<")


def simulation_document(
    simulation: Simulation, gap: Gap, files: dict[str, str], time: dict[str, float], memory: float
) -> dict[str, Any]:
    """The document of ``slamcli simulate --json``."""
    return {
        **head("simulate"),
        "scenario": simulation.scenario.document(),
        "poses": simulation.graph.poses,
        "landmarks": simulation.graph.landmarks,
        "edges": simulation.graph.edges,
        "by_tag": _by_tag(simulation),
        "loop_closures": len(simulation.closures.pairs),
        "outliers": sum(int(mask.sum()) for mask in simulation.outliers),
        "path_length": simulation.path_length,
        "chi2_at_truth": simulation.chi2_at_truth(),
        "dimensions": simulation.measured_dimensions(),
        "drift": asdict(gap),
        "notes": simulation.notes,
        "files": files,
        "time": time,
        "peak_memory_mb": memory,
    }


def drift_table(key: str, points: list[DriftPoint]) -> list[str]:
    """The drift of dead reckoning for each value of an option."""
    with_landmarks = any(point.landmark_rmse is not None for point in points)
    rows = [(key, "runs", "gap mean", "std", "max", "heading", "drift", *(("landmarks",) if with_landmarks else ()))]
    units = ("", "", "m", "m", "m", "deg", "%", *(("m rmse",) if with_landmarks else ()))
    rows.append(units)
    for point in points:
        numbers = (point.gap_mean, point.gap_std, point.gap_max, point.rotation_mean, point.drift_mean)
        cells = [str(point.value), str(point.runs), *(f"{_settled(number):.4g}" for number in numbers)]
        if with_landmarks:
            cells.append("-" if point.landmark_rmse is None else f"{_settled(point.landmark_rmse):.4g}")
        rows.append(tuple(cells))
    return ["dead reckoning: how far the last pose is off, seen from the first", "", *table(rows, ">" * len(rows[0]))]


def drift_document(key: str, scenario: Scenario, points: list[DriftPoint]) -> dict[str, Any]:
    """The document of ``slamcli simulate --sweep --json``."""
    return {
        **head("simulate"),
        "scenario": scenario.document(),
        "sweep": key,
        "points": [asdict(point) for point in points],
    }


def _by_tag(simulation: Simulation) -> dict[str, int]:
    return {factors.tag: len(factors) for factors in simulation.graph.factors}


def _edges(simulation: Simulation) -> str:
    closures = int(np.count_nonzero(~simulation.closures.false))
    tags = ", ".join(f"{tag} {count}" for tag, count in _by_tag(simulation).items())
    return f"{simulation.graph.edges}: {tags} ({plural(closures, 'true loop closure')})"


def _drift(gap: Gap) -> str:
    """The gap at the end of the vertices that are written."""
    translation, rotation = _settled(gap.translation or 0.0), _settled(gap.rotation or 0.0)
    percent = _settled(gap.drift_translation or 0.0)
    return f"the guess ends {translation:.4g} m and {rotation:.4g} deg off ({percent:.3g} % of the path)"


def _settled(value: float) -> float:
    """Zero where only the rounding of the numbers written is left."""
    return 0.0 if abs(value) < 1e-5 else value
