"""The figures of a case by name: where its documents have them, their units, and which way is better."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from slamcli.batch.pipeline import Outcome

LOWER, HIGHER, EQUAL = "lower", "higher", "equal"


@dataclass(frozen=True)
class Metric:
    """A figure.

    Attributes
    ----------
    name
        As suites have it.
    meaning
        In words, with the unit.
    better
        ``lower``, ``higher``, or ``equal``: any change is for the worse.
    places
        (step, dotted key of its document); the first that is there counts. ``*`` stands for the command of the case.
    """

    name: str
    meaning: str
    better: str
    places: tuple[tuple[str, str], ...]


METRICS = {
    metric.name: metric
    for metric in (
        Metric("chi2", "sum of e^T Omega e at the end", LOWER, (("*", "chi2"), ("*", "final_chi2"))),
        Metric("final_chi2", "what was minimized, at the end", LOWER, (("*", "final_chi2"),)),
        Metric("iterations", "number of iterations", LOWER, (("*", "iterations"),)),
        Metric(
            "ate", "absolute trajectory error, rms in m", LOWER, (("evaluate", "estimates.0.ate.translation.rmse"),)
        ),
        Metric(
            "ate_rotation", "the same of rotations, in degrees", LOWER, (("evaluate", "estimates.0.ate.rotation.rmse"),)
        ),
        Metric(
            "rpe", "relative pose error, rms in m", LOWER, (("evaluate", "estimates.0.rpe.0.errors.translation.rmse"),)
        ),
        Metric("nnz_l", "nonzeros of the Cholesky factor", LOWER, (("*", "sparsity.nnz_factor"),)),
        Metric("fill_in", "nonzeros of the factor over those of H", LOWER, (("*", "sparsity.fill_in"),)),
        Metric("precision", "of the kept loop closures", HIGHER, (("evaluate", "estimates.0.closures.precision"),)),
        Metric("recall", "of the kept loop closures", HIGHER, (("evaluate", "estimates.0.closures.recall"),)),
        Metric("certified", "1 with a certificate of the global minimum", HIGHER, (("*", "certificate.certified"),)),
        Metric("nees", "mean NEES over its dimension", EQUAL, (("evaluate", "estimates.0.nees.mean"),)),
        Metric("nis", "mean NIS over its dimension", EQUAL, (("*", "nis.mean"),)),
        Metric("memory", "largest resident memory in MB", LOWER, (("*", "peak_memory_mb"),)),
        Metric("solve_seconds", "time of the command without reading and writing, in s", LOWER, (("*", "time.total"),)),
    )
}
#: Figures of the process rather than of a document.
EXIT_CODE = "exit_code"
SECONDS = "seconds"


def value(outcome: Outcome, name: str) -> float | None:
    """A figure of a case, None if there is none.

    Parameters
    ----------
    outcome
        Of the case.
    name
        Of ``METRICS``, ``exit_code``, ``seconds`` (wall time of the command's process), or ``step:dotted.key`` for
        any number of a document, such as ``evaluate:estimates.0.gap.translation``.
    """
    if name == EXIT_CODE:
        return outcome.exit_code
    if name == SECONDS:
        return outcome.steps[outcome.command].seconds if outcome.command in outcome.steps else None
    places = METRICS[name].places if name in METRICS else (tuple(name.split(":", 1)),)
    for step, key in places:
        found = _number(_at(outcome.document(outcome.command if step == "*" else step), key))
        if found is not None:
            return found
    return None


def _at(document: Any, key: str) -> Any:
    """What stands at a dotted key; digits count in lists."""
    for part in key.split("."):
        if isinstance(document, list) and part.isdigit() and int(part) < len(document):
            document = document[int(part)]
        elif isinstance(document, dict):
            document = document.get(part)
        else:
            return None
    return document


def _number(found: Any) -> float | None:
    return None if found is None or isinstance(found, str | list | dict) else float(found)
