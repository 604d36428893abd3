"""``slamcli evaluate``: estimates against the truth."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import click

from slamcli.cli.inputs import INPUT
from slamcli.cli.options import DIALECTS, FILE, check_outputs, color_option, json_option, use_color, warn
from slamcli.errors import InputError, UsageError

if TYPE_CHECKING:
    from slamcli.evaluation import Evaluation
    from slamcli.graph.trajectory import Trajectory

_EXAMPLES = """\b
Examples:
  slamcli evaluate optimized.g2o --truth truth.g2o
  slamcli evaluate gn.g2o gnc.g2o --truth truth.tum --timestamps stamps.txt
  slamcli evaluate graph.g2o --dead-reckoning --truth truth.g2o -o errors.csv
  slamcli evaluate optimized.g2o --labels labels.csv --json

\b
Exit codes: 0 success, 2 usage, 3 invalid input or no pose to compare, 5 the
positions do not determine the alignment.
"""


@click.command(name="evaluate", epilog=_EXAMPLES)
@click.argument("estimates", metavar="ESTIMATE...", nargs=-1, required=True, type=INPUT)
@click.option("--truth", type=INPUT, metavar="FILE", help="The true poses, in any format that slamcli reads.")
@click.option(
    "--align",
    type=click.Choice(["none", "origin", "se", "sim"]),
    help="Before comparing: nothing, the first pose, rotation and translation, these and the scale (Umeyama).  "
    "[default: se; none with --covariances]",
)
@click.option(
    "--associate",
    type=click.Choice(["auto", "id", "time", "index"]),
    default="auto",
    show_default=True,
    help="How poses find their partners. auto: by time if both have stamps, else by id, else (KITTI) by index.",
)
@click.option("--timestamps", type=FILE, metavar="FILE", help="Stamps for the estimates, one a line, by order of id.")
@click.option("--truth-timestamps", type=FILE, metavar="FILE", help="The same for the truth.")
@click.option(
    "--max-time-difference",
    type=float,
    default=0.01,
    show_default=True,
    metavar="S",
    help="Seconds between the stamps of two poses that belong together.",
)
@click.option(
    "--delta",
    type=float,
    multiple=True,
    metavar="X",
    help="Relative errors over this distance; may be given several times.  [default: 1]",
)
@click.option(
    "--delta-unit",
    type=click.Choice(["frames", "m", "deg", "rad"]),
    default="frames",
    show_default=True,
    help="Unit of --delta: poses, metres along the path, or angle.",
)
@click.option("--all-pairs", is_flag=True, help="Let every pose start a pair, not only the end of the pair before.")
@click.option("--dead-reckoning", is_flag=True, help="Evaluate the integrated odometry of each graph beside it.")
@click.option("--labels", type=FILE, metavar="FILE", help="Which loop closures are false: precision, recall, F1.")
@click.option(
    "--estimated-labels",
    type=FILE,
    metavar="FILE",
    help="Which closures the estimate rejects (optimize --labels-out), instead of the gate.",
)
@click.option(
    "--gate",
    type=float,
    default=0.99,
    show_default=True,
    metavar="P",
    help="A closure counts as accepted if its chi2 is below this quantile.",
)
@click.option(
    "--covariances", type=FILE, metavar="FILE", help="Covariances of the estimate's poses (npz or CSV): NEES."
)
@click.option("-o", "--errors", type=FILE, metavar="FILE", help="Write the errors of each pose as CSV.")
@click.option("--dialect", type=click.Choice(DIALECTS), help="Format of ESTIMATE.  [default: by content]")
@click.option("--lenient", is_flag=True, help="Skip, count and show malformed records instead of stopping at them.")
@json_option
@color_option
def command(estimates: tuple[str, ...], truth: str | None, **given: Any) -> int:
    """Compare ESTIMATE... with the truth: absolute and relative pose errors, drift, landmarks, loop closures.

    Estimates and truth are graphs or trajectories (TUM, KITTI, EuRoC, x y theta), recognized by content; - is standard
    input. The figures are those of evo. Without --truth, only what needs none is reported.
    """
    _check(estimates, truth, given)
    from slamcli.evaluation import EvaluateOptions, evaluate
    from slamcli.formats.covariances import read_covariances
    from slamcli.formats.labels import read_labels
    from slamcli.formats.trajectories import read_trajectory

    options = EvaluateOptions(
        align=given["align"] or ("none" if given["covariances"] else "se"),
        associate=given["associate"],
        max_time_difference=given["max_time_difference"],
        deltas=given["delta"] or (1.0,),
        delta_unit=given["delta_unit"],
        all_pairs=given["all_pairs"],
        gate=given["gate"],
    )
    true = None
    if truth is not None:
        true = _said(read_trajectory(truth, lenient=given["lenient"], timestamps=given["truth_timestamps"]))
    evaluation = evaluate(
        list(_estimates(estimates, given)),
        true,
        options=options,
        labels=read_labels(given["labels"]) if given["labels"] else None,
        estimated_labels=read_labels(given["estimated_labels"]) if given["estimated_labels"] else None,
        covariances=read_covariances(given["covariances"]) if given["covariances"] else None,
    )
    _report(evaluation, given)
    return 0


def _check(estimates: tuple[str, ...], truth: str | None, given: dict[str, Any]) -> None:
    """Options that need each other, and streams that carry one thing."""
    if truth is None:
        for name in ("truth_timestamps", "covariances", "errors"):
            if given[name]:
                raise UsageError(f"--{name.replace('_', '-')} needs --truth")
    if given["covariances"] and len(estimates) > 1:
        raise UsageError("--covariances belong to one estimate")
    if given["estimated_labels"]:
        if not given["labels"]:
            raise UsageError("--estimated-labels needs --labels, which says what is true")
        if len(estimates) > 1:
            raise UsageError("--estimated-labels belong to one estimate")
    names = ("timestamps", "truth_timestamps", "labels", "estimated_labels")
    readers = [*estimates, *(given[name] for name in names), truth]
    if readers.count("-") > 1:
        raise UsageError("only one file can come from standard input")
    check_outputs(given, ("errors",), json=given["json"], inputs=[*readers, given["covariances"]])


def _estimates(paths: tuple[str, ...], given: dict[str, Any]) -> Iterator[Trajectory]:
    """Each estimate, and behind it its dead reckoning where that was asked for."""
    from slamcli.formats.trajectories import read_trajectory, with_stamps

    reckoned = stamped = False
    for path in paths:
        estimate = read_trajectory(
            path, dialect=given["dialect"], lenient=given["lenient"], empty_ok=given["dead_reckoning"]
        )
        if given["timestamps"] and estimate.stamps is None and len(estimate):
            stamped = True
            estimate = with_stamps(estimate, given["timestamps"])
        _said(estimate)
        if len(estimate):
            yield estimate
        if given["dead_reckoning"]:
            integrated = _dead_reckoning(estimate, given["timestamps"])
            if integrated is not None:
                reckoned = True
                yield integrated
    if given["dead_reckoning"] and not reckoned:
        raise UsageError("--dead-reckoning needs a graph with edges between poses")
    if given["timestamps"] and not (stamped or reckoned):
        raise UsageError("--timestamps: every estimate has time stamps of its own")


def _dead_reckoning(estimate: Trajectory, timestamps: str | None) -> Trajectory | None:
    """The integrated odometry of a graph, None where there is no odometry."""
    from dataclasses import replace

    from slamcli.evaluation import dead_reckoning
    from slamcli.formats.trajectories import with_stamps
    from slamcli.graph.trajectory import of_graph

    graph = estimate.graph
    if graph is None or not any(factors.kind.relative_pose for factors in graph.factors):
        warn([f"{estimate.source}: holds no edges between poses, so no dead reckoning"])
        if len(estimate) == 0:
            raise InputError(f"{estimate.source}: holds no pose with a value and no edge between poses")
        return None
    if len(estimate) == 0:
        warn([f"{estimate.source}: holds no pose with a value: only its dead reckoning is evaluated"])
    out = of_graph(dead_reckoning(graph), f"dead reckoning of {estimate.source}")
    if estimate.stamps is not None and len(out) == len(estimate):
        return replace(out, stamps=estimate.stamps)
    return with_stamps(out, timestamps) if timestamps else out


def _said(trajectory: Trajectory) -> Trajectory:
    """The trajectory, after what its reader skipped or assumed has been printed."""
    from slamcli.reporting.summaries import reading_warnings

    report = trajectory.graph.report if trajectory.graph is not None else None
    warn([f"{trajectory.source}: {line}" for line in reading_warnings(report)])
    warn(list(trajectory.notes))
    return trajectory


def _report(evaluation: Evaluation, given: dict[str, Any]) -> None:
    from slamcli.formats.source import write_bytes
    from slamcli.reporting import documents
    from slamcli.reporting.evaluation import errors_csv, evaluation_document, evaluation_summary

    warn(evaluation.notes)
    if given["errors"]:
        write_bytes(given["errors"], errors_csv(evaluation))
    if given["json"]:
        print(documents.dumps(evaluation_document(evaluation)))
        return
    out = sys.stderr if given["errors"] == "-" else sys.stdout
    print(*evaluation_summary(evaluation, use_color(given["color"], out)), sep="\n", file=out)
