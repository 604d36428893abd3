"""Command lines of ``slamcli convert``."""

from __future__ import annotations

from command_line import LINE, SINGULAR
from row import BROKEN, SCENE, TORO, Case

ROWS = (
    Case("convert {in} -", 0, out=LINE),
    Case("convert {in} - --to toro", 0, out="EDGE2 0 2 1.6 0 0 1 0 1 1 0 0\n"),
    Case("convert {in} - --to g2o", 0, out="EDGE_SE2 0 1 1.1 0 0 1 0 0 2 0 3\n", content=TORO),
    Case("convert {in} - --to toro", 0, err="not carried over: 1 XY vertices", content=SINGULAR),
    Case("convert - {out} --dialect g2o", 0),
    Case("convert {in} {out} --to ply", 0),
    Case("convert {in} - --to bundler", 0, out="# Bundle file v0.3\n2 2\n", content=SCENE),
    Case("convert {in} - --to bal", 3, err="bal holds cameras, points and their observations only"),
    Case("convert {in} - --to g2o", 3, err="knows no distortion, and 1 of 2 cameras", content=SCENE),
    Case("convert {in} -", 3, err="{in}:5:16:", content=BROKEN),
    Case("convert {in} - --lenient", 0, err="skipped", content=BROKEN),
    Case("convert {in} - --to vertigo", 2, err="vertigo"),
    Case("convert {in}", 2, err="OUTPUT"),
    Case("convert {in} nowhere/out.g2o", 3, err="nowhere/out.g2o: cannot be written"),
    Case("convert --help", 0, out="Usage: slamcli convert"),
)
