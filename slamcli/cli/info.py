"""``slamcli info``: describe a graph."""

from __future__ import annotations

import click

from slamcli.cli.options import input_options, json_option, warn, worst_option

_EXAMPLES = """\b
Examples:
  slamcli info graph.g2o
  slamcli info graph.g2o --json | jq .chi2
"""


@click.command(name="info", epilog=_EXAMPLES)
@input_options
@worst_option
@json_option
def command(input: str, dialect: str | None, lenient: bool, worst: int, json: bool) -> int:
    """Describe the graph INPUT (g2o or TORO, - is standard input).

    What was read and skipped, counts by tag, ids, connectivity, degrees, loop closures, extent, chi2 at the file's
    values, and the range of the eigenvalues of the information matrices.
    """
    from slamcli.formats import read
    from slamcli.graph.describe import describe, worst_edges
    from slamcli.reporting import documents, summaries

    graph = read(input, dialect=dialect, lenient=lenient)
    warn(summaries.reading_warnings(graph.report))
    description = describe(graph)
    edges = worst_edges(graph, worst) if description.chi2 is not None else []
    if json:
        print(documents.dumps(documents.info_document(graph, description, edges)))
    else:
        print(*summaries.info_summary(graph, description), *summaries.worst_table(edges), sep="\n")
    return 0
