"""Command lines of ``slamcli regress``. ``{config}`` is the suite, ``{in}`` a graph beside it."""

from __future__ import annotations

from row import Case

SUITE = """\
name: rows
cases:
  - name: line
    data: graph.g2o
    command: info
    metrics: [chi2, edges]
"""
#: Its baseline would be config.baseline.json, which is not there.
LIMITED = SUITE.replace("[chi2, edges]", "{edges: {at_most: 1}}")

ROWS = (
    Case(
        "regress {config}",
        0,
        out=("line  new", "note: no baseline", "rows: 1 case in", "1 new"),
        config=SUITE,
    ),
    Case("regress {config} -v --color always", 0, out=("\x1b[33mnew\x1b[0m", "edges"), config=SUITE),
    Case("regress {config} --format json", 0, out=('"command": "regress"', '"verdict": "new"'), config=SUITE),
    Case("regress {config} --format junit --jobs 2", 0, out=("<testsuites", 'tests="1"'), config=SUITE),
    Case("regress {config} --format github", 0, out=("::warning file=config.yaml,line=3", "::notice"), config=SUITE),
    Case("regress {config} --format markdown --only l*", 0, out="| line |", config=SUITE),
    Case("regress {config} -o report.html --state s.jsonl", 0, out="line  new", config=SUITE),
    Case("regress {config} --state s.jsonl --resume", 0, out="line  new", config=SUITE),
    Case(
        "regress {config} --update-baseline --baseline b.json",
        0,
        out=("baseline b.json written: 3 figures changed", "line edges: - -> "),
        config=SUITE,
    ),
    Case(
        "regress {config}",
        1,
        out=("line  limit", "edges limit: 3 is above the limit 1", "$ slamcli info"),
        config=LIMITED,
    ),
    Case("regress {config} --only x", 2, err=("--only x: config.yaml has no such case", "line"), config=SUITE),
    Case("regress {config} --baseline b.json", 2, err="there is no such baseline", config=SUITE),
    Case("regress {config} --baseline graph.g2o", 2, err="graph.g2o: is no JSON document", config=SUITE),
    Case("regress {config} --baseline {config}", 2, err="is an input", config=SUITE),
    Case("regress {config} --resume", 2, err="--resume needs --state FILE or -o FILE", config=SUITE),
    Case("regress {config} --jobs 0", 2, err="--jobs", config=SUITE),
    Case("regress {config}", 2, err=("config.yaml:1: unknown key 'method' of a suite",)),
    Case("regress nowhere.yaml", 2, err="nowhere.yaml: cannot be read"),
    Case("regress {config} -o nowhere/report.xml", 3, err="there is no folder", config=SUITE),
    Case("regress {config} --state nowhere/s", 3, err="nowhere/s: cannot be written", config=SUITE),
    Case("regress --help", 0, out=("Usage: slamcli regress", "--update-baseline", "Exit codes")),
)
