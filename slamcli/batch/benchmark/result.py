"""What a benchmark measured: runs, their median and spread, ratios."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from slamcli.batch.benchmark.case import reaches
from slamcli.batch.benchmark.grid import Variant
from slamcli.errors import ExitCode

#: Status of a run that has converged, and what stands for those of peers, whose runs have a given length.
CONVERGED, GIVEN = "converged", "given"
#: A run that keeps more processors busy than this, for each of the threads it may have, is remarked on.
BUSY = 1.3


@dataclass(frozen=True)
class Data:
    """A graph of the benchmark.

    Attributes
    ----------
    name
        As the user gave it, without folders and ending.
    path
        Of the file.
    sha256
        Of the file.
    poses, landmarks, edges
        Counts.
    optimum
        Lowest known chi2 by the registry of data sets, None where it has none.
    """

    name: str
    path: str
    sha256: str
    poses: int
    landmarks: int
    edges: int
    optimum: float | None = None


@dataclass(frozen=True)
class Run:
    """One run, a process of its own.

    Attributes
    ----------
    solve
        Seconds between the loaded graph and the converged one, of the second of two runs in the process; None if
        there is no such time.
    first
        The same of the first run in the process.
    process
        Seconds of the whole process, from its start to its answer, both runs and loading included.
    memory
        Peak memory of the process in MB.
    cores
        Processors that it kept busy.
    iterations
        Number of iterations.
    chi2
        slamcli's, at the values that it ended with, None if there are none.
    polished
        Of a peer whose own cost is another one: chi2 where slamcli's Gauss-Newton ends from there.
    status
        Of slamcli: ``converged``, ...; of a peer ``given``, as the number of its iterations is; ``failed``.
    note
        Why it failed, or what is to be said about the time.
    """

    solve: float | None
    first: float | None = None
    process: float | None = None
    memory: float | None = None
    cores: float | None = None
    iterations: int = 0
    chi2: float | None = None
    polished: float | None = None
    status: str = "failed"
    note: str = ""

    @classmethod
    def of(cls, answer: Mapping[str, Any], process: float) -> Run:
        """From the answer of a child."""
        solve = answer["solve"]
        status = answer.get("status", GIVEN) if solve is not None else "failed"
        note = str(answer["note"])
        if status == GIVEN and _finite(answer["chi2"]) is None:
            note = f"diverged; {note}".removesuffix("; ")
        if status not in (CONVERGED, GIVEN, "failed"):
            note = f"{status.replace('_', ' ')}: {answer.get('reason', '')}".rstrip(": ")
        return cls(
            solve,
            answer.get("cold"),
            process,
            answer.get("memory"),
            answer.get("cores"),
            int(answer["iterations"]),
            _finite(answer["chi2"]),
            answer.get("polished") if answer["reached"] else None,
            status,
            note,
        )

    def reached(self, best: float) -> bool:
        """Whether it ended at the lowest known chi2, or of its own cost where that leads there."""
        return any(reaches(chi2, best) for chi2 in (self.chi2, self.polished) if chi2 is not None)


@dataclass
class Row:
    """A variant on a graph.

    Attributes
    ----------
    data, variant
        Which.
    setting
        Of a peer: how it was run, the fastest that reaches the optimum.
    runs
        In the order of the repetitions.
    remark
        Why there are no runs.
    """

    data: Data
    variant: Variant
    setting: str | None = None
    runs: list[Run] = field(default_factory=list)
    remark: str = ""

    @property
    def times(self) -> list[float]:
        """Seconds of the runs that have some."""
        return [run.solve for run in self.runs if run.solve is not None]

    @property
    def median(self) -> float | None:
        """Of the times."""
        return statistics.median(self.times) if self.times else None

    @property
    def deviation(self) -> float | None:
        """Median absolute deviation of the times."""
        if not self.times:
            return None
        middle = statistics.median(self.times)
        return statistics.median(abs(time - middle) for time in self.times)

    @property
    def last(self) -> Run | None:
        """The last run."""
        return self.runs[-1] if self.runs else None

    @property
    def failed(self) -> bool:
        """Whether a run has no time, or has not converged."""
        return bool(self.remark) or any(run.status not in (CONVERGED, GIVEN) for run in self.runs)

    def peak(self, name: str) -> float | None:
        """Largest of a figure of the runs (``memory``, ``cores``), None if there is none."""
        return max((value for run in self.runs if (value := getattr(run, name)) is not None), default=None)


@dataclass
class BenchResult:
    """A benchmark.

    Attributes
    ----------
    data, variants
        What was compared; the first variant is the reference of the ratios.
    rows
        Variants by graph, as far as it came.
    repeats, time_limit, threads
        As they were in effect.
    provenance
        Versions, machine and date.
    interrupted
        Whether the user stopped it.
    """

    data: tuple[Data, ...]
    variants: tuple[Variant, ...]
    rows: list[Row]
    repeats: int
    time_limit: float
    threads: int
    provenance: dict[str, Any]
    interrupted: bool = False

    def best(self, data: Data) -> float | None:
        """Lowest chi2 on a graph, that of the registry or of this benchmark; None if there is none."""
        found = [] if data.optimum is None else [data.optimum]
        found += [run.chi2 for row in self.of(data) for run in row.runs if run.chi2 is not None]
        return min(found, default=None)

    def of(self, data: Data) -> list[Row]:
        """Rows of a graph."""
        return [row for row in self.rows if row.data is data]

    def reached(self, row: Row) -> bool | None:
        """Whether all runs ended at the lowest chi2; None where there is none or something else was minimized."""
        best = self.best(row.data)
        runs = [run for run in row.runs if run.chi2 is not None]
        if best is None or not runs or not row.variant.minimizes_chi2:
            return None
        return all(run.reached(best) for run in runs)

    def ratio(self, row: Row) -> float | None:
        """Median over the repetitions of the time over that of the first variant in the same one."""
        first = self.of(row.data)[0]
        pairs = [
            (one.solve, other.solve)
            for one, other in zip(row.runs, first.runs, strict=False)
            if one.solve is not None and other.solve is not None
        ]
        return statistics.median(a / b for a, b in pairs) if pairs else None

    def notes(self, row: Row) -> str:
        """What is to be said about a row: why it failed, what its time holds, how many processors it used."""
        words = [row.setting or "", row.remark, row.last.note if row.last else ""]
        cores = row.peak("cores")
        if cores is not None and cores > BUSY * self.threads:
            words.append(f"{cores:.1f} processors busy")
        if 0 < len(row.runs) < self.repeats:
            words.append(f"{len(row.runs)} of {self.repeats} runs")
        return "; ".join(word for word in words if word)

    @property
    def exit_code(self) -> ExitCode:
        """130 after an interruption, 1 if a variant of slamcli has no time of an optimization that converged."""
        if self.interrupted:
            return ExitCode.INTERRUPTED
        ours = [row for row in self.rows if not row.variant.is_peer]
        return ExitCode.CHECK_FAILED if any(row.failed for row in ours) else ExitCode.SUCCESS


def _finite(chi2: float | None) -> float | None:
    return chi2 if chi2 is not None and math.isfinite(chi2) else None
