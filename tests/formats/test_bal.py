"""BAL and Bundler: what is read, what is written, and what is refused with line and column."""

import bz2
import gzip
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bundle_scenes import perturbed, ring
from numpy.testing import assert_allclose
from support import BUNDLED, dataset, write_file

import slamcli
from slamcli import models
from slamcli.errors import InputError
from slamcli.formats import read, render, write
from slamcli.formats.recognize import of_ending
from slamcli.formats.trajectories import read_trajectory
from slamcli.geometry import so3
from slamcli.graph import FactorGraph

# One camera at the origin, which looks along -z with f = 100, k1 = 0.5, and one 2 m back; points straight ahead and
# one metre to the right at a depth of 2 m: p = (0.5, 0), r = 1 + 0.5 / 4, so u = 100 * 1.125 * 0.5 = 56.25.
TEXT = """\
2 2 3
0 0     1.5 -2.5
0 1     5.625e+01 0
1 1     0.25 +.5
0
0
0
0
0
0
100
0.5
0
0
0
0
0
0
-2
100
0
0
0
0
-2
1
0
-2
"""

BUNDLE = """\
# Bundle file v0.3
3 2
100 0.5 0
1 0 0
0 1 0
0 0 1
0 0 0
0 0 0
0 0 0
0 0 0
0 0 0
0 0 0
100 0 0
1 0 0
0 1 0
0 0 1
0 0 -2
0 0 -2
255 0 10
1 0 17 1.5 -2.5
1 0 -2
1 2 3
2 0 18 56.25 0 2 5 0.25 0.5
"""


def changed(text: str, line: int, new: str) -> str:
    lines = text.splitlines(keepends=True)
    lines[line - 1] = new + "\n"
    return "".join(lines)


@pytest.mark.parametrize("text", [TEXT, BUNDLE], ids=["bal", "bundler"])
def test_residuals_by_hand(tmp_path: Path, text: str) -> None:
    graph = read(str(write_file(tmp_path, text, "scene.txt")))
    assert (graph.poses, graph.landmarks, graph.edges) == (2, 2, 3)
    residual = graph.factors[0].residual(graph.values)
    assert_allclose(residual, [[-1.5, 2.5], [0.0, 0.0], [24.75, -0.5]], atol=1e-13)  # 100 * 1/4 - 0.25
    assert_allclose(graph.values["CAMERA"][1, :3], [0.0, 0.0, 2.0])


def test_ids_lines_and_report(tmp_path: Path) -> None:
    graph = read(str(write_file(tmp_path, TEXT, "scene.txt")))
    assert graph.report is not None
    assert graph.report.format == "bal"
    assert graph.report.lines == 28
    assert graph.variables["CAMERA"].ids.tolist() == [0, 1]
    assert graph.variables["XYZ"].ids.tolist() == [2, 3]
    assert graph.factors[0].lines.tolist() == [2, 3, 4]
    assert graph.report.notes == ["1 point is seen fewer than twice: its distance is not determined"]
    unplaced = read(str(write_file(tmp_path, BUNDLE, "bundle.out")))
    assert unplaced.report is not None
    assert unplaced.variables["CAMERA"].ids.tolist() == [0, 2]
    assert any("1 of 3 cameras have no place" in note for note in unplaced.report.notes)


def test_numbers_may_stand_on_any_line(tmp_path: Path) -> None:
    header, *rest = TEXT.split("\n", 1)
    joined = header + "\n" + " ".join(rest[0].split())
    graph = read(str(write_file(tmp_path, joined, "scene.txt")))
    assert graph.chi2() == pytest.approx(read(str(write_file(tmp_path, TEXT, "other.txt"))).chi2())
    assert not graph.factors[0].lines.any()


@pytest.mark.parametrize("compress", [bz2.compress, gzip.compress], ids=["bz2", "gz"])
def test_compressed_files(tmp_path: Path, compress: object) -> None:
    path = write_file(tmp_path, compress(TEXT.encode()), "scene")  # type: ignore[operator]
    assert read(str(path)).edges == 3
    path = write_file(tmp_path, compress(TEXT.encode())[:-20], "damaged")  # type: ignore[operator]
    with pytest.raises(InputError, match="damaged"):
        read(str(path))


