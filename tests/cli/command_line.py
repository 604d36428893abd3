"""How the tests run the command line: in this process, or in one of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

INFO = "1 0 0 1 0 1"
#: Three poses on a line whose closure contradicts the odometry: chi2 0.16 at these values, 0.0533 at the optimum.
LINE = f"""\
VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1 0 0
VERTEX_SE2 2 2 0 0
EDGE_SE2 0 1 1 0 0 {INFO}
EDGE_SE2 1 2 1 0 0 {INFO}
EDGE_SE2 0 2 1.6 0 0 {INFO}
"""
#: A pose whose orientation nothing tells: H is singular.
LOOSE = "VERTEX_SE2 77 0 0 0\nEDGE_PRIOR_SE2_XY 77 0.1 0 10 0 10\n"
#: A landmark that a single bearing sees: H is singular with it, and `optimize` holds it back.
SINGULAR = f"""\
VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1 0 0
VERTEX_XY 77 5 5
EDGE_SE2 0 1 1 0 0 {INFO}
EDGE_BEARING_SE2_XY 0 77 0.8 10
"""


def environment(**variables: str) -> dict[str, str]:
    """The environment without what a user may have set for slamcli or for colours."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("SLAMCLI_", "_SLAMCLI")) and k != "NO_COLOR"}
    return {**kept, **variables}


def start(*words: str, **options: object) -> subprocess.Popen[bytes]:
    """A process of its own, with pipes for all streams."""
    given = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "env": environment()}
    return subprocess.Popen([sys.executable, "-m", "slamcli", *words], **{**given, **options})  # type: ignore[call-overload,no-any-return]


def manhattan(path: Path, poses: int) -> Path:
    """A large graph of planar poses on a grid, whose vertices are far from its edges."""
    side = 50
    lines = []
    for k in range(poses):
        x, y = k % side, k // side
        lines.append(f"VERTEX_SE2 {k} {x + 0.3 * (k % 7)} {y + 0.2 * (k % 5)} {0.1 * (k % 11)}")
    for k in range(poses):
        for other in (k + 1, k + side):
            if other < poses:
                dx, dy = other % side - k % side, other // side - k // side
                lines.append(f"EDGE_SE2 {k} {other} {dx + 0.01 * (k % 3)} {dy} {0.01 * (k % 4)} 10 0 0 10 0 50")
    path.write_text("\n".join(lines) + "\n")
    return path
