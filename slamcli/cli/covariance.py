"""``slamcli covariance``: how uncertain each pose and landmark of a graph is."""

from __future__ import annotations

import sys
import time
from typing import Any

import click

from slamcli.cli.options import FILE, check_outputs, input_options, json_option, warn
from slamcli.cli.solver_options import intrinsics_option
from slamcli.errors import UsageError

_EXAMPLES = """\b
Examples:
  slamcli optimize graph.g2o -o best.g2o && slamcli covariance best.g2o -o cov.npz
  slamcli covariance optimized.g2o --of 17,42 --joint 17,42
  slamcli covariance optimized.g2o --relative 17,42 --convention gtsam --json
  slamcli evaluate optimized.g2o --truth truth.g2o --covariances cov.npz
  slamcli plot optimized.g2o --covariances cov.npz -o map.png

\b
Exit codes: 0 success, 2 usage (also an id that does not exist), 3 invalid input,
5 numerical failure (the edges do not determine all variables; nothing is written).
"""

_SELECTIONS = ("all", "poses", "landmarks")
CONVENTIONS = ("slamcli", "g2o", "gtsam")
SCALES = ("none", "posterior")


class Ids(click.ParamType):  # type: ignore[type-arg]  # generic only in click 8.5
    """Whole numbers with commas between them, a given number of them or any."""

    name = "ids"

    def __init__(self, count: int | None = None) -> None:
        self.count = count

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, ...]:
        """The ids, or a usage error."""
        if isinstance(value, tuple):
            return value
        try:
            ids = tuple(int(part) for part in value.split(","))
        except ValueError:
            self.fail(f"expected ids with commas between them, got {value!r}", param, ctx)
        if self.count is not None and len(ids) != self.count:
            self.fail(f"expected {self.count} ids, got {value!r}", param, ctx)
        return ids


@click.command(name="covariance", epilog=_EXAMPLES)
@input_options
@click.option(
    "--of",
    default="all",
    show_default=True,
    metavar="all|poses|landmarks|ID,...",
    help="Whose covariances are printed and written.",
)
@click.option("--joint", type=Ids(), metavar="I,J,...", help="The joint covariance of these variables as well.")
@click.option(
    "--relative",
    type=Ids(2),
    multiple=True,
    metavar="I,J",
    help="J in the frame of I, with its covariance; may be given several times.",
)
@click.option("--cross", is_flag=True, help="Cross-covariances of connected pairs as well (npz, JSON).")
@click.option(
    "--convention",
    type=click.Choice(CONVENTIONS),
    default="slamcli",
    show_default=True,
    help="Tangent space of the poses. g2o: planar translation in the world. gtsam: rotation vector first in space.",
)
@click.option(
    "--scale",
    type=click.Choice(SCALES),
    default="none",
    show_default=True,
    help="Scale of the information. posterior multiplies covariances by chi2 over the degrees of freedom, for "
    "information that is known up to a factor.",
)
@click.option(
    "--probability",
    type=click.FloatRange(0.0, 1.0, min_open=True, max_open=True),
    default=0.95,
    show_default=True,
    help="Of the regions whose semi-axes are given.",
)
@click.option(
    "--rows", type=click.IntRange(min=0), default=10, show_default=True, metavar="N", help="Variables that are listed."
)
@click.option("--fix", type=int, multiple=True, metavar="ID", help="Hold this variable; may be given several times.")
@intrinsics_option
@click.option(
    "-o", "--output", type=FILE, metavar="FILE", help="Write .npz, .csv or .json; - is CSV on standard output."
)
@json_option
def command(input: str, **given: Any) -> int:
    """Print marginal covariances of the graph INPUT at the values that it has (- is standard input).

    They are blocks of the inverse of H, the Gauss-Newton approximation that `optimize` minimizes with: right at an
    optimum, so optimize first; a warning says when the values are none. Each is in the frame of its pose (landmarks:
    of the world) and relative to what is held, which the output names.
    """
    from slamcli.formats import read
    from slamcli.formats.covariance_files import require_one_size
    from slamcli.graph import analyze
    from slamcli.reporting import covariance as reporting
    from slamcli.reporting import documents, summaries
    from slamcli.reporting.landmarks import held_back_warning
    from slamcli.solver.covariance import CovarianceRequest, recover, recovery_at
    from slamcli.solver.options import OptimizeOptions

    check_outputs(given, ("output",), json=given["json"], inputs=[input])
    if given["probability"] != given["probability"]:  # click's range lets NaN pass
        raise UsageError("--probability is a number between 0 and 1, got nan")
    request = CovarianceRequest(
        *_selection(given["of"]),
        joint=given["joint"] or (),
        relative=given["relative"],
        cross=given["cross"],
        convention=given["convention"],
        scale=given["scale"],
    )
    _check_format(given)
    graph = read(input, dialect=given["dialect"], lenient=given["lenient"])
    warn(summaries.reading_warnings(graph.report))
    started = time.perf_counter()
    options = OptimizeOptions(fix=given["fix"], intrinsics=given["intrinsics"])
    result = recover(recovery_at(graph, options), request)
    seconds = time.perf_counter() - started
    if given["output"]:
        require_one_size(given["output"], {m.kind.name: m.kind.dimension for m in result.marginals})
    warn(held_back_warning(result.under_observed) + reporting.optimum_warning(result))
    quantiles = quantiles_at(given["probability"])
    document: dict[str, Any] = {}
    if given["json"] or (given["output"] or "").endswith((".json", ".json.gz")):
        times = {"recover": seconds}
        document = reporting.covariance_document(result, analyze(graph), quantiles, given["probability"], times)
    if given["output"]:
        reporting.write_covariances(given["output"], result, document)
    if given["json"]:
        print(documents.dumps(document))
        return 0
    written = {None: "nothing (-o FILE keeps the covariances)", "-": "standard output"}.get(
        given["output"], given["output"]
    )
    lines = reporting.covariance_summary(result, quantiles, given["probability"], given["rows"], seconds, written)
    print(*lines, sep="\n", file=sys.stderr if given["output"] == "-" else sys.stdout)
    return 0


