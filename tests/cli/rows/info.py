"""Command lines of ``slamcli info``."""

from __future__ import annotations

from row import AMBIGUOUS, BROKEN, TORO, UNKNOWN, Case

ROWS = (
    Case("info {in}", 0, out=("3 poses, 3 edges (1 loop closure)", "0.160000 at these values", "VERTEX_SE2 3")),
    Case("info -", 0, out="3 poses"),
    Case("info {in} --json", 0, out=('"command": "info"', '"poses": 3')),
    Case("info {in} --worst 2", 0, out=("2 edges with the largest chi2", "EDGE_SE2 0 2")),
    Case("info {in} --dialect g2o", 0, out="g2o, 6 lines"),
    Case("info {in} --dialect toro", 3, err="{in}"),
    Case("info {in}", 0, out="toro, 3 lines", content=TORO),
    Case("info {in}", 3, err="nothing in the file says which", content=AMBIGUOUS),
    Case("info {in} --dialect toro", 0, out="toro, 1 line", content=AMBIGUOUS),
    Case("info {in}", 3, err=("{in}:5:16:", "EDGE_SE2 1 2 1 x 0", "^", "--lenient"), content=BROKEN),
    Case("info {in} --lenient", 0, out="1 malformed", err="{in}:5:16", content=BROKEN),
    Case("info {in}", 0, out="FOO 1", err="1 FOO record", content=UNKNOWN),
    Case("info {in}", 3, err="no record", content=""),
    Case("info nowhere.g2o", 3, err="nowhere.g2o: cannot be read: No such file"),
    Case("info .", 3, err="is a directory"),
    Case("info", 2, err="INPUT"),
    Case("info {in} --worst -1", 2, err="--worst"),
    Case("info --help", 0, out=("Usage: slamcli info", "--lenient", "Examples")),
)
