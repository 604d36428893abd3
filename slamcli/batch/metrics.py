"""The figures of a case by name: where its documents have them, their units, and which way is better."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from slamcli.batch.pipeline import Outcome

LOWER, HIGHER, EQUAL = "lower", "higher", "equal"
DIRECTIONS = (LOWER, HIGHER, EQUAL)


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
        (step, key of its document); the first that is there counts. ``*`` stands for the command of the case. A key is
        dotted, digits count in lists; ``a+b`` is a sum, ``a/b`` a quotient, and ``a=word`` is 1 where that word stands
        there, else 0. Without a place it is a figure of the process.
    relative, absolute
        A change for the worse by no more than absolute + relative · |old value| is none: what other processors,
        libraries and compilers change on the same input.
    gate
        Whether a change for the worse is a failure; times are not, unless a suite says so.
    timed
        Whether it depends on what else the machine does: it counts only where one case runs at a time.
    """

    name: str
    meaning: str
    better: str
    places: tuple[tuple[str, str], ...] = ()
    relative: float = 0.0
    absolute: float = 0.0
    gate: bool = True
    timed: bool = False


#: Figures of the process rather than of a document, and of a suite's run.
EXIT_CODE, SECONDS = "exit_code", "seconds"
SOLVE_SECONDS, TIME_RATIO = "solve_seconds", "time_ratio"

#: The command's own work: without starting the process, reading and writing.
_SOLVE = (
    ("*", "time.iterate+time.setup+time.certify"),  # optimize
    ("ekf", "time.total"),
    ("*", "time.compare"),  # sparsity
    ("*", "time.recover"),  # covariance
)
_TRUTH, _LOOPS = "estimates.0.", "estimates.0.closures."

