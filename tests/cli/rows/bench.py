"""Command lines of ``slamcli bench``."""

from __future__ import annotations

from row import BROKEN, INDEFINITE, Case

ROWS = (
    Case(
        "bench {in} --runs 1 --param method=gn,lm --threads 1 --time-limit 60",
        0,
        out=("median ms", "method=gn", "method=lm", "1.00", "0.0533333333", "yes", "1 alternating run"),
    ),
    Case("bench {in} --runs 1 --json", 0, out=('"command": "bench"', '"mad": 0.0', '"reached": true')),
    Case("bench {in} --runs 1 --export csv", 0, out="data,sha256,variant,tool,setting"),
    Case("bench {in} --runs 1 --export markdown -o table.txt", 0, out="median ms"),
    Case(
        "bench {in} --runs 1 --param max-iterations=1,50 --param init=file -o table.md",
        1,
        out=("max_iterations=1 init=file", "not converged: iteration limit 1 reached"),
        content="VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 3 1 1\nVERTEX_SE2 2 1 2 2\n"
        + "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\nEDGE_SE2 1 2 1 0 1 1 0 0 1 0 1\nEDGE_SE2 0 2 1 1 2 1 0 0 1 0 1\n",
    ),
    Case("bench {in} --runs 1", 1, out="numerical failure", content=INDEFINITE),
    Case("bench {in} --param methd=gn", 2, err=("no option 'methd'", "did you mean method?")),
    Case("bench {in} --param method=gm", 2, err=("method 'gm' does not exist", "one of: auto, gn")),
    Case("bench {in} --param max-iterations=x", 2, err="expected an integer, got 'x'"),
    Case("bench {in} --peers gtsan", 2, err=("no peer 'gtsan'", "did you mean gtsam?")),
    Case("bench {in} {in}", 2, err="stands twice"),
    Case("bench -", 2, err="standard input"),
    Case("bench", 2, err="Missing argument"),
    Case("bench {in} --json --export csv", 2, err="both want standard output"),
    Case("bench {in} --json -o -", 2, err="both want standard output"),
    Case("bench {in} -o table.txt", 2, err=("say its format with --export", ".md")),
    Case("bench {in} -o {in} --export csv", 2, err="is an input and would be overwritten"),
    Case("bench {in} --time-limit 0", 2, err="--time-limit"),
    Case("bench {in} --time-limit nan", 2, err="--time-limit needs a number"),
    Case("bench {in} --param certify=true", 2, err="the optimizer has no option 'certify'"),
    Case("bench {in} --runs 0", 2, err="--runs"),
    Case("bench {in} -o . --export csv", 3, err=".: cannot be written: is a folder"),
    Case("bench {in} -o nowhere/table.md", 3, err="nowhere/table.md: cannot be written"),
    Case("bench nowhere.g2o", 3, err="nowhere.g2o: cannot be read"),
    Case("bench intel", 2, err=("data sets are called 'intel'", "intel_sesync")),
    Case("bench {in}", 3, err="{in}:5:16:", content=BROKEN),
    Case("bench {in}", 3, err="no edge that slamcli can use", content="VERTEX_SE2 0 0 0 0\n"),
    Case("bench --help", 0, out=("Usage: slamcli bench", "--peers", "Exit codes")),
)
