"""The steps of one case: data (a file, or simulated and spoiled), a command, and the comparison with the truth.

A step is a command line of slamcli with ``--json``; its document is its result. So whatever a batch measures is what a
user gets from the same command lines.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from slamcli.batch.execution import Execution, Executor
from slamcli.errors import ExitCode
from slamcli.formats.configuration import load_mapping

#: Commands whose estimate is compared with the truth, as far as there is one.
ESTIMATORS = ("optimize", "ekf")
#: Exit codes with which such a command has written its estimate.
_WRITTEN = (ExitCode.SUCCESS, ExitCode.CHECK_FAILED, ExitCode.NOT_CONVERGED)

#: Operations of ``inject`` that make edges false; the others leave nothing to label.
FALSE = ("false_closures", "false_observations", "corrupt_odometry")

#: Values of options as YAML has them: true for a flag, a list for an option that is given several times.
Options = Mapping[str, Any]


@dataclass(frozen=True)
class Case:
    """What is run.

    Attributes
    ----------
    name
        Of the case; unique in a batch.
    command
        Of slamcli: ``optimize``, ``ekf``, ``sparsity``, ...
    options
        Of that command.
    data
        File that it reads; None where ``simulate`` makes one.
    simulate
        World or scenario file of ``slamcli simulate``, None where there is a file.
    simulation
        Options of ``simulate`` (``poses``, ``seed``, ``set``: a list of key=value, ...).
    inject
        Options of ``slamcli inject``; empty for none.
    truth
        File with the truth of ``data``; a simulation has its own.
    labels
        File that says which loop closures of ``data`` are false.
    evaluate
        Options of ``slamcli evaluate``, such as ``align``.
    time_limit
        Seconds for each step, None for no limit.
    """

    name: str
    command: str = "optimize"
    options: Options = field(default_factory=dict)
    data: str | None = None
    simulate: str | None = None
    simulation: Options = field(default_factory=dict)
    inject: Options = field(default_factory=dict)
    truth: str | None = None
    labels: str | None = None
    evaluate: Options = field(default_factory=dict)
    time_limit: float | None = None


@dataclass(frozen=True)
class Outcome:
    """What came of a case.

    Attributes
    ----------
    steps
        The executions by step: ``simulate``, ``inject``, the name of the command, ``evaluate``; those that did not
        take place are absent.
    command
        Name of the step that the case is about.
    failed
        Name of the step besides it that failed, None if none did.
    """

    steps: dict[str, Execution]
    command: str
    failed: str | None = None

    @property
    def exit_code(self) -> int:
        """Of the command, or of the step that failed before or after it."""
        return self.steps[self.failed or self.command].exit_code

    def document(self, step: str) -> dict[str, Any]:
        """Of a step; empty where it has none."""
        execution = self.steps.get(step)
        return {} if execution is None or execution.document is None else execution.document


def run(case: Case, folder: Path, execute: Executor) -> Outcome:
    """Run all steps of a case in a folder, which its files stay in; steps after one that failed do not take place."""
    steps: dict[str, Execution] = {}

    def ran(step: str, words: list[str]) -> bool:
        steps[step] = execute([step, *words, "--json"], folder, case.time_limit)
        return steps[step].exit_code == ExitCode.SUCCESS

    data, truth, labels = case.data, case.truth, case.labels
    ending = _ending(case)
    if case.simulate is not None:
        data, truth = f"graph{ending}", f"truth{ending}"
        if not ran("simulate", [case.simulate, *words_of(case.simulation), "-o", data, "--truth", truth]):
            return Outcome(steps, case.command, "simulate")
    if data is None:
        raise ValueError("a case needs data or a simulation")
    if case.inject:
        source, data = data, f"spoiled{ending}"
        words = [source, *words_of(case.inject), "-o", data]
        if any(name.replace("-", "_") in FALSE for name in case.inject):
            labels = "labels.csv"
            words += ["--labels", labels]
        if not ran("inject", words):
            return Outcome(steps, case.command, "inject")
    compared = case.command in ESTIMATORS and (truth is not None or labels is not None)
    estimate = f"estimate{ending}"
    outputs = ["-o", estimate] if compared else []
    rejecting = compared and labels is not None and case.command == "optimize"
    if rejecting and (case.options.get("robust", "none") != "none" or case.options.get("kernel", "none") != "none"):
        outputs += ["--labels-out", "estimated.csv"]
    ran(case.command, [data, *words_of(case.options), *outputs])
    if compared and steps[case.command].exit_code in _WRITTEN:
        words = [estimate, *words_of(case.evaluate)]
        words += ["--truth", truth] if truth is not None else []
        words += ["--labels", labels] if labels is not None else []
        words += ["--estimated-labels", "estimated.csv"] if "estimated.csv" in outputs else []
        if not ran("evaluate", words):
            return Outcome(steps, case.command, "evaluate")
    return Outcome(steps, case.command)


def _ending(case: Case) -> str:
    """Of the files of a case: scenes of cameras with distortion go into BAL only."""
    if case.simulate is None:
        return ".bal" if str(case.data).endswith((".bal", ".out")) else ".g2o"
    from slamcli.simulation.camera_scenes import CAMERA_WORLDS

    world: object = case.simulate
    if Path(case.simulate).suffix in (".yaml", ".yml") and Path(case.simulate).is_file():
        world = load_mapping(case.simulate).get("world")
    return ".bal" if world in CAMERA_WORLDS else ".g2o"


def words_of(options: Options) -> list[str]:
    """Words of a command line: ``{method: lm, certify: true, restart: false, fix: [1, 2]}`` gives
    ``--method lm --certify --no-restart --fix 1 --fix 2``.
    """
    words: list[str] = []
    for name, value in options.items():
        flag = name.replace("_", "-")
        if value is True:
            words.append(f"--{flag}")
        elif value is False:
            words.append(f"--no-{flag}")
        elif value is not None:
            for item in value if isinstance(value, list | tuple) else [value]:
                words += [f"--{flag}", str(item)]
    return words
