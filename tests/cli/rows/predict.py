"""Command lines of ``slamcli predict``."""

from __future__ import annotations

from row import Case

ROWS = (
    Case(
        "predict --pose 2,1,30deg --landmark 5,5 --reading 5.2,21deg",
        0,
        out=("range 5 m, bearing 0.403696 rad (23.1301 deg)", "range +0.2 m, bearing -0.0371773 rad (-2.1301 deg)"),
    ),
    Case("predict --pose 2,1,0 --landmark 5,5 --noise 0.1,2deg", 0, out=("S = Hx P Hx^T", "bearing 0.0349066 rad")),
    Case(
        "predict --pose 2,1,0 --landmark 5,5 --sensor range --reading 5.1 --pose-noise 3cm,4cm,0 --landmark-noise 0,0",
        0,
        out=("Jacobians of h", "NIS", "(squared Mahalanobis distance, 1 degree of freedom)"),
    ),
    Case("predict --pose 2,1,0 --landmark 5,5 --frame local", 0, out="ahead, to the left, turn"),
    Case("predict --pose 2,1,0 --landmark 5,5 --json", 0, out=('"command": "predict"', '"innovation": null')),
    Case("predict --pose 2,1,0 --landmark 2,1", 2, err="the landmark is at the pose itself, (2, 1)"),
    Case("predict --pose 2,1 --landmark 5,5", 2, err=("--pose", "expected 3 numbers")),
    Case("predict --pose 2,1,30grad --landmark 5,5", 2, err=("'grad'", "rad, deg")),
    Case("predict --pose 2,1,0 --landmark 5,5 --reading 5.2", 2, err=("--reading", "expected 2 numbers")),
    Case("predict --pose 2,1,0 --landmark 5,5 --sensor sonar", 2, err="sonar"),
    Case("predict --help", 0, out=("Usage: slamcli predict", "--pose-noise", "Examples")),
)
