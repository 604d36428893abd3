"""Command lines of ``slamcli inject``."""

from __future__ import annotations

from command_line import LINE
from row import BROKEN, ROW, TORO, Case

ROWS = (
    Case("inject {in} -o {out} --false-closures 1", 2, err="only 0 of 1 false closures"),
    Case(
        "inject {in} -o {out} --false-closures 1", 0, out=("1, policy random; 1 are true", "1 of 5 edges"), content=ROW
    ),
    Case(
        "inject {in} -o - --false-closures 1 --seed 3",
        0,
        out=ROW + "EDGE_SE2 ",
        err=("seed            3", "standard output"),
        content=ROW,
    ),
    Case("inject {in} -o {out} --false-closures 0% -q", 0, content=ROW),
    Case("inject {in} -o {out} --drop-closures 50%", 2, err="no loop closures to take 50%", content=TORO),
    Case("inject {in} -o {out} --false-closures 1 --policy local --json", 0, out='"policy": "local"', content=ROW),
    Case("inject {in} -o {out} --false-closures 1 --policy grouped --group-size 1-2", 0, out="1 run", content=ROW),
    Case("inject {in} -o {out} --false-closures 1 --group-size 3", 2, err="--policy random", content=ROW),
    Case("inject {in} -o - --false-closures 1 --information 7", 0, out=" 7 0 0 7 0 7\n", content=ROW),
    Case("inject {in} -o {out} --false-closures 1 --truth {in}", 0, out="reference", content=ROW),
    Case("inject {in} -o {out} --false-closures 1 --policy sideways", 2, err="sideways"),
    Case("inject {in} -o {out} --false-closures -1", 2, err="not negative"),
    Case("inject {in} -o {out} --false-observations 1", 2, err="no observations"),
    Case("inject {in} -o {out} --corrupt-odometry 50% --magnitude 0.5", 0, out="1 of 2 edges, magnitude 0.5"),
    Case("inject {in} -o {out} --corrupt-odometry 3", 2, err="cannot choose 3 of 2 odometry edges"),
    Case("inject {in} -o - --drop-closures 1 -q", 0, out=LINE.replace("EDGE_SE2 0 2 1.6 0 0 1 0 0 1 0 1\n", "")),
    Case("inject {in} -o - --scale-information 2 --scale closures -q", 0, out="EDGE_SE2 0 2 1.6 0 0 2 0 0 2 0 2\n"),
    Case("inject {in} -o {out} --scale-information -2", 2, err="positive finite number"),
    Case("inject {in} -o {out} --perturb 0.1,5deg", 0, out=("2 of 3 variables", "0.1 m and 0.0872665 rad")),
    Case("inject {in} -o {out} --perturb 0.1,5m", 2, err="'5m'"),
    Case("inject - -o {out} --perturb 0.1 --labels labels.csv", 0, out="labels.csv"),
    Case("inject {in} -o {out} --perturb 0.1 --labels {out}", 2, err="--output and --labels name the same file"),
    Case("inject {in} -o {out} --perturb 0.1 --labels {in}", 2, err="INPUT and --labels name the same file"),
    Case("inject {in} -o - --perturb 0.1 --labels -", 2, err="both want standard output"),
    Case("inject {in} -o {out} --perturb 0.1 --policy local", 2, err="--policy does nothing without --false-closures"),
    Case("inject {in} -o {out} --perturb 0.1 --seed -1", 2, err="--seed"),
    Case("inject {in} -o {out} --drop-closures 1 --lenient", 0, err="skipped", content=BROKEN),
    Case("inject {in} -o {out} --drop-closures 0", 3, err="{in}:5:16:", content=BROKEN),
    Case("inject {in} -o {out} --perturb 1 --dialect toro", 0, err="{out} holds toro", content=TORO),
    Case("inject {in} -o nowhere/out.g2o --perturb 1", 3, err="nowhere/out.g2o: cannot be written"),
    Case("inject {in} -o {out}", 2, err=("nothing to do", "--false-closures")),
    Case("inject {in} --perturb 1", 2, err="--output"),
    Case("inject --help", 0, out=("Usage: slamcli inject", "--policy", "Examples")),
)
