"""The grid of variants: what --param and --peers mean, and what they refuse."""

from __future__ import annotations

import importlib.util

import pytest

from slamcli.batch.benchmark import grid
from slamcli.batch.benchmark.peers.settings import PEERS, SETTINGS, tried
from slamcli.errors import UsageError
from slamcli.solver.options import OptimizeOptions


def test_the_grid_is_the_product_and_the_last_option_changes_fastest() -> None:
    made = grid.variants(grid.parameters(["method=gn,lm", "max-iterations=10,20,30"]))
    assert [one.label for one in made] == [
        f"method={method} max_iterations={count}" for method in ("gn", "lm") for count in (10, 20, 30)
    ]
    assert made[4].options == {"method": "lm", "max_iterations": 20}
    assert not any(one.is_peer for one in made)


def test_peers_come_behind() -> None:
    made = grid.variants({}, ("g2opy",))
    assert [(one.label, one.tool, dict(one.options)) for one in made] == [
        ("slamcli", "slamcli", {}),
        ("g2opy", "g2opy", {}),
    ]


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("tolerance=1e-6,0", (1e-6, 0.0)),
        ("time_limit=none,2.5", (None, 2.5)),
        ("fix=0,3+5", ((0,), (3, 5))),
        ("robust=pcm+gnc", ("pcm+gnc",)),
        ("kernel-width=none", (None,)),
        ("kernel=none", ("none",)),
        ("max-iterations=7", (7,)),
    ],
)
def test_values_have_the_types_of_the_options(text: str, values: tuple[object, ...]) -> None:
    (found,) = grid.parameters([text]).values()
    assert found == values
    assert [type(one) for one in found] == [type(one) for one in values]
    name = text.partition("=")[0].replace("-", "_")
    assert grid.parameters([f"{name}={','.join(map(grid.shown, found))}"]) == {name: found}


def test_every_option_of_optimize_can_be_varied() -> None:
    for name in OptimizeOptions.names():
        default = getattr(OptimizeOptions(), name)
        if default == ():
            continue
        assert grid.parameters([f"{name}={grid.shown(default)}"]) == {name: (default,)}


@pytest.mark.parametrize(
    ("texts", "words"),
    [
        (["methd=gn"], "did you mean method?"),
        (["method=gm"], "one of: auto, gn"),
        (["method"], "expected NAME=VALUE"),
        (["method="], "expected NAME=VALUE"),
        (["method=gn,gn"], "a value stands twice"),
        (["method=gn", "method=lm"], "stands twice"),
        (["max_iterations=1.5"], "expected an integer"),
        (["tolerance=small"], "expected a number"),
        (["tolerance=nan"], "expected a number"),
        (["fix=1;2"], "expected ids"),
        (["tolerance=-1"], "zero or positive"),
        (["robust=gnc", "kernel=huber"], "two ways to the same end"),
        (["max_iterations=" + ",".join(map(str, range(1, 202)))], "201 variants"),
    ],
)
def test_what_makes_no_grid_is_refused(texts: list[str], words: str) -> None:
    with pytest.raises(UsageError) as caught:
        grid.variants(grid.parameters(texts))
    assert words in " ".join([caught.value.message, *caught.value.details])


def test_peers_are_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UsageError, match="no peer 'gtsan'") as caught:
        grid.peers(["gtsan"])
    assert "gtsam" in caught.value.details[0]
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(UsageError, match="gtsam is not installed") as caught:
        grid.peers(["gtsam"])
    assert "slamcli[peers]" in caught.value.details[0]
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: object())
    assert grid.peers(["gtsam,g2opy", "gtsam"]) == ("gtsam", "g2opy")


def test_robust_variants_minimize_something_else() -> None:
    made = grid.variants(grid.parameters(["kernel=none,huber"]))
    assert [one.minimizes_chi2 for one in made] == [True, False]
    made = grid.variants(grid.parameters(["robust=none,gnc"]))
    assert [one.minimizes_chi2 for one in made] == [True, False]


def test_what_is_tried_of_a_peer_needs_no_start_that_is_not_counted() -> None:
    for peer in PEERS:
        chosen = tried(peer)
        assert chosen and set(chosen) <= set(SETTINGS[peer])
        assert not any(one.borrowed for one in chosen)
        assert len({one.name for one in SETTINGS[peer]}) == len(SETTINGS[peer])
