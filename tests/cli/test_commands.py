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
AMBIGUOUS = "EDGE2 0 1 1.1 0 0 1 0 2 3 0 0\n"
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
    Case("optimize {in} --worst 1", 0, out=("the 1 edge with the largest chi2", "EDGE_SE2")),
    Case("optimize {in}", 0, out="FOO 1", err="1 FOO record", content=UNKNOWN),
    Case("optimize {in} --lenient", 0, out="1 malformed", content=BROKEN),
    Case("optimize {in} --dialect toro", 0, out="chi2", content=AMBIGUOUS),
    Case("optimize {in} --color always", 0, out="\x1b[32mconverged"),
    Case("optimize {in} --color never", 0, out="converged:"),
    Case("optimize {in} --color auto", 0, out="converged:"),
    # optimize: methods and options
    *(Case(f"optimize {{in}} --method {method}", 0, out="-> 0.053333") for method in ("gn", "lm", "dogleg")),
    *(Case(f"optimize {{in}} --init {init}", 0, out="-> 0.053333") for init in ("file", "odometry", "spanning-tree")),
    *(Case(f"optimize {{in}} --ordering {name}", 0, out=f"ordering {name}") for name in ("amd", "natural")),
    *(Case(f"optimize {{in}} --linear-solver {name}", 0, out="-> 0.053333") for name in ("cholmod", "superlu")),
    *(Case(f"optimize {{in}} --method lm --scaling {name}", 0, out="-> 0.053333") for name in ("none", "marquardt")),
    Case("optimize {in} --fix 2 --fix 1", 0, out="2 fixed by the file or by --fix: 1, 2"),
    Case("optimize {in} --fix 0 --fix 1 --fix 2", 0, out=("all variables are held", "0.160000 -> 0.160000")),
    Case("optimize {in} --tolerance 0.5", 0, out="converged"),
    Case("optimize {in} --config {config}", 0, out="fixed by the file or by --fix: 1"),
    # optimize: not converged
    Case("optimize {in} --max-iterations 0", 4, out="not converged: no iterations allowed"),
    Case("optimize {in} -o {out} --trace {out}", 2, err="name the same file"),
    Case("optimize {in} -o /dev/stdout --json", 2, err="both want standard output"),
    Case("optimize {in} -o folder/", 2, err="needs the name of a file"),
    Case("optimize {in} --tolerance inf", 2, err="must be a finite number"),
    Case("optimize {in} --method lm --max-iterations 1 -o {out}", 4, out="not converged: iteration limit 1 reached"),
    Case("optimize {in} --method lm --time-limit 1e-9", 4, out="time limit"),
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
    Case("optimize {in} --config {config}", 2, err="expected option names with values", config="- method"),
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
    # evaluate
    # inject
    # plot
    # predict
    # simulate
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
