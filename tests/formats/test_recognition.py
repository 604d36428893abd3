"""What is a graph file at all, in which dialect, and what is told of lines that are no records."""

import gzip
import io
import sys
from pathlib import Path

import pytest
from support import BUNDLED, EDGES, dataset, vectors, write_file

import slamcli
from slamcli.errors import InputError, UsageError

VERTEX = "VERTEX_SE2 0 0 0 0\n"
EDGE2 = "EDGE2 0 1 1 0 0 4 0 4 9 0 0\n"
UNREADABLE = {
    "empty": (b"", "holds no record at all"),
    "blank": (b"\n \n\r\n\t\n", "holds no record at all"),
    "byte order mark only": (b"\xef\xbb\xbf", "holds no record at all"),
    "comments only": (b"# a graph\n# of nothing\n", "holds no record at all"),
    "unknown tags": (b"NODE 1 2 3\nLINK 1 2\n", "holds no record of a known format"),
    "a header only": (b"PARAMS_SE3OFFSET 0 0 0 0 0 0 0 1\n", "holds no vertex and no edge"),
    "FIX only": (b"FIX 0\n", "holds no record of a known format"),
    "binary": (b"VERTEX_SE2\0\x01\x02", "is a binary file"),
    "UTF-16": (VERTEX.encode("utf-16"), "is UTF-16 text"),
    "UTF-16 without mark": (VERTEX.encode("utf-16-le"), "is a binary file"),
    "truncated gzip": (gzip.compress(vectors.encode())[:-9], "damaged gzip file"),
    "damaged gzip": (gzip.compress(vectors.encode())[:30] + b"\xff" * 40, "damaged gzip file"),
    "gzip header only": (b"\x1f\x8b", "damaged gzip file"),
    "gzip of UTF-16": (gzip.compress(VERTEX.encode("utf-16")), "is UTF-16 text"),
    "gzip of nothing": (gzip.compress(b""), "holds no record at all"),
    "iSAM": (b"ODOMETRY 0 1 1 0 0 1 0 0 1 0 1\n", "belong to iSAM or GTSAM files"),
    "two formats": ((VERTEX + "VERTEX2 1 0 0 0\n").encode(), "holds records of two formats"),
    "EDGE2 without vertices": (EDGE2.encode(), "edges without vertices, in a notation that TORO, iSAM and GTSAM share"),
    "EDGE2 with ODOMETRY": ((f"VERTEX2 0 0 0 0\n{EDGE2}ODOMETRY 0 1 1 0 0 1 0 0 1 0 1\n").encode(), "square root"),
}


@pytest.mark.parametrize(("data", "message"), UNREADABLE.values(), ids=UNREADABLE)
def test_what_is_no_graph_file(tmp_path: Path, data: bytes, message: str) -> None:
    path = write_file(tmp_path, data)
    for lenient in (False, True):
        with pytest.raises(InputError) as caught:
            slamcli.read(str(path), lenient=lenient)
        assert str(caught.value).startswith(f"{path}: ")
        assert message in str(caught.value)
        assert caught.value.exit_code == 3


def test_a_directory_and_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is a directory"):
        slamcli.read(str(tmp_path))
    with pytest.raises(InputError, match="cannot be read: No such file"):
        slamcli.read(str(tmp_path / "missing.g2o"))


def test_an_unknown_dialect(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="unknown dialect 'isam'") as caught:
        slamcli.read(str(write_file(tmp_path, VERTEX)), dialect="isam")
    assert "g2o" in caught.value.details[0]
    assert "toro" in caught.value.details[0]


def test_a_named_dialect_reads_its_records_and_counts_the_others(tmp_path: Path) -> None:
    path = write_file(tmp_path, f"{VERTEX}VERTEX2 5 1 1 1\n{EDGE2}")
    g2o, toro = (slamcli.read(str(path), dialect=name) for name in ("g2o", "toro"))
    assert g2o.report is not None
    assert toro.report is not None
    assert (g2o.report.format, g2o.report.by_tag) == ("g2o", {"VERTEX_SE2": 1})
    assert g2o.report.skipped == {"VERTEX2": 1, "EDGE2": 1}
    assert (toro.report.format, toro.report.by_tag) == ("toro", {"VERTEX2": 1, "EDGE2": 1})
    assert toro.report.skipped == {"VERTEX_SE2": 1}
    assert toro.report.created == {"SE2": [0, 1]}


