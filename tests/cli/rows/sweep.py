"""Command lines of ``slamcli sweep``."""

from __future__ import annotations

from row import Case

#: Two tasks, and what is wrong with others.
STUDY = """\
name: study
seeds: 1
case: {simulate: square, simulation: {poses: 20, set: {closures.count: 3}}}
axes: {options.method: [gn, lm]}
metrics: [ate, chi2, 'optimize:dof']
"""
FAILING = STUDY.replace("options.method: [gn, lm]", "options.fix: [0, 99]")
CLOSED = "simulate square --poses 20 --set closures.count=3 --seed 0 -o graph.g2o --truth truth.g2o --json"

ROWS = (
    Case(
        "sweep {config} -o out --jobs 1 --times",
        0,
        out=("study: 2 tasks (2 options.method × 1 seed)", "2 run: 2 without a failure", "out/table.csv", "times.csv"),
        config=STUDY,
    ),
    Case("sweep {config} --table - --jobs 2", 0, out="task,options.method,seed,exit_code", err="2 run", config=STUDY),
    Case(
        "sweep {config} --isolate --only *method=gn* --json",
        0,
        out=('"command": "sweep"', '"tasks": 1', '"exit_codes": {\n    "0": 1', '"complete": true', '"low": null'),
        config=STUDY,
    ),
    Case("sweep {config} --retry-failed", 1, out=("1 usage", "task 1: optimize ended with"), config=FAILING),
    Case("sweep {config} --no-run", 3, err="study.sweep: has no results of a sweep", config=STUDY),
    Case("sweep {config} --no-resume --no-run --json", 2, err="--no-resume puts them aside", config=STUDY),
    Case("sweep {config} --no-resume --only *seed=0", 0, out="2 run", config=STUDY),
    Case("sweep {config} --show 1", 0, out=("# task 1: options.method=lm,seed=0", f"slamcli {CLOSED}"), config=STUDY),
    Case("sweep {config} --show 2", 2, err="--show 2: there is no such task; there are 2, from 0 to 1", config=STUDY),
    Case("sweep {config} --only nothing", 2, err="no task matches --only 'nothing'", config=STUDY),
    Case("sweep {config} --jobs 2 --dask local:2", 2, err="--jobs is for this machine", config=STUDY),
    Case("sweep {config} --dask local:none", 2, err="--dask", config=STUDY),
    Case("sweep {config} --jobs 0", 2, err="--jobs", config=STUDY),
    Case("sweep {config} --table table.xlsx", 2, err="ends in .csv or .parquet", config=STUDY),
    Case("sweep {config} --table {config}", 2, err="is an input and would be overwritten", config=STUDY),
    Case("sweep {config} --table - --json", 2, err="both want standard output", config=STUDY),
    Case(
        "sweep {config}",
        2,
        err=("{config}: a command line of this sweep is wrong", "No such option", "--methd"),
        config=STUDY.replace("method", "methd"),
    ),
    Case("sweep {config}", 2, err=("'dogl' is not one of", "in task 1"), config=STUDY.replace("lm", "dogl")),
    Case("sweep {config}", 2, err="unknown key 'axis'", config=STUDY.replace("axes", "axis")),
    Case(
        "sweep {config}",
        2,
        err="there is no command 'optimise'",
        config=STUDY.replace("case: {", "case: {command: optimise, ").replace(", 'optimize:dof'", ""),
    ),
    Case("sweep {config} -o graph.g2o/out", 3, err="cannot be written", config=STUDY),
    Case("sweep {config} -o {in}", 3, err="{in}: cannot be written", config=STUDY),
    Case("sweep nowhere.yaml", 2, err="nowhere.yaml: cannot be read"),
    Case("sweep --help", 0, out=("Usage: slamcli sweep", "--dask", "Exit codes")),
)
