"""``slamcli inject``: spoil a graph on purpose, and say which edges are outliers."""

from __future__ import annotations

import os
import re
import sys
from typing import Any

import click

from slamcli.cli.inputs import INPUT
from slamcli.cli.options import FILE, check_outputs, input_options, json_option, warn
from slamcli.cli.quantities import Numbers
from slamcli.errors import UsageError

_EXAMPLES = """\b
Examples:
  slamcli inject graph.g2o -o spoiled.g2o --false-closures 100 --labels labels.csv
  slamcli inject graph.g2o -o spoiled.g2o --false-closures 20% --policy aliased
  slamcli inject graph.g2o -o worse.g2o --perturb 0.1,5deg --drop-closures 50%
  slamcli inject graph.g2o -o - --corrupt-odometry 3 | slamcli optimize -

\b
Exit codes: 0 success, 2 usage (also: more than the graph can give), 3 invalid input.
No graph is written then.
"""

#: Options that say how, and the options one of which they need.
_NEEDS = {
    "policy": ("false_closures",),
    "group_size": ("false_closures",),
    "information": ("false_closures",),
    "truth": ("false_closures", "false_observations"),
    "magnitude": ("corrupt_odometry",),
    "scale": ("scale_information",),
}
_OPERATIONS = (
    "false_closures",
    "false_observations",
    "corrupt_odometry",
    "drop_closures",
    "scale_information",
    "perturb",
)
_GROUPED = ("grouped", "random-grouped", "aliased")


class _AmountType(click.ParamType):  # type: ignore[type-arg]  # generic only in click 8.5
    """``N`` or ``P%``."""

    name = "amount"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """An ``Amount``."""
        from slamcli.simulation.injection import Amount

        if isinstance(value, Amount):
            return value
        text = str(value).strip()
        if re.fullmatch(r"\d{1,12}", text, re.ASCII):
            return Amount(float(text))
        if re.fullmatch(r"(\d{1,9}\.?\d*|\.\d+)%", text, re.ASCII):
            return Amount(float(text[:-1]), percent=True)
        self.fail(f"expected a whole number or a percentage such as 10%, not negative, found {text!r}", param, ctx)


class _RangeType(click.ParamType):  # type: ignore[type-arg]
    """``N`` or ``LOW-HIGH``."""

    name = "range"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        """Smallest and largest."""
        if isinstance(value, tuple):
            return value
        match = re.fullmatch(r"(\d{1,6})(?:-(\d{1,6}))?", value.strip(), re.ASCII)
        if match is None or not 1 <= int(match[1]) <= int(match[2] or match[1]):
            self.fail(f"expected a length or LOW-HIGH, such as 10-20, found {value!r}", param, ctx)
        return int(match[1]), int(match[2] or match[1])


class _SigmaType(click.ParamType):  # type: ignore[type-arg]
    """``M`` or ``M,RAD``: a translation, and a rotation that is the same number where it is left out."""

    name = "sigma"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, float]:
        """Both numbers in SI units."""
        units = ("m", "rad") if "," in str(value) else ("m",)
        numbers = Numbers(*units, minimum=0.0).convert(value, param, ctx)
        return numbers[0], numbers[-1]


@click.command(name="inject", epilog=_EXAMPLES)
@input_options
@click.option("-o", "--output", type=FILE, required=True, metavar="FILE", help="Write the graph; - is standard output.")
@click.option("--labels", type=FILE, metavar="FILE", help="Write which edges are outliers, as CSV.")
@click.option(
    "--false-closures", type=_AmountType(), metavar="N|P%", help="Add false loop closures; P% of the true ones."
)
@click.option(
    "--policy",
    type=click.Choice(["random", "local", "grouped", "random-grouped", "aliased"]),
    default="random",
    show_default=True,
    help="Where: between any two poses; two near in time; runs of either; runs between places that look alike.",
)
@click.option(
    "--group-size",
    type=_RangeType(),
    default="10-20",
    show_default=True,
    metavar="N|LOW-HIGH",
    help="Closures in a run.",
)
@click.option(
    "--information",
    type=Numbers(minimum=0.0),
    metavar="I,...",
    help="Diagonal of the information of false closures.  [default: that of the true ones]",
)
@click.option(
    "--truth",
    type=INPUT,
    metavar="FILE",
    help="Graph that false edges must contradict.  [default: the values of INPUT or its optimum]",
)
@click.option(
    "--false-observations",
    type=_AmountType(),
    metavar="N|P%",
    help="Attach observations to the wrong landmark; P% of them all.",
)
@click.option(
    "--corrupt-odometry", type=_AmountType(), metavar="N|P%", help="Gross errors on odometry edges; P% of them all."
)
@click.option(
    "--magnitude",
    type=float,
    default=1.0,
    show_default=True,
    help="How gross: 1 is 0.5 to 1.5 steps and 30 to 90 degrees.",
)
@click.option("--drop-closures", type=_AmountType(), metavar="N|P%", help="Remove loop closures; P% of them all.")
@click.option("--scale-information", type=float, metavar="F", help="Multiply information matrices by F.")
@click.option(
    "--scale",
    type=click.Choice(["all", "odometry", "closures"]),
    default="all",
    show_default=True,
    help="Of which edges.",
)
@click.option(
    "--perturb",
    type=_SigmaType(),
    metavar="SIGMA",
    help="Noise on the guess: M (metres, as many radians) or M,RAD, as 0.1,5deg.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of all random numbers.")
