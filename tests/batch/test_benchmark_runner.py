"""Alternation, statistics and failures with a runner that measures nothing; then real runs."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from support import BUNDLED

from slamcli.batch.benchmark.grid import Variant
from slamcli.batch.benchmark.peers.settings import tried
from slamcli.batch.benchmark.processes import answers, failure
from slamcli.batch.benchmark.result import Data
from slamcli.batch.benchmark.runner import described, run, steps
from slamcli.errors import ExitCode
from slamcli.reporting.benchmark import COLUMNS, benchmark_document, benchmark_summary, exported

DATA = Data("small", "small.g2o", "0" * 64, 3, 0, 4, optimum=2.0)
OTHER = Data("other", "other.g2o", "1" * 64, 3, 0, 4)
GN, LM = Variant("method=gn", options={"method": "gn"}), Variant("method=lm", options={"method": "lm"})
G2O, GTSAM = Variant("g2opy", "g2opy"), Variant("gtsam", "gtsam")


def solved(seconds: float, chi2: float = 2.0, **more: Any) -> dict[str, Any]:
    return {"solve": seconds, "iterations": 3, "chi2": chi2, "reached": chi2 <= 2.000001, "note": ""} | more


class Fake:
    """Answers requests from a script: (path, tool or method) -> what it answers, call by call; the last one stays."""

    def __init__(self, script: dict[tuple[str, str], list[dict[str, Any]]]) -> None:
        self.script, self.calls = script, list[str]()

    def __call__(
        self, request: dict[str, Any], count: int, limit: Callable[[], float], loading: float, threads: int
    ) -> Iterator[dict[str, Any]]:
        tool = request["peer"]
        if tool == "reference":
            self.calls.append(tool)
            yield solved(1.0)
            return
        assert len(request["tasks"]) == count and limit() > 0
        name = request["path"].rsplit("/", 1)[-1].removesuffix(".g2o")
        for task in request["tasks"]:
            key = task["method"] if tool == "slamcli" else tool
            searching = tool != "slamcli" and task[1] is None
            self.calls.append(f"search {key}" if searching else f"{name} {key}")
            replies = self.script[name, f"search {key}" if searching else key]
            reply = replies.pop(0) if len(replies) > 1 else replies[0]
            if reply.get("interrupt"):
                raise KeyboardInterrupt
            yield {"status": "converged", **reply} if tool == "slamcli" and reply["solve"] is not None else reply


def test_variants_alternate_after_a_warm_up() -> None:
    fake = Fake({(name, key): [solved(1.0)] for name in ("small", "other") for key in ("gn", "lm")})
    ticks: list[str] = []
    result = run((DATA, OTHER), (GN, LM), repeats=2, ask=fake, tick=ticks.append)
    each = ["gn", "lm"] * 3
    assert fake.calls == [f"small {key}" for key in each] + [f"other {key}" for key in each]
    assert [len(row.runs) for row in result.rows] == [2, 2, 2, 2]
    assert len(ticks) == steps((DATA, OTHER), (GN, LM), 2)
    assert result.exit_code == ExitCode.SUCCESS


def test_statistics_are_those_of_the_counted_runs() -> None:
    """Worked by hand: the warm-up of 9 s counts nowhere, and ratios are those of the same repetition."""
    fake = Fake(
        {
            ("small", "gn"): [solved(t) for t in (9.0, 1.0, 2.0, 4.0)],
            ("small", "lm"): [solved(t) for t in (9.0, 3.0, 2.0, 6.0)],
        }
    )
    result = run((DATA,), (GN, LM), repeats=3, ask=fake)
    first, second = result.rows
    assert (first.median, first.deviation, min(first.times), max(first.times)) == (2.0, 1.0, 1.0, 4.0)
    assert (second.median, second.deviation) == (3.0, 1.0)
    assert (result.ratio(first), result.ratio(second)) == (1.0, 1.5)  # of 3, 1 and 1.5


def test_reached_is_against_the_lowest_that_is_known() -> None:
    fake = Fake({("small", "gn"): [solved(1.0, 2.000001)], ("small", "lm"): [solved(1.0, 2.00001)]})
    result = run((DATA,), (GN, LM), repeats=1, ask=fake)
    assert result.best(DATA) == 2.0
    assert [result.reached(row) for row in result.rows] == [True, False]
    fake = Fake({("other", "gn"): [solved(1.0, 5.0)], ("other", "lm"): [solved(1.0, 4.0)]})
    result = run((OTHER,), (GN, LM), repeats=1, ask=fake)
    assert result.best(OTHER) == 4.0
    assert [result.reached(row) for row in result.rows] == [False, True]
    robust = Variant("robust=gnc", options={"method": "gn", "robust": "gnc"})
    assert (
        result.reached(run((DATA,), (robust,), repeats=1, ask=Fake({("small", "gn"): [solved(1.0)]})).rows[0]) is None
    )


@pytest.mark.parametrize(
    ("reply", "words"),
    [
        (failure("the process died of SIGSEGV"), "SIGSEGV"),
        (failure("stopped after 5 s"), "stopped after 5 s"),
        (solved(1.0, math.nan, status="numerical_failure", reason="H is singular"), "numerical failure: H is"),
        (
            solved(1.0, 3.0, status="not_converged", reason="iteration limit 3 reached"),
            "not converged: iteration limit",
        ),
    ],
)
def test_a_variant_that_fails_is_a_row_and_exit_code_1(reply: dict[str, Any], words: str) -> None:
    fake = Fake({("small", "gn"): [solved(1.0)], ("small", "lm"): [reply]})
    result = run((DATA,), (GN, LM), repeats=2, ask=fake)
    assert result.exit_code == ExitCode.CHECK_FAILED
    assert words in result.notes(result.rows[1])
    assert len(result.rows[0].runs) == 2
    if reply["solve"] is None:
        assert fake.calls.count("small lm") == 1, "what failed in the warm-up would fail again"
    for kind in ("csv", "json", "markdown"):
        assert words.split(":")[0] in exported(result, kind)


def test_a_peer_runs_its_fastest_setting_that_reaches_the_optimum() -> None:
    settings = [solved(0.1, 2.5), solved(0.5), solved(0.3, iterations=7), failure("singular"), solved(0.4)]
    fake = Fake(
        {("small", "gn"): [solved(1.0)], ("small", "search g2opy"): settings, ("small", "g2opy"): [solved(0.25)]}
    )
    result = run((DATA,), (GN, G2O), repeats=2, ask=fake)
    row = result.rows[1]
    plain = [one for one in tried("g2opy") if one.method == "gn"]
    assert row.setting == plain[2].name
    assert fake.calls.count("search g2opy") == len(plain), "no damped method where Gauss-Newton gets there"
    assert result.ratio(row) == 0.25 and result.reached(row) is True
    assert fake.calls[0] == "small gn" and fake.calls[1] == "reference", "the warm-up, then what peers aim at"
    assert result.exit_code == ExitCode.SUCCESS


def test_a_peer_that_crashes_or_ends_elsewhere_does_not_fail_the_bench() -> None:
    fake = Fake(
        {
            ("small", "gn"): [solved(1.0)],
            ("small", "search g2opy"): [failure("takes graphs of relative poses only")],
            ("small", "search gtsam"): [solved(0.2, 9.0), solved(0.3, 3.0), solved(0.4, 5.0)],
            ("small", "gtsam"): [solved(0.3, 3.0), failure("the process died of SIGABRT")],
        }
    )
    result = run((DATA,), (GN, G2O, GTSAM), repeats=3, ask=fake)
    ours, missing, elsewhere = result.rows
    assert not missing.runs and result.notes(missing) == "takes graphs of relative poses only"
    assert result.reached(missing) is None and result.ratio(missing) is None
    assert result.reached(elsewhere) is False, "the lowest that it came to is shown"
    assert fake.calls.count("search gtsam") == len(tried("gtsam")), "all that there is was tried"
    assert len(elsewhere.runs) == 2, "no third run after a crash"
    assert "SIGABRT" in result.notes(elsewhere)
    assert result.exit_code == ExitCode.SUCCESS
    assert len(ours.runs) == 3


def test_a_peer_that_misses_the_optimum_by_chance_gets_another_iteration() -> None:
    fake = Fake(
        {
            ("small", "gn"): [solved(1.0)],
            ("small", "search g2opy"): [solved(0.5)],
            ("small", "g2opy"): [solved(0.5), solved(0.5, 2.1), solved(0.6), solved(0.7)],
        }
    )
    result = run((DATA,), (GN, G2O), repeats=3, ask=fake)
    assert result.rows[1].times == [0.5, 0.6, 0.7] and result.reached(result.rows[1]) is True
    assert fake.calls.count("small g2opy") == 4


def test_own_optimum_counts_only_if_the_peer_says_that_it_is_there() -> None:
    """A peer of another cost: polishing may lead to the optimum from a point that is none of its own minima."""
    there = solved(0.2, 2.3, polished=2.0, reached=True)
    for reached in (True, False):
        fake = Fake(
            {
                ("small", "gn"): [solved(1.0)],
                ("small", "search gtsam"): [there],
                ("small", "gtsam"): [there | {"reached": reached}],
            }
        )
        result = run((DATA,), (GN, GTSAM), repeats=1, ask=fake)
        assert result.reached(result.rows[1]) is reached


def test_an_interruption_keeps_what_there_is() -> None:
    fake = Fake({("small", "gn"): [solved(1.0)], ("small", "lm"): [solved(1.0), solved(2.0), {"interrupt": True}]})
    result = run((DATA, OTHER), (GN, LM), repeats=5, ask=fake)
    assert result.interrupted and result.exit_code == ExitCode.INTERRUPTED
    assert [len(row.runs) for row in result.rows] == [2, 1]
    assert result.ratio(result.rows[1]) == 2.0
    assert "2 of 5 runs" in result.notes(result.rows[0])
    assert "Interrupted" in benchmark_summary(result)[-1] and "Interrupted" in exported(result, "markdown")
    assert json.loads(exported(result, "json"))["interrupted"] is True


def test_tables_have_a_row_for_each_variant_and_nothing_is_nan() -> None:
    fake = Fake({("small", "gn"): [solved(1.0, math.inf)], ("small", "lm"): [solved(1.0, math.nan)]})
    result = run((DATA,), (GN, LM), repeats=1, ask=fake)
    lines = exported(result, "markdown").splitlines()
    assert lines[0] == "| " + " | ".join(COLUMNS) + " |"
    assert [line.split(" | ")[1] for line in lines[2:4]] == ["method=gn", "method=lm"]
    records = list(csv.DictReader(io.StringIO(exported(result, "csv"))))
    assert [record["variant"] for record in records] == ["method=gn", "method=lm"]
    assert float(records[0]["median_s"]) == 1.0
    assert "NaN" not in exported(result, "json") and "nan" not in "".join(lines)
    assert benchmark_document(result)["rows"][0]["chi2"] is None


def test_real_runs_agree_with_each_other_and_with_the_peers() -> None:
    path = BUNDLED / "manhattan_small.g2o"
    peers = []
    for name in ("gtsam", "g2opy"):
        try:
            __import__(name)
            peers.append(Variant(name, name))
        except ImportError:
            pass
    data = described("manhattan_small", path)
    assert (data.poses, data.edges) == (400, 699)
    result = run((data,), (GN, LM, *peers), repeats=1)
    for row in result.rows:
        assert result.reached(row) is True, (row.variant.label, result.notes(row))
        (one,) = row.runs
        assert one.process is not None and one.solve is not None and 0.0 < one.solve < one.process
        assert one.memory is not None and 10.0 < one.memory < 1000.0
        assert one.iterations > 0
    assert result.rows[0].runs[0].chi2 == pytest.approx(877.048409, rel=1e-7)


def test_a_child_that_takes_too_long_or_breaks_is_an_answer() -> None:
    request = {"path": str(BUNDLED / "manhattan_small.g2o"), "peer": "slamcli", "best": None, "tasks": [{}]}
    (late,) = answers(request, 1, lambda: 0.01, loading=0.0)
    assert late["solve"] is None and late["note"] == "stopped after 0.01 s"
    (broken,) = answers(request | {"path": "nowhere.g2o"}, 1, lambda: 60.0)
    assert broken["solve"] is None and "nowhere.g2o: cannot be read" in broken["note"]
    (wrong,) = answers(request | {"tasks": [{"fix": [777777]}]}, 1, lambda: 60.0)
    assert "no variable has the id 777777" in wrong["note"]


@pytest.mark.parametrize(
    ("name", "optimum"), [("manhattan_small.g2o", 877.0484089), ("square_toro.graph", 52.313557056)]
)
def test_the_optimum_of_the_registry_is_found_by_the_hash_of_the_file(name: str, optimum: float) -> None:
    assert described("x", BUNDLED / name).optimum == pytest.approx(optimum, rel=1e-9)


def test_files_of_the_working_directory_are_no_part_of_a_child(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file random.py beside the data would be imported in place of the library."""
    for name in ("random.py", "slamcli.py", "tempfile.py"):
        (tmp_path / name).write_text("raise SystemExit(77)\n")
    monkeypatch.chdir(tmp_path)
    request = {
        "path": str(BUNDLED / "square_toro.graph"),
        "peer": "slamcli",
        "best": None,
        "reference": "",
        "tasks": [{}],
    }
    (answer,) = answers(request, 1, lambda: 60.0)
    assert answer["chi2"] == pytest.approx(52.3135571, rel=1e-8)


def test_an_optimum_of_zero_is_reached_but_for_rounding() -> None:
    fake = Fake({("other", "gn"): [solved(1.0, 2e-19)], ("other", "lm"): [solved(1.0, 1e-20)]})
    result = run((OTHER,), (GN, LM), repeats=1, ask=fake)
    assert [result.reached(row) for row in result.rows] == [True, True]


def test_a_peer_that_diverges_is_said_to() -> None:
    fake = Fake(
        {
            ("small", "gn"): [solved(1.0)],
            ("small", "search g2opy"): [solved(0.5, math.nan)],
            ("small", "g2opy"): [solved(0.5, math.nan)],
        }
    )
    result = run((DATA,), (GN, G2O), repeats=1, ask=fake)
    assert result.reached(result.rows[1]) is None and "diverged" in result.notes(result.rows[1])
