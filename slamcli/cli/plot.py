"""``slamcli plot``: figures of graphs, trajectories, iterations and errors."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from slamcli.cli.inputs import INPUT
from slamcli.cli.options import DIALECTS, FILE, warn
from slamcli.errors import InputError, UsageError
from slamcli.reporting.text import plural

if TYPE_CHECKING:
    from slamcli.evaluation.alignment import Alignment
    from slamcli.graph import FactorGraph
    from slamcli.graph.trajectory import Trajectory
    from slamcli.reporting.plots.scene import Estimate

#: Options that change nothing but maps.
_FOR_MAPS = ("truth", "align", "view", "color_by", "closures", "labels", "covariances", "dialect", "lenient")

#: Of a picture, from edge to edge: 1.6 GB where both are so many.
_MOST_PIXELS = 20_000

_EXAMPLES = """\b
Examples:
  slamcli plot graph.g2o -o map.png
  slamcli plot before.g2o after.g2o --truth truth.g2o -o map.pdf
  slamcli plot graph.g2o --color-by chi2 -o worst.svg
  slamcli plot gn.jsonl lm.jsonl -x time --names Gauss-Newton,Levenberg -o chi2.png
  slamcli plot errors.csv -o errors.png

\b
Exit codes: 0 success, 2 usage, 3 invalid input, 5 the alignment is not determined;
nothing is written unless the code is 0.
"""


@click.command(name="plot", epilog=_EXAMPLES)
@click.argument("inputs", metavar="INPUT...", type=INPUT, nargs=-1, required=True)
@click.option(
    "-o", "--output", type=FILE, required=True, metavar="FILE", help="Picture: .png, .svg or .pdf; - is PNG on stdout."
)
@click.option("--truth", type=INPUT, metavar="FILE", help="Graph or trajectory to draw dark and dashed.")
@click.option(
    "--align",
    type=click.Choice(["none", "origin", "se", "sim"]),
    default="none",
    show_default=True,
    help="Move each INPUT onto the truth: by the first pose, rotation and translation, or these and the scale.",
)
@click.option(
    "--view",
    type=click.Choice(["auto", "3d", "xy", "xz", "yz"]),
    default="auto",
    show_default=True,
    help="What a map shows. auto: 3d where an input is in space, else xy.",
)
@click.option(
    "--color-by",
    type=click.Choice(["none", "chi2"]),
    default="none",
    show_default=True,
    help="Colour the edges of a graph by their chi2, the worst on top.",
)
@click.option(
    "--closures/--no-closures",
    default=None,
    help="Draw loop closures and observations of landmarks.  [default: with a single INPUT]",
)
@click.option("--labels", type=FILE, metavar="FILE", help="Which edges are false, to draw those in another colour.")
@click.option(
    "--covariances",
    type=FILE,
    multiple=True,
    metavar="FILE",
    help="Draw 95 % regions of landmarks and some poses: npz with ids, covariance, frame; once for each kind.",
)
@click.option(
    "-x",
    "--x-axis",
    type=click.Choice(["auto", "iteration", "time", "distance"]),
    default="auto",
    show_default=True,
    help="Of iterations: iteration (auto) or time. Of errors: time (auto, where it is known) or distance.",
)
@click.option("--names", metavar="A,B,...", help="Names for the legend.  [default: the names of the files]")
@click.option("--title", metavar="TEXT", help="Title; an empty one for none.")
@click.option("--size", metavar="W,H", help="Width and height in inches.  [default: to suit the data]")
@click.option(
    "--dpi",
    type=click.IntRange(min=20, max=1200),
    default=150,
    show_default=True,
    help="Pixels per inch; those of dense layers in .svg and .pdf.",
)
@click.option("--dialect", type=click.Choice(DIALECTS), help="Format of graphs.  [default: recognized by content]")
@click.option("--lenient", is_flag=True, help="Skip and count malformed records of graphs instead of stopping.")
@click.pass_context
def command(context: click.Context, /, inputs: tuple[str, ...], output: str, **given: Any) -> int:
    """Draw each INPUT... into one figure: a map, iterations or errors, as the content of the files has it.

    Graphs and trajectories become a map with equal scales. Traces and JSON documents of optimize become chi2 over
    the iterations, CSV files of evaluate --errors errors over time.
    """
    size = _size(given["size"])
    _check_pixels(size, given["dpi"])
    _check_inputs(inputs, given)
    from slamcli.formats.source import write_bytes
    from slamcli.reporting.plots.files import format_of, render
    from slamcli.reporting.plots.inputs import one_kind
    from slamcli.reporting.plots.style import house_style

    file_format = format_of(output)
    kind = one_kind(inputs)
    _refuse_useless(kind, context)
    common = {"title": given["title"], "size": size, "dpi": given["dpi"]}
    draw = {"map": _map, "iterations": _iterations, "errors": _errors}[kind]
    with house_style():
        data, notes = render(draw(inputs, given, common), file_format, given["dpi"])
    warn(notes)
    write_bytes(output, data)
    return 0


def _map(inputs: tuple[str, ...], given: dict[str, Any], common: dict[str, Any]) -> Any:
    from slamcli.reporting.plots.maps import MapOptions, draw_map
    from slamcli.reporting.plots.regions import read_regions

    names = _names(given["names"], _short(inputs), "INPUT")
    trajectories = [_read(path, given) for path in inputs]
    estimates = [_estimate(*pair, given["labels"]) for pair in zip(trajectories, names, strict=True)]
    regions = None
    if given["covariances"]:
        regions = read_regions(given["covariances"], _graph(trajectories[0], "--covariances"))
    truth = None
    if given["truth"]:
        true = _read(given["truth"], given)
        truth = _estimate(true, os.path.basename(given["truth"]))
        alignments = [_alignment(trajectory, true, given["align"]) for trajectory in trajectories]
        estimates = [estimate.moved(found) for estimate, found in zip(estimates, alignments, strict=True)]
        regions = regions and regions.moved(alignments[0])
    options = MapOptions(**common, view=given["view"], color_by=given["color_by"], closures=given["closures"])
    return draw_map(estimates, truth, regions, options)


def _read(path: str, given: dict[str, Any]) -> Trajectory:
    from slamcli.formats.trajectories import read_trajectory
    from slamcli.reporting import summaries

    trajectory = read_trajectory(path, dialect=given["dialect"], lenient=given["lenient"], empty_ok=True)
    if trajectory.graph is not None:
        warn(summaries.reading_warnings(trajectory.graph.report))
    warn(list(trajectory.notes))
    return trajectory


def _estimate(trajectory: Trajectory, name: str, labels: str | None = None) -> Estimate:
    from slamcli.reporting.plots.scene import estimate_of

    outliers = None
    if labels is not None:
        from slamcli.formats.labels import outlier_masks, read_labels

        graph = _graph(trajectory, "--labels")
        outliers = outlier_masks(read_labels(labels), graph, labels)
    estimate = estimate_of(trajectory, name, outliers)
    warn(estimate.notes)
    if not len(estimate.points):
        hint = "  slamcli optimize --init odometry -o FILE places the poses that only edges name"
        raise InputError(f"{trajectory.source}: nothing in it has a finite position", (hint,))
    return estimate


def _alignment(trajectory: Trajectory, truth: Trajectory, method: str) -> Alignment:
    from slamcli.evaluation.alignment import align
    from slamcli.evaluation.association import associate
    from slamcli.models import SE2

    if method == "none":
        return align(trajectory.lifted(), truth.lifted(), method)
    pairs = associate(trajectory, truth)
    planar = trajectory.kind is SE2 and truth.kind is SE2
    return align(trajectory.lifted()[pairs.estimate], truth.lifted()[pairs.truth], method, planar)


def _graph(trajectory: Trajectory, option: str) -> FactorGraph:
    if trajectory.graph is None:
        raise UsageError(f"{option} needs a graph; {trajectory.source} is a trajectory")
    return trajectory.graph


def _iterations(inputs: tuple[str, ...], given: dict[str, Any], common: dict[str, Any]) -> Any:
    from slamcli.reporting.plots.inputs import read_runs
    from slamcli.reporting.plots.iterations import AXES, draw_iterations
    from slamcli.reporting.plots.style import FigureOptions

    runs = [run for path, name in zip(inputs, _short(inputs), strict=True) for run in read_runs(path, name)]
    names = _names(given["names"], [run.name for run in runs], "run")
    x_axis = _x_axis(given["x_axis"], AXES, "iterations")
    runs = [replace(run, name=name) for run, name in zip(runs, names, strict=True)]
    return draw_iterations(runs, x_axis, FigureOptions(**common))


def _errors(inputs: tuple[str, ...], given: dict[str, Any], common: dict[str, Any]) -> Any:
    from slamcli.reporting.plots.errors import AXES, draw_errors
    from slamcli.reporting.plots.inputs import read_errors
    from slamcli.reporting.plots.style import FigureOptions

    series = [one for path, name in zip(inputs, _short(inputs), strict=True) for one in read_errors(path, name)]
    names = _names(given["names"], _short([one.name for one in series]), "estimate")
    x_axis = _x_axis(given["x_axis"], ("auto", *AXES), "errors")
    series = [replace(one, name=name) for one, name in zip(series, names, strict=True)]
    return draw_errors(series, x_axis, FigureOptions(**common))


def _short(paths: Sequence[str]) -> list[str]:
    """Names of the files without their folders, where that tells them apart."""
    short = ["standard input" if path == "-" else os.path.basename(path) for path in paths]
    return short if len(set(short)) == len(short) else list(paths)


def _names(given: str | None, default: Sequence[str], noun: str) -> list[str]:
    if given is None:
        return list(default)
    names = [name.strip() for name in given.split(",")]
    if len(names) != len(default):
        raise UsageError(f"--names has {plural(len(names), 'name')} for {plural(len(default), noun)}")
    return names


def _x_axis(given: str, known: Sequence[str], kind: str) -> str:
    if given == "auto":
        return known[0]
    if given not in known:
        choices = " or ".join(name for name in known if name != "auto")
        raise UsageError(f"--x-axis {given} is not for {kind}", (f"  expected {choices}",))
    return given


def _size(given: str | None) -> tuple[float, float] | None:
    if given is None:
        return None
    try:
        width, height = (float(word) for word in given.split(","))
    except ValueError:
        width = height = 0.0
    if not (1.0 <= width <= 100.0 and 1.0 <= height <= 100.0):
        raise UsageError(f"--size {given}: expected width and height in inches, from 1 to 100", ("  such as 7,5",))
    return width, height


def _check_pixels(size: tuple[float, float] | None, dpi: int) -> None:
    """A picture has to fit into memory, and a viewer has to open it."""
    pixels = [round(side * dpi) for side in size or (0.0, 0.0)]
    if max(pixels) > _MOST_PIXELS:
        raise UsageError(
            f"--size and --dpi make {pixels[0]} x {pixels[1]} pixels, more than {_MOST_PIXELS} in one direction",
            ("  a smaller --size or --dpi",),
        )


def _check_inputs(inputs: tuple[str, ...], given: dict[str, Any]) -> None:
    """Standard input can be read once, and some options need a single graph."""
    named = [*inputs, given["truth"], given["labels"], *given["covariances"]]
    if named.count("-") > 1 or "-" in (given["truth"], given["labels"], *given["covariances"]):
        raise UsageError("only one INPUT can be - (standard input)")
    if given["align"] != "none" and not given["truth"]:
        raise UsageError("--align needs --truth, the trajectory to align with")
    for name, wanted in (("labels", given["labels"]), ("color-by chi2", given["color_by"] == "chi2")):
        if wanted and len(inputs) > 1:
            raise UsageError(f"--{name} is for a single graph, got {len(inputs)} inputs")


def _refuse_useless(kind: str, context: click.Context) -> None:
    """An option that has no effect on this kind of figure is a mistake."""
    from slamcli.reporting.plots.inputs import KINDS

    for name in ("x_axis",) if kind == "map" else _FOR_MAPS:
        if context.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE:
            option = f"--{name.replace('_', '-')}"
            raise UsageError(f"{option} has no meaning here: the input is {KINDS[kind]}")
