"""One table for the whole command line: arguments and input, exit code, what is said."""

from __future__ import annotations

import io
import json
import os
from dataclasses import dataclass
from pathlib import Path

import pytest
from command_line import LINE, SINGULAR

from slamcli.cli.commands import COMMANDS
from slamcli.cli.main import build_group, main

BROKEN = LINE.replace("EDGE_SE2 1 2 1 0 0", "EDGE_SE2 1 2 1 x 0")
UNKNOWN = "FOO 1 2 3\n" + LINE
INDEFINITE = LINE.replace("1.6 0 0 1 0 0 1 0 1", "1.6 0 0 1 0 0 -1 0 1")
TORO = "VERTEX2 0 0 0 0\nVERTEX2 1 1 0 0\nEDGE2 0 1 1.1 0 0 1 0 2 3 0 0\n"
ROW = "".join(f"VERTEX_SE2 {k} {9 * k} 0 0\n" for k in range(4))
ROW += "".join(f"EDGE_SE2 {k} {k + 1} 9 0 0 1 0 0 1 0 1\n" for k in range(3)) + "EDGE_SE2 0 2 18 0 0 1 0 0 1 0 1\n"
AMBIGUOUS = "EDGE2 0 1 1.1 0 0 1 0 2 3 0 0\n"
PLANAR = "0 0 0\n1 0.5 0\n2 0 0\n"
EDGES = "".join(line for line in LINE.splitlines(keepends=True) if line.startswith("EDGE"))
UNPLACED = "".join(f"{line}\n" for line in LINE.splitlines() if line.startswith("EDGE"))
TRACE = '{"event": "start", "chi2": 9.0}\n{"event": "iteration", "chi2": 1.0, "time": 0.1}\n'
ERRORS = "estimate,id,time_s,distance_m,translation_error_m,rotation_error_deg\na,0,,0.0,0.5,1.0\na,1,,1.0,0.7,1.0\n"
#: A landmark that three poses on a line see.
SEEN = """\
VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1 0 0
VERTEX_SE2 2 2 0 0
VERTEX_XY 7 2 1
EDGE_SE2 0 1 1 0 0 100 0 0 100 0 400
EDGE_SE2 1 2 1 0 0 100 0 0 100 0 400
EDGE_SE2_XY 0 7 2 1 100 0 100
EDGE_SE2_XY 1 7 1 1 100 0 100
EDGE_SE2_XY 2 7 0 1 100 0 100
"""
CHAIN = "".join(line for line in LINE.splitlines(keepends=True) if not line.startswith("EDGE_SE2 0 2"))
#: A pose in the middle of three, a chain too long to be drawn, and what some rows add to other graphs.
STAR = "".join(f"VERTEX_SE2 {k} {k} 0 0\n" for k in range(4))
STAR += "".join(f"EDGE_SE2 0 {k} {k} 0 0 1 0 0 1 0 1\n" for k in range(1, 4))
LONG = "".join(f"VERTEX_SE2 {k} {k} 0 0\n" for k in range(151))
VERTICES = "VERTEX2 0 0 0 0\nVERTEX2 1 1.1 0 0\n"
EXTRA = "VERTEX_SE2 3 3 0 0\nEDGE_SE2 2 3 1 0 0 1 0 0 1 0 1\n"
#: A closure that says a path of two metres ends where it began.
FALSE_CLOSURE = """\
VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1 0 0
VERTEX_SE2 2 2 0 0
EDGE_SE2 0 1 1 0 0 100 0 0 100 0 400
EDGE_SE2 1 2 1 0 0 100 0 0 100 0 400
EDGE_SE2 0 2 0 0 0 100 0 0 100 0 400
"""
#: The same closure with a switch, as Vertigo writes it.
SWITCHED = FALSE_CLOSURE.replace("EDGE_SE2 0 2", "EDGE_SE2_SWITCHABLE 0 2 9")
SWITCHED += "VERTEX_SWITCH 9 1\nEDGE_SWITCH_PRIOR 9 1 1\n"
CONFIG = "method: lm\nmax-iterations: 3\nfix: [1]\n"


@dataclass(frozen=True)
class Case:
    """A command line; {in}, {out}, {config} stand for files, and {in} holds ``content``."""

    words: str
    code: int = 0
    out: str | tuple[str, ...] = ()
    err: str | tuple[str, ...] = ()
    content: str = LINE
    config: str = CONFIG


#: Two cameras of BAL, the first with distortion, and two points that both see.
SCENE = (
    "2 2 4\n0 0 1.5 -2.5\n0 1 50 0\n1 0 0.25 0.5\n1 1 30 0\n"
    + "0 0 0 0 0 0 100 0.5 0 0 0 0 0 0 -2 100 0 0 0 0 -2 1 0 -2".replace(" ", "\n")
    + "\n"
)


