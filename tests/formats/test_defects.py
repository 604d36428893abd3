"""Every kind of defect: where it is reported, and that ``lenient`` skips it, counts it and keeps the rest."""

from pathlib import Path

import pytest
from support import write_file

import slamcli
from slamcli.errors import InputError
from slamcli.formats import ParseError, render

EYE3 = "1 0 0 1 0 1"
EYE6 = " ".join("1" if i == j else "0" for i in range(6) for j in range(i, 6))
SOUND = (
    "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nVERTEX_XY 7 1 1\n"
    "VERTEX_SE3:QUAT 20 0 0 0 0 0 0 1\nVERTEX_TRACKXYZ 30 1 1 1\n"
    f"EDGE_SE2 0 1 1 0 0 {EYE3}\n"
)
SOUND_LINES = SOUND.count("\n")

# a defective record, the column and a part of the message
DEFECTS = {
    "partial line": ("EDGE_SE2 0 1 1 0 0 1 0 0 1 0", 29, "EDGE_SE2 expects 11 numbers, found 10"),
    "tag alone": ("VERTEX_SE2", 11, "expects 4 numbers, found 0"),
    "too many numbers": ("VERTEX_XY 8 1 1   99 5", 19, "VERTEX_XY expects 3 numbers, found 5"),
    "missing information": ("EDGE_SE2 0 1 1 0 0", 19, "expects 11 numbers, found 5"),
    "nan": (f"EDGE_SE2 0 1 nan 0 0 {EYE3}", 14, "expected a finite number, found 'nan'"),
    "inf": ("VERTEX_XY 8 1 -inf", 15, "expected a finite number, found '-inf'"),
    "overflow": ("VERTEX_XY 8 1 1e999", 15, "expected a finite number, found '1e999'"),
    "decimal comma": ("  VERTEX_XY 8 1,5 1", 15, "expected a finite number, found '1,5'"),
    "fortran exponent": ("VERTEX_XY\t8\t1d0\t1", 13, "expected a finite number, found '1d0'"),
    "word": ("VERTEX_XY x7 1 1", 11, "expected a finite number, found 'x7'"),
    "id with a fraction": ("VERTEX_XY 8.5 1 1", 11, "expected an id (a whole number of 64 bits), found '8.5'"),
    "second id with a fraction": (f"EDGE_SE2 0 1.5 1 0 0 {EYE3}", 12, "found '1.5'"),
    "id of 65 bits": ("VERTEX_XY 18446744073709551616 1 1", 11, "found '18446744073709551616'"),
    "duplicate vertex": ("VERTEX_SE2 1 5 5 5", 19, "vertex 1 is defined twice"),
    "zero quaternion": ("VERTEX_SE3:QUAT 8 1 1 1 0 0 0 0", 32, "VERTEX_SE3:QUAT has a quaternion of zero length"),
    "zero measured quaternion": (f"EDGE_SE3:QUAT 20 20 1 1 1 0 0 0 0 {EYE6}", 76, "quaternion of zero length"),
    "zero quaternion of a parameter": ("PARAMS_SE3OFFSET 1 1 1 1 0 0 0 0", 33, "quaternion of zero length"),
    "missing parameter": (
        "EDGE_SE3_TRACKXYZ 20 30 4 1 1 1 1 0 0 1 0 1",
        44,
        "names parameter 4, which no record",
    ),
    "vertex of another kind": (
        f"EDGE_SE2 0 7 1 0 0 {EYE3}",
        31,
        "needs a SE2 vertex, but 7 is of another kind",
    ),
    "FIX of an unknown vertex": ("FIX 99", 5, "FIX names 99, which is no vertex of this graph"),
    "FIX of garbage": ("FIX 0 #1\nFIX x", 5, "FIX expects ids, found 'x'"),
    "FIX of a huge number": (f"FIX 0 {2**70}", 7, f"found '{2**70}'"),
}
each_defect = pytest.mark.parametrize(("record", "column", "message"), DEFECTS.values(), ids=DEFECTS)


def variants(record: str) -> list[tuple[str, int]]:
    """The defect behind and before a sound graph, with its line."""
    extra = record.count("\n")
    return [(SOUND + record, SOUND_LINES + 1 + extra), (SOUND + record + "\r\n", SOUND_LINES + 1 + extra)] + (
        [] if "duplicate" in record or "SE2 1 5" in record else [(f"{record}\n{SOUND}", 1 + extra)]
    )


@each_defect
def test_place_and_message(tmp_path: Path, record: str, column: int, message: str) -> None:
    for text, line in variants(record):
        path = write_file(tmp_path, text)
        with pytest.raises(ParseError) as caught:
            slamcli.read(str(path))
        (diagnostic,) = caught.value.diagnostics
        assert (diagnostic.path, diagnostic.line, diagnostic.column) == (str(path), line, column)
        assert message in diagnostic.message
        assert str(caught.value).startswith(f"{path}:{line}:{column}: ")
        last = record.splitlines()[-1]
        quote, marker = caught.value.details[:2]
        assert quote == "    " + last.replace("\t", " ")
        assert marker.index("^") == 4 + column - 1
        assert caught.value.exit_code == 3


