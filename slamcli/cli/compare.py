"""``slamcli compare``: dead reckoning, filter and smoother on the same data."""

from __future__ import annotations

import sys
from typing import Any

import click

from slamcli.cli.filter_options import filter_options, log_of, log_options, options_of, unused_noise
from slamcli.cli.inputs import INPUT_OR_WORLD
from slamcli.cli.options import FILE, check_outputs, json_option, warn
from slamcli.errors import UsageError

_EXAMPLES = """\b
Examples:
  slamcli compare square --set landmarks.count=30 -o compare.png
  slamcli compare graph.g2o --truth truth.g2o --corrections corrections.csv
  slamcli compare victoriaPark.g2o --closure largest --json
  slamcli compare --scaling 100,200,400,800

\b
Exit codes: 0 success, 2 usage, 3 invalid input, 5 numerical failure (a filter or
smoother that diverged).
"""
_STAGES = 4
#: What belongs to a comparison, and not to --scaling.
_OF_A_LOG = ("output", "corrections", "truth", "robot", "dialect", "settings")


@click.command(name="compare", epilog=_EXAMPLES)
@click.argument("input", metavar="INPUT", required=False, type=INPUT_OR_WORLD)
@log_options
@click.option(
    "--align",
    type=click.Choice(["none", "origin", "se"]),
    default="none",
    show_default=True,
    help="Before comparing with the truth: nothing, the first pose, or rotation and translation (then no NEES).",
)
@click.option(
    "--closure",
    default="last",
    show_default=True,
    metavar="last|largest|ID",
    help="The loop closure to take apart: the last, the one at which the filter jumps farthest, or that of a pose.",
)
@click.option("--corrections", type=FILE, metavar="FILE", help="Write by how much it moves each pose, as CSV.")
@click.option("-o", "--output", type=FILE, metavar="FILE", help="Draw paths, uncertainty, corrections: .png .svg .pdf.")
@click.option(
    "--dpi", type=click.IntRange(20, 1200), default=150, show_default=True, help="Pixels for each inch of a picture."
)
@click.option("--scaling", metavar="N,N,...", help="Instead of INPUT: simulated worlds of so many landmarks each.")
@click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="Set a key of the scenario.")
@filter_options
@json_option
def command(input: str | None, **given: Any) -> int:
    """Dead reckoning, EKF and smoother on the data of INPUT, with the same models and the same noise.

    INPUT is a landmark graph, a sensor log (docs/logs.md) or a scenario: a YAML file or the name of a world. Prints
    errors against the truth, consistency, time and memory, and what one loop closure does to every pose.
    """
    check_outputs(given, ("output", "corrections"), json=given["json"], inputs=[input, given["truth"]])
    if given["scaling"] is not None:
        return _scaling(input, given)
    if input is None:
        raise UsageError("compare needs an INPUT, or --scaling", ("  slamcli compare square --set landmarks.count=30",))
    return _compare(input, given)


def _compare(path: str, given: dict[str, Any]) -> int:
    from slamcli.batch.compare import compare
    from slamcli.cli.process import progress
    from slamcli.formats.source import write_bytes
    from slamcli.reporting import comparison as reporting
    from slamcli.reporting import documents

    picture, closure = _format(given["output"]), _closure(given["closure"])
    log = log_of(path, given)
    options = options_of(log, given)
    warn(unused_noise(log, given))
    with progress("comparing", _STAGES) as tick:
        found = compare(log, options, align=given["align"], closure=closure, tick=tick)
    if given["corrections"]:
        if found.closure is None:
            warn([f"there is no loop closure: nothing is written to {given['corrections']}"])
        else:
            write_bytes(given["corrections"], reporting.corrections_csv(found.closure))
    if picture is not None:
        write_bytes(given["output"], _drawn(found, picture, given["dpi"]))
    if given["json"]:
        print(documents.dumps(reporting.comparison_document(found)))
        return 0
    out = sys.stderr if "-" in (given["output"], given["corrections"]) else sys.stdout
    print(*reporting.comparison_summary(found), sep="\n", file=out)
    return 0


def _scaling(path: str | None, given: dict[str, Any]) -> int:
    from slamcli.batch.scaling import scaling
    from slamcli.cli.process import progress
    from slamcli.reporting import comparison as reporting
    from slamcli.reporting import documents

    if path is not None:
        raise UsageError(f"--scaling simulates its own worlds: it takes no INPUT, got {path!r}")
    for name in _OF_A_LOG:
        if given[name]:
            raise UsageError(f"--{'set' if name == 'settings' else name} has no meaning with --scaling")
    try:
        counts = [int(word) for word in given["scaling"].split(",")]
    except ValueError:
        raise UsageError(f"--scaling needs numbers of landmarks between commas, got {given['scaling']!r}") from None
    with progress("comparing", len(set(counts))) as tick:
        found = scaling(counts, lambda log: options_of(log, given), tick=tick)
    if given["json"]:
        print(documents.dumps(reporting.scaling_document(found)))
    else:
        print(*reporting.scaling_summary(found), sep="\n")
    return 0


def _closure(choice: str) -> str | int:
    if choice in ("last", "largest"):
        return choice
    try:
        return int(choice)
    except ValueError:
        raise UsageError(f"--closure {choice!r}: expected last, largest or the id of a pose") from None


def _format(path: str | None) -> str | None:
    """Format of the picture, told before anything is computed."""
    if path is None:
        return None
    from slamcli.reporting.plots.files import format_of

    return format_of(path)


def _drawn(found: Any, kind: str, dpi: int) -> bytes:
    from slamcli.reporting.plots.comparison import draw_comparison
    from slamcli.reporting.plots.files import render
    from slamcli.reporting.plots.style import FigureOptions, house_style

    options = FigureOptions(dpi=dpi)
    with house_style():
        data, notes = render(draw_comparison(found, options), kind, options.dpi)
    warn(notes)
    return data
