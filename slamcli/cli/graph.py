"""``slamcli graph``: draw the factor graph itself."""

from __future__ import annotations

import sys
from typing import Any

import click

from slamcli.cli.options import FILE, check_outputs, input_options, json_option, warn
from slamcli.errors import UsageError

_EXAMPLES = """\b
Examples:
  slamcli graph small.g2o --svg graph.svg
  slamcli graph small.g2o --variant online --dot - | dot -Tpdf -o online.pdf
  slamcli graph small.g2o --eliminate least-degree --svg steps.svg
  slamcli graph large.g2o --ids 100-105 --hops 1 --svg part.svg

\b
Exit codes: 0 success, 2 usage (also: more variables than can be drawn), 3 invalid
input.
"""

#: Variables that a picture can hold, and one of a strip of steps.
LIMIT, STEPS_LIMIT = 150, 24


@click.command(name="graph", epilog=_EXAMPLES)
@input_options
@click.option("--dot", type=FILE, metavar="FILE", help="Write it in Graphviz's dot language; - is standard output.")
@click.option("--svg", type=FILE, metavar="FILE", help="Draw it: .svg, .png or .pdf by the ending; - is SVG.")
@click.option(
    "--variant",
    type=click.Choice(["full", "online"]),
    default="full",
    show_default=True,
    help="Full SLAM keeps all poses; in online SLAM the past ones are eliminated.",
)
@click.option(
    "--eliminate",
    metavar="ORDER",
    help="Eliminate variables step by step: natural, least-degree, or ids such as 3,1,2.",
)
@click.option("--ids", metavar="IDS", help="Only these variables, such as 7,10-20.")
@click.option(
    "--hops", type=click.IntRange(min=0), default=0, metavar="N", help="With --ids: and so many edges around."
)
@click.option(
    "--layout",
    type=click.Choice(["auto", "estimate", "spring"]),
    default="auto",
    show_default=True,
    help="Where variables stand: at their estimates, or where springs pull them. auto: at the estimates that all have.",
)
@click.option("--title", metavar="TEXT", help="Title of the picture.  [default: what it shows]")
@json_option
def command(input: str, **given: Any) -> int:
    """Draw the factor graph INPUT: circles for variables, squares for factors.

    With --eliminate, the picture is a strip of the steps: which variable goes, which factor takes its place, which
    pairs of variables are joined anew (fill-in).
    """
    check_outputs(given, ("dot", "svg"), json=given["json"], inputs=(input,))
    if given["hops"] and given["ids"] is None:
        raise UsageError("--hops needs --ids")
    if given["eliminate"] == "":
        raise UsageError("--eliminate needs an order: natural, least-degree, or ids such as 3,1,2")
    if given["eliminate"] and given["variant"] == "online":
        raise UsageError("--eliminate is for --variant full: online is an elimination itself")
    from slamcli.formats import read
    from slamcli.formats.source import write_bytes
    from slamcli.graph import analyze
    from slamcli.graph.bipartite import eliminate_all, online, spring_layout
    from slamcli.reporting import graph_dot, summaries
    from slamcli.reporting.documents import dumps

    kind = _format_of(given["svg"])
    graph = read(input, dialect=given["dialect"], lenient=given["lenient"])
    warn(summaries.reading_warnings(graph.report))
    start, cut = _chosen(graph, given, STEPS_LIMIT if given["eliminate"] else LIMIT)
    drawn = online(start) if given["variant"] == "online" else start
    steps = eliminate_all(start, _order(start, given["eliminate"])) if given["eliminate"] else []
    metric = _metric(start, given["layout"])
    places = start.positions if metric else spring_layout(start)
    layout = "at the estimates" if metric else "by springs"
    if given["dot"]:
        text = graph_dot.dot_steps(start, steps) if steps else graph_dot.dot(drawn)
        write_bytes(given["dot"], text.encode())
    if given["svg"]:
        _write_picture(given, kind, input, start, drawn, steps, places, metric, graph.space == 3)
    if given["json"]:
        print(dumps(graph_dot.graph_document(graph, analyze(graph), drawn, given["variant"], cut, steps)))
        return 0
    written = ["standard output" if given[k] == "-" else given[k] for k in ("dot", "svg") if given[k]]
    lines = graph_dot.graph_summary(graph, drawn, given["variant"], cut, written, layout)
    out = sys.stderr if "-" in (given["dot"], given["svg"]) else sys.stdout
    print(*lines, *(graph_dot.step_lines(steps) if steps else []), sep="\n", file=out)
    return 0


