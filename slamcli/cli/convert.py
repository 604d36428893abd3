"""``slamcli convert``: between g2o and TORO."""

from __future__ import annotations

import click

from slamcli.cli.options import DIALECTS, input_options, warn

_EXAMPLES = """\b
Examples:
  slamcli convert graph.toro graph.g2o --to g2o
  slamcli convert graph.g2o - --to toro | head
"""


@click.command(name="convert", epilog=_EXAMPLES)
@input_options
@click.argument("output", metavar="OUTPUT")
@click.option("--to", type=click.Choice(DIALECTS), help="Format to write.  [default: that of INPUT]")
def command(input: str, output: str, dialect: str | None, lenient: bool, to: str | None) -> int:
    """Convert the graph INPUT to OUTPUT (- is standard input or output).

    Information matrices are converted with their order and frame. What the other format cannot express is said on
    standard error. Without a change of format the bytes stay as they are.
    """
    from slamcli.formats import read, write
    from slamcli.reporting import summaries

    graph = read(input, dialect=dialect, lenient=lenient)
    warn(summaries.reading_warnings(graph.report))
    warn([f"not carried over: {loss}" for loss in write(graph, output, dialect=to)])
    return 0