CASES = (
    # without a command
    Case("", 2, out="Usage: slamcli"),
    Case("--help", 0, out=("Commands:", "optimize", "Exit codes")),
    Case("-h", 0, out="Commands:"),
    Case("--version", 0, out=("slamcli 0.", "numpy", "cvxopt")),
    Case("optimise {in}", 2, err="optimize"),
    Case("--bogus", 2, err="--bogus"),
    # info
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
    # convert
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
    # optimize: results
    Case("optimize {in}", 0, out=("converged", "0.160000 -> 0.053333", "lowest id held: 0", "fill-in")),
    Case("optimize -", 0, out="0.160000 -> 0.053333"),
    Case("optimize {in} -o {out}", 0, out="converged"),
    Case("optimize {in} -o -", 0, out="VERTEX_SE2 1 0.8666", err="0.160000 -> 0.053333"),
    Case("optimize {in} -o - -q", 0, out="EDGE_SE2 0 2 1.6"),
    Case("optimize {in} --json", 0, out='"status": "converged"'),
    Case("optimize {in} -q", 0),
    Case("optimize {in} -v", 0, out="converged", err=("iteration", "0.160000", "0.053333")),
    Case("optimize {in} --g2o-log", 0, err="iteration= 0\t chi2= 0.053333\t time= "),
    Case("optimize {in} --trace -", 0, out='{"event": "iteration", "iteration": 1', err="converged"),
    Case("optimize {in} --trace {out} -q", 0),
    Case("optimize {in} --ply {out}", 0, out=("reprojection, pixels", "left free"), content=SCENE),
    Case("optimize {in} --ply nowhere/scene.ply", 3, err="cannot be written", content=SCENE),
    Case("optimize {in} --json", 0, out='"reprojection": {', content=SCENE),
    Case("optimize {in} --init chordal", 2, err="images measure none", content=SCENE),
    Case("info {in}", 0, out=("2 poses, 2 landmarks, 4 edges", "bal, 29 lines"), content=SCENE),
    Case("info {in}", 3, err="{in}:3:3: expected the index of a point", content=SCENE.replace("0 1", "0 2")),
    Case("optimize {in} --covariances c.npz", 0, out="converged"),
    Case("optimize {in} --covariances - -q", 0, out="id,x_x,x_y,x_theta"),
    Case("optimize {in} --covariances -", 0, out="2,0.666", err="converged"),
    Case("optimize {in} --covariances c.txt", 2, err="npz, csv or json"),
    Case("optimize {in} --covariances c.csv", 2, err="SE2 (3 x 3) and XY (2 x 2)", content=SEEN),
    Case("optimize {in} -o - --covariances -", 2, err="both want standard output"),
    Case("optimize {in} --worst 1", 0, out=("the 1 edge with the largest chi2", "EDGE_SE2")),
    Case("optimize {in}", 0, out="FOO 1", err="1 FOO record", content=UNKNOWN),
    Case("optimize {in} --lenient", 0, out="1 malformed", content=BROKEN),
    Case("optimize {in} --dialect toro", 0, out="chi2", content=AMBIGUOUS),
    Case("optimize {in} --color always", 0, out="\x1b[32mconverged"),
    Case("optimize {in} --color never", 0, out="converged:"),
    Case("optimize {in} --color auto", 0, out="converged:"),
    # optimize: methods and options
    *(Case(f"optimize {{in}} --method {method}", 0, out="-> 0.053333") for method in ("gn", "lm", "dogleg")),
    *(
        Case(f"optimize {{in}} --init {init}", 0, out="-> 0.053333")
        for init in ("file", "odometry", "spanning-tree", "chordal", "auto")
    ),
    *(
        Case(f"optimize {{in}} --ordering {name}", 0, out=f"ordering {name}")
        for name in ("amd", "colamd", "rcm", "natural", "amd-landmarks-first", "amd-last-pose-last")
    ),
    Case("optimize {in} --ordering auto", 0, out="ordering amd"),
    *(Case(f"optimize {{in}} --linear-solver {name}", 0, out="-> 0.053333") for name in ("cholmod", "superlu")),
    *(Case(f"optimize {{in}} --elimination {name}", 0, out="-> 0.053333") for name in ("auto", "none")),
    Case("optimize {in} --elimination schur", 2, err="points that no edge joins"),
    *(Case(f"optimize {{in}} --method lm --scaling {name}", 0, out="-> 0.053333") for name in ("none", "marquardt")),
    Case("optimize {in} --fix 2 --fix 1", 0, out="2 fixed by the file or by --fix: 1, 2"),
    Case("optimize {in} --fix 0 --fix 1 --fix 2", 0, out=("all variables are held", "0.160000 -> 0.160000")),
    Case("optimize {in} --tolerance 0.5", 0, out="converged"),
    Case("optimize {in} --config {config}", 0, out="fixed by the file or by --fix: 1"),
    # optimize: robust kernels
    Case("optimize {in} --kernel cauchy", 0, out=("cauchy of width 3.36821 on loop closures: 1 edge of 3", "cost")),
    Case("optimize {in} --kernel dcs --kernel-width 5", 0, out=("dcs of width 5 on loop", "0.053333 at the end")),
    Case("optimize {in} --kernel huber --kernel-on all --kernel-width 9", 0, out=("9 on all edges", "-> 0.053333")),
    Case("optimize {in} --kernel fair --kernel-on closures --json", 0, out='"kernel_edges": 1'),
    Case("optimize {in} --kernel cauchy", 0, out="width - on loop closures: 0 edges", content=CHAIN),
    Case("optimize {in} --kernel hubert", 2, err=("hubert", "'huber'")),
    Case("optimize {in} --kernel huber --kernel-width 0", 2, err="kernel_width must be positive"),
    Case("optimize {in} --kernel huber --kernel-width inf", 2, err="kernel_width must be a finite number"),
    Case("optimize {in} --kernel-on odometry", 2, err="odometry"),
    # optimize: robust methods
    *(
        Case(f"optimize {{in}} --robust {name}", 0, out=("rejected  0 of 1 loop closure", "kept"))
        for name in ("auto", "gnc", "gnc-gm", "pcm", "pcm+gnc", "switchable")
    ),
    Case("optimize {in} --robust none", 0, out="-> 0.053333"),
    Case(
        "optimize {in} --robust gnc --noise-scale 1 --robust-probability 0.9",
        0,
        out=("rejected  1 of 1", "chi2  weight  line  edge", "EDGE_SE2 0 2"),
        content=FALSE_CLOSURE,
    ),
    Case("optimize {in} --robust gnc --rejected 0", 0, out="rejected  1 of 1", content=FALSE_CLOSURE),
    Case("optimize {in} --robust gnc --json", 0, out=('"rejection": {', '"noise_scale"'), content=FALSE_CLOSURE),
    Case("optimize {in} --robust gnc --labels-out -", 0, out="3,EDGE_SE2,0,2,outlier", content=FALSE_CLOSURE),
    Case("optimize {in} --robust gnc --drop-rejected -", 0, out="EDGE_SE2 1 2", content=FALSE_CLOSURE),
    Case("optimize {in} --kernel dcs --labels-out -", 0, out="edge,tag,from,to,label"),
    Case("optimize {in} --labels-out -", 2, err="--labels-out needs --robust or --kernel"),
    Case("optimize {in} --drop-rejected -", 2, err="--drop-rejected needs --robust or --kernel"),
    Case("optimize {in} --noise-scale 2", 2, err="--noise-scale needs --robust"),
    Case("optimize {in} --robust gnc --noise-scale 0", 2, err="noise_scale must be positive"),
    Case("optimize {in} --robust gnc --robust-probability 1", 2, err="between 0 and 1"),
    Case("optimize {in} --robust gnc --kernel huber", 2, err="two ways"),
    Case("optimize {in} --robust gnc --certify", 2, err="--drop-rejected"),
    Case("optimize {in} --robust ransac", 2, err="ransac"),
    Case(
        "optimize {in} --config {config} --kernel dcs",
        2,
        err="kernel_width must be a number",
        config="kernel_width: wide",
    ),
    Case("optimize {in} --kernel-width 2", 2, err="--kernel-width needs --kernel"),
    Case("optimize {in} --kernel-on all", 2, err="--kernel-on needs --kernel"),
    *(Case(f"optimize {{in}} --robust {name}", 3, err="switchable", content=SWITCHED) for name in ("auto", "gnc")),
    *(
        Case(f"optimize {{in}} --robust gnc --{name} {{in}}", 2, err=f"--{name} ", content=FALSE_CLOSURE)
        for name in ("trace", "labels-out", "ply")
    ),
    Case("optimize {in} --config {config} -o {config}", 2, err="would be overwritten"),
    # optimize: not converged
    Case("optimize {in} --max-iterations 0", 4, out="not converged: no iterations allowed"),
    Case("optimize {in} -o {out} --trace {out}", 2, err="name the same file"),
    Case("optimize {in} -o /dev/stdout --json", 2, err="both want standard output"),
    Case("optimize {in} -o folder/", 2, err="needs the name of a file"),
    Case("optimize {in} --tolerance inf", 2, err="must be a finite number"),
    Case(
        "optimize {in} --method lm --init file --max-iterations 1 -o {out}",
        4,
        out="not converged: iteration limit 1 reached",
    ),
    Case("optimize {in} --method lm --init file --time-limit 1e-9", 4, out="time limit"),
    # optimize: certificates
    Case("optimize {in} --certify", 0, out=("certified: the critical point", "S + eta I", "the same minimum")),
    Case("optimize {in} --certify --json", 0, out=('"status": "certified"', '"lower_bound"', '"chi2_polished"')),
    Case("optimize {in} --certify --restart", 0, out="certified"),
    Case("optimize {in} --certify --no-restart", 0, out="certified"),
    Case("optimize {in} --certify -q", 0),
    Case("optimize {in} --certify", 1, out=("inapplicable", "EDGE_SE2_XY 3"), content=SEEN),
    Case("optimize {in} --certify --kernel huber", 2, err="no certificate for a robust estimate"),
    Case("optimize {in} --objective isotropic", 0, out=("objective", "isotropic chordal", "cost", "chi2 (g2o)")),
    Case("optimize {in} --objective isotropic --certify --json", 0, out='"objective": "isotropic"'),
    Case("optimize {in} --objective g2o", 0, out="chi2"),
    Case("optimize {in} --objective chordal", 2, err="chordal"),
    Case("optimize {in} --objective isotropic", 3, err=("not defined", "EDGE_SE2_XY"), content=SEEN),
    Case("optimize {in} --objective isotropic --covariances {out}", 2, err="--objective isotropic"),
    Case("optimize {in} --config {config}", 0, out="certified", config="certify: true\nobjective: isotropic"),
    Case("optimize {in} --config {config}", 2, err="certify must be true or false", config="certify: 3"),
    Case("optimize {in} --config {config}", 2, err="objective 'x' does not exist", config="objective: x"),
    # optimize: usage
    Case("optimize {in} --method newton", 2, err=("newton", "'gn', 'lm', 'dogleg'")),
    Case("optimize {in} --methd lm", 2, err="--method"),
    Case("optimize {in} --init random", 2, err="random"),
    Case("optimize {in} --max-iterations -1", 2, err="-1"),
    Case("optimize {in} --max-iterations many", 2, err="many"),
    Case("optimize {in} --tolerance -1", 2, err="tolerance must"),
    Case("optimize {in} --tolerance nan", 2, err="tolerance must"),
    Case("optimize {in} --time-limit 0", 2, err="time_limit must be positive"),
    Case("optimize {in} --fix 9", 2, err=("no variable has the id 9", "SE2 0 to 2")),
    Case("optimize {in} --fix one", 2, err="one"),
    Case("optimize {in} -o - --json", 2, err="--output and --json both want standard output"),
    Case("optimize {in} -o - --trace -", 2, err="--output and --trace both want standard output"),
    Case("optimize {in} --json --trace -", 2, err="both want standard output"),
    Case("optimize", 2, err="INPUT"),
    Case("optimize --help", 0, out=("Usage: slamcli optimize", "--linear-solver", "Exit codes")),
    # optimize: configuration files
    Case("optimize {in} --config {config}", 2, err=("option 'metod'", "did you mean method?"), config="metod: lm"),
    Case("optimize {in} --config {config}", 2, err=("unknown option 'x'", "known: method"), config="x: 1"),
    Case("optimize {in} --config {config}", 2, err=("tolerance must be a number", "1.0e-9"), config="tolerance: 1e-6"),
    Case("optimize {in} --config {config}", 2, err="method 'newton' does not exist", config="method: newton"),
    Case("optimize {in} --config {config}", 2, err="max_iterations must be a number", config="max_iterations: true"),
    Case("optimize {in} --config {config}", 2, err="fix must be a list of ids", config="fix: [a]"),
    Case("optimize {in} --config {config}", 2, err="expected keys with values", config="- method"),
    Case("optimize {in} --config {config}", 2, err="is not valid YAML", config="method: [lm"),
    Case("optimize {in} --config nowhere.yaml", 2, err="nowhere.yaml: cannot be read"),
    Case("optimize {in} --config {config}", 0, out="converged", config=""),
    # optimize: input that is no graph
    Case("optimize {in}", 3, err=("error: {in}:5:16:", "EDGE_SE2 1 2 1 x 0"), content=BROKEN),
    Case("optimize nowhere.g2o", 3, err="nowhere.g2o: cannot be read"),
    Case("optimize {in}", 3, err="no edge", content="VERTEX_SE2 0 0 0 0\n"),
    Case("optimize {in} -o nowhere/out.g2o", 3, err="nowhere/out.g2o: cannot be written"),
    # optimize: numerical failures
    Case("optimize {in}", 5, out="numerical failure", err=("not positive definite", "XY 77"), content=SINGULAR),
    Case("optimize {in} --method lm", 0, out="converged", content=SINGULAR),
    Case("optimize {in} -o {out}", 5, err=("EDGE_SE2 0 2 (line 6)", "nothing is written to {out}"), content=INDEFINITE),
    Case("optimize {in}", 5, err="no edge that determines one: 77", content=SINGULAR.replace("VERTEX_XY 77 5 5\n", "")),
    # compare
    Case("compare {in}", 0, out=("dead reckoning", "filter", "smoother", "no loop closure"), content=SEEN),
    Case("compare {in} --truth {in} --align origin", 0, out=("ATE m", "landmarks m", "NEES"), content=SEEN),
    Case("compare {in} --truth {in} --align se", 0, out="alignment  se:", content=SEEN),
    Case("compare {in} --json", 0, out=('"command": "compare"', '"closure": null'), content=SEEN),
    Case("compare {in} --closure 2", 0, out="loop closure at pose 2 (step 2): 1 reading", content=SEEN),
    Case("compare {in} --closure 2 --corrections -", 0, out="id,filter_m,smoother_m\n0,0.0,0.0", content=SEEN),
    Case("compare {in} --corrections nowhere.csv", 0, err="nothing is written to nowhere.csv", content=SEEN),
    Case("compare {in} -o picture.svg --dpi 50 --jacobians first-estimates", 0, out="differ by", content=SEEN),
    Case("compare circle --set poses=20 --set landmarks.count=5 --closure largest", 0, out="circle, seed 0: 20 steps"),
    Case("compare --scaling 30,40", 0, out=("N to the power", "nnz(L)")),
    Case("compare --scaling 30,40 --json", 0, out=('"scaling"', '"exponent"')),
    Case("compare --scaling 30", 2, err="at least two numbers of landmarks"),
    Case("compare --scaling many", 2, err="numbers of landmarks between commas"),
    Case("compare {in} --scaling 30,40", 2, err="takes no INPUT"),
    Case("compare --scaling 30,40 --truth {in}", 2, err="--truth has no meaning with --scaling"),
    Case("compare {in} --closure 9", 2, err="no pose has the id 9", content=SEEN),
    Case("compare {in} --closure 0", 2, err="pose 0 is the first one", content=SEEN),
    Case("compare {in} --corrections {in}", 2, err="is an input and would be overwritten", content=SEEN),
    Case("compare circle --truth {in} --corrections {in}", 2, err="is an input and would be overwritten", content=SEEN),
    Case("compare {in} --closure best", 2, err="expected last, largest or the id of a pose", content=SEEN),
    Case("compare {in} -o picture.bmp", 2, err=".png, .svg or .pdf", content=SEEN),
    Case("compare {in} --corrections - --json", 2, err="both want standard output", content=SEEN),
    Case(
        "compare {in} --sensor-range 0.1",
        3,
        err=("no reading was taken for a landmark", "out-of-range 3"),
        content=SEEN,
    ),
    Case("compare {in}", 3, err="no reading of a landmark"),
    Case("compare nowhere.g2o", 3, err="nowhere.g2o: cannot be read"),
    Case("compare", 2, err="compare needs an INPUT, or --scaling"),
    Case("compare --help", 0, out=("Usage: slamcli compare", "--scaling", "Exit codes")),
    # ekf
    Case("ekf {in}", 0, out=("2 predictions", "1 landmark", "NIS", "association"), content=SEEN),
    Case("ekf -", 0, out="1 landmark", content=SEEN),
    Case("ekf {in} -q -o -", 0, out="VERTEX_XY 7 ", content=SEEN),
    Case("ekf {in} -o {out}", 0, out="{out}", content=SEEN),
    Case("ekf {in} --trajectory - -q", 0, out="2 2 0 0 0 0 0 1", content=SEEN),
    Case("ekf {in} --trace - -q", 0, out='"event": "step", "step": 2', content=SEEN),
    Case("ekf {in} --covariances {out} -q", 0, content=SEEN),
    Case("ekf {in} --landmark-covariances {out} -q", 0, content=SEEN),
    Case("ekf {in} --correlation {out} -q", 0, content=SEEN),
    Case("ekf {in} --json", 0, out=('"command": "ekf"', '"predictions": 2'), content=SEEN),
    Case("ekf {in} --truth {in}", 0, out=("ATE", "map error"), content=SEEN),
    Case("ekf {in} --dialect g2o --lenient", 0, out="1 landmark", content=SEEN),
    Case("ekf {in} --association nearest --gate 0.95 --new-gate 0.999", 0, out="made", content=SEEN),
    Case("ekf {in} --association jcbb", 0, out="made", content=SEEN),
    Case("ekf {in} --reject-outliers", 0, out="used", content=SEEN),
    Case("ekf {in} --form joseph --jacobians first-estimates", 0, out="NIS", content=SEEN),
    Case("ekf {in} --compressed --area-radius 5", 0, out="NIS", content=SEEN),
    Case("ekf {in} --start-noise 0.1,0.1,1deg --sensor-range 50", 0, out="NIS", content=SEEN),
    Case("ekf {in} --sensor-range 0.5", 0, out="out-of-range 3", content=SEEN),
    Case("ekf {in} --reject-outliers --new-gate 0.5", 0, out="used", content=SEEN),
    Case("ekf {in} --association jcbb --new-gate 0.5", 2, err="--new-gate 0.5 is below --gate", content=SEEN),
    Case("ekf {in} --area-radius 5", 2, err="no meaning without --compressed", content=SEEN),
    Case("ekf circle --truth {in} -o {in}", 2, err="is an input and would be overwritten", content=SEEN),
    Case("ekf {in} --sensor-range -1", 2, err="sensor_range must be positive", content=SEEN),
    Case("ekf {in} --noise laser=1", 2, err=("--noise needs SENSOR=deviations", "range-bearing"), content=SEEN),
    Case("ekf {in} --noise xy=1", 2, err=("--noise xy", "2 numbers"), content=SEEN),
    Case("ekf {in} --motion-noise 1,2", 2, err=("--motion-noise of a body robot", "3 numbers"), content=SEEN),
    Case(
        "ekf {in} --motion-noise 1,2,1deg --noise xy=1,1", 0, out="NIS", err="--motion-noise is not used", content=SEEN
    ),
    Case("ekf {in} --noise xy=1,1", 0, err="the log states the noise of these readings", content=SEEN),
    Case("ekf {in} --noise range=1", 0, err="the log has no such readings", content=SEEN),
    Case("ekf {in} --gate 1", 2, err="--gate", content=SEEN),
    Case("ekf {in} --robot 1", 2, err="robot", content=SEEN),
    Case("ekf {in}", 3, err="no reading of a landmark"),
    Case("ekf {in}", 3, err="{in}", content="hello world\n"),
    Case("ekf nowhere.g2o", 3, err="nowhere.g2o: cannot be read"),
    Case("ekf {in} --set poses=3", 2, err="INPUT is a log", content=SEEN),
    Case("ekf circle --set poses=20 --set landmarks.count=5", 0, out=("circle, seed 0: 20 steps", "NEES")),
    Case("ekf circle --set poses=20", 0, out="0 landmarks"),
    Case("ekf circle --set poses=2 --set landmarks.count=5", 0, out=("determine no alignment", "map error")),
    Case("ekf circle --runs 2 --set poses=20", 0, out="no updates"),
    Case("ekf torus --set poses=20", 3, err="planar"),
    Case("ekf circle --truth {in}", 2, err="INPUT is a scenario"),
    Case("ekf circle --runs 2 --jobs 1 --set poses=20 --set landmarks.count=5", 0, out=("2 runs", "95 % band")),
    Case("ekf circle --runs 2 --json --set poses=20 --set landmarks.count=5", 0, out='"nees_mean"'),
    Case("ekf {in} --runs 2", 2, err="--runs simulates a scenario", content=SEEN),
    Case("ekf circle --runs 2 -o {out}", 2, err="writes no file"),
    Case("ekf {in} -o - --json", 2, err="both want standard output", content=SEEN),
    Case("ekf", 2, err="INPUT"),
    Case("ekf --help", 0, out=("Usage: slamcli ekf", "--association", "Exit codes")),
    # evaluate
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
    # inject
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
    # plot
    Case("plot {in} -o map.png", 0),
    Case("plot - -o map.svg --title Line --size 4,3 --dpi 50", 0),
    Case("plot {in} {in} -o map.pdf --names a,b --closures", 0),
    Case("plot {in} -o map.png --no-closures --view xz", 0),
    Case("plot {in} -o map.png --color-by chi2", 0),
    Case("plot {in} -o map.png --truth {in} --align origin", 0),
    Case("plot {in} -o map.png --truth {in} --align se", 0),
    Case("plot {in} -o map.png", 0, err="1 FOO record", content=UNKNOWN),
    Case("plot {in} -o map.png --lenient", 0, err="skipped", content=BROKEN),
    Case("plot {in} -o map.png --dialect toro", 0, content=TORO),
    Case("plot {config} -o chi2.png -x time", 0, config=TRACE),
    Case("plot {config} {config} -o chi2.png --names gn,lm", 0, config=TRACE),
    Case("plot {config} -o errors.png -x distance", 0, config=ERRORS),
    Case("plot {in} -o map.png --labels {config}", 0, config="0 2\n"),
    Case("plot {config} -o map.png --truth {in}", 0, config="0 1 2 3 0 0 0 1\n1 2 2 3 0 0 0 1\n"),
    Case("plot {in}", 2, err="--output"),
    Case("plot -o map.png", 2, err="INPUT"),
    Case("plot {in} -o map.jpg", 2, err=("map.jpg ends in .jpg", ".png, .svg or .pdf")),
    Case("plot {in} -o map", 2, err="has no ending"),
    Case("plot {in} -o out/", 2, err="has no ending"),
    Case("plot {in} {config} -o map.png", 2, err=("{in}: a graph", "{config}: iterations"), config=TRACE),
    Case("plot - - -o map.png", 2, err="only one INPUT can be -"),
    Case("plot {in} {in} -o map.png --color-by chi2", 2, err="--color-by chi2 is for a single graph, got 2"),
    Case("plot {in} {in} -o map.png --labels {config}", 2, err="--labels is for a single graph"),
    Case("plot {in} -o map.png --align se", 2, err="--align needs --truth"),
    Case("plot {in} -o map.png --names a,b", 2, err="--names has 2 names for 1 INPUT"),
    Case("plot {in} -o map.png --size 4", 2, err="--size 4: expected width and height"),
    Case("plot {in} -o map.png --size 50,50 --dpi 1200", 2, err="60000 x 60000 pixels"),
    Case("plot {in} -o map.png --size nan,1", 2, err="--size nan,1"),
    Case("plot {in} -o map.png --dpi 0", 2, err="--dpi"),
    Case("plot {in} -o map.png -x time", 2, err=("--x-axis has no meaning here", "a graph or a trajectory")),
    Case("plot {config} -o chi2.png -x distance", 2, err="--x-axis distance is not for iterations", config=TRACE),
    Case("plot {config} -o errors.png -x time", 2, err="has no time_s", config=ERRORS),
    Case("plot {config} -o chi2.png --view xy", 2, err="--view has no meaning here", config=TRACE),
    Case("plot {config} -o map.png --labels {in}", 2, err="--labels needs a graph", config="0 0 0 0 0 0 0 1\n"),
    Case("plot nowhere.g2o -o map.png", 3, err="nowhere.g2o: cannot be read"),
    Case("plot . -o map.png", 3, err="is a directory"),
    Case("plot {in} -o map.png", 3, err="{in}:5:16:", content=BROKEN),
    Case("plot {in} -o map.png", 3, err="{in}:1:", content=LINE.replace("VERTEX_SE2 0 0", "VERTEX_SE2 0 nan")),
    Case("plot {in} -o map.png", 3, err="no record", content=""),
    Case("plot {in} -o map.png", 3, err=("nothing in it has a finite position", "--init odometry"), content=UNPLACED),
    Case("plot {in} -o map.png --covariances nowhere.npz", 3, err="nowhere.npz: cannot be read"),
    Case("plot {in} -o map.png --labels {config}", 3, err="the graph does not have", config="0 7\n"),
    Case("plot {config} -o chi2.png", 3, err="holds no iterations", config=TRACE.splitlines()[0]),
    Case("plot {in} -o nowhere/map.png", 3, err="nowhere/map.png: cannot be written"),
    Case("plot --help", 0, out=("Usage: slamcli plot", "--covariances", "Exit codes")),
    # predict
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
    # covariance
    Case("covariance {in}", 0, out=("3 SE2", "lowest id held: 0", "whose own are zero"), err="not at an optimum"),
    Case("covariance -", 0, out="tangent      SE2: x [m], y [m], theta [rad]; frame of the pose"),
    Case("covariance {in} --of 2,0", 0, out=("0.8165", "held")),
    Case("covariance {in} --of poses --rows 1", 0, out="the 1 SE2 of largest uncertainty"),
    Case("covariance {in} --of landmarks", 0, out="1 XY", content=SEEN),
    Case("covariance {in} --fix 1", 0, out="1 fixed by the file or by --fix: 1"),
    Case("covariance {in} --joint 1,2", 0, out=("joint covariance:", "2 theta")),
    Case("covariance {in} --relative 1,2 --relative 2,0", 0, out=("2 seen from 1, SE2 (1, 0, 0)", "0 seen from 2")),
    Case("covariance {in} --relative 1,7 --probability 0.5", 0, out=("7 seen from 1, XY", "0.5"), content=SEEN),
    Case("covariance {in} --probability nan", 2, err="between 0 and 1"),
    Case("covariance {in} --cross", 0, out="cross-covariances of 2 connected pairs of SE2 and SE2", content=SEEN),
    Case("covariance {in} --convention gtsam", 0, out="convention   gtsam"),
    Case("covariance {in} --scale posterior", 0, out="posterior: times chi2 / degrees of freedom = 0.16 / 3"),
    Case("covariance {in} --json", 0, out=('"command": "covariance"', '"at_optimum": false')),
    Case("covariance {in} -o -", 0, out="# convention: slamcli\n", err="3 SE2"),
    Case("covariance {in} --output c.json", 0, out="c.json"),
    Case("covariance {in} -o c.npz", 0, out="1 XY", content=SEEN),
    Case("covariance {in} --dialect toro", 0, out="2 SE2", content=TORO),
    Case("covariance {in} --lenient", 0, out="3 SE2", err="skipped", content=BROKEN),
    Case("covariance {in} -o c.csv", 2, err=("SE2 (3 x 3) and XY (2 x 2)", "--of"), content=SEEN),
    Case("covariance {in} -o c.csv --cross", 2, err="no room for --cross"),
    Case("covariance {in} -o c.txt", 2, err="npz, csv or json"),
    Case("covariance {in} -o {in}", 2, err="--output {in} is an input"),
    Case("covariance {in} -o - --json", 2, err="both want standard output"),
    Case("covariance {in} --of 9", 2, err=("no variable has the id 9", "SE2 0 to 2")),
    Case("covariance {in} --of some", 2, err="got 'some'"),
    Case("covariance {in} --of landmarks", 2, err="no landmarks"),
    Case("covariance {in} --joint 1,x", 2, err="expected ids"),
    Case("covariance {in} --relative 1", 2, err="expected 2 ids"),
    Case("covariance {in} --relative 1,1", 2, err="two different variables"),
    Case("covariance {in} --relative 7,1", 2, err="nothing is relative from XY to SE2", content=SEEN),
    Case("covariance {in} --convention ros", 2, err="ros"),
    Case("covariance {in} --probability 1", 2, err="--probability"),
    Case("covariance {in} --fix 9", 2, err="no variable has the id 9"),
    Case("covariance {in}", 3, err="{in}:5:16:", content=BROKEN),
    Case("covariance {in}", 3, err="no record", content=""),
    Case("covariance {in}", 3, err=("have no estimate", "slamcli optimize"), content=UNPLACED),
    Case("covariance {in}", 3, err="no edge that slamcli can use", content="VERTEX_SE2 0 0 0 0\n"),
    Case("covariance {in} -o nowhere/c.npz", 3, err="nowhere/c.npz: cannot be written"),
    Case("covariance {in}", 5, err=("no covariances", "XY 77"), content=SINGULAR),
    Case("covariance {in}", 5, err="indefinite", content=INDEFINITE),
    Case("covariance --help", 0, out=("Usage: slamcli covariance", "--relative", "Exit codes")),
    # graph
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
    # marginalize
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
    # sparsity
    Case(
        "sparsity {in}",
        0,
        out=("6 x 6, 21 nonzeros in the triangle", "nnz(L)", "natural", "amd *", "what --ordering auto"),
    ),
    Case("sparsity - --orderings amd,natural", 0, out="natural"),
    Case("sparsity {in} --orderings auto", 0, out="auto (amd)"),
    Case("sparsity {in} --orderings natural,rcm,colamd --json", 0, out=('"command": "sparsity"', '"name": "colamd"')),
    Case("sparsity {in} --time-limit 0 --json", 0, out=('"calibration": null', '"measured_time": null')),
    Case("sparsity {in} --fix 2 --time-limit 0", 0, out=("1 fixed by the file or by --fix: 2", "6 x 6")),
    Case("sparsity {in} --orderings amd-landmarks-first", 0, out=("reduced", "6 x 6", "1 landmark"), content=SEEN),
    Case("sparsity {in} --orderings amd --add-closure 2,3", 0, out=("blocks of", "appear"), content=ROW),
    Case("sparsity {in} --orderings amd --marginalize 2", 0, out=("blocks of", "appear"), content=ROW),
    Case("sparsity {in} --spy {out} --tree tree.svg --title Row --dpi 40", 2, err="--spy {out}"),
    Case(
        "sparsity {in} --spy spy.png --tree tree.svg --title Row --dpi 40", 0, out=("spy.png", "tree.svg"), content=ROW
    ),
    Case("sparsity {in} --spy a.png --tree a.png", 2, err="name the same file"),
    Case("sparsity {in} --spy - --json", 2, err="both want standard output"),
    Case("sparsity {in} --tree tree.txt", 2, err=("--tree tree.txt ends in .txt", ".svg")),
    Case("sparsity {in} --spy nowhere/spy.png --orderings amd", 3, err="nowhere/spy.png: cannot be written"),
    Case("sparsity {in} --orderings mmd", 2, err=("'mmd' does not exist", "colamd")),
    Case("sparsity {in} --orderings ,", 2, err="names no ordering"),
    Case("sparsity {in} --add-closure 1", 2, err="expected two ids"),
    Case("sparsity {in} --add-closure 1,1", 2, err="joins two variables"),
    Case("sparsity {in} --add-closure 1,77", 2, err=("--add-closure: no variable has the id 77", "SE2 0 to 2")),
    Case("sparsity {in} --marginalize 77", 2, err=("--marginalize: no variable has the id 77", "SE2 0 to 2")),
    Case("sparsity {in} --marginalize 0", 2, err="variable 0 is held"),
    Case("sparsity {in} --time-limit -1", 2, err="--time-limit"),
    Case("sparsity {in} --time-limit nan", 2, err="--time-limit must be a number"),
    Case("sparsity {in} --fix 0 --fix 1 --fix 2", 3, err="all variables are held"),
    Case("sparsity {in}", 3, err="no edge that slamcli can use", content="VERTEX_SE2 0 0 0 0\n"),
    Case("sparsity {in}", 3, err="{in}:5:16:", content=BROKEN),
    Case("sparsity {in} --lenient --dialect g2o --orderings amd", 0, err="skipped: {in}:5:16", content=BROKEN),
    Case("sparsity nowhere.g2o", 3, err="nowhere.g2o: cannot be read"),
    Case("sparsity --help", 0, out=("Usage: slamcli sparsity", "--add-closure", "Exit codes")),
    # simulate
    Case("simulate camera-ring -o scene.bal --truth truth.bal --poses 5", 0, out=("5 cameras", "reprojection, pixels")),
    Case("simulate camera-flight --json --seed 3", 0, out=('"dropped"', '"reprojection": {')),
    Case("simulate camera-ring -o -", 0, out="20 500 ", err="written"),
    Case("simulate camera-ring --log log.csv", 2, err="--log has no meaning for a scene of cameras"),
    Case("simulate camera-ring --set cameras=1", 2, err="no point is seen by two cameras"),
    Case("simulate camera-ring -o scene.g2o", 3, err="knows no distortion"),
    Case("simulate square --poses 9 -o {out}", 0, out=("world", "9 poses, 8 m", "drift", "{out}")),
    Case("simulate square --poses 9 -o -", 0, out="VERTEX_SE2 8", err="9 poses"),
    Case("simulate square --poses 9 -q -o -", 0, out="EDGE_SE2 7 8"),
    Case("simulate square --poses 9", 0, out="nothing (-o FILE keeps the graph)"),
    Case("simulate square --poses 9 --json", 0, out=('"command": "simulate"', '"world": "square"', '"drift"')),
    Case("simulate square --poses 9 --truth {out}", 0, out="truth"),
    Case("simulate square --poses 9 --log -", 0, out="time_s,kind,pose,other,z1,z2,z3,i11", err="drift"),
    Case("simulate square --poses 9 --labels -", 0, out="edge,tag,from,to,label", err="drift"),
    Case("simulate square --poses 9 --seed 7", 0, out="seed 7"),
    Case("simulate {config}", 0, out="11 poses", config="world: circle\nposes: 11\n"),
    Case("simulate {config} --set poses=12", 0, out="12 poses", config="world: circle\nposes: 11\n"),
    Case("simulate square --poses 9 --sweep robot.noise=0,0.1 --runs 2", 0, out=("gap mean", "0.1")),
    Case("simulate square --poses 9 --sweep robot.noise=0,1 --runs 2 --json", 0, out=('"sweep": "robot.noise"',)),
    Case("simulate square --sweep robot.slip", 2, err="--sweep needs key=value"),
    Case("simulate square --sweep poses=3 -o {out}", 2, err="writes no file"),
    Case("simulate square -o x.tum", 2, err=("x.tum", "as g2o or TORO")),
    Case("simulate {config}", 2, err="the key poses stands twice", config="poses: 3\nposes: 4\n"),
    Case("simulate square --runs 0", 2, err="0"),
    Case("simulate squar", 2, err=("no world and no file 'squar'", "did you mean square?")),
    Case("simulate nowhere.yaml", 2, err="nowhere.yaml: cannot be read"),
    Case("simulate {config}", 2, err="{config}: unknown key 'pose'", config="world: circle\npose: 11\n"),
    Case("simulate {config}", 2, err="is not valid YAML", config="world: ["),
    Case("simulate square --set robot.slp=1", 2, err=("unknown key 'robot.slp'", "did you mean slip?")),
    Case("simulate square --set poses", 2, err="--set needs key=value"),
    Case("simulate square -o {out} --truth {out}", 2, err="name the same file"),
    Case("simulate square -o - --json", 2, err="both want standard output"),
    Case("simulate {config} --log {config}", 2, err="--log {config} is an input", config="world: square\n"),
    Case("simulate square --poses 9 -o nowhere/x.g2o", 3, err="nowhere/x.g2o: cannot be written"),
    Case("simulate", 2, err="SOURCE"),
    Case("simulate --help", 0, out=("Usage: slamcli simulate", "Worlds:", "Exit codes")),
)


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.code} {case.words}")
def test_command(
    case: Case, tmp_path: Path, capfdbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    names = {"{in}": "graph.g2o", "{out}": "out.g2o", "{config}": "config.yaml"}
    monkeypatch.chdir(tmp_path)
    for name in list(os.environ):
        if name.startswith("SLAMCLI_") or name == "NO_COLOR":
            monkeypatch.delenv(name)
    Path("graph.g2o").write_text(case.content)
    Path("config.yaml").write_text(case.config)
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(case.content.encode())))
    words = [names.get(word, word) for word in case.words.split()]
    code = main(words)
    streams = [stream.decode() for stream in capfdbinary.readouterr()]
    for parts, found in zip((case.out, case.err), streams, strict=True):
        for part in (parts,) if isinstance(parts, str) else parts:
            for name, file in names.items():
                part = part.replace(name, file)
            assert part in found
    assert code == case.code
    assert "Traceback" not in streams[1]
    if case.code in (2, 3):
        assert streams[0] == "" or not words
        assert "error" in streams[1].lower() or not words
    written = Path("out.g2o").exists()
    assert written == ("out.g2o" in words and case.code in (0, 4))


def test_the_table_knows_every_command_and_option() -> None:
    """Whoever adds an option adds a line here."""
    used = {word for case in CASES for word in case.words.split()}
    for name in COMMANDS:
        assert name in used
        command = build_group().get_command(None, name)  # type: ignore[arg-type]
        assert command is not None
        for parameter in command.params:
            if parameter.param_type_name == "option":
                assert used & set(parameter.opts), f"{name} {parameter.opts[-1]} has no line in the table"


def test_quiet_is_quiet(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "graph.g2o"
    path.write_text(LINE)
    assert main(["optimize", str(path), "-q"]) == 0
    assert capsys.readouterr() == ("", "")


def test_json_is_one_document(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Also of a failed run, with null for what there is not."""
    path = tmp_path / "graph.g2o"
    for content, code, status in ((LINE, 0, "converged"), (INDEFINITE, 5, "numerical_failure")):
        path.write_text(content)
        assert main(["optimize", str(path), "--json"]) == code
        document = json.loads(capsys.readouterr().out)
        assert (document["status"], document["exit_code"]) == (status, code)
        assert document["input"]["path"] == str(path)
        assert (document["sparsity"] is None) == (code == 5)
