"""Options of an optimization: one frozen dataclass, the same keys on the command line, in YAML and in the API."""

from __future__ import annotations

from dataclasses import dataclass, fields

from slamcli.errors import UsageError

METHODS = ("auto", "gn", "lm", "dogleg")
INITS = ("file", "odometry", "spanning-tree", "chordal", "auto")
ORDERINGS = ("auto", "amd", "colamd", "metis", "rcm", "natural", "amd-landmarks-first", "amd-last-pose-last")
LINEAR_SOLVERS = ("cholmod", "superlu", "pardiso")
ELIMINATIONS = ("auto", "none", "schur")
REDUCED_SOLVERS = ("auto", "dense", "sparse", "iterative")
SCALINGS = ("none", "marquardt")
GAUGES = ("auto", "free", "first")
INTRINSICS = ("auto", "fixed", "shared", "free")
KERNELS = (
    "none",
    "huber",
    "pseudo-huber",
    "cauchy",
    "geman-mcclure",
    "welsch",
    "fair",
    "tukey",
    "dcs",
    "saturated",
)
KERNEL_ON = ("closures", "all")
ROBUST = ("none", "auto", "gnc", "gnc-gm", "switchable", "pcm", "pcm+gnc")


@dataclass(frozen=True)
class OptimizeOptions:
    """Options of an optimization.

    Attributes
    ----------
    method
        ``auto`` (watched Gauss-Newton, see ``policies.automatic``), ``gn`` (Gauss-Newton), ``lm``
        (Levenberg-Marquardt) or ``dogleg`` (Powell).
    init
        Where it starts: the ``file``'s values, the integrated ``odometry``, a ``spanning-tree``, a ``chordal``
        relaxation, or ``auto``: the better of the file's values and a chordal relaxation, in doubt runs from both and
        more (see ``multistart``).
    max_iterations
        Budget of iterations.
    tolerance
        Converged when the relative decrease of chi2, the last one or what is still to come, is below this.
    time_limit
        Budget of seconds for the iterations, None for no limit.
    fix
        Ids of variables to hold, on top of those that the file fixes.
    ordering
        Elimination order, one of ``ORDERINGS``; ``auto`` is ``amd``, or on large graphs ``metis`` where that is better.
    linear_solver
        ``cholmod``, ``superlu`` or ``pardiso``.
    elimination
        ``none``, ``schur`` (points first, block by block: see ``solver.schur``), or ``auto``: that where it saves time.
    reduced_solver
        How the system that is left after an elimination is solved: ``dense`` or ``sparse`` factorization, ``iterative``
        (conjugate gradients: see ``solver.schur.implicit``), or ``auto``: whichever is expected to be fastest.
    scaling
        Damping of Levenberg-Marquardt: ``none`` adds lambda to the diagonal of H as g2o does, ``marquardt`` adds
        lambda times the diagonal.
    gauge
        What is held in scenes of cameras (see ``gauge.choose``).
    intrinsics
        What intrinsics of cameras are: as the file has them (``auto``), constants (``fixed``), one unknown set for all
        cameras (``shared``), or unknowns of each (``free``).
    kernel
        Robust kernel, ``none`` for least squares (see ``robust.kernels``).
    kernel_width
        Its width, in units of the root of an edge's chi2; of chi2 itself for ``geman-mcclure`` and ``dcs``. None: where
        chi2 is at its 99 % quantile.
    kernel_on
        The edges that it acts on: loop ``closures`` or ``all``.
    robust
        How false loop closures are rejected (see ``robust.run``); ``auto`` is ``pcm+gnc``, which it becomes.
    robust_probability
        With which a right closure passes the gate that rejects the others.
    noise_scale
        Noise of the edges over the noise that their information states, None to estimate it.
    """

    method: str = "auto"
    init: str = "auto"
    max_iterations: int = 100
    tolerance: float = 1e-9
    time_limit: float | None = None
    fix: tuple[int, ...] = ()
    ordering: str = "auto"
    linear_solver: str = "cholmod"
    elimination: str = "auto"
    reduced_solver: str = "auto"
    scaling: str = "none"
    gauge: str = "auto"
    intrinsics: str = "auto"
    kernel: str = "none"
    kernel_width: float | None = None
    kernel_on: str = "closures"
    robust: str = "none"
    robust_probability: float = 0.9999
    noise_scale: float | None = None

    def __post_init__(self) -> None:
        for name, allowed in (
            ("method", METHODS),
            ("init", INITS),
            ("ordering", ORDERINGS),
            ("linear_solver", LINEAR_SOLVERS),
            ("elimination", ELIMINATIONS),
            ("reduced_solver", REDUCED_SOLVERS),
            ("scaling", SCALINGS),
            ("gauge", GAUGES),
            ("intrinsics", INTRINSICS),
            ("kernel", KERNELS),
            ("kernel_on", KERNEL_ON),
            ("robust", ROBUST),
        ):
            if getattr(self, name) not in allowed:
                raise UsageError(f"{name} {getattr(self, name)!r} does not exist", (f"  one of: {', '.join(allowed)}",))
        if self.elimination == "none" and self.reduced_solver != "auto":
            raise UsageError(
                f"reduced_solver {self.reduced_solver!r} solves what an elimination leaves",
                ("  --elimination schur makes one",),
            )
        if not self.tolerance >= 0.0:
            raise UsageError(f"tolerance must be zero or positive, got {self.tolerance}")
        if self.max_iterations < 0:
            raise UsageError(f"max_iterations must not be negative, got {self.max_iterations}")
        if self.time_limit is not None and not self.time_limit > 0.0:
            raise UsageError(f"time_limit must be positive, got {self.time_limit}")
        if self.kernel_width is not None and not 1e-100 <= self.kernel_width <= 1e100:
            raise UsageError(f"kernel_width must be positive, from 1e-100 to 1e100, got {self.kernel_width}")
        if self.robust == "auto":
            object.__setattr__(self, "robust", "pcm+gnc")
        if self.robust != "none" and self.kernel != "none":
            raise UsageError("robust and kernel are two ways to the same end", ("  give one of them",))
        if not 0.0 < self.robust_probability < 1.0:
            raise UsageError(f"robust_probability must lie between 0 and 1, got {self.robust_probability}")
        if self.noise_scale is not None and not self.noise_scale > 0.0:
            raise UsageError(f"noise_scale must be positive, got {self.noise_scale}")

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Names of all options."""
        return tuple(field.name for field in fields(cls))
