"""The ways to run a peer, and which of them ``slamcli bench`` tries."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product


@dataclass(frozen=True)
class Setting:
    """One way to run a peer.

    Attributes
    ----------
    method
        ``gn``, ``lm``, ``lm-ceres`` (GTSAM's parameters after Ceres) or ``dogleg``.
    start
        ``file`` (the odometry where the file has no vertices; not counted), ``own`` (the peer's initialization,
        counted), ``own-tree`` (GTSAM's LAGO along a spanning tree, counted), ``spanning-tree`` (slamcli's, counted)
        or ``chordal`` (slamcli's, not counted).
    solver
        GTSAM's elimination order, g2o's linear solver and how its ordering sees the matrix, or Ceres' linear solver.
    """

    method: str
    start: str
    solver: str

    @property
    def name(self) -> str:
        """A short name, the key in documents."""
        return f"{self.method} {self.solver} {self.start}"

    @property
    def borrowed(self) -> bool:
        """Whether it runs from slamcli's chordal start, so that its time is a part of a whole only."""
        return self.start == "chordal"


def _settings(methods: tuple[str, ...], starts: tuple[str, ...], solvers: tuple[str, ...]) -> tuple[Setting, ...]:
    return tuple(Setting(*words) for words in product(methods, starts, solvers))


_GTSAM_STARTS = ("own", "own-tree", "file", "spanning-tree", "chordal")
#: Every setting of each peer, by the name of its module and of its package.
SETTINGS = {
    "gtsam": _settings(("gn", "lm", "lm-ceres"), _GTSAM_STARTS, ("METIS", "COLAMD")),
    "g2opy": (
        *_settings(("gn",), ("own", "file", "chordal"), ("Eigen-block", "Eigen-scalar")),
        *_settings(("lm", "dogleg"), ("own", "file", "chordal"), ("Eigen-block",)),
    ),
    "pyceres": _settings(("lm", "dogleg"), ("file", "spanning-tree"), ("SPARSE_NORMAL_CHOLESKY",)),
}
PEERS = tuple(SETTINGS)


def tried(peer: str) -> tuple[Setting, ...]:
    """What ``slamcli bench`` tries: all but variants of one method or start and slamcli's chordal start."""
    left_out = ("own-tree", "chordal")
    return tuple(one for one in SETTINGS[peer] if one.start not in left_out and one.method != "lm-ceres")
