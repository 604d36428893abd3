"""Scenes that mean nothing, or not enough: each ends with a message that names the culprit and the documented code."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bundle_scenes import perturbed, ring

import slamcli
from slamcli import models
from slamcli.cli.main import main
from slamcli.formats import render
from slamcli.geometry import so3
from slamcli.graph import FactorGraph

BASE = perturbed(ring(cameras=4, points=20, share=1.0))
TEXT = render(BASE, "bal").data.decode()


def changed(graph: FactorGraph, name: str, change: Callable[[np.ndarray], None]) -> str:
    values = {key: value.copy() for key, value in graph.values.items()}
    change(values[name])
    return render(graph.with_values(values), "bal").data.decode()


def line(number: int, change: Callable[[list[str]], list[str]]) -> str:
    """The scene with another observation in a line, from 1."""
    lines = TEXT.split("\n")
    lines[number - 1] = " ".join(change(lines[number - 1].split()))
    return "\n".join(lines)


def behind() -> str:
    def turn(cameras: np.ndarray) -> None:
        cameras[:, 3:7] = so3.compose(cameras[:, 3:7], np.tile([0.0, 1.0, 0.0, 0.0], (4, 1)))

    return changed(BASE, "CAMERA", turn)


def set_to(rows: object, value: object) -> Callable[[np.ndarray], None]:
    def change(values: np.ndarray) -> None:
        values[rows] = value  # type: ignore[index]

    return change


def some(keep: np.ndarray) -> str:
    factors = BASE.factors[0]
    return render(replace(BASE, factors=[factors.part(np.flatnonzero(keep))]), "bal").data.decode()


def same_place() -> str:
    scene = ring(cameras=2, points=20, share=1.0)
    values = {key: value.copy() for key, value in scene.values.items()}
    values["CAMERA"][1] = values["CAMERA"][0]
    factors = scene.factors[0]
    exact = models.BAL_PROJECTION.residual(factors.gather(values), np.zeros((len(factors), 2)), None)
    return render(
        replace(scene, factors=[replace(factors, measurements=exact)]).with_values(values), "bal"
    ).data.decode()


INDICES = BASE.factors[0].indices
PINHOLE = "1 1 1\n500 500 320 240\n0 0 1 2\n" + "0\n" * 9
CAM = "VERTEX_CAM 0 0 0 0 0 0 0 1 {} 510 320 240 0.1\nVERTEX_XYZ 5 0 0 3\nEDGE_PROJECT_P2MC 5 0 1 2 1 0 1\n"

SCENES: dict[str, tuple[str, str, int, tuple[str, ...]]] = {
    # name: text, options, exit code, what standard error says
    "nothing": ("", "", 3, ("holds no record",)),
    "counts of nothing": ("0 0 0\n", "", 3, ("no record of a known format",)),
    "counts only": ("4 20 80\n", "", 3, ("no record of a known format",)),
    "cut off": (TEXT[: len(TEXT) // 2], "", 3, ("found the end of the file", "make 419 numbers")),
    "too long": (TEXT + "1\n", "", 3, ("expected the end of the file",)),
    "camera out of range": (
        line(6, lambda t: ["9", *t[1:]]),
        "",
        3,
        (":6:1: expected the index of a camera", "at most 3"),
    ),
    "point out of range": (
        line(6, lambda t: [t[0], "20", *t[2:]]),
        "",
        3,
        ("expected the index of a point", "at most 19"),
    ),
    "negative index": (line(6, lambda t: ["-1", *t[1:]]), "", 3, ("expected the index of a camera",)),
    "no whole index": (line(6, lambda t: ["1.5", *t[1:]]), "", 3, ("expected the index of a camera",)),
    "NaN pixel": (line(6, lambda t: [*t[:2], "nan", t[3]]), "", 3, (":6:5: expected a finite number, found 'nan'",)),
    "infinite pixel": (line(6, lambda t: [*t[:3], "-inf"]), "", 3, ("expected a finite number, found '-inf'",)),
    "pixel 1e200": (line(6, lambda t: [*t[:2], "1e200", t[3]]), "", 5, ("bal 0 8 (line 6): chi2 overflows", "1e+200")),
    "camera at 1e200": (
        changed(BASE, "CAMERA", set_to((2, slice(0, 3)), 1e200)),
        "",
        3,
        ("CAMERA 2 is beyond 1e+100",),
    ),
    "point at 1e200": (changed(BASE, "XYZ", set_to(2, 1e200)), "", 3, ("XYZ 6 is beyond 1e+100",)),
    "no observations": (render(replace(BASE, factors=[]), "bal").data.decode(), "", 3, ("nothing to optimize",)),
    "all behind": (behind(), "", 3, ("all 80 observations are of points behind", "other axis")),
    "all behind, shared": (behind(), "--intrinsics shared", 3, ("all 80 observations are of points behind",)),
    "zero depth": (
        changed(BASE, "XYZ", set_to(3, BASE.values["CAMERA"][1, :3])),
        "",
        5,
        ("1 observation is not finite", "bal 1 7 (line 25): depth", "nothing is written"),
    ),
    "zero depth, shared": (
        changed(BASE, "XYZ", set_to(3, BASE.values["CAMERA"][1, :3])),
        "--intrinsics shared",
        5,
        ("bal 1 7 24 (line 25): depth",),
    ),
    "one camera": (some(INDICES[:, 0] == 0), "", 0, ("20 points are seen fewer than twice", "3 cameras see nothing")),
    "one camera, gn": (some(INDICES[:, 0] == 0), "--method gn --gauge first", 5, ("fewer than twice", "not determine")),
    "one camera, once": (some(INDICES[:, 0] == 0), "--method gn", 5, ("not positive definite",)),
    "two at one place": (same_place(), "--method gn --gauge first", 5, ("not positive definite", "XYZ")),
    "point seen once": (
        some((INDICES[:, 1] != 7) | (INDICES[:, 0] == 0)),
        "",
        0,
        ("1 point is seen fewer than twice: its distance is not determined",),
    ),
    "camera without observations": (some(INDICES[:, 0] != 2), "", 0, ("1 camera sees nothing",)),
    "duplicate": (
        TEXT.replace("4 20 80", "4 20 81").replace("\n0 1 ", "\n0 1 1 1\n0 1 ", 1),
        "--max-iterations 1",
        4,
        ("1 observation repeats an earlier one of the same camera and point",),
    ),
    "constant zero focal length": (
        changed(BASE, "CAMERA", set_to((2, 7), 0.0)),
        "--intrinsics fixed",
        3,
        ("camera 2 has the constant focal length 0",),
    ),
    "zero focal length, gn": (
        changed(BASE, "CAMERA", set_to((2, 7), 0.0)),
        "--method gn --gauge first",
        5,
        ("not positive definite", "CAMERA 2"),
    ),
    "zero focal length of g2o": (CAM.format("0"), "", 3, ("camera 0 has the constant focal length 0",)),
    "NaN focal length of g2o": (CAM.format("nan"), "", 3, ("expected a finite number",)),
    "zero focal length of pinholes": (PINHOLE.replace("500 5", "0 5", 1), "", 3, ("expected the end of the file",)),
    "pinhole without focal length": (PINHOLE.replace("500 500", "0.0 500"), "", 3, (":2:1: expected a focal length",)),
    "gauge of poses": (
        "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n",
        "--gauge first",
        2,
        ("gauge 'first' is for cameras",),
    ),
    "intrinsics of poses": (
        "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n",
        "--intrinsics fixed",
        2,
        ("is for cameras",),
    ),
    "shared intrinsics of g2o": (CAM.format("500"), "--intrinsics shared", 2, ("slamcli convert --to bal-pinhole",)),
    "free intrinsics of pinholes": (PINHOLE[:-2] + "3\n", "--intrinsics free", 2, ("--intrinsics shared frees it",)),
}


@pytest.mark.parametrize("name", SCENES)
def test_degenerate_scene(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    text, options, code, said = SCENES[name]
    path, out = tmp_path / "scene.txt", tmp_path / "out.txt"
    path.write_text(text)
    found = main(["optimize", str(path), "-o", str(out), *options.split()])
    captured = capfd.readouterr()
    assert found == code, captured.err
    for words in said:
        assert words in captured.err
    assert "Traceback" not in captured.err
    assert "Warning" not in captured.err
    assert out.exists() == (code in (0, 4))


@pytest.mark.parametrize("name", SCENES)
def test_covariances_of_degenerate_scenes(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Never a traceback, and never numbers that are not finite."""
    path = tmp_path / "scene.txt"
    path.write_text(SCENES[name][0])
    code = main(["covariance", str(path), "--json"])
    captured = capfd.readouterr()
    assert code in (0, 3, 5)
    assert "Traceback" not in captured.err
    assert "Warning" not in captured.err
    assert (code == 0) == bool(captured.out)
    assert "null" not in captured.out.partition('"marginals"')[2].partition('"cross"')[0]


def test_zero_focal_lengths_that_are_unknown_are_found_again() -> None:
    values = {name: value.copy() for name, value in BASE.values.items()}
    values["CAMERA"][:, 7] = 0.0
    result = slamcli.optimize(BASE.with_values(values), tolerance=1e-12)
    assert result.final_chi2 == pytest.approx(slamcli.optimize(BASE, tolerance=1e-12).final_chi2, rel=1e-6)
