"""Command lines of ``slamcli compare``."""

from __future__ import annotations

from row import SEEN, Case

ROWS = (
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
)
