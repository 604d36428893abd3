"""The lines of iterations: g2o's byte for byte, and our table."""

import re

import pytest

from slamcli.reporting import iterations
from slamcli.solver.result import IterationRecord


def record(**changes: object) -> IterationRecord:
    fields: dict[str, object] = {
        "iteration": 1,
        "chi2": 45.733582312,
        "chi2_change": -506.0,
        "gradient_norm": 8.3,
        "step_norm": 9.2,
        "damping": None,
        "trials": 1,
        "accepted": True,
        "step": "gauss-newton",
        "time": 0.00804648,
    }
    return IterationRecord(**{**fields, **changes})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "cumulated", "wanted"),
    [
        # as g2o printed them on intel_sesync
        (
            {},
            0.00804648,
            "iteration= 0\t chi2= 45.733582\t time= 0.00804648\t cumTime= 0.00804648\t edges= 2512\t schur= 0",
        ),
        (
            {"chi2": 46.73299733, "damping": 0.01628738928, "step": "damped", "time": 0.0101},
            0.0101,
            "iteration= 0\t chi2= 46.732997\t time= 0.0101\t cumTime= 0.0101\t edges= 2512\t schur= 0"
            "\t lambda= 0.016287\t levenbergIter= 1",
        ),
        # dogleg, from its printVerbose
        (
            {"iteration": 3, "damping": 1e4, "trials": 2, "step": "dogleg", "time": 1.0},
            2.5,
            "iteration= 2\t chi2= 45.733582\t time= 1\t cumTime= 2.5\t edges= 2512\t Delta= 10000"
            "\t step= Dogleg\t tries= 2",
        ),
        ({"damping": 0.5, "step": "gauss-newton"}, 0.0, "\t Delta= 0.5\t step= GN\t tries= 1"),
        ({"damping": 0.5, "step": "steepest-descent"}, 0.0, "\t Delta= 0.5\t step= Descent\t tries= 1"),
        ({"time": 1.23456789e-7}, 0.0, "\t time= 1.23457e-07\t"),
        ({"chi2": 654162688.487887}, 0.0, "\t chi2= 654162688.487887\t"),
    ],
)
def test_line_of_g2o(changes: dict[str, object], cumulated: float, wanted: str) -> None:
    assert wanted in iterations.g2o_line(record(**changes), 2512, cumulated)


@pytest.mark.parametrize("damping", [None, 0.25])
@pytest.mark.parametrize("step", ["gauss-newton", "damped", "steepest-descent", "dogleg"])
def test_fields_of_g2o_are_parted_by_tab_and_blank(damping: float | None, step: str) -> None:
    line = iterations.g2o_line(record(damping=damping, step=step), 7, 0.5)
    assert re.fullmatch(r"[A-Za-z0-9]+= \S+(\t [A-Za-z0-9]+= \S+)*", line)


def ends(row: str) -> list[int]:
    """Where the cells of a row end; a time and its unit are one cell."""
    return [match.end() for match in re.finditer(r"\S+(?: ms| s)?", row)]


def test_rows_of_the_table_stand_under_their_titles() -> None:
    """Right-aligned: each number ends where its title does."""
    start, damped, plain = (
        iterations.line(551.735731, None),
        iterations.line(45.7, record(damping=0.0162)),
        iterations.line(1e9, record(iteration=100, time=2.0)),
    )
    header = iterations.header("lm")
    titles = header.split()
    assert titles == ["iteration", "chi2", "change", "gradient", "step", "damping", "trials", "time"]
    assert ends(start) == ends(header)[:2]
    assert ends(damped) == ends(plain) == ends(header)
    assert start.split() == ["0", "551.735731"]
    assert dict(zip(titles, damped.split(), strict=False))["damping"] == "1.62e-02"
    assert dict(zip(titles, plain.split(), strict=False))["damping"] == "-"


def test_the_damping_of_dogleg_is_its_radius() -> None:
    assert "radius" in iterations.header("dogleg") and "damping" not in iterations.header("dogleg")
    assert len(iterations.header("dogleg")) == len(iterations.header("gn"))


def test_rejected_steps_are_marked() -> None:
    assert iterations.line(1.0, record(accepted=False)).endswith("rejected")
    assert "rejected" not in iterations.line(1.0, record())
