"""Command lines of ``slamcli marginalize``."""

from __future__ import annotations

from command_line import LINE
from row import AMBIGUOUS, BROKEN, EXTRA, INDEFINITE, SEEN, STAR, UNPLACED, VERTICES, Case

ROWS = (
    Case(
        "marginalize {in} -o {out} --remove 1",
        0,
        out=("3 poses, 3 edges -> 2 poses, 2 edges", "1 kept as they are, 1 recovered", "exact", "{out}"),
        err="no optimum",
    ),
    Case("marginalize {in} -o - --remove 1", 0, out="EDGE_SE2 0 2 2 0 0 0.5", err="KLD"),
    Case("marginalize {in} --keep every:2 -q", 0, err="no optimum"),
    Case("marginalize {in} --keep every:2 --json", 0, out=('"command": "marginalize"', '"fill_in": 0')),
    Case(
        "marginalize {in} --keep poses-only --sparsify chow-liu", 0, out="of the kept 2 before, 3 in the", content=SEEN
    ),
    Case("marginalize - --keep landmarks-only --sparsify subgraph", 0, out="0: removed, but not", content=SEEN),
    Case("marginalize {in} --remove 1 --lenient", 0, err="skipped", content=BROKEN),
    Case("marginalize {in} --remove 1 --dialect toro", 0, out="1 pose, 0 edges", content=AMBIGUOUS + VERTICES),
    Case("marginalize {in} --keep 0,2", 0, err="1 fixed variable would go", content=LINE + "FIX 1\n" + EXTRA),
    Case("marginalize {in} --remove 0 --largest-blanket 2", 2, err="--largest-blanket 3 does it", content=STAR),
    Case("marginalize {in}", 2, err="--keep RULE or --remove RULE"),
    Case("marginalize {in} --keep every:1", 2, err="2 or more"),
    Case("marginalize {in} --keep all", 2, err="'all' is no id"),
    Case("marginalize {in} --remove 7", 2, err="no variable has the id 7"),
    Case("marginalize {in} -o - --json --keep every:2", 2, err="both want standard output"),
    Case("marginalize {in} --remove 1", 3, err="no estimate", content=UNPLACED),
    Case("marginalize {in} --remove 1", 3, err="{in}:5:16:", content=BROKEN),
    Case("marginalize {in} --remove 1 -o {out}", 5, err="indefinite", content=INDEFINITE),
    Case("marginalize {in} -o nowhere/x.g2o --remove 1", 3, err="cannot be written"),
    Case("marginalize --help", 0, out=("Usage: slamcli marginalize", "--sparsify", "Exit codes")),
)
