"""Command lines of ``slamcli evaluate``."""

from __future__ import annotations

from row import BROKEN, EDGES, PLANAR, Case

ROWS = (
    Case("evaluate {in} --truth {in}", 0, out=("3 by id", "se: rotation and translation", "ATE translation (m)")),
    Case("evaluate {in} - --truth {in}", 0, out=("graph.g2o", "RPE rotation (deg) over 1 frame", "median")),
    Case("evaluate {in}", 0, out="first to last pose  2 m, 0 deg"),
    Case("evaluate {in} --truth {config} --align none", 0, out=("0.288675", "0.166667"), config=PLANAR),
    *(
        Case(f"evaluate {{in}} --truth {{config}} --align {name}", 0, out=f"{name}: ", config=PLANAR)
        for name in ("none", "origin", "se", "sim")
    ),
    *(
        Case(f"evaluate {{in}} --truth {{config}} --associate {name}", 0, out=f"3 by {chosen}", config=PLANAR)
        for name, chosen in (("auto", "id"), ("id", "id"), ("index", "index"))
    ),
    Case("evaluate {in} --truth {config} --associate time", 3, err="graph.g2o has no time stamps", config=PLANAR),
    Case("evaluate {in} --timestamps {config} --truth {in}", 0, out="3 by id", config="1\n2\n3\n"),
    Case(
        "evaluate {in} --timestamps {config} --truth {in} --truth-timestamps {config} --max-time-difference 0.5",
        0,
        out=("3 by time", "largest time difference  0 s"),
        config="1\n2\n3\n",
    ),
    Case("evaluate {in} --timestamps {config}", 3, err="holds 2 time stamps for the 3 poses", config="1\n2\n"),
    Case("evaluate {config} --timestamps {in}", 2, err="time stamps of its own", config="1 2 3 0\n"),
    Case("evaluate {in} --truth-timestamps {config}", 2, err="--truth-timestamps needs --truth"),
    Case("evaluate {in} --truth {in} --max-time-difference -1", 2, err="at least 0"),
    Case("evaluate {in} --truth {in} --delta 1 --delta 2", 0, out=("over 1 frame", "over 2 frames")),
    Case("evaluate {in} --truth {in} --delta 1 --delta-unit m --all-pairs", 0, out="over 1 m"),
    Case("evaluate {in} --truth {in} --delta 9", 0, out="ATE", err="no two of 3 poses are 9 frames apart"),
    Case("evaluate {in} --truth {in} --delta 0.5", 2, err="whole number of frames"),
    Case("evaluate {in} --truth {in} --delta-unit miles", 2, err="miles"),
    Case("evaluate {in} --dead-reckoning --truth {in}", 0, out=("dead reckoning of graph.g2o", "drift over the path")),
    Case("evaluate {in} --dead-reckoning", 0, out="dead reckoning of graph.g2o", content=EDGES, err="only its dead"),
    Case("evaluate {in}", 3, err=("no pose with a value", "--init odometry"), content=EDGES),
    Case("evaluate {config} --dead-reckoning", 2, err="needs a graph with edges", config=PLANAR),
    Case("evaluate {in} --labels {config}", 0, out="TP / FP / FN / TN        1 / 0 / 0 / 0", config="0 1\n"),
    Case("evaluate {in} --labels {config} --gate 0.01", 0, out="FN / TN        0 / 0 / 0 / 1", config="0 2\n"),
    Case(
        "evaluate {in} --labels {config} --estimated-labels {config}",
        0,
        out="FN / TN        0 / 0 / 0 / 1",
        config="0 2\n",
    ),
    Case("evaluate {in} --estimated-labels {config}", 2, err="needs --labels", config="0 2\n"),
    Case(
        "evaluate {in} {in} --labels {config} --estimated-labels {config}",
        2,
        err="belong to one estimate",
        config="0 2\n",
    ),
    Case("evaluate {in} --labels {config} --gate 1", 2, err="probability between 0 and 1", config="0 2\n"),
    Case("evaluate {in} --labels {config}", 3, err="config.yaml:1:1", config="hello\n"),
    Case("evaluate {in} --truth {in} --covariances {config}", 0, out=("none: ", "mean NEES"), config="2,1,0,0,1,0,1\n"),
    Case("evaluate {in} --truth {in} --covariances {config} --align se", 2, err="NEES", config="2,1,0,0,1,0,1\n"),
    Case("evaluate {in} --truth {in} --covariances {config}", 3, err="expected 4, 7 or 22 numbers", config="2,1,0\n"),
    Case("evaluate {in} --covariances {config}", 2, err="--covariances needs --truth"),
    Case("evaluate {in} {in} --truth {in} --covariances {config}", 2, err="belong to one estimate"),
    Case("evaluate {in} --truth {in} -o {out}", 0, out="ATE"),
    Case("evaluate {in} --truth {in} --errors -", 0, out="estimate,id,time_s,distance_m,x_m", err="ATE"),
    Case("evaluate {in} --truth {in} -o - --json", 2, err="both want standard output"),
    Case("evaluate {in} --truth {in} -o {in}", 2, err="--errors {in} is an input and would be overwritten"),
    Case("evaluate {in} --truth {in} -o folder/", 2, err="needs the name of a file"),
    Case("evaluate {in} -o {out}", 2, err="--errors needs --truth"),
    Case("evaluate {in} --truth {in} -o nowhere/out.csv", 3, err="nowhere/out.csv: cannot be written"),
    Case("evaluate {in} --truth {in} --json", 0, out=('"command": "evaluate"', '"matched": 3')),
    Case("evaluate {in} --truth {in} --color always", 0, out="\x1b[1mgraph.g2o"),
    Case("evaluate {in} --dialect toro", 3, err="{in}"),
    Case("evaluate {in} --lenient", 0, out="poses", err="{in}:5:16", content=BROKEN),
    Case("evaluate {in}", 3, err="{in}:5:16:", content=BROKEN),
    Case(
        "evaluate {in} --truth {config}", 3, err=("config.yaml:1:1", "time stamp is missing"), config="0 0 0 0 0 0 1\n"
    ),
    Case("evaluate {in} --truth {config}", 3, err=("no id in common", "ids 0 to 2"), config="VERTEX_SE2 9 0 0 0\n"),
    Case("evaluate {in} --truth {config}", 3, err="nothing tells", config="0.5 0 0 0\n"),
    Case("evaluate {in} --truth {config}", 3, err="holds no record", config=""),
    Case("evaluate nowhere.tum", 3, err="nowhere.tum: cannot be read"),
    Case("evaluate {in} --truth {in}", 5, err="in one point", content="VERTEX_SE2 0 0 0 0\n"),
    Case("evaluate - --truth -", 2, err="only one file"),
    Case("evaluate", 2, err="ESTIMATE"),
    Case("evaluate --help", 0, out=("Usage: slamcli evaluate", "--dead-reckoning", "Examples")),
    Case("evaluate {in} --truth manhattan_smal", 3, err="did you mean the data set manhattan_small or"),
    Case(
        "evaluate {in} --truth manhattan_small",
        0,
        out="manhattan_small.g2o",
        err="reading the data set manhattan_small",
    ),
)