def _format_of(path: str | None) -> str:
    """Format of the picture by the ending of its file."""
    import os

    if path in (None, "-"):
        return "svg"
    ending = os.path.splitext(str(path))[1].removeprefix(".").lower()
    if ending not in ("svg", "png", "pdf"):
        raise UsageError(f"--svg {path}: expected a file that ends in .svg, .png or .pdf")
    return ending


def _chosen(graph: Any, given: dict[str, Any], limit: int) -> tuple[Any, int]:
    """The part to draw, and how many factors leave it."""
    from slamcli.graph.bipartite import bipartite, neighbourhood

    chosen = None
    count = graph.poses + graph.landmarks
    if given["ids"] is not None:
        from slamcli.solver.marginalization.selection import by_ids

        chosen = neighbourhood(graph, by_ids(graph, "--ids", given["ids"]), given["hops"])
        count = sum(int(mask.sum()) for mask in chosen.values())
    if count > limit:
        what = "a strip of steps" if given["eliminate"] else "a picture"
        hint = ("  --ids 0-9 chooses some, --hops N what is around them",)
        raise UsageError(f"{count} variables are more than {what} can show ({limit})", hint)
    return bipartite(graph, chosen)


def _order(start: Any, rule: str) -> list[int]:
    """Keys in the order in which they go."""
    from slamcli.graph.bipartite import least_degree, order_of

    if rule == "natural":
        return [v.key for v in sorted(start.variables.values(), key=lambda v: (not v.is_pose, v.id))]
    if rule == "least-degree":
        return least_degree(start)
    words = [word.strip() for word in rule.split(",")]
    if not all(word.removeprefix("-").isascii() and word.removeprefix("-").isdigit() for word in words):
        raise UsageError(f"--eliminate {rule}: expected natural, least-degree, or ids such as 3,1,2")
    ids = [int(word) for word in words]
    keys = order_of(start, ids)
    for identifier, key in zip(ids, keys, strict=True):
        if key < 0:
            raise UsageError(f"--eliminate: no variable that is drawn has the id {identifier}")
    if len(set(keys)) < len(keys):
        raise UsageError(f"--eliminate {rule}: an id occurs twice")
    return keys


def _metric(drawn: Any, layout: str) -> bool:
    """Whether variables stand at their estimates."""
    places = [drawn.positions.get(key) for key in drawn.variables]
    possible = None not in places
    if layout == "estimate" and not possible:
        raise UsageError("--layout estimate: not every variable has an estimate", ("  --layout spring needs none",))
    return possible and (layout == "estimate" or (layout == "auto" and len(set(places)) == len(places)))


def _write_picture(
    given: dict[str, Any],
    kind: str,
    path: str,
    start: Any,
    drawn: Any,
    steps: Any,
    places: Any,
    metric: bool,
    from_above: bool,
) -> None:
    import os

    from slamcli.formats.source import write_bytes
    from slamcli.reporting.plots import factor_graph, style
    from slamcli.reporting.plots.files import render
    from slamcli.reporting.text import plural

    name = "standard input" if path == "-" else os.path.basename(path)
    subtitle = f"{plural(len(drawn.variables), 'variable')}, {plural(len(drawn.factors), 'factor')}"
    if metric and from_above and not steps:
        subtitle += ", seen from above"
    with style.house_style():
        if steps:
            title = given["title"] or f"{name}: elimination, step by step"
            figure = factor_graph.draw_steps(start, steps, places, title, subtitle)
        else:
            title = given["title"] or f"{name}: {given['variant']} SLAM"
            gone = [variable for key, variable in start.variables.items() if key not in drawn.variables]
            figure = factor_graph.draw(drawn, places, title, subtitle, metric, gone)
        data, notes = render(figure, kind, 150)
    warn(notes)
    write_bytes(given["svg"], data)
