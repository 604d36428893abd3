"""Options of an optimization: one frozen dataclass, the same keys on the command line, in YAML and in the API."""

from __future__ import annotations

from dataclasses import dataclass, fields

from slamcli.errors import UsageError

METHODS = ("gn", "lm", "dogleg")
INITS = ("file", "odometry", "spanning-tree", "chordal", "auto")
ORDERINGS = ("amd", "natural")
LINEAR_SOLVERS = ("cholmod", "superlu", "pardiso")
SCALINGS = ("none", "marquardt")


@dataclass(frozen=True)
class OptimizeOptions:
    """Options of an optimization.

    Attributes
    ----------
    method
        ``gn`` (Gauss-Newton), ``lm`` (Levenberg-Marquardt) or ``dogleg`` (Powell).
    init
        Where it starts: the ``file``'s values, the integrated ``odometry``, a ``spanning-tree``, a ``chordal``
        relaxation, or ``auto``: what is best of the file's values and two chordal starts.
    max_iterations
        Budget of iterations.
    tolerance
        Converged when the relative decrease of chi2, the last one or what is still to come, is below this.
    time_limit
        Budget of seconds for the iterations, None for no limit.
    fix
        Ids of variables to hold, on top of those that the file fixes.
    ordering
        Elimination order: ``amd`` or ``natural``.
    linear_solver
        ``cholmod``, ``superlu`` or ``pardiso``.
    scaling
        Damping of Levenberg-Marquardt: ``none`` adds lambda to the diagonal of H as g2o does, ``marquardt`` adds
        lambda times the diagonal.
    """

    method: str = "gn"
    init: str = "file"
    max_iterations: int = 100
    tolerance: float = 1e-9
    time_limit: float | None = None
    fix: tuple[int, ...] = ()
    ordering: str = "amd"
    linear_solver: str = "cholmod"
    scaling: str = "none"

    def __post_init__(self) -> None:
        for name, allowed in (
            ("method", METHODS),
            ("init", INITS),
            ("ordering", ORDERINGS),
            ("linear_solver", LINEAR_SOLVERS),
            ("scaling", SCALINGS),
        ):
            if getattr(self, name) not in allowed:
                raise UsageError(f"{name} {getattr(self, name)!r} does not exist", (f"  one of: {', '.join(allowed)}",))
        if not self.tolerance >= 0.0:
            raise UsageError(f"tolerance must be zero or positive, got {self.tolerance}")
        if self.max_iterations < 0:
            raise UsageError(f"max_iterations must not be negative, got {self.max_iterations}")
        if self.time_limit is not None and not self.time_limit > 0.0:
            raise UsageError(f"time_limit must be positive, got {self.time_limit}")

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Names of all options."""
        return tuple(field.name for field in fields(cls))