METRICS = {
    metric.name: metric
    for metric in (
        Metric(
            "chi2",
            "sum of e^T Omega e over the edges that count, at the end (info: at the values of the file)",
            LOWER,
            (("*", "chi2"), ("*", "final_chi2")),
            relative=1e-6,
            absolute=1e-9,
        ),
        Metric("initial_chi2", "the same at the start", EQUAL, (("*", "initial_chi2"),), relative=1e-6, absolute=1e-9),
        Metric(
            "final_chi2", "what was minimized, at the end", LOWER, (("*", "final_chi2"),), relative=1e-6, absolute=1e-9
        ),
        Metric("iterations", "number of iterations", LOWER, (("*", "iterations"),), absolute=1.0),
        Metric(
            "ate",
            "absolute trajectory error, rms in m",
            LOWER,
            (("evaluate", _TRUTH + "ate.translation.rmse"),),
            relative=1e-3,
            absolute=1e-9,
        ),
        Metric(
            "ate_rotation",
            "the same of rotations, in degrees",
            LOWER,
            (("evaluate", _TRUTH + "ate.rotation.rmse"),),
            relative=1e-3,
            absolute=1e-7,
        ),
        Metric(
            "rpe",
            "relative pose error over the first --delta, rms in m",
            LOWER,
            (("evaluate", _TRUTH + "rpe.0.errors.translation.rmse"),),
            relative=1e-3,
            absolute=1e-9,
        ),
        Metric(
            "rpe_rotation",
            "the same of rotations, in degrees",
            LOWER,
            (("evaluate", _TRUTH + "rpe.0.errors.rotation.rmse"),),
            relative=1e-3,
            absolute=1e-7,
        ),
        Metric(
            "landmark_error",
            "error of the landmarks, rms in m",
            LOWER,
            (("evaluate", _TRUTH + "landmarks.error.rmse"), ("*", "truth.landmark_rmse")),
            relative=1e-3,
            absolute=1e-9,
        ),
        Metric(
            "nees",
            "mean NEES over its dimension: 1 is expected",
            EQUAL,
            (("evaluate", _TRUTH + "nees.mean/" + _TRUTH + "nees.dimension"),),
            relative=1e-3,
        ),
        Metric(
            "nis", "mean NIS over its degrees of freedom: 1 is expected", EQUAL, (("*", "nis.mean"),), relative=1e-3
        ),
        Metric("precision", "of the kept loop closures", HIGHER, (("evaluate", _LOOPS + "precision"),), absolute=1e-9),
        Metric("recall", "of the kept loop closures", HIGHER, (("evaluate", _LOOPS + "recall"),), absolute=1e-9),
        Metric("rejected", "number of rejected loop closures", EQUAL, (("*", "rejection.rejected"),)),
        Metric(
            "certified",
            "1 with a certificate of the global minimum, else 0",
            HIGHER,
            (("*", "certificate.status=certified"),),
        ),
        Metric(
            "certified_cost",
            "isotropic cost at the certified solution",
            EQUAL,
            (("*", "certificate.cost"),),
            relative=1e-6,
            absolute=1e-9,
        ),
        Metric(
            "reprojection",
            "reprojection error at the end, rms in pixels",
            LOWER,
            (("*", "reprojection.after.rms"),),
            relative=1e-5,
        ),
        Metric(
            "nnz_l",
            "nonzeros of the Cholesky factor (sparsity: under the first of its orders)",
            LOWER,
            (("*", "sparsity.nnz_factor"), ("*", "orderings.0.nnz_factor")),
            relative=0.02,
        ),
        Metric(
            "fill_in",
            "nonzeros of the factor over those of H",
            LOWER,
            (("*", "sparsity.fill_in"), ("*", "orderings.0.fill_in")),
            relative=0.02,
        ),
        Metric(
            "flops",
            "operations of the factorization",
            LOWER,
            (("*", "sparsity.factor_flops"), ("*", "orderings.0.flops")),
            relative=0.05,
        ),
        Metric("edges", "number of edges that were read", EQUAL, (("*", "input.edges"),)),
        Metric(
            "memory",
            "largest resident memory of the process in MB",
            LOWER,
            (("*", "peak_memory_mb"),),
            relative=0.25,
            absolute=25.0,
        ),
        Metric(
            SOLVE_SECONDS,
            "time of optimize, ekf, sparsity or covariance without reading and writing, in s",
            LOWER,
            _SOLVE,
            relative=0.5,
            gate=False,
            timed=True,
        ),
        Metric(
            TIME_RATIO,
            "solve_seconds over the time of a reference kernel in the same run",
            LOWER,
            relative=0.5,
            gate=False,
            timed=True,
        ),
        Metric(SECONDS, "wall time of the command's process, in s", LOWER, relative=0.5, gate=False, timed=True),
        Metric(EXIT_CODE, "exit code of the command", EQUAL),
    )
}


def metric(name: str) -> Metric:
    """What is known about a figure; of ``step:key`` nothing but that it should stay as it is."""
    if name in METRICS:
        return METRICS[name]
    step, _, key = name.partition(":")
    return Metric(name, f"{key} in the document of {step}", EQUAL, ((step, key),), relative=1e-6, absolute=1e-9)


def value(outcome: Outcome, name: str) -> float | None:
    """A figure of a case, None if there is none.

    Parameters
    ----------
    outcome
        Of the case.
    name
        Of ``METRICS``, among them ``exit_code`` and ``seconds`` (wall time of the command's process), or ``step:key``
        for any number of a document, such as ``evaluate:estimates.0.gap.translation``.
    """
    if name == EXIT_CODE:
        return outcome.exit_code
    if name == SECONDS:
        return outcome.steps[outcome.command].seconds if outcome.command in outcome.steps else None
    for step, key in metric(name).places:
        found = _read(outcome.document(outcome.command if step == "*" else step), key)
        if found is not None:
            return found
    return None


def _read(document: dict[str, Any], key: str) -> float | None:
    """The number at a key: plain, ``a=word``, ``a/b`` or ``a+b``."""
    if "=" in key:
        place, _, word = key.partition("=")
        found = _at(document, place)
        return float(str(found) == word) if found is not None else None
    parts = [_number(_at(document, part)) for part in re.split(r"[+/]", key)]
    numbers = [part for part in parts if part is not None]
    if len(numbers) < len(parts):
        return None
    if "/" in key:
        return numbers[0] / numbers[1] if numbers[1] else None
    return sum(numbers)


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
    return float(found) if isinstance(found, int | float) else None
