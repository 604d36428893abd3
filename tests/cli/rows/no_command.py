"""Command lines without a command."""

from __future__ import annotations

from row import Case

ROWS = (
    Case("", 2, out="Usage: slamcli"),
    Case("--help", 0, out=("Commands:", "optimize", "Exit codes")),
    Case("-h", 0, out="Commands:"),
    Case("--version", 0, out=("slamcli 0.", "numpy", "cvxopt")),
    Case("optimise {in}", 2, err="optimize"),
    Case("--bogus", 2, err="--bogus"),
)
