"""Suites, machines and baselines for the tests: nothing runs but what a table of documents says."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from slamcli.batch.execution import Execution
from slamcli.batch.regression import baseline as baselines
from slamcli.batch.regression.reading import read
from slamcli.batch.regression.result import MetricResult, RegressionReport
from slamcli.batch.regression.run import Machine
from slamcli.batch.regression.session import regress
from slamcli.batch.regression.suite import Suite

GRAPH = "VERTEX_SE2 0 0 0 0\n"
#: What ``optimize`` prints, as far as the suites below look.
OPTIMIZED = {
    "chi2": 10.0,
    "final_chi2": 10.0,
    "iterations": 5,
    "status": "converged",
    "sparsity": {"nnz_factor": 100},
    "certificate": {"status": "certified", "cost": 3.0},
    "time": {"load": 9.0, "iterate": 1.0, "setup": 0.5, "certify": 0.25, "write": 9.0, "total": 19.75},
    "peak_memory_mb": 50.0,
}

Answer = tuple[int, Any, str]


class FakeMachine:
    """Answers with documents instead of running anything.

    Attributes
    ----------
    documents
        By name of the step; a list has one for each time it is asked for, the last one again and again.
    codes, messages
        Exit code and standard error of a step; 0 and nothing where they say nothing.
    lines
        All command lines that were asked for.
    """

    def __init__(
        self,
        documents: Mapping[str, Any] | None = None,
        codes: Mapping[str, int] | None = None,
        messages: Mapping[str, str] | None = None,
        pace: Callable[[], float] = lambda: 0.5,
    ) -> None:
        self.documents = dict(documents if documents is not None else {"optimize": OPTIMIZED})
        self.codes, self.messages = dict(codes or {}), dict(messages or {})
        self.lines: list[tuple[str, ...]] = []
        self.paces = 0
        self._pace = pace
        self.stopped = False

    def execute(self, words: Sequence[str], folder: Path, limit: float | None) -> Execution:
        """One answer; files that ``-o`` names are made."""
        self.lines.append(tuple(words))
        step = words[0]
        if "-o" in words:
            (folder / words[words.index("-o") + 1]).write_text(f"{step} {len(self.lines) if step == 'x' else ''}")
        document = self.documents.get(step)
        if isinstance(document, list):
            document = document.pop(0) if len(document) > 1 else document[0]
        return Execution(tuple(words), self.codes.get(step, 0), document, self.messages.get(step, ""), 2.0)

    def reference(self) -> float:
        """Seconds of the kernel."""
        self.paces += 1
        return self._pace()

    def stop(self) -> None:
        """Nothing runs."""
        self.stopped = True

    @property
    def machine(self) -> Machine:
        """As the runner takes it."""
        return Machine(self.execute, self.stop, self.reference)


def suite_of(folder: Path, cases: str, name: str = "suite.yaml") -> Suite:
    """A suite with these cases (YAML, indented by two), beside a file graph.g2o."""
    (folder / "graph.g2o").write_text(GRAPH)
    path = folder / name
    path.write_text(f"name: test\ncases:\n{cases}")
    return read(path)


ONE = "  - {name: one, data: graph.g2o, metrics: [chi2]}\n"


def ran(suite: Suite, fake: FakeMachine | None = None, **options: Any) -> RegressionReport:
    """A run with the baseline beside the suite, if there is one."""
    path = baselines.default_path(suite.path)
    fake = fake or FakeMachine()
    return regress(suite, fake.machine, baseline=baselines.read(path), baseline_path=path, **options)


def optimized(**changes: Any) -> dict[str, Any]:
    """The document of ``optimize`` with other values."""
    return {**OPTIMIZED, **changes}


def figure(report: RegressionReport, name: str, case: int = 0) -> MetricResult:
    """One figure of a case."""
    return next(found for found in report.cases[case].metrics if found.name == name)


def blessed(folder: Path, cases: str = ONE) -> Suite:
    """A suite whose baseline is OPTIMIZED."""
    suite = suite_of(folder, cases)
    report = ran(suite, update=True)
    assert report.update is not None and report.update.written, report
    return suite
