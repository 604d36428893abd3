"""Trajectory files: what is recognized, what round trips, and what is said about broken ones."""

from __future__ import annotations

import gzip
import io
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import dataset, write_file

from slamcli.errors import InputError, NumericalError, UsageError
from slamcli.formats.trajectories import form_of_ending, read_trajectory, with_stamps, write_trajectory
from slamcli.graph.trajectory import Trajectory
from slamcli.models import SE2, SE3

HALF = np.sqrt(0.5)


def read_text(tmp_path: Path, text: str | bytes, **options: object) -> Trajectory:
    return read_trajectory(str(write_file(tmp_path, text, "trajectory.txt")), **options)  # type: ignore[arg-type]


# -- recognition -------------------------------------------------------------------------------------------------------


def test_tum(tmp_path: Path) -> None:
    found = read_text(tmp_path, "# time x y z q\n1.5 1 2 3 0 0 0 2\n\n2.5\t4 5 6 0 0 0.5 0.5 # a comment\r\n")
    assert found.kind is SE3 and found.ids is None
    assert found.stamps is not None and found.stamps.tolist() == [1.5, 2.5]
    np.testing.assert_allclose(found.poses, [[1, 2, 3, 0, 0, 0, 1], [4, 5, 6, 0, 0, HALF, HALF]], rtol=1e-15)
    assert "trajectory.txt:2: the quaternion has length 2; 2 such quaternions are normalized" in found.notes[0]


def test_kitti(tmp_path: Path) -> None:
    found = read_text(tmp_path, "1 0 0 5 0 1 0 6 0 0 1 7\n0 -1 0 1 1 0 0 2 0 0 1 3\n")
    assert found.kind is SE3 and found.ids is None and found.stamps is None
    np.testing.assert_allclose(found.poses, [[5, 6, 7, 0, 0, 0, 1], [1, 2, 3, 0, 0, HALF, HALF]], rtol=1e-15)


def test_planar_tables(tmp_path: Path) -> None:
    plain = read_text(tmp_path, "1 2 0.5\n3 4 7\n")
    assert plain.kind is SE2 and plain.stamps is None
    assert plain.ids is not None and plain.ids.tolist() == [0, 1]
    np.testing.assert_allclose(plain.poses, [[1, 2, 0.5], [3, 4, 7 - 2 * np.pi]])
    stamped = read_text(tmp_path, "9.5 1 2 0.5\n")
    assert stamped.kind is SE2 and stamped.ids is None
    assert stamped.stamps is not None and stamped.stamps.tolist() == [9.5]


@pytest.mark.parametrize("rest", ["", ",1,2,3,4,5,6,7,8,9"])
def test_euroc(tmp_path: Path, rest: str) -> None:
    """Nanoseconds, and w before x y z; ground truth has nine more columns."""
    found = read_text(tmp_path, f"#timestamp [ns], p_x [m]\n1403636579758555392,1,2,3,{HALF},0,0,{HALF}{rest}\n")
    assert found.stamps is not None and found.stamps[0] == 1403636579758555392 / 1e9
    np.testing.assert_allclose(found.poses, [[1, 2, 3, 0, 0, HALF, HALF]], rtol=1e-15)


def test_euroc_near_zero_needs_its_header(tmp_path: Path) -> None:
    row = "5000000000,1,2,3,1,0,0,0\n"
    found = read_text(tmp_path, "#timestamp [ns],x\n" + row)
    assert found.stamps is not None and found.stamps.tolist() == [5.0]
    with pytest.raises(InputError, match="expected nanoseconds"):
        read_text(tmp_path, row)


def test_graphs_of_any_kind(tmp_path: Path) -> None:
    """In the order of ids; vertices without edges suffice."""
    g2o = read_text(tmp_path, "VERTEX_SE2 5 1 2 3\nVERTEX_SE2 3 4 5 6\n")
    assert g2o.ids is not None and g2o.ids.tolist() == [3, 5] and g2o.graph is not None
    toro = read_text(tmp_path, "VERTEX2 1 1 2 3\nVERTEX2 0 4 5 6\n")
    assert toro.poses[0].tolist() == pytest.approx([4, 5, 6 - 2 * np.pi])
    spatial = read_text(tmp_path, "VERTEX_SE3:QUAT 0 1 2 3 0 0 0 1\n", dialect="g2o")
    assert spatial.kind is SE3


