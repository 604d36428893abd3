"""The options of the solver: what is minimized how, from where and for how long."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import click

from slamcli.errors import UsageError
from slamcli.solver.options import (
    ELIMINATIONS,
    GAUGES,
    INITS,
    INTRINSICS,
    LINEAR_SOLVERS,
    METHODS,
    ORDERINGS,
    REDUCED_SOLVERS,
    SCALINGS,
    OptimizeOptions,
)

F = TypeVar("F", bound=Callable[..., Any])


def intrinsics_option(function: F) -> F:
    """``--intrinsics``."""
    return click.option(
        "--intrinsics",
        type=click.Choice(INTRINSICS),
        default="auto",
        show_default=True,
        help="Of cameras: constants (fixed), one unknown set for all (shared), unknowns of each (free). auto: free in "
        "BAL and Bundler, fixed elsewhere.",
    )(function)


def solver_options(function: F) -> F:
    """The options of ``OptimizeOptions`` but those of robustness: ``--method --init ... --gauge --intrinsics``."""
    function = intrinsics_option(function)
    function = click.option(
        "--gauge",
        type=click.Choice(GAUGES),
        default="auto",
        show_default=True,
        help="Of scenes of cameras. first: hold the pose of the first camera, and the scale by another; free: hold "
        "nothing; auto: hold the first camera where its intrinsics are constants, else nothing.",
    )(function)
    function = click.option(
        "--scaling",
        type=click.Choice(SCALINGS),
        default="none",
        show_default=True,
        help="Damping of lm: lambda on the diagonal (none, as g2o) or lambda times the diagonal.",
    )(function)
    function = click.option(
        "--reduced-solver",
        type=click.Choice(REDUCED_SOLVERS),
        default="auto",
        show_default=True,
        help="What the elimination leaves: dense or sparse factorization, or conjugate gradients without forming it "
        "(iterative). auto: what is faster.",
    )(function)
    function = click.option(
        "--elimination",
        type=click.Choice(ELIMINATIONS),
        default="auto",
        show_default=True,
        help="Points first, block by block (schur), or all by the sparse factorization (none). auto: what is faster.",
    )(function)
    function = click.option(
        "--linear-solver",
        type=click.Choice(LINEAR_SOLVERS),
        default="cholmod",
        show_default=True,
        help="Sparse factorization.",
    )(function)
    function = click.option(
        "--ordering",
        type=click.Choice(ORDERINGS),
        default="auto",
        show_default=True,
        help="Elimination order. auto is amd, or metis on large graphs where that saves time: see slamcli sparsity.",
    )(function)
    function = click.option(
        "--fix", type=int, multiple=True, metavar="ID", help="Hold this variable; may be given several times."
    )(function)
    function = click.option("--time-limit", type=float, metavar="S", help="Budget of seconds for the iterations.")(
        function
    )
    function = click.option(
        "--tolerance",
        type=float,
        default=1e-9,
        show_default=True,
        help="Converged when the relative decrease of chi2, the last or what is still to come, is below this.",
    )(function)
    function = click.option(
        "--max-iterations", type=click.IntRange(min=0), default=100, show_default=True, help="Budget of iterations."
    )(function)
    function = click.option(
        "--init",
        type=click.Choice(INITS),
        default="auto",
        show_default=True,
        help="Where to start; chordal, spanning-tree and odometry need no guess. auto takes the better of the file's "
        "values and a chordal relaxation; where the outcome leaves a doubt it runs from both and more.",
    )(function)
    function = click.option(
        "--method",
        type=click.Choice(METHODS),
        default="auto",
        show_default=True,
        help="Method. auto is Gauss-Newton, watched: it may raise chi2 for a while, is accelerated on slow tails and "
        "left for dogleg where it fails. Plain Gauss-Newton, Levenberg-Marquardt, Powell's dogleg.",
    )(function)
    return function


def options_of(values: dict[str, Any]) -> OptimizeOptions:
    """Checked options: a config file may hold anything."""
    wanted: dict[str, type | tuple[type, ...]] = {
        "max_iterations": int,
        "tolerance": (int, float),
        "kernel_width": (int, float, type(None)),
        "time_limit": (int, float, type(None)),
        "robust_probability": (int, float),
        "noise_scale": (int, float, type(None)),
    }
    for name, kind in wanted.items():
        if not isinstance(values[name], kind) or isinstance(values[name], bool):
            hint = ("  YAML reads 1e-9 as text: write 1.0e-9",) if isinstance(values[name], str) else ()
            raise UsageError(f"{name} must be a number, got {values[name]!r}", hint)
        if isinstance(values[name], (int, float)) and not abs(values[name]) < 1e300:
            raise UsageError(f"{name} must be a finite number")
    fix = values["fix"] if isinstance(values["fix"], (list, tuple)) else [values["fix"]]
    if not all(isinstance(i, int) and not isinstance(i, bool) for i in fix):
        raise UsageError(f"fix must be a list of ids, got {values['fix']!r}")
    return OptimizeOptions(**{**values, "fix": tuple(fix)})
