"""BAL's layout with shared pinhole intrinsics: by hand, round trips, conversions, defects, recognition."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bundle_scenes import ring
from support import dataset

import slamcli
from slamcli.errors import InputError
from slamcli.formats import bal, bal_pinhole, render, scene_formats
from slamcli.graph import FactorGraph

# The second camera is turned by a right angle about y and moved: it sees (1, 2, 4) at
# (-4, 2, 1) + (5, 0, 3) = (1, 2, 4), too.
SMALL = """\
# two cameras
#   and a point

2 1 2
500 400 320 240
0 0 445 440
1 0 444.0 441.5
0
0
0
0
0
0
5.0
0.0
3.0
0.0
-1.5707963267948966
0.0
1.0
2.0
4.0
"""


def parsed(text: str) -> FactorGraph:
    return bal_pinhole.parse("scene.txt", text.encode(), text.encode())


def test_residuals_by_hand() -> None:
    graph = parsed(SMALL)
    np.testing.assert_allclose(graph.factors[0].residual(graph.values), [[0.0, 0.0], [1.0, -1.5]], atol=1e-12)
    assert graph.factors[0].lines.tolist() == [6, 7]
    assert graph.variables["SE3_EXPMAP"].ids.tolist() == [0, 1]
    assert graph.variables["XYZ"].ids.tolist() == [2]
    intrinsics = graph.variables["PINHOLE_INTRINSICS"]
    assert (intrinsics.ids.tolist(), intrinsics.fixed.tolist()) == ([3], [True])
    assert graph.report is not None
    assert (graph.report.lines, graph.report.comments, graph.report.blank) == (22, 2, 1)
    assert graph.switches == 0


def test_it_is_recognized_and_written_as_it_was() -> None:
    found = scene_formats.recognize(SMALL.encode())
    assert found is not None
    assert found.name == "bal-pinhole"
    assert render(parsed(SMALL)).data == SMALL.encode()


def test_what_changed_is_written_behind_the_same_comments() -> None:
    graph = parsed(SMALL)
    moved = graph.with_values({**graph.values, "XYZ": graph.values["XYZ"] + 0.25})
    text = render(moved).data.decode()
    assert text.startswith("# two cameras\n#   and a point\n\n2 1 2\n500.0 400.0 320.0 240.0\n0 0 445.0 440.0\n")
    again = parsed(text)
    assert render(again.with_values(again.values)).data.decode() == text
    np.testing.assert_allclose(again.values["SE3_EXPMAP"], graph.values["SE3_EXPMAP"], atol=1e-15)
    np.testing.assert_array_equal(again.values["XYZ"], [[1.25, 2.25, 4.25]])


@pytest.mark.parametrize("intrinsics", ["500 500 320 240", "517.3 516.5 318.6 255.3", "1 1 0 0"])
def test_whole_numbers_do_not_make_it_bal(intrinsics: str) -> None:
    text = SMALL.replace("500 400 320 240", intrinsics).encode()
    found = scene_formats.recognize(text)
    assert found is not None
    assert found.name == "bal-pinhole"


def test_bal_is_still_bal() -> None:
    text = bal.render(ring(cameras=3, points=4))
    for data in (text, text.replace(b"\n0 0 ", b"\n2 3 ", 1)):  # a first observation that could be intrinsics
        found = scene_formats.recognize(data)
        assert found is not None
        assert found.name == "bal"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("1 0 444.0", "2 0 444.0", r"scene.txt:7:1: expected the index of a camera .*at most 1"),
        ("1 0 444.0", "1 1 444.0", r"scene.txt:7:3: expected the index of a point"),
        ("444.0", "nan", r"scene.txt:7:5: expected a finite number, found 'nan'"),
        ("500 400", "0 400", r"scene.txt:5:1: expected a focal length \(a number above 0\), found '0'"),
        ("500 400", "500 -400", r"scene.txt:5:5: expected a focal length"),
        ("4.0\n", "4.0\n1\n", r"scene.txt:23:1: expected the end of the file"),
        ("2.0\n4.0\n", "2.0\n", r"expected number 30 of 30, found the end of the file"),
    ],
)
def test_defects_are_located(old: str, new: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parsed(new.join(SMALL.rsplit(old, 1)))


def test_to_g2o_and_back() -> None:
    graph = parsed(SMALL)
    rendered = render(graph, "g2o")
    assert rendered.losses == ["one set of intrinsics for all cameras: each has a copy"]
    assert b"VERTEX_CAM 1 " in rendered.data
    assert b"EDGE_PROJECT_P2MC 2 1 444 441.5 1 0 1" in rendered.data
    from slamcli.formats.reader import parse

    g2o = parse("scene.g2o", rendered.data, rendered.data)
    assert g2o.chi2() == pytest.approx(graph.chi2())
    back = render(g2o, "bal-pinhole")
    assert back.losses == []
    np.testing.assert_allclose(parsed(back.data.decode()).chi2(), graph.chi2())


def test_to_bal_needs_one_focal_length() -> None:
    with pytest.raises(InputError, match="fx and fy"):
        render(parsed(SMALL), "bal")
    graph = parsed(SMALL.replace("500 400", "500 500"))
    rendered = render(graph, "bal")
    assert any("constants" in loss for loss in rendered.losses)
    turned = bal.parse("scene.bal", rendered.data, rendered.data)
    np.testing.assert_allclose(turned.chi2(), graph.chi2())
    assert turned.values["CAMERA"][:, 7:].tolist() == [[500.0, 0.0, 0.0]] * 2


def test_cameras_that_differ_are_refused() -> None:
    scene = ring(cameras=3)
    values = scene.values["CAMERA"].copy()
    values[:, 8:] = 0.0
    with pytest.raises(InputError, match="one set of intrinsics, and the cameras of this graph have 3"):
        render(scene.with_values({**scene.values, "CAMERA": values}), "bal-pinhole")
    values[:, 7] = 500.0
    same = scene.with_values({**scene.values, "CAMERA": values})
    data = render(same, "bal-pinhole").data
    assert bal_pinhole.parse("x", data, data).chi2() == pytest.approx(same.chi2())


def test_cameras_without_observations() -> None:
    text = "2 0 0\n500 400 320 240\n" + "0\n" * 12
    assert bal_pinhole.recognize(text.encode())
    graph = parsed(text)
    assert (graph.poses, graph.edges) == (2, 0)
    assert render(replace(graph, document=None), "bal-pinhole").data.count(b"\n") == 14


@pytest.mark.parametrize(
    ("name", "cameras", "chi2"), [("gbp_fr1desk_vsmall.txt", 10, 89887016.48), ("gbp_fr1desk_small.txt", 20, None)]
)
def test_the_published_sets(name: str, cameras: int, chi2: float | None, tmp_path: Path) -> None:
    graph = slamcli.read(str(dataset(f"bal/{name}")))
    assert graph.poses == cameras
    assert chi2 is None or graph.chi2() == pytest.approx(chi2)
    result = slamcli.optimize(graph)
    assert result.exit_code == 0
    assert result.final_chi2 < 1e-3 * result.initial_chi2
    np.testing.assert_array_equal(
        result.graph.values["PINHOLE_INTRINSICS"], [[517.306408, 516.469215, 318.64304, 255.313989]]
    )
