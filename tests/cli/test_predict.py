"""``slamcli predict``: the worked example as it is printed, units, and what is refused."""

import json
import math
import re
from pathlib import Path

import pytest

from slamcli.cli import predict as command_line
from slamcli.cli.main import main
from slamcli.filtering.innovation import FRAMES, SENSORS

LESSON = ["predict", "--pose", "2,1,30deg", "--landmark", "5,5", "--reading", "5.2,21deg"]
NOISE = ["--noise", "0.1,2deg", "--pose-noise", "5cm,5cm,1deg", "--landmark-noise", "10mm,0.01"]
JSON_PAGE = Path(__file__).parents[2] / "docs" / "json.md"


def document(capsys: pytest.CaptureFixture[str], *words: str) -> dict:
    assert main([*words, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_worked_example(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(LESSON) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "prediction h      range 5 m, bearing 0.403696 rad (23.1301 deg)" in lines
    assert "innovation z - h  range +0.2 m, bearing -0.0371773 rad (-2.1301 deg)" in lines
    assert "sign              z - h, reading minus prediction, as g2o's EDGE_BEARING_SE2_XY has it" in lines
    assert "range    -0.6   -0.8      0         0.6         0.8" in lines
    assert "bearing  0.16  -0.12     -1       -0.16        0.12" in lines


def test_units_change_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    first = document(capsys, *LESSON, *NOISE)
    words = f"predict --pose 200cm,1000mm,{math.pi / 6!r} --landmark 5m,5 --reading 520cm,{math.radians(21)!r}rad"
    noise = f"--noise 10cm,{math.radians(2)!r} --pose-noise 0.05,0.05,{math.radians(1)!r} --landmark-noise 0.01,0.01"
    second = document(capsys, *words.split(), *noise.split())
    for key in ("prediction", "innovation", "nis", "probability"):
        assert second[key] == pytest.approx(first[key], rel=1e-12)


def test_keys_of_the_document_are_explained(capsys: pytest.CaptureFixture[str]) -> None:
    found = document(capsys, *LESSON, *NOISE)
    assert [key for key in found if f"`{key}`" not in JSON_PAGE.read_text(encoding="utf-8")] == []
    assert None not in found.values()
    without = document(capsys, *LESSON[:5])
    missing = {key for key, value in without.items() if value is None}
    assert missing == {"reading", "innovation", "innovation_covariance", "nis", "probability"}


@pytest.mark.parametrize(("name", "reading"), [("bearing", "21deg"), ("range", "5.2"), ("xy", "4,2")])
def test_signs_of_all_sensors(capsys: pytest.CaptureFixture[str], name: str, reading: str) -> None:
    found = document(capsys, *LESSON[:5], "--sensor", name, "--reading", reading)
    assert found["innovation_sign"] == "z - h"
    expected = [z - h for z, h in zip(found["reading"], found["prediction"], strict=True)]
    assert found["innovation"] == pytest.approx(expected, rel=1e-12)
    assert found["factor_sign"] == ("h - z" if name == "xy" else "z - h")
    assert main([*LESSON[:5], "--sensor", name, "--reading", reading]) == 0
    assert ("the opposite sign, h - z" in capsys.readouterr().out) == (name == "xy")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--pose 2,1 --landmark 5,5", r"--pose.*expected 3 numbers between commas \(m,m,rad\), found 2 in '2,1'"),
        ("--pose 2,1,x --landmark 5,5", r"--pose.*expected a number with or without a unit, found 'x' in '2,1,x'"),
        ("--pose 2,1,3m --landmark 5,5", r"--pose.*the unit 'm' of '3m' in '2,1,3m': expected rad, deg or none"),
        ("--pose 2,1,nan --landmark 5,5", r"--pose.*found 'nan'"),
        ("--pose 2,1,1e999 --landmark 5,5", r"--pose.*'1e999' in '2,1,1e999' is too large"),
        ("--pose ,, --landmark 5,5", r"--pose.*found ''"),
        ("--pose 2,1,0 --landmark 5,5 --reading 5", r"--reading.*expected 2 numbers between commas \(m,rad\), found 1"),
        ("--pose 2,1,0 --landmark 5,5 --reading 5deg,1", r"--reading.*the unit 'deg' of '5deg'.*expected m, cm, mm"),
        ("--pose 2,1,0 --landmark 5,5 --sensor range --reading 5,1", r"--reading.*expected 1 number \(m\), found 2"),
        ("--pose 2,1,0 --landmark 5,5 --noise 1,-2deg", r"--noise.*no number may be below 0"),
        ("--pose 2,1,0 --landmark 5,5 --pose-noise -1,1,1", r"--pose-noise.*no number may be below 0, found -1"),
        ("--pose 2,1,0 --landmark 2,1", r"the landmark is at the pose itself, \(2, 1\)"),
        ("--landmark 2,1", r"Missing option '--pose'"),
        ("--pose 2,1,0", r"Missing option '--landmark'"),
    ],
)
def test_what_is_refused(capsys: pytest.CaptureFixture[str], words: str, said: str) -> None:
    assert main(["predict", *words.split()]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert re.search(said, err), err


def test_negative_numbers_are_no_options(capsys: pytest.CaptureFixture[str]) -> None:
    found = document(capsys, "predict", "--pose", "-2,-1,-30deg", "--landmark", "-5,-5")
    assert found["pose"] == pytest.approx([-2.0, -1.0, -math.pi / 6])


def test_choices_are_those_of_the_model() -> None:
    assert tuple(SENSORS) == command_line.SENSORS
    (frame,) = (option for option in command_line.command.params if option.name == "frame")
    assert tuple(frame.type.choices) == FRAMES
