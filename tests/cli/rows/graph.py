"""Command lines of ``slamcli graph``."""

from __future__ import annotations

from command_line import LINE
from row import AMBIGUOUS, BROKEN, LONG, SEEN, UNPLACED, Case

ROWS = (
    Case("graph {in}", 0, out=("3 poses, 3 factors: 2 odometry, 1 loop closure", "nothing (--dot FILE or --svg")),
    Case("graph {in} --dot -", 0, out=("graph factor_graph {", 'label="x0"'), err="3 factors"),
    Case("graph - --svg - --title hello", 0, out=("<svg", "</svg>"), err="at the estimates"),
    Case("graph {in} --svg picture.png --layout spring", 0, out=("by springs", "picture.png")),
    Case("graph {in} --variant online --dot -", 0, out='label="x2"', err="1 pose, 1 factor: 1 marginal", content=LINE),
    Case("graph {in} --eliminate natural --svg steps.svg", 0, out=("1  x0", "fill-in: 0 pairs in all")),
    Case("graph {in} --eliminate least-degree --json", 0, out=('"command": "graph"', '"separator"')),
    Case("graph {in} --eliminate 1", 0, out="x0 x2"),
    Case("graph {in} --eliminate=", 2, err="--eliminate needs an order"),
    Case("graph {in} --ids 7 --hops 1", 0, out=("3 poses, 1 landmark", "odometry"), content=SEEN),
    Case("graph {in} --ids 0", 0, out=("1 pose, 0 factors: none", "2 factors to variables outside the choice")),
    Case("graph {in} --lenient", 0, err="skipped", content=BROKEN),
    Case("graph {in} --dialect toro", 0, out="2 poses", content=AMBIGUOUS),
    Case("graph {in} --layout estimate", 2, err="not every variable has an estimate", content=UNPLACED),
    Case("graph {in} --layout auto", 0, out="by springs", content=UNPLACED),
    Case("graph {in} --hops 1", 2, err="--hops needs --ids"),
    Case("graph {in} --ids 9", 2, err="no variable has the id 9"),
    Case("graph {in} --eliminate 0,0", 2, err="an id occurs twice"),
    Case("graph {in} --eliminate 9", 2, err="no variable that is drawn has the id 9"),
    Case("graph {in} --eliminate amd", 2, err="expected natural, least-degree, or ids"),
    Case("graph {in} --eliminate natural --variant online", 2, err="--eliminate is for --variant full"),
    Case("graph {in} --svg graph.jpg", 2, err="ends in .svg, .png or .pdf"),
    Case("graph {in} --dot - --json", 2, err="both want standard output"),
    Case("graph {in} --dot {in}", 2, err="is an input and would be overwritten"),
    Case("graph {in}", 2, err=("151 variables are more than a picture can show", "--ids"), content=LONG),
    Case("graph {in} --eliminate natural", 2, err="more than a strip of steps can show (24)", content=LONG),
    Case("graph {in}", 3, err="{in}:5:16:", content=BROKEN),
    Case("graph {in} --svg nowhere/x.svg", 3, err="cannot be written"),
    Case("graph --help", 0, out=("Usage: slamcli graph", "--eliminate", "Exit codes")),
)