def test_points_behind_their_camera_are_counted(tmp_path: Path) -> None:
    graph = read(str(write_file(tmp_path, changed(TEXT, 25, "3"), "scene.txt")))
    assert graph.report is not None
    assert "1 of 3 observations are of points behind their camera" in graph.report.notes


@pytest.mark.parametrize(
    ("line", "new", "where", "message"),
    [
        (1, "2 2 4", "26:2", "found the end of the file"),
        (1, "2 2 2", "25:1", "expected the end of the file"),
        (1, "0 0 0", "2:1", "expected the end of the file"),
        (2, "0 0     nan -2.5", "2:9", "expected a finite number, found 'nan'"),
        (2, "0 0     1,5 -2.5", "2:9", "found '1,5'"),
        (3, "0 2     5.625e+01 0", "3:3", "the index of a point (a whole number from 0, at most 1), found '2'"),
        (3, "2 1     5.625e+01 0", "3:1", "the index of a camera"),
        (3, "0.5 1   5.625e+01 0", "3:1", "the index of a camera"),
        (11, "1e400", "11:1", "expected a finite number"),
        (11, "0x10", "11:1", "expected a finite number, found '0x10'"),
    ],
)
def test_defects_are_named_with_their_place(tmp_path: Path, line: int, new: str, where: str, message: str) -> None:
    path = write_file(tmp_path, changed(TEXT, line, new), "scene.txt")
    with pytest.raises(InputError) as caught:
        read(str(path), dialect="bal")
    text = caught.value.message
    assert text.startswith(f"{path}:")
    assert message in text
    if "end of the file" not in message:
        assert text.startswith(f"{path}:{where}:")


