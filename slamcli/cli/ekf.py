"""``slamcli ekf``: EKF-SLAM on a landmark graph, a simulation or a real sensor log."""

from __future__ import annotations

import os
import sys
from typing import Any

import click

from slamcli.cli.filter_options import (
    filter_options,
    log_of,
    log_options,
    options_of,
    scenario_of_input,
    unused_noise,
)
from slamcli.cli.inputs import INPUT_OR_WORLD
from slamcli.cli.options import FILE, check_outputs, json_option, warn
from slamcli.cli.process import interruptible, peak_memory, progress
from slamcli.errors import ExitCode, UsageError

_EXAMPLES = """\b
Examples:
  slamcli ekf graph.g2o --trajectory filtered.tum -o filtered.g2o
  slamcli ekf log.csv --truth truth.g2o --association jcbb
  slamcli ekf MRCLAM_Dataset6 --robot 1 --motion-noise 0.1,0.1,0.1,0.1,0.1,0.1 \\
      --noise range-bearing=0.2,3deg
  slamcli ekf scenario.yaml --runs 50 --jobs 2 --jacobians first-estimates

INPUT is a landmark graph, a CSV log of slamcli simulate, the folder or file of a real
log (docs/logs.md), or a scenario: a YAML file or the name of a world.

\b
Exit codes: 0 done, 2 usage or configuration, 3 invalid input, 5 numerical failure,
130 interrupted (the estimate so far is written).
"""
_OUTPUTS = ("output", "trajectory", "covariances", "landmark_covariances", "correlation", "trace")


@click.command(name="ekf", epilog=_EXAMPLES)
@click.argument("input", metavar="INPUT", type=INPUT_OR_WORLD)
@log_options
@click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="Set a key of the scenario.")
@filter_options
@click.option("-o", "--output", type=FILE, metavar="FILE", help="Write poses and landmarks as a graph.")
@click.option("--trajectory", type=FILE, metavar="FILE", help="Write the path (.tum, .kitti).")
@click.option("--covariances", type=FILE, metavar="FILE", help="Write the covariance of each pose at its step (npz).")
@click.option(
    "--landmark-covariances", type=FILE, metavar="FILE", help="Write the covariances of the landmarks at the end (npz)."
)
@click.option("--correlation", type=FILE, metavar="FILE", help="Write the correlation matrix at the end (npz).")
@click.option("--trace", type=FILE, metavar="FILE", help="Write one JSON line for each step; - is standard output.")
@click.option("--runs", type=click.IntRange(min=1), metavar="N", help="Mean NEES over N seeds of a scenario.")
@click.option("--jobs", type=click.IntRange(min=1), default=1, show_default=True, help="Processes for --runs.")
@click.option("-q", "--quiet", is_flag=True, help="Print no summary; warnings and errors remain.")
@json_option
def command(input: str, **given: Any) -> int:
    """Run EKF-SLAM on INPUT: one pass over the data, pose and landmarks in one state with full covariance.

    The motion and sensor models are those of the optimizer. Noise comes from the log where it states any, else from
    --motion-noise and --noise.
    """
    check_outputs(given, _OUTPUTS, json=given["json"], inputs=[input, given["truth"]])
    # thousands of small updates: waking BLAS threads takes longer than what they save. Read when numpy is loaded
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    if given["runs"]:
        return _monte_carlo(input, given)
    from slamcli.evaluation.filter_run import judge
    from slamcli.filtering.run import run
    from slamcli.reporting import documents
    from slamcli.reporting import ekf as reporting

    log = log_of(input, given)
    options = options_of(log, given)
    warn(unused_noise(log, given))
    events: list[dict[str, Any]] | None = [] if given["trace"] else None
    watch = None if events is None else lambda record: events.append(reporting.trace_event(record))
    with progress("filtering", len(log)) as tick, interruptible("step") as interrupted:
        result = run(log, options, on_step=watch, progress=lambda step: tick(), interrupted=interrupted)
    written = _write(result, log, events, given)  # before the truth is looked at, which may not fit
    scores = judge(result, log)
    if given["json"]:
        print(documents.dumps(reporting.ekf_document(log, options, result, scores, peak_memory())))
    elif not given["quiet"]:
        out = sys.stderr if "-" in (given[name] for name in _OUTPUTS) else sys.stdout
        print(*reporting.ekf_summary(log, result, scores, written, peak_memory()), sep="\n", file=out)
    return int(ExitCode.INTERRUPTED if result.interrupted else ExitCode.SUCCESS)


def _monte_carlo(path: str, given: dict[str, Any]) -> int:
    """Mean NEES over the seeds of a scenario."""
    from dataclasses import replace
    from functools import partial

    from slamcli.evaluation.monte_carlo import monte_carlo, simulated_log
    from slamcli.reporting import documents
    from slamcli.reporting import ekf as reporting

    scenario = scenario_of_input(path, given)
    if scenario is None:
        raise UsageError("--runs simulates a scenario: INPUT must be a YAML file or the name of a world")
    if any(given[name] for name in _OUTPUTS):
        raise UsageError("--runs prints a table and writes no file")
    scenarios = [replace(scenario, seed=scenario.seed + k) for k in range(given["runs"])]
    options = options_of(simulated_log(scenario), given)
    with progress("filtering", len(scenarios)) as tick:
        runs = monte_carlo(scenarios, partial(options_of, given=given), jobs=given["jobs"], tick=tick)
    if given["json"]:
        print(documents.dumps(reporting.monte_carlo_document(options, scenario.document(), runs)))
    else:
        print(*reporting.monte_carlo_table(runs), sep="\n")
    return 0


def _write(result: Any, log: Any, events: list[dict[str, Any]] | None, given: dict[str, Any]) -> str:
    """Write what was asked for; say where."""
    from slamcli.filtering.estimate import estimated_graph, estimated_trajectory, landmark_ids
    from slamcli.formats import write
    from slamcli.formats.covariances import write_correlation, write_covariances
    from slamcli.formats.source import write_bytes
    from slamcli.formats.trajectories import write_trajectory
    from slamcli.reporting import documents

    if given["output"]:
        write(estimated_graph(result), given["output"], dialect="g2o")
    if given["trajectory"]:
        write_trajectory(estimated_trajectory(result, log.source), given["trajectory"])
    if given["covariances"]:
        write_covariances(given["covariances"], result.ids, result.covariances)
    if given["landmark_covariances"]:
        write_covariances(given["landmark_covariances"], landmark_ids(result), result.landmarks.covariances)
    if given["correlation"]:
        write_correlation(given["correlation"], landmark_ids(result), result.correlation())
    if events is not None:
        first = {**documents.head("ekf"), "event": "start", "input": log.source}
        lines = [documents.dumps(event, indent=None) + "\n" for event in (first, *events)]
        write_bytes(given["trace"], "".join(lines).encode())
    return ", ".join(given[name] for name in _OUTPUTS if given[name]) or "nothing (-o FILE keeps the estimate)"
