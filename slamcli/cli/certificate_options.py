"""The options of certified optima: which objective is minimized, and whether its minimum is certified."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import click

F = TypeVar("F", bound=Callable[..., Any])

#: Those that a config file may set.
CERTIFICATE_OPTIONS = ("objective", "certify", "restart")


def certificate_options(function: F) -> F:
    """``--objective --certify --no-restart``."""
    function = click.option(
        "--restart/--no-restart",
        default=True,
        show_default=True,
        help="Where a certificate fails, look for the global minimum elsewhere: from a chordal relaxation, then along "
        "the negative curvature (Riemannian staircase).",
    )(function)
    function = click.option(
        "--certify",
        is_flag=True,
        help="Certify the global minimum of the isotropic objective, and compare it with the result. Code 1 if there "
        "is no certificate.",
    )(function)
    function = click.option(
        "--objective",
        type=click.Choice(("g2o", "isotropic")),
        default="g2o",
        show_default=True,
        help="Minimize chi2 as g2o defines it, or SE-Sync's isotropic chordal objective of the relative poses.",
    )(function)
    return function


def check_certificate(given: dict[str, Any]) -> None:
    """Checked values: a config file may hold anything, and some options exclude each other.

    Raises
    ------
    UsageError
        If a value is none of those that exist, or two options contradict each other.
    """
    from slamcli.errors import UsageError

    for name in ("certify", "restart"):
        if not isinstance(given[name], bool):
            raise UsageError(f"{name} must be true or false, got {given[name]!r}")
    if given["objective"] != "g2o" and given.get("covariances"):
        raise UsageError("--covariances are those of chi2: not with --objective isotropic")