def test_compressed_and_from_standard_input(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = b"0 1 2 3 0 0 0 1\n"
    assert len(read_text(tmp_path, gzip.compress(text))) == 1
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(text)))
    assert read_trajectory("-").source == "-"
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"VERTEX_SE2 5 1 2 3\n")))
    assert read_trajectory("-").kind is SE2
    assert len(read_text(tmp_path, b"\xef\xbb\xbf" + text)) == 1  # a byte order mark


# -- time stamps -------------------------------------------------------------------------------------------------------


def test_stamps_of_a_graph_go_by_id(tmp_path: Path) -> None:
    stamps = write_file(tmp_path, "10.5\n11.5\n", "stamps.txt")
    found = read_text(tmp_path, "VERTEX_SE2 5 1 2 3\nVERTEX_SE2 3 4 5 6\n", timestamps=str(stamps))
    assert found.ids is not None and found.stamps is not None
    assert dict(zip(found.ids.tolist(), found.stamps.tolist(), strict=True)) == {3: 10.5, 5: 11.5}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("1\n", "holds 1 time stamps for the 2 poses"),
        ("", "holds no time stamp"),
        ("1 2\n3 4\n", ":1:1: expected one time stamp in seconds a line, found 2 numbers"),
        ("1\nx\n", ":2:1: expected a finite number, found 'x'"),
        ("one\n", ":1:1: expected a finite number, found 'one'"),
        ("time\n1\n2\n", ":1:1: expected a finite number, found 'time'"),
    ],
)
def test_stamps_that_do_not_fit(tmp_path: Path, content: str, message: str) -> None:
    stamps = write_file(tmp_path, content, "stamps.txt")
    with pytest.raises(InputError) as error:
        read_text(tmp_path, "1 2 3\n4 5 6\n", timestamps=str(stamps))
    assert message in error.value.message
    assert "--lenient" not in "".join(error.value.details)


def test_stamps_for_what_has_stamps(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="time stamps of its own"):
        with_stamps(read_text(tmp_path, "0 1 2 3 0 0 0 1\n"), "stamps.txt")


def test_stamps_that_do_not_increase_are_noted(tmp_path: Path) -> None:
    """Allowed: the order of the file is that of the drive."""
    rows = "".join(f"{t} {k} 0 0 0 0 0 1\n" for k, t in enumerate([5, 4, 4, 3]))
    found = read_text(tmp_path, rows)
    assert found.poses[:, 0].tolist() == [0, 1, 2, 3]
    assert [note.partition("trajectory.txt")[2] for note in found.notes] == [
        ":2: time stamps go back here and 1 times more",
        ":3: time stamps stand still here",
    ]


# -- round trips -------------------------------------------------------------------------------------------------------

numbers = st.floats(-1e6, 1e6, allow_nan=False, width=64)


@given(st.lists(st.tuples(numbers, numbers, numbers, numbers, numbers, numbers), min_size=1, max_size=5), st.booleans())
def test_round_trip(tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[float, ...]], stamped: bool) -> None:
    """Stamps, positions and quaternions come back from TUM bit for bit; KITTI rounds rotations only."""
    values = np.array(rows)
    poses = SE3.retract(np.tile(SE3.identity, (len(rows), 1)).astype(float), values * [1, 1, 1, 1e-6, 1e-6, 1e-6])
    stamps = np.arange(len(rows)) + values[:, 0] if stamped else None
    trajectory = Trajectory(SE3, poses, ids=np.arange(len(rows)) + 10, stamps=stamps)
    folder = tmp_path_factory.mktemp("trajectories")
    for name in ("a.tum", "a.tum.gz", "a.txt"):
        write_trajectory(trajectory, str(folder / name))
        found = read_trajectory(str(folder / name))
        np.testing.assert_array_equal(found.poses, poses)
        np.testing.assert_array_equal(found.stamps, trajectory.ids if stamps is None else stamps)
    write_trajectory(trajectory, str(folder / "a.kitti"))
    found = read_trajectory(str(folder / "a.kitti"))
    np.testing.assert_array_equal(found.poses[:, :3], poses[:, :3])
    np.testing.assert_allclose(np.abs((found.poses[:, 3:] * poses[:, 3:]).sum(axis=1)), 1.0, rtol=1e-14)


