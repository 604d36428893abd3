"""The worlds: paths of a robot with known truth, each of any size."""

from __future__ import annotations

from collections.abc import Callable

from slamcli.simulation.worlds import planar, spatial
from slamcli.simulation.worlds.path import Path

#: The world of each name: ``(poses, rng, *, parameters) -> Path``.
WORLDS: dict[str, Callable[..., Path]] = {
    "square": planar.square,
    "circle": planar.circle,
    "figure-eight": planar.figure_eight,
    "corridor": planar.corridor,
    "manhattan": planar.manhattan,
    "city": planar.city,
    "garage": planar.garage,
    "sphere": spatial.sphere,
    "torus": spatial.torus,
    "grid": spatial.grid,
    "helix": spatial.helix,
    "lawnmower": spatial.lawnmower,
}

#: The worlds of planar robots.
PLANAR = frozenset(("square", "circle", "figure-eight", "corridor", "manhattan", "city", "garage"))

__all__ = ["PLANAR", "WORLDS", "Path"]