@pytest.mark.parametrize(
    ("line", "new", "message"),
    [
        (2, "3", "expected"),
        (4, "1 0 0.5", "expected a rotation matrix"),
        (20, "2 0 17 1.5 -2.5", "expected"),
        (20, "-1", "the number of views"),
        (20, "1 1 17 1.5 -2.5", "expected a camera that has a place"),
        (19, "256 0 0", "expected a colour"),
        (23, "3 0 18 56.25 0 2 5 0.25 0.5", "found the end of the file"),
    ],
)
def test_defects_of_bundler_files(tmp_path: Path, line: int, new: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        read(str(write_file(tmp_path, changed(BUNDLE, line, new), "bundle.out")))
    assert message in caught.value.message


def test_an_empty_scene_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no camera and no point"):
        read(str(write_file(tmp_path, "0 0 0\n", "scene.txt")), dialect="bal")


@pytest.mark.parametrize("text", [TEXT, BUNDLE], ids=["bal", "bundler"])
def test_what_has_not_changed_keeps_its_bytes(tmp_path: Path, text: str) -> None:
    graph = read(str(write_file(tmp_path, text, "scene.txt")))
    assert render(graph).data == text.encode()


@pytest.mark.parametrize("text", [TEXT, BUNDLE], ids=["bal", "bundler"])
@pytest.mark.parametrize("target", ["bal", "bundler"])
def test_a_changed_scene_is_written_and_read(tmp_path: Path, text: str, target: str) -> None:
    graph = read(str(write_file(tmp_path, text, "scene.txt")))
    values = {name: value.copy() for name, value in graph.values.items()}
    values["XYZ"][0, 0] += 0.1
    moved = graph.with_values(values)
    path = tmp_path / "out.bal"
    assert write(moved, str(path), dialect=target) == []
    again = read(str(path))
    assert again.report is not None
    assert again.report.format == target
    assert again.chi2() == pytest.approx(moved.chi2(), rel=1e-13)
    np.testing.assert_array_equal(again.values["XYZ"], values["XYZ"])
    np.testing.assert_array_equal(again.factors[0].measurements, graph.factors[0].measurements)
    if text is BUNDLE and target == "bundler":
        lines = path.read_text().splitlines()
        assert lines[7:12] == ["0 0 0"] * 5
        assert lines[18] == "255 0 10"
        assert lines[22] == "2 0 18 56.25 0.0 2 5 0.25 0.5"


@pytest.mark.parametrize("target", ["bal", "bundler"])
def test_graphs_made_in_memory_survive(tmp_path: Path, target: str) -> None:
    scene = perturbed(ring(cameras=5, points=20))
    path = tmp_path / "scene.txt"
    write(scene, str(path), dialect=target)
    again = read(str(path))
    assert again.chi2() == pytest.approx(scene.chi2(), rel=1e-12)
    assert_allclose(again.values["CAMERA"][:, :3], scene.values["CAMERA"][:, :3], atol=1e-14)
    turn = so3.compose(so3.inverse(again.values["CAMERA"][:, 3:7]), scene.values["CAMERA"][:, 3:7])
    assert_allclose(so3.log(turn), 0.0, atol=1e-14)
    np.testing.assert_array_equal(again.values["XYZ"], scene.values["XYZ"])


def test_what_the_formats_cannot_hold(tmp_path: Path) -> None:
    graph = read(str(BUNDLED / "manhattan_small.g2o"))
    for target in ("bal", "bundler"):
        with pytest.raises(InputError, match="cameras, points and their observations only"):
            render(graph, target)
    scene = ring()
    factors = replace(scene.factors[0], information=np.tile(2.0 * np.eye(2), (scene.edges, 1, 1)))
    lost = render(replace(scene, factors=[factors]).with_fixed([0]), "bal").losses
    assert len(lost) == 2
    assert "information" in lost[0]
    assert "1 fixed" in lost[1]
    with pytest.raises(InputError):
        render(read(str(write_file(tmp_path, TEXT, "scene.txt"))), "toro")


def test_pose_graphs_are_not_taken_for_scenes(tmp_path: Path) -> None:
    assert read(str(BUNDLED / "landmarks_small.g2o")).report.format == "g2o"  # type: ignore[union-attr]
    with pytest.raises(InputError, match="no record of a known format"):
        read(str(write_file(tmp_path, "1 2\n3 4 5\n", "numbers.txt")))


@pytest.mark.parametrize(
    ("name", "counts", "cost"),
    [
        ("bal/dubrovnik-3-7-pre.txt", (3, 7, 19), 2764.22),
        ("bal/dubrovnik-1-1-pre.txt", (1, 1, 1), 63.3164),
        ("bal/problem-49-7776-pre.txt", (49, 7776, 31843), 850912.46),
        ("bal/problem-16-22106-pre.txt", (16, 22106, 83718), 4185660.0),
        ("bal/Balbianello.out", (5, 544, 1417), 126.928),
    ],
)
def test_the_standard_sets(name: str, counts: tuple[int, int, int], cost: float) -> None:
    graph = slamcli.read(str(dataset(name)))
    assert (graph.poses, graph.landmarks, graph.edges) == counts
    assert 0.5 * graph.chi2() == pytest.approx(cost, rel=1e-5)
    assert graph.factors[0].kind is models.BAL_PROJECTION


def without_distortion(scene: FactorGraph) -> FactorGraph:
    values = dict(scene.values)
    values["CAMERA"] = values["CAMERA"].copy()
    values["CAMERA"][:, 8:] = 0.0
    return scene.with_values(values)


def test_scenes_without_distortion_become_g2o_and_come_back(tmp_path: Path) -> None:
    scene = without_distortion(perturbed(ring(cameras=4, points=20)))
    path, back = tmp_path / "scene.g2o", tmp_path / "back.bal"
    losses = write(scene, str(path), dialect="g2o")
    assert len(losses) == 1
    assert "focal lengths" in losses[0]
    graph = read(str(path))
    assert set(graph.variables) == {"SE3_EXPMAP", "XYZ"}
    assert graph.chi2() == pytest.approx(scene.chi2(), rel=1e-12)
    losses = write(graph, str(back), dialect="bal")
    assert "intrinsics" in losses[0]
    again = read(str(back))
    assert again.chi2() == pytest.approx(scene.chi2(), rel=1e-12)
    assert_allclose(again.values["CAMERA"][:, :3], scene.values["CAMERA"][:, :3], atol=1e-13)
    assert_allclose(again.values["CAMERA"][:, 7:], scene.values["CAMERA"][:, 7:], atol=1e-13)


def test_a_principal_point_goes_into_the_pixels(tmp_path: Path) -> None:
    text = (
        "VERTEX_CAM 0 0 0 0 0 0 0 1 500 500 320 240 0.1\nVERTEX_XYZ 1 0.4 0.2 2\nVERTEX_XYZ 2 -0.5 0.1 3\n"
        "EDGE_PROJECT_P2MC 1 0 425 285 2 0.5 3\nEDGE_PROJECT_P2MC 2 0 237 260 1 0 1\n"
    )
    graph = read(str(write_file(tmp_path, text)))
    path = tmp_path / "out.bal"
    write(graph, str(path), dialect="bal")
    again = read(str(path))
    residual = graph.factors[0].residual(graph.values)
    assert_allclose(again.factors[0].residual(again.values), residual * [1.0, -1.0], atol=1e-12)
    assert again.factors[0].measurements.tolist() == [[105.0, -45.0], [-83.0, -20.0]]


def test_conversions_that_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="knows no distortion, and 4 of 4 cameras"):
        render(ring(cameras=4), "g2o")
    text = "VERTEX_CAM 0 0 0 0 0 0 0 1 500 510 320 240 0.1\nVERTEX_XYZ 1 0 0 2\nEDGE_PROJECT_P2MC 1 0 425 285 2 0.5 3\n"
    with pytest.raises(InputError, match="two focal lengths"):
        render(read(str(write_file(tmp_path, text))), "bal")
    stereo = "VERTEX_CAM 0 0 0 0 0 0 0 1\nVERTEX_XYZ 1 0 0 2\nEDGE_PROJECT_P2SC 1 0 1 2 3 1 0 0 1 0 1\n"
    graph = read(str(write_file(tmp_path, stereo)))
    assert graph.report is not None
    assert graph.report.notes == ["1 VERTEX_CAM records end early: 300 300 320 320 0.1 is used for the rest"]
    assert graph.values["SBA_CAMERA"][0, 7:].tolist() == [300.0, 300.0, 320.0, 320.0, 0.1]
    with pytest.raises(InputError, match="EDGE_PROJECT_P2SC"):
        render(graph, "bal")