@click.option("-q", "--quiet", is_flag=True, help="Print no summary; warnings and errors remain.")
@json_option
@click.pass_context
def command(context: click.Context, /, input: str, **given: Any) -> int:
    """Spoil the graph INPUT (g2o or TORO, - is standard input) on purpose: outliers, worse edges, a worse guess.

    Edges that are not touched keep their bytes; new ones go to the end. The same seed gives the same files. The order
    of the operations is that of the options below; each has random numbers of its own.
    """
    _check_streams(input, given)
    _check_needs(context, given)
    return _inject(input, given)


def _inject(path: str, given: dict[str, Any]) -> int:
    from slamcli.formats import read, write
    from slamcli.formats.labels import labels_of, write_labels
    from slamcli.formats.recognize import of_ending
    from slamcli.graph import analyze
    from slamcli.reporting import injection as report
    from slamcli.reporting.documents import dumps
    from slamcli.reporting.summaries import reading_warnings
    from slamcli.simulation.injection import inject
    from slamcli.simulation.reference import from_graph, from_truth

    graph = read(path, dialect=given["dialect"], lenient=given["lenient"])
    warn(reading_warnings(graph.report))
    options = _options(given)
    truth = read(given["truth"]) if given["truth"] else None
    injected = inject(graph, options, from_graph if truth is None else lambda g: from_truth(g, truth, given["truth"]))
    warn(report.inject_warnings(injected))
    output, labels = given["output"], given["labels"]
    losses = write(injected.graph, output)
    own = graph.report.format if graph.report else None
    if of_ending(output) not in (None, own):
        losses.append(f"{output} holds {own}, the format of the input: slamcli convert changes it")
    warn(losses)
    if labels:
        write_labels(labels, *labels_of(injected.graph, injected.outliers))
    if given["json"]:
        print(dumps(report.inject_document(graph, analyze(graph), injected, options, output, labels)))
    elif not given["quiet"]:
        out = sys.stderr if "-" in (output, labels) else sys.stdout
        print(*report.inject_summary(graph, injected, options, output, labels), sep="\n", file=out)
    return 0


def _options(given: dict[str, Any]) -> Any:
    from slamcli.simulation.injection import InjectOptions

    names = (*_OPERATIONS, "policy", "group_size", "information", "magnitude", "scale", "seed")
    return InjectOptions(**{name: given[name] for name in names})


def _check_needs(context: click.Context, given: dict[str, Any]) -> None:
    """Something to do, and no option without what it belongs to."""
    if all(given[name] is None for name in _OPERATIONS):
        listed = ", ".join(f"--{name.replace('_', '-')}" for name in _OPERATIONS)
        raise UsageError("nothing to do", (f"  give one or more of {listed}",))
    default = click.core.ParameterSource.DEFAULT
    for name, needed in _NEEDS.items():
        if context.get_parameter_source(name) is not default and all(given[need] is None for need in needed):
            wanted = " or ".join(f"--{need.replace('_', '-')}" for need in needed)
            raise UsageError(f"--{name.replace('_', '-')} does nothing without {wanted}")
    if context.get_parameter_source("group_size") is not default and given["policy"] not in _GROUPED:
        raise UsageError(f"--group-size does nothing with --policy {given['policy']}")


def _check_streams(path: str, given: dict[str, Any]) -> None:
    """Standard output carries one thing, standard input too, and no file is overwritten by another.

    The graph may go where it came from.
    """
    check_outputs(given, ("output", "labels"), json=given["json"])
    if path == "-" and given["truth"] == "-":
        raise UsageError("INPUT and --truth both want standard input")
    files = {"INPUT": path, "--truth": given["truth"], "--output": given["output"], "--labels": given["labels"]}
    real = {name: os.path.realpath(file) for name, file in files.items() if file not in (None, "-")}
    for one, other in (("INPUT", "--labels"), ("--truth", "--labels"), ("--truth", "--output")):
        if one in real and real[one] == real.get(other):
            raise UsageError(f"{one} and {other} name the same file")
