"""A row of the table of command lines, and what the rows have for input."""

from __future__ import annotations

from dataclasses import dataclass

from command_line import LINE

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
