"""Command lines of ``slamcli covariance``."""

from __future__ import annotations

from command_line import SINGULAR
from row import BROKEN, INDEFINITE, SEEN, TORO, UNPLACED, Case

# A pose whose only edge says nothing of its orientation.
_LOOSE_POSE = """\
VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1 0 0
VERTEX_SE2 2 2 0 0
EDGE_SE2 0 1 1 0 0 10 0 0 10 0 10
EDGE_SE2 1 2 1 0 0 10 0 0 10 0 0
"""

ROWS = (
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
    Case("covariance {in}", 0, out=("2 SE2", "held back"), err="1 landmark is not determined", content=SINGULAR),
    Case("covariance {in} --json", 0, out='"reason": "a single bearing"', err="held back: 77", content=SINGULAR),
    Case("covariance {in} --of 77", 5, err=("landmark 77", "77: a single bearing"), content=SINGULAR),
    Case("covariance {in}", 5, err=("no covariances", "SE2 2, mostly"), content=_LOOSE_POSE),
    Case("covariance {in}", 5, err="indefinite", content=INDEFINITE),
    Case("covariance {in} --intrinsics fixed", 2, err="is for cameras"),
    Case("covariance --help", 0, out=("Usage: slamcli covariance", "--relative", "Exit codes")),
)
