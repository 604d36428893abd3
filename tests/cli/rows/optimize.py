"""Command lines of ``slamcli optimize``."""

from __future__ import annotations

from command_line import LOOSE, SINGULAR
from row import AMBIGUOUS, BROKEN, CHAIN, FALSE_CLOSURE, INDEFINITE, SCENE, SEEN, SWITCHED, UNKNOWN, Case

ROWS = (
    # results
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
    *(
        Case(f"optimize {{in}} --gauge {name}", 0, out=said, content=SCENE)
        for name, said in (("auto", "scale left free"), ("free", "scale left free"), ("first", "pose of 0"))
    ),
    Case("optimize {in} --gauge last", 2, err="last", content=SCENE),
    Case("optimize {in} --gauge first", 2, err="gauge 'first' is for cameras that see points"),
    *(
        Case(f"optimize {{in}} --intrinsics {name} -o {{out}}", 0, out="converged", content=SCENE)
        for name in ("auto", "fixed", "shared", "free")
    ),
    Case("optimize {in} --intrinsics none", 2, err="none", content=SCENE),
    Case("optimize {in} --intrinsics shared", 2, err="intrinsics 'shared' is for cameras that see points"),
    Case("optimize {in} --config {config}", 0, out="pose of 0", content=SCENE, config="gauge: first"),
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
    # methods and options
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
    *(
        Case(f"optimize {{in}} --reduced-solver {name}", 0, out=f"as a {name} matrix", content=SCENE)
        for name in ("dense", "sparse")
    ),
    Case("optimize {in} --reduced-solver auto", 0, out="as a dense matrix", content=SCENE),
    Case("optimize {in} --reduced-solver iterative", 0, out=("never formed", "conjugate gradients"), content=SCENE),
    Case("optimize {in} --reduced-solver iterative --json", 0, out='"linear_iterations": ', content=SCENE),
    Case("optimize {in} --reduced-solver iterative -v", 0, out="conjugate", err="cg ", content=SCENE),
    Case("optimize {in} --reduced-solver iterative", 2, err="'iterative' needs points that no edge joins"),
    Case("optimize {in} --reduced-solver lapack", 2, err="lapack"),
    Case("optimize {in} --reduced-solver dense --elimination none", 2, err="what an elimination leaves", content=SCENE),
    Case("optimize {in} --config {config}", 2, err="reduced_solver 'x' does not exist", config="reduced_solver: x"),
    *(Case(f"optimize {{in}} --method lm --scaling {name}", 0, out="-> 0.053333") for name in ("none", "marquardt")),
    Case("optimize {in} --fix 2 --fix 1", 0, out="2 fixed by the file or by --fix: 1, 2"),
    Case("optimize {in} --fix 0 --fix 1 --fix 2", 0, out=("all variables are held", "0.160000 -> 0.160000")),
    Case("optimize {in} --tolerance 0.5", 0, out="converged"),
    Case("optimize {in} --config {config}", 0, out="fixed by the file or by --fix: 1"),
    # robust kernels
    Case("optimize {in} --kernel cauchy", 0, out=("cauchy of width 3.36821 on loop closures: 1 edge of 3", "cost")),
    Case("optimize {in} --kernel dcs --kernel-width 5", 0, out=("dcs of width 5 on loop", "0.053333 at the end")),
    Case("optimize {in} --kernel huber --kernel-on all --kernel-width 9", 0, out=("9 on all edges", "-> 0.053333")),
    Case("optimize {in} --kernel fair --kernel-on closures --json", 0, out='"kernel_edges": 1'),
    Case("optimize {in} --kernel cauchy", 0, out="width - on loop closures: 0 edges", content=CHAIN),
    Case("optimize {in} --kernel hubert", 2, err=("hubert", "'huber'")),
    Case("optimize {in} --kernel huber --kernel-width 0", 2, err="kernel_width must be positive"),
    Case("optimize {in} --kernel huber --kernel-width inf", 2, err="kernel_width must be a finite number"),
    Case("optimize {in} --kernel-on odometry", 2, err="odometry"),
    # robust methods
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
    # not converged
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
    # certificates
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
    # usage
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
    # configuration files
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
    # input that is no graph
    Case("optimize {in}", 3, err=("error: {in}:5:16:", "EDGE_SE2 1 2 1 x 0"), content=BROKEN),
    Case("optimize nowhere.g2o", 3, err="nowhere.g2o: cannot be read"),
    Case("optimize {in}", 3, err="no edge", content="VERTEX_SE2 0 0 0 0\n"),
    Case("optimize {in} -o nowhere/out.g2o", 3, err="nowhere/out.g2o: cannot be written"),
    # numerical failures
    Case("optimize {in}", 5, out="numerical failure", err=("not positive definite", "SE2 77"), content=LOOSE),
    Case("optimize {in} --method lm", 0, out="converged", content=LOOSE),
    Case("optimize {in} -o {out}", 5, err=("EDGE_SE2 0 2 (line 6)", "nothing is written to {out}"), content=INDEFINITE),
    # under-observed landmarks
    Case(
        "optimize {in}",
        0,
        out="held back  1 landmark with 1 edge, under-observed: 77 (a single bearing)",
        err="warning: 1 landmark is not determined by its edges and held back: 77",
        content=SINGULAR,
    ),
    Case("optimize {in} --json", 0, out='"reason": "a single bearing"', err="held back: 77", content=SINGULAR),
    Case(
        "optimize {in} -o -",
        0,
        out="EDGE_BEARING_SE2_XY 0 77 0.8 10",
        err="no value is written for 1 landmark that had none: 77",
        content=SINGULAR.replace("VERTEX_XY 77 5 5\n", ""),
    ),
)
