"""``slamcli convert``: between g2o, TORO, BAL and Bundler, and to PLY."""

from __future__ import annotations

import click

from slamcli.cli.options import DIALECTS, FILE, input_options, warn

_EXAMPLES = """\b
Examples:
  slamcli convert graph.toro graph.g2o --to g2o
  slamcli convert graph.g2o - --to toro | head
"""


@click.command(name="convert", epilog=_EXAMPLES)
@input_options
@click.argument("output", metavar="OUTPUT", type=FILE)
@click.option(
    "--to",
    type=click.Choice((*DIALECTS, "ply")),
    help="Format to write.  [default: by OUTPUT's ending (.g2o, .toro, .graph, .bal, bundle.out, .ply), else INPUT's]",
)
def command(input: str, output: str, dialect: str | None, lenient: bool, to: str | None) -> int:
    """Convert the graph INPUT to OUTPUT (- is standard input or output).

    Information matrices are converted with their order and frame. What the other format cannot express is said on
    standard error. Without a change of format the bytes stay as they are. PLY holds points and poses to look at.
    """
    from slamcli.formats import read, write
    from slamcli.formats.ply import write_ply
    from slamcli.formats.recognize import of_ending
    from slamcli.reporting import summaries

    graph = read(input, dialect=dialect, lenient=lenient)
    warn(summaries.reading_warnings(graph.report))
    if to == "ply" or (to is None and output.removesuffix(".gz").endswith(".ply")):
        write_ply(graph, output)
        return 0
    warn([f"not carried over: {loss}" for loss in write(graph, output, dialect=to or of_ending(output))])
    return 0