def test_planar_poses_are_lifted(tmp_path: Path, capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    trajectory = Trajectory(SE2, np.array([[1.0, 2.0, np.pi / 2]]))
    write_trajectory(trajectory, "-")
    assert capfdbinary.readouterr().out.decode().split()[:6] == ["0", "1", "2", "0", "0", "0"]
    write_trajectory(trajectory, "-", "kitti")
    values = [float(word) for word in capfdbinary.readouterr().out.split()]
    np.testing.assert_allclose(values, [0, -1, 0, 1, 1, 0, 0, 2, 0, 0, 1, 0], atol=1e-15)


def test_what_is_not_written(tmp_path: Path) -> None:
    path = tmp_path / "out.tum"
    path.write_text("old")
    with pytest.raises(NumericalError, match="is not finite"):
        write_trajectory(Trajectory(SE2, np.array([[0.0, 0.0, 0.0], [np.nan, 0.0, 0.0]])), str(path))
    assert path.read_text() == "old"
    with pytest.raises(UsageError, match="euroc"):
        write_trajectory(Trajectory(SE2, np.zeros((1, 3))), str(path), "euroc")


def test_endings() -> None:
    assert [form_of_ending(name) for name in ("a.tum", "a.kitti.gz", "a.txt", "a.g2o")] == ["tum", "kitti", None, None]


# -- broken files ------------------------------------------------------------------------------------------------------

GOOD = "0 0 0 0 0 0 0 1\n"


@pytest.mark.parametrize(
    ("text", "message", "hint"),
    [
        (GOOD + "1 nan 0 0 0 0 0 1\n", ":2:3: expected a finite number, found 'nan'", "tracking lost"),
        (GOOD + "1 inf 0 0 0 0 0 1\n", ":2:3: expected a finite number, found 'inf'", "tracking lost"),
        (GOOD + "1 0 0 0 0 0 1\n", ":2:14: expected 8 numbers, found 7", "t x y z qx qy qz qw"),
        (GOOD + "1 0 0 0 0 0 0 1 9\n", ":2:17: expected 8 numbers, found 9", "t x y z qx qy qz qw"),
        (GOOD + "1 0 0 0 0 0 0 0\n", ":2:9: the quaternion has length 0", "tracking lost"),
        (GOOD + "1,5 0 0 0 0 0 0 1\n", ":2:1: expected a finite number, found '1,5'", "decimal comma"),
        (GOOD + "1,0,0,0,0,0,0,1\n", ":2:16: expected 8 numbers, found 1", "commas?"),
        (GOOD + "1 0x1 0 0 0 0 0 1\n", ":2:3: expected a finite number, found '0x1'", ""),
        ("time x y z qx qy qz qw\n" + GOOD, ":1:1: expected a finite number, found 'time'", "begin it with #"),
        ("1 2 3 4 5 6 7 8 9 10 11 12\n", ":1:1: numbers 1-3, 5-7 and 9-11 are not the rows", "KITTI goes along"),
        ("-1 0 0 5 0 1 0 6 0 0 1 7\n", ":1:1: numbers 1-3, 5-7", "KITTI goes along"),
    ],
)
def test_broken_records(tmp_path: Path, text: str, message: str, hint: str) -> None:
    """Line, column, what was found, what was expected and why it may be so; --lenient skips the record and says so."""
    with pytest.raises(InputError) as error:
        read_text(tmp_path, text)
    assert f"trajectory.txt{message}" in error.value.message
    assert hint in "".join(error.value.details)
    assert "--lenient" in error.value.details[-1]
    if text.count("\n") > 1:
        lenient = read_text(tmp_path, text, lenient=True)
        assert len(lenient) == 1
        assert message in lenient.notes[0]
    else:
        with pytest.raises(InputError, match="holds no usable pose"):
            read_text(tmp_path, text, lenient=True)


@pytest.mark.parametrize(
    ("text", "found", "hint"),
    [
        ("0 0 0 0 0 0 1\n", "7 numbers", "time stamp is missing"),
        ("7 0.5 0 0 0 0 0 0 1\n", "9 numbers", "index column"),
        ("1 2\n", "2 numbers", "without a heading"),
        ("1\n2\n", "1 numbers", "--timestamps"),
        ("1 2 3 4 5 6\n", "6 numbers", "Euler angles"),
        ("0 1 0 0 5 0 1 0 6 0 0 1 7\n", "13 numbers", "index or a time stamp before the matrix"),
        ("1 0 0 5 0 1 0 6 0 0 1 7 0 0 0 1\n", "16 numbers", "4 x 4"),
        ("0.5,0,0,0,0,0,0,1\n", "8 numbers", "TUM file with commas"),
        ("1,2,3\n", "3 numbers", "commas instead of blanks"),
        ("0,5 0,1 0,2 0 0 0 0 1\n", "11 numbers", "decimal commas"),
    ],
)
def test_unknown_layouts(tmp_path: Path, text: str, found: str, hint: str) -> None:
    """The causes behind evo's "must have 8 entries per row"."""
    for lenient in (False, True):
        with pytest.raises(InputError) as error:
            read_text(tmp_path, text, lenient=lenient)
        assert error.value.message.endswith(f"found {found}")
        assert "trajectory.txt:1:1: expected" in error.value.message
        assert hint in error.value.details[-1]
        assert "--lenient" not in "".join(error.value.details)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no record at all"),
        ("# nothing\n\n", "holds no record at all"),
        ("hello world\n", "holds no record of a known format"),
        ("VERTEX_XY 1 2 3\n", "holds no pose with a value"),
        ("EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n", "holds no pose with a value"),
        ("VERTEX_SE2 0 0 0 nan\n", ":1:18: expected a finite number"),
        (b"\x00\x01", "is a binary file"),
    ],
)
def test_no_trajectory(tmp_path: Path, text: str | bytes, message: str) -> None:
    with pytest.raises(InputError) as error:
        read_text(tmp_path, text)
    assert message in error.value.message


