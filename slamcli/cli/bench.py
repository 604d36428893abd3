"""``slamcli bench``: methods, orderings and peers on the same graphs, in turn."""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING, Any

import click

from slamcli.cli.options import FILE, check_outputs, json_option
from slamcli.errors import InputError, UsageError

if TYPE_CHECKING:
    from slamcli.batch.benchmark.result import BenchResult, Data

_EXAMPLES = """\b
Examples:
  slamcli bench graph.g2o --param method=gn,lm
  slamcli bench graph.g2o --param ordering=amd,metis --param method=gn,lm
  slamcli bench sphere2500 torus3D --peers gtsam,g2opy --runs 7 -o table.md

DATA are files, or names that slamcli datasets list knows. A run is a process of its own; its time is that of the
second of two optimizations in it, without loading. Peers come with: pip install 'slamcli[peers]'

\b
Exit codes: 0 all variants of slamcli converged, 1 one of them did not or failed (its
row says why; what becomes of peers does not count), 2 usage, 3 missing or invalid
data, 130 interrupted (the table so far is printed and written).
"""
#: Endings of -o and what they mean.
_ENDINGS = {".csv": "csv", ".json": "json", ".md": "markdown"}


@click.command(name="bench", epilog=_EXAMPLES)
@click.argument("data", metavar="DATA...", nargs=-1, required=True, type=FILE)
@click.option(
    "--param",
    multiple=True,
    metavar="NAME=V,V",
    help="Values of an option of optimize; several options make a grid, and its first variant is the reference.",
)
@click.option("--peers", multiple=True, metavar="LIST", help="Peers with commas: gtsam, g2opy, pyceres.")
@click.option(
    "--runs", type=click.IntRange(1, 1000), default=5, show_default=True, help="Alternating runs of each variant."
)
@click.option(
    "--threads", type=click.IntRange(1, 1024), default=1, show_default=True, help="Threads of the libraries of a run."
)
@click.option(
    "--time-limit",
    type=click.FloatRange(min=0.0, min_open=True, max=1e6),
    default=120.0,
    show_default=True,
    metavar="S",
    help="Seconds for a run, both optimizations and loading included; it is ended then.",
)
@click.option(
    "--export",
    type=click.Choice(["csv", "json", "markdown"]),
    help="Print this instead of the table, or write it to -o.  [default for -o: by its ending]",
)
@click.option("-o", "--output", type=FILE, metavar="FILE", help="Write the table as well: .csv, .json or .md.")
@json_option
def command(data: tuple[str, ...], **given: Any) -> int:
    """Time variants of optimize, and peers, on DATA...: alternating runs, median and spread, ratio to the first.

    What every tool ends with is checked by our chi2. Figures of different runs of bench are not comparable, those of
    one table are.
    """
    kind = _check(data, given)
    from slamcli.batch.benchmark import grid, runner
    from slamcli.cli.process import progress, terminable

    variants = grid.variants(grid.parameters(given["param"]), grid.peers(given["peers"]))
    found = _described(data)
    with progress("benchmark", runner.steps(found, variants, given["runs"])) as advance, terminable():
        result = runner.run(
            found,
            variants,
            repeats=given["runs"],
            time_limit=given["time_limit"],
            threads=given["threads"],
            tick=lambda words: advance(),
        )
    _report(result, kind, given)
    return int(result.exit_code)


def _check(data: tuple[str, ...], given: dict[str, Any]) -> str | None:
    """Format of the export, None for none; what cannot be written is told before the work, not after."""
    if "-" in data:
        raise UsageError("bench reads its data many times, which standard input does not allow")
    if given["time_limit"] != given["time_limit"]:  # nan is in every range
        raise UsageError("--time-limit needs a number of seconds, got nan")
    check_outputs(given, ("output",), json=given["json"], inputs=data)
    output, kind = given["output"], given["export"]
    if kind and output is None and given["json"]:
        raise UsageError("--export and --json both want standard output", ("  write one of them to a file with -o",))
    if output is None:
        return kind
    ending = os.path.splitext(output.removesuffix(".gz").removesuffix(".bz2"))[1]
    if kind is None and ending not in _ENDINGS:
        raise UsageError(f"-o {output}: say its format with --export, or end it in {', '.join(_ENDINGS)}")
    if os.path.isdir(output):
        raise InputError(f"{output}: cannot be written: is a folder")
    folder = os.path.dirname(os.path.abspath(output))
    if output != "-" and not (os.path.isdir(folder) and os.access(folder, os.W_OK)):
        words = "Permission denied" if os.path.isdir(folder) else "No such file or directory"
        raise InputError(f"{output}: cannot be written: {words}")
    return kind or _ENDINGS[ending]


def _described(names: tuple[str, ...]) -> tuple[Data, ...]:
    """The graphs, with names that tell them apart."""
    from slamcli.batch.benchmark.runner import described
    from slamcli.batch.datasets import resolve

    paths = [resolve(name) for name in names]
    stems = [path.name.removesuffix(".gz").removesuffix(".bz2").rsplit(".", 1)[0] for path in paths]
    for path in paths:
        if paths.count(path) > 1:
            raise UsageError(f"{path} stands twice")
        if path.is_dir():
            raise InputError(f"{path}: is a folder, expected a graph file")
    labels = [str(path) if stems.count(stem) > 1 else stem for stem, path in zip(stems, paths, strict=True)]
    return tuple(described(label, path) for label, path in zip(labels, paths, strict=True))


def _report(result: BenchResult, kind: str | None, given: dict[str, Any]) -> None:
    """Print first: what is on the screen is not lost if the file cannot be written."""
    from slamcli.formats.source import write_bytes
    from slamcli.reporting import benchmark, documents

    if given["json"]:
        print(documents.dumps(benchmark.benchmark_document(result)))
    elif kind and given["output"] in (None, "-"):
        sys.stdout.write(benchmark.exported(result, kind))
    else:
        print(*benchmark.benchmark_summary(result), sep="\n")
    if kind and given["output"] not in (None, "-"):
        sys.stdout.flush()
        write_bytes(given["output"], benchmark.exported(result, kind).encode())