def test_a_camera_needs_its_own_sort_of_parameter(tmp_path: Path) -> None:
    text = (
        "PARAMS_SE3OFFSET 3 0 0 0 0 0 0 1\nVERTEX_SE3:EXPMAP 0 0 0 0 0 0 0 1\nVERTEX_XYZ 1 0 0 2\n"
        "EDGE_PROJECT_XYZ2UV:EXPMAP 1 0 3 1 2 1 0 1\n"
    )
    with pytest.raises(InputError, match="names parameter 3, which is no PARAMS_CAMERAPARAMETERS"):
        read(str(write_file(tmp_path, text)))


def test_three_whole_numbers_may_begin_a_trajectory(tmp_path: Path) -> None:
    path = write_file(tmp_path, "0 0 0\n1 0 0\n2 0 1\n", "planar.txt")
    assert len(read_trajectory(str(path))) == 3
    assert len(read_trajectory(str(write_file(tmp_path, "1 2 3\n", "one.txt")))) == 1


def test_cameras_are_a_trajectory(tmp_path: Path) -> None:
    path = write_file(tmp_path, TEXT, "scene.txt")
    trajectory = read_trajectory(str(path))
    assert trajectory.kind is models.SE3
    assert trajectory.poses.shape == (2, 7)
    assert_allclose(trajectory.positions, [[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]])


@pytest.mark.parametrize("ending", ["bz2", "gz"])
def test_compressed_output(tmp_path: Path, ending: str) -> None:
    scene, path = ring(cameras=3, points=10), tmp_path / f"scene.bal.{ending}"
    write(scene, str(path), dialect=of_ending(str(path)))
    raw = path.read_bytes()
    assert (bz2.decompress if ending == "bz2" else gzip.decompress)(raw).startswith(b"3 10 ")
    assert read(str(path)).chi2() == pytest.approx(scene.chi2(), rel=1e-12)