def test_graphs_without_values_on_request(tmp_path: Path) -> None:
    found = read_text(tmp_path, "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n", empty_ok=True)
    assert len(found) == 0 and found.graph is not None and found.graph.poses == 2


def test_the_index_counts_what_was_skipped(tmp_path: Path) -> None:
    """Poses of a planar table keep the id of their place in the file."""
    found = read_text(tmp_path, "0 0 0\n1 x 0\n2 0 0\n", lenient=True)
    assert found.ids is not None and found.ids.tolist() == [0, 2]


def test_most_records_decide_the_layout(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=":1:14: expected 8 numbers, found 7"):
        read_text(tmp_path, "0 0 0 0 0 0 1\n" + GOOD + GOOD)


@pytest.mark.datasets
@pytest.mark.parametrize(
    ("name", "kind", "poses"),
    [
        ("pose2d/manhattanOlson3500_nodes_groundTruth.dat", SE2, 3500),
        ("pose3d/KITTI_00_gt_copslam.g2o", SE3, 4541),
        ("raw/mrclam/MRCLAM_Dataset6/Robot1_Groundtruth.dat", SE2, 49241),
        ("outliers/rrr_Bovisa04_GT_GPS.g2o", SE2, 1140),
    ],
)
def test_standard_files(name: str, kind: object, poses: int) -> None:
    found = read_trajectory(str(dataset(name)))
    assert (found.kind, len(found)) == (kind, poses)
    assert found.notes == ()
