"""The options of robust estimation: how edges that contradict the others are kept from bending the map."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import click

from slamcli.cli.options import FILE
from slamcli.errors import UsageError
from slamcli.solver.options import KERNEL_ON, KERNELS, ROBUST

F = TypeVar("F", bound=Callable[..., Any])


def robust_options(function: F) -> F:
    """``--robust --robust-probability --noise-scale --rejected --labels-out --drop-rejected --kernel...``."""
    function = click.option(
        "--drop-rejected",
        type=FILE,
        metavar="FILE",
        help="Write the optimized graph without the rejected closures; the other records keep their bytes.",
    )(function)
    function = click.option(
        "--labels-out",
        type=FILE,
        metavar="FILE",
        help="Write which edges are rejected, as CSV: the labels that evaluate takes.",
    )(function)
    function = click.option(
        "--rejected",
        type=click.IntRange(min=0),
        default=10,
        show_default=True,
        metavar="N",
        help="List the N rejected closures with the largest chi2; --json has all.",
    )(function)
    function = click.option(
        "--noise-scale",
        type=float,
        metavar="S",
        help="Noise of the edges over the noise that their information states.  [default: estimated]",
    )(function)
    function = click.option(
        "--robust-probability",
        type=float,
        default=0.9999,
        show_default=True,
        metavar="P",
        help="Probability with which a right closure passes the gate.",
    )(function)
    function = click.option(
        "--robust",
        type=click.Choice(ROBUST),
        default="none",
        show_default=True,
        help="Reject false loop closures: auto is pcm+gnc, a pairwise consistent set as the start of graduated "
        "non-convexity. Either alone (gnc: truncated least squares, gnc-gm: Geman-McClure), or switchable constraints.",
    )(function)
    function = click.option(
        "--kernel-on",
        type=click.Choice(KERNEL_ON),
        default="closures",
        show_default=True,
        help="Edges that the kernel acts on: loop closures, or all.",
    )(function)
    function = click.option(
        "--kernel-width",
        type=float,
        metavar="W",
        help="Where the kernel turns, in units of the root of an edge's chi2; of chi2 for geman-mcclure and dcs.  "
        "[default: where chi2 is at its 99 % quantile]",
    )(function)
    function = click.option(
        "--kernel",
        type=click.Choice(KERNELS),
        default="none",
        show_default=True,
        metavar="NAME",
        help=f"Robust kernel: an edge counts rho(chi2) instead of chi2. One of {', '.join(KERNELS)}.",
    )(function)
    return function


def check_robust(given: dict[str, Any]) -> None:
    """Refuse options that need each other or exclude each other.

    Raises
    ------
    UsageError
        Where they do.
    """
    robust = given["robust"] != "none"
    if not robust and given["kernel"] == "none":
        for name in ("labels_out", "drop_rejected"):
            if given[name]:
                raise UsageError(f"--{name.replace('_', '-')} needs --robust or --kernel")
    if given["kernel"] == "none":
        for name, idle in (("kernel_width", None), ("kernel_on", "closures")):
            if given[name] != idle:
                raise UsageError(f"--{name.replace('_', '-')} needs --kernel")
    if given["noise_scale"] is not None and given["robust"] in ("none", "switchable"):
        raise UsageError("--noise-scale needs --robust with pcm or gnc")
    if robust and (given["certify"] or given["objective"] != "g2o"):
        what = "--certify" if given["certify"] else "--objective"
        raise UsageError(
            f"{what} covers all edges, --robust does not", ("  --drop-rejected FILE, then certify that file",)
        )


def write_rejection(result: Any, rejection: Any, given: dict[str, Any]) -> list[str]:
    """Write labels and the graph without the rejected closures, where asked for; what the formats cannot express."""
    losses: list[str] = []
    if given["labels_out"]:
        from slamcli.formats.labels import labels_of, write_labels

        write_labels(given["labels_out"], *labels_of(result.graph, rejection.rejected))
    if given["drop_rejected"]:
        from slamcli.formats import write
        from slamcli.solver.robust.rejection import without_rejected

        losses = write(without_rejected(result.graph, rejection), given["drop_rejected"])
    return losses
