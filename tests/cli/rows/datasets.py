"""Command lines of ``slamcli datasets``. Here are the bundled data sets and no others."""

from __future__ import annotations

from row import Case

ROWS = (
    Case("datasets", 2, err="Missing command"),
    Case("datasets lst", 2, err="No such command 'lst'"),
    Case("datasets --help", 0, out=("Usage: slamcli datasets", "Exit codes", "fetch", "verify")),
    Case("datasets list", 0, out=("sphere2500", "727.149667", "8 of them here")),
    Case("datasets list --available", 0, out=("landmarks_small", "372.237356", "8 data sets, 8 of them here")),
    Case("datasets list --group bundled --json", 0, out=('"command": "datasets list"', '"name": "square_toro"')),
    Case("datasets list INTEL", 0, out=("INTEL_carlone", "intel_openslam", "intel_sesync", "0 of them here")),
    Case("datasets list nothing-like-it", 2, err="no data set has 'nothing-like-it'"),
    Case("datasets list --group bundeld", 2, err=("no group 'bundeld'", "did you mean bundled?")),
    Case("datasets show sphere2500", 0, out=("2500 poses, 4949 edges", "SE-Sync", "727.149667", "fetch sphere2500")),
    Case("datasets show square_toro --json", 0, out=('"command": "datasets show"', '"convention": "toro"')),
    Case("datasets show intel", 2, err=("data sets are called 'intel'", "INTEL_carlone", "intel_openslam")),
    Case("datasets show spere2500", 2, err=("no data set 'spere2500'", "did you mean sphere2500")),
    Case("datasets path manhattan-small", 0, out="manhattan_small.g2o"),
    Case("datasets path sphere2500", 3, err=("sphere2500 is not here", "pose3d/sphere2500.g2o", "fetch sphere2500")),
    Case("datasets path intel", 2, err=("data sets are called 'intel'", "intel_sesync")),
    Case("datasets path zzzz", 2, err=("no data set 'zzzz'", "slamcli datasets list")),
    Case("datasets verify", 0, out="8 as they should be, 0 wrong"),
    Case("datasets verify square_toro --deep", 0, out=("ok       square_toro", "1 as they should be")),
    Case("datasets verify square_toro --json", 0, out=('"command": "datasets verify"', '"status": "ok"')),
    Case("datasets verify zzzz", 2, err="no data set 'zzzz'"),
    Case("datasets fetch", 2, err="NAME"),
    Case("datasets fetch square_toro", 0, out="square_toro: was here: "),
    Case("datasets fetch sphere2500", 2, err=("no mirror is named", "--mirror URL", "david-m-rosen/SE-Sync")),
    Case("datasets fetch sphere2500 --mirror ftp://x", 2, err="no http or https address"),
    Case("datasets fetch sphere2500 --mirror .", 2, err=("no http or https address", "SLAMCLI_DATASETS")),
    Case("datasets fetch sphere2500 --mirror http:///x --retries 0", 2, err="no http or https address"),
    Case(
        "datasets fetch sphere2500 --mirror http://localhost:1 --retries 0 --timeout 5",
        3,
        err="pose3d/sphere2500.g2o: no connection to the server, 1 time\n",
    ),
    Case("datasets fetch sphere2500 --retries -1", 2, err="--retries"),
    Case("datasets fetch sphere2500 --timeout 0", 2, err="--timeout"),
    Case("info manhattan_small", 0, out="400", err="reading the data set manhattan_small: "),
    Case("optimize sphere2500", 3, err="the data set sphere2500 is not here"),
    Case("info intel", 2, err="data sets are called 'intel'"),
    Case("evaluate manhattan_small --truth {in}", 0, out="rmse", err="reading the data set manhattan_small: "),
)