def test_the_format_is_in_the_tags_not_in_the_name(tmp_path: Path) -> None:
    for name, text, expected in (("a.graph", VERTEX, "g2o"), ("b.g2o", "VERTEX2 0 0 0 0\n", "toro")):
        graph = slamcli.read(str(write_file(tmp_path, text, name)))
        assert graph.report is not None
        assert graph.report.format == expected


def test_lines_that_are_no_records_are_counted(tmp_path: Path) -> None:
    """Nothing is dropped in silence: unknown tags, data, comments and blank lines add up to all lines."""
    text = (
        "# a comment\n\nVERTEX_SE2 0 0 0 0 # with a comment\n  #another\nROBOTLASER1 0 -1.57 3.14 x 1,5 nan\n"
        "VERTEX_SE2 1 1 0 0\nNEWTAG\nNEWTAG 1 2 3\nVERTEX_SE2X 1\n\t\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\nFIX 0"
    )
    graph = slamcli.read(str(write_file(tmp_path, text)))
    report = graph.report
    assert report is not None
    assert report.by_tag == {"VERTEX_SE2": 2, "EDGE_SE2": 1, "FIX": 1}
    assert report.skipped == {"ROBOTLASER1": 1, "NEWTAG": 2, "VERTEX_SE2X": 1}
    assert report.skipped_total == 4
    assert (report.lines, report.comments, report.blank) == (12, 2, 2)
    assert sum(report.by_tag.values()) + report.skipped_total + report.comments + report.blank == report.lines


@pytest.mark.parametrize("name", ["manhattan_small.g2o", "square_toro.graph"])
def test_gzip_is_recognized_by_content(tmp_path: Path, name: str) -> None:
    plain = slamcli.read(str(BUNDLED / name))
    packed = slamcli.read(str(write_file(tmp_path, gzip.compress((BUNDLED / name).read_bytes()), "plain.txt")))
    assert packed.chi2() == plain.chi2()
    assert packed.document is not None
    assert plain.document is not None
    assert packed.document.data == plain.document.data
    assert packed.document.sha256 != plain.document.sha256


@pytest.mark.parametrize("packed", [False, True])
def test_standard_input(monkeypatch: pytest.MonkeyPatch, packed: bool) -> None:
    data = gzip.compress(vectors.encode()) if packed else vectors.encode()
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(data)))
    graph = slamcli.read("-")
    assert graph.report is not None
    assert (graph.report.path, graph.edges) == ("-", len(EDGES))


def test_layout_does_not_matter(tmp_path: Path) -> None:
    """Byte order mark, carriage returns, tabs, blanks, comments behind records, no newline at the end."""
    plain = slamcli.read(str(write_file(tmp_path, vectors)))
    lines = vectors.splitlines()
    for text in (
        "\ufeff" + vectors,
        "\r\n".join(lines),
        "\n\n".join("\t" + line.replace(" ", " \t ") + "  " for line in lines),
        "\n".join(f"{line} # {line}" for line in lines),
        "\ufeff" + "\r\n".join(f"{line}\t#1" for line in reversed(lines)),
    ):
        graph = slamcli.read(str(write_file(tmp_path, text)))
        assert graph.chi2() == pytest.approx(plain.chi2(), rel=1e-15)
        assert graph.report is not None
        assert plain.report is not None
        assert graph.report.by_tag == plain.report.by_tag
        assert graph.report.skipped == {}


@pytest.mark.datasets
def test_handmade_files_of_the_standard_data_sets() -> None:
    windows = dataset("exotic/handmade_crlf_bom_comments_tabs.g2o")
    with pytest.raises(InputError, match=r":9:46: expected a finite number, found '1d0'"):
        slamcli.read(str(windows))
    graph = slamcli.read(str(windows), lenient=True)
    assert (graph.poses, graph.edges) == (3, 2)
    assert graph.chi2() == pytest.approx(0.0, abs=1e-9)
    missing = slamcli.read(str(dataset("exotic/handmade_missing_vertices.g2o")))
    assert missing.report is not None
    assert missing.report.created == {"SE2": [17, 1766, 3928]}
    bare = slamcli.read(str(dataset("exotic/handmade_edges_without_information.g2o")))
    assert bare.report is not None
    assert bare.report.notes == ["1 EDGE_SE3:QUAT records have no information: the identity is used"]
    tags = slamcli.read(str(dataset("exotic/handmade_prior_quat_tag.g2o")))
    assert tags.report is not None
    assert tags.report.skipped == {"EDGE_SE3_PRIOR:QUAT": 1, "EDGE_PRIOR_SE3:QUAT": 1}
