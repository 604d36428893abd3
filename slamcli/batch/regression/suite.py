"""What a suite says: its cases, their figures, and by how much these may change."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from slamcli.batch.metrics import Metric
from slamcli.batch.pipeline import Case

#: A known optimum counts as reached within this part of it.
OPTIMUM_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Gauge:
    """How one figure of a case is judged.

    Attributes
    ----------
    metric
        What it is; direction, tolerances and gate are those of the suite where it states any.
    at_most, at_least
        Limits that hold without a baseline.
    equals
        The value that it has to have, within the tolerances.
    optimum, within
        The lowest value that is known, and the part of it by which the figure may differ.
    """

    metric: Metric
    at_most: float | None = None
    at_least: float | None = None
    equals: float | None = None
    optimum: float | None = None
    within: float = OPTIMUM_TOLERANCE

    @property
    def limits(self) -> dict[str, float]:
        """Those that are stated."""
        found = {name: getattr(self, name) for name in ("at_most", "at_least", "equals", "optimum")}
        return {name: value for name, value in found.items() if value is not None}


@dataclass(frozen=True)
class SuiteCase:
    """One case as the suite has it: names of data sets and relative paths are not looked up yet.

    Attributes
    ----------
    case
        What is run.
    gauges
        Its figures, ``exit_code`` first.
    repeats
        How often it is run.
    optional
        Whether missing data skip it.
    optimum
        Tolerance within which chi2 has to be the optimum that the registry states for the data set; None for none.
    line
        Where it begins in the file.
    definition
        Hash of all that it runs: not of its name, figures and repeats.
    """

    case: Case
    gauges: tuple[Gauge, ...]
    repeats: int
    optional: bool
    optimum: float | None
    line: int
    definition: str

    @property
    def name(self) -> str:
        """Of the case."""
        return self.case.name

    @property
    def expected(self) -> int:
        """Exit code."""
        return int(self.gauges[0].equals or 0)


@dataclass(frozen=True)
class Suite:
    """A suite file.

    Attributes
    ----------
    name
        As it says, else that of its file.
    path
        Of the file; what it names is relative to its folder.
    sha256
        Of the file.
    cases
        In its order.
    """

    name: str
    path: Path
    sha256: str
    cases: tuple[SuiteCase, ...] = field(default_factory=tuple)

    @property
    def folder(self) -> Path:
        """Which relative paths start from."""
        return self.path.parent