def _selection(of: str) -> tuple[str, tuple[int, ...]]:
    """What ``--of`` chooses: a group, or ids."""
    if of in _SELECTIONS:
        return of, ()
    try:
        return "all", tuple(int(part) for part in of.split(","))
    except ValueError:
        raise UsageError(f"--of is all, poses, landmarks or ids with commas between them, got {of!r}") from None


def _check_format(given: dict[str, Any]) -> None:
    from slamcli.formats.covariance_files import ending_of

    if given["output"] is None or ending_of(given["output"]) != ".csv":
        return
    for name in ("cross", "joint", "relative"):
        if given[name]:
            raise UsageError(f"a CSV file has no room for --{name}", ("  write .npz or .json",))


def check_covariances(path: str | None, graph: Any) -> None:
    """Refuse a name that no format has, and a CSV file for several kinds of variables; None is no file."""
    if path:
        from slamcli.formats.covariance_files import require_one_size

        kinds = [column.kind for column in graph.variables.values() if len(column) and column.kind.space]
        require_one_size(path, {kind.name: kind.dimension for kind in kinds})


def write_covariances(result: Any, path: str) -> None:
    """Write the covariances of all poses and landmarks at the end of a run of ``optimize``.

    Raises
    ------
    NumericalError
        If H is singular at the end.
    """
    from slamcli.errors import ExitCode
    from slamcli.graph import analyze
    from slamcli.reporting import covariance as reporting
    from slamcli.solver.covariance import CovarianceRequest, recover, recovery_of

    if result.exit_code == ExitCode.NUMERICAL_FAILURE:
        print(f"  no covariances are written to {path}", file=sys.stderr)
        return
    started = time.perf_counter()
    found = recover(recovery_of(result), CovarianceRequest())
    times = {"recover": time.perf_counter() - started}
    warn(reporting.optimum_warning(found))
    document: dict[str, Any] = {}
    if path.endswith((".json", ".json.gz")):
        document = reporting.covariance_document(found, analyze(found.graph), quantiles_at(0.95), 0.95, times)
    reporting.write_covariances(path, found, document)


def quantiles_at(probability: float) -> dict[int, float]:
    """Quantiles of the chi-square distribution, by degrees of freedom."""
    from slamcli.evaluation.consistency import chi2_quantile

    return {dof: chi2_quantile(dof, probability) for dof in (2, 3)}