@each_defect
def test_lenient_skips_counts_and_keeps_the_rest(tmp_path: Path, record: str, column: int, message: str) -> None:
    sound = slamcli.read(str(write_file(tmp_path, SOUND)))
    for text, line in variants(record):
        path = write_file(tmp_path, text)
        graph = slamcli.read(str(path), lenient=True)
        assert graph.report is not None
        (found,) = graph.report.malformed
        assert found.startswith(f"{path}:{line}:{column}: ")
        assert message in found
        assert graph.report.skipped_total == 1
        assert {tag: n for tag, n in graph.report.by_tag.items() if tag != "FIX"} == sound.report.by_tag  # type: ignore[union-attr]
        assert {name: column.ids.tolist() for name, column in graph.variables.items()} == {
            name: column.ids.tolist() for name, column in sound.variables.items()
        }
        assert graph.chi2() == sound.chi2()
        assert graph.edges == 1
        assert graph.report.created == {}
        assert render(graph).data == text.encode()  # what was skipped stays in the file


def test_all_defects_are_collected_in_the_order_of_the_file(tmp_path: Path) -> None:
    records = [record for name, (record, *_) in DEFECTS.items() if "\n" not in record and not name.startswith("FIX")]
    graph = slamcli.read(str(write_file(tmp_path, SOUND + "\n".join(records))), lenient=True)
    assert graph.report is not None
    places = [int(entry.split(":")[1]) for entry in graph.report.malformed]
    assert sorted(places) == [SOUND_LINES + 1 + k for k in range(len(records))]
    assert graph.edges == 1
    two = write_file(tmp_path, SOUND + "VERTEX_XY 8 nan 1\nEDGE_SE2 1\nVERTEX_XY 9 1 nan\nVERTEX_XY 10 nan 1\n")
    with pytest.raises(ParseError) as caught:
        slamcli.read(str(two))
    lines = [diagnostic.line for diagnostic in caught.value.diagnostics]
    assert lines == sorted(lines)
    assert len(lines) >= 3
    assert "--lenient" in caught.value.details[-1]


def test_several_bad_numbers_of_one_line_are_one_or_more_diagnostics_of_that_line(tmp_path: Path) -> None:
    graph = slamcli.read(str(write_file(tmp_path, SOUND + "VERTEX_XY 8 nan x")), lenient=True)
    assert graph.report is not None
    assert [entry.split(":")[1:3] for entry in graph.report.malformed] == [["7", "13"], ["7", "17"]]


@pytest.mark.parametrize(
    "record",
    ["EDGE_SE2_XY 50 1 1 1 1 0 1", f"EDGE_SE3:QUAT 20 50 1 1 1 0 0 0 0 {EYE6}", "EDGE_SE2_XY 50 51 1 1 1 0"],
)
def test_a_skipped_edge_creates_no_vertex(tmp_path: Path, record: str) -> None:
    """Edges to a vertex of another kind, with a zero quaternion and of too few numbers."""
    graph = slamcli.read(str(write_file(tmp_path, SOUND + record)), lenient=True)
    assert graph.report is not None
    assert len(graph.report.malformed) == 1
    assert graph.report.created == {}
    assert all(column.known.all() for column in graph.variables.values())


def test_a_graph_of_nothing_but_defects(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no vertex and no edge"):
        slamcli.read(str(write_file(tmp_path, "VERTEX_SE2 0 0\nEDGE_SE2 0 1\n")), lenient=True)


def test_the_first_of_two_equal_vertices_counts_whatever_its_tag(tmp_path: Path) -> None:
    """TORO has two tags for a planar pose."""
    for first, second in (("VERTEX", "VERTEX2"), ("VERTEX2", "VERTEX")):
        path = write_file(tmp_path, f"{first} 3 1 2 0\n{second} 3 5 6 0\n{second} 4 0 0 0\n")
        with pytest.raises(ParseError, match=r":2:\d+: vertex 3 is defined twice"):
            slamcli.read(str(path))
        graph = slamcli.read(str(path), lenient=True)
        row = graph.variables["SE2"].row_of(3)
        assert graph.variables["SE2"].values[row].tolist() == [1.0, 2.0, 0.0]


def test_a_parameter_defined_twice(tmp_path: Path) -> None:
    twice = "PARAMS_SE3OFFSET 1 1 2 3 0 0 0 1\nPARAMS_SE3OFFSET 1 9 9 9 0 0 0 1\n"
    path = write_file(tmp_path, twice + SOUND)
    with pytest.raises(ParseError, match=":2:33: parameter 1 is defined twice"):
        slamcli.read(str(path))
    graph = slamcli.read(str(path), lenient=True)
    assert graph.parameters[1].tolist() == [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0]
    assert graph.report is not None
    assert graph.report.by_tag["PARAMS_SE3OFFSET"] == 1


def test_hints_for_what_goes_wrong_most_often(tmp_path: Path) -> None:
    hints = {"decimal comma": "decimal point", "fortran exponent": "write e", "missing information": "is missing"}
    hints["missing parameter"] = "PARAMS_SE3OFFSET 4"
    for name, hint in hints.items():
        with pytest.raises(ParseError) as caught:
            slamcli.read(str(write_file(tmp_path, SOUND + DEFECTS[name][0])))
        assert hint in caught.value.diagnostics[0].hint


def test_the_marker_stays_under_the_defect_of_a_very_long_line(tmp_path: Path) -> None:
    information = "1.2345678901234567 " * 20
    for record in (f"EDGE_SE3:QUAT 20 21 1 1 1 0 0 0 1 {information}bad", f"VERTEX_XY 8 bad {'1 ' * 200}"):
        with pytest.raises(ParseError) as caught:
            slamcli.read(str(write_file(tmp_path, SOUND + record)))
        quote, marker = caught.value.details[:2]
        assert quote[marker.index("^") :].startswith("bad")
        assert len(quote) <= 104
