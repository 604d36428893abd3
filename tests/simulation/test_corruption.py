"""What is spoiled is spoiled by as much as was asked, the rest keeps its bytes, and the labels name what is false."""

from dataclasses import replace
from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from support import BUNDLED, write_file

import slamcli
from slamcli.errors import UsageError
from slamcli.formats import render
from slamcli.formats.labels import labels_of, outlier_masks, read_labels, write_labels
from slamcli.geometry import so3
from slamcli.graph import FactorGraph
from slamcli.graph.topology import is_loop_closure
from slamcli.simulation.corruption import corrupt_odometry, perturb, pick
from slamcli.simulation.injection import Amount, Injected, InjectOptions, inject
from slamcli.simulation.odometry_chain import is_observation, is_odometry

NAMES = ("manhattan_small.g2o", "sphere_small.g2o", "landmarks_small.g2o", "square_toro.graph")
every_graph = pytest.mark.parametrize("name", NAMES)


def bundled(name: str) -> FactorGraph:
    return slamcli.read(str(BUNDLED / name))


def counts(injected: Injected) -> dict[str, int]:
    return {operation.name: operation.count for operation in injected.operations}


@every_graph
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=12)
@given(
    false=st.none() | st.integers(0, 8),
    odometry=st.none() | st.integers(0, 8),
    gone=st.none() | st.integers(0, 8),
    scale=st.sampled_from([None, 1.0, 4.0]),
    sigma=st.sampled_from([None, (0.1, 0.05)]),
    policy=st.sampled_from(["random", "local"]),
    seed=st.integers(0, 1000),
)
def test_labels_match_the_written_file(
    tmp_path: Path,
    name: str,
    false: int | None,
    odometry: int | None,
    gone: int | None,
    scale: float | None,
    sigma: tuple[float, float] | None,
    policy: str,
    seed: int,
) -> None:
    graph = bundled(name)
    closures = sum(int(is_loop_closure(graph, f).sum()) for f in graph.factors)
    amounts = [None if number is None else Amount(number) for number in (false, odometry)]
    options = InjectOptions(
        false_closures=amounts[0],
        policy=policy,
        corrupt_odometry=amounts[1],
        drop_closures=None if gone is None else Amount(min(gone, closures)),
        scale_information=scale,
        scale="closures",
        perturb=sigma,
        seed=seed,
    )
    injected = inject(graph, options)
    text = render(injected.graph).data
    write_labels(str(tmp_path / "labels.csv"), *labels_of(injected.graph, injected.outliers))
    again = slamcli.read(str(write_file(tmp_path, text, name)))
    masks = outlier_masks(read_labels(str(tmp_path / "labels.csv")), again)
    assert sum(int(mask.sum()) for mask in masks) == (false or 0) + (odometry or 0) == injected.outlier_count
    assert again.edges == graph.edges + (false or 0) - min(gone or 0, closures)
    if gone is None and (scale in (None, 1.0)) and sigma is None:
        lines = (BUNDLED / name).read_bytes().splitlines(), text.splitlines()
        original, now = ([line for line in part if not line.startswith(b"#")] for part in lines)  # they stand last
        changed = {k + 1 for k in range(len(original)) if original[k] != now[k]}
        marked = {int(n) for f, m in zip(again.factors, masks, strict=True) for n in f.lines[m]}
        assert marked == changed | set(range(len(original) + 1, len(now) + 1))


@every_graph
def test_the_same_seed_gives_the_same_bytes(name: str) -> None:
    graph = bundled(name)
    everything = InjectOptions(false_closures=Amount(5), corrupt_odometry=Amount(5), perturb=(0.1, 0.1), seed=3)
    one, two = (render(inject(graph, everything).graph).data for _ in range(2))
    assert one == two
    assert one != render(inject(graph, replace(everything, seed=4)).graph).data


def test_an_operation_does_not_change_what_the_others_draw() -> None:
    graph = bundled("manhattan_small.g2o")
    odometry = is_odometry(graph, graph.factors[0])
    alone = inject(graph, InjectOptions(corrupt_odometry=Amount(9)))
    with_others = inject(
        graph,
        InjectOptions(
            false_closures=Amount(10.0, percent=True),
            policy="grouped",
            corrupt_odometry=Amount(9),
            drop_closures=Amount(50.0, percent=True),
            perturb=(0.1, 0.1),
        ),
    )
    measured = [
        injected.graph.factors[0].measurements[is_odometry(graph, injected.graph.factors[0])]
        for injected in (alone, with_others)
    ]
    np.testing.assert_array_equal(measured[0], measured[1])
    assert (measured[0] != graph.factors[0].measurements[odometry]).any(axis=1).sum() == 9
    only_false = inject(graph, InjectOptions(false_closures=Amount(10.0, percent=True), policy="grouped"))
    added = [injected.graph.factors[0] for injected in (only_false, with_others)]
    np.testing.assert_array_equal(*(f.measurements[f.lines == 0] for f in added))
    np.testing.assert_array_equal(*(f.indices[f.lines == 0] for f in added))


@every_graph
@pytest.mark.parametrize("magnitude", [1.0, 1.5])
def test_bounds_of_corrupted_odometry(name: str, magnitude: float) -> None:
    graph = bundled(name)
    factors = graph.factors[0]
    rows = np.flatnonzero(is_odometry(graph, factors))
    worse = corrupt_odometry(factors, rows, magnitude, np.random.default_rng(0))
    kind = factors.kind.variables[0]
    error = kind.compose(kind.inverse(factors.measurements[rows]), worse.measurements[rows])
    lengths = np.linalg.norm(factors.measurements[:, : kind.space], axis=1)
    far = np.linalg.norm(error[:, : kind.space], axis=1) / np.maximum(lengths[rows], np.median(lengths)) / magnitude
    if kind.space == 2:
        turn = np.abs(error[:, 2])
        assert 0.2 < (error[:, 2] > 0).mean() < 0.8
    else:
        turn = 2.0 * np.arccos(np.minimum(np.abs(error[:, 6]), 1.0))
    assert 0.5 <= far.min() <= far.max() <= 1.5
    assert np.deg2rad(30) * magnitude - 1e-9 <= turn.min() <= turn.max() <= np.deg2rad(90) * magnitude + 1e-9
    assert far.std() == pytest.approx(np.sqrt(1.0 / 12.0), rel=0.3)  # uniform
    others = np.setdiff1d(np.arange(len(factors)), rows)
    np.testing.assert_array_equal(worse.measurements[others], factors.measurements[others])


def test_only_closures_are_dropped() -> None:
    graph = bundled("manhattan_small.g2o")
    closures = is_loop_closure(graph, graph.factors[0])
    injected = inject(graph, InjectOptions(drop_closures=Amount(40.0, percent=True)))
    rest = injected.graph.factors[0]
    assert counts(injected) == {"drop_closures": int(np.floor(0.4 * closures.sum() + 0.5))}
    assert is_loop_closure(graph, rest).sum() == closures.sum() - counts(injected)["drop_closures"]
    assert is_odometry(graph, rest).sum() == (~closures).sum()
    original = (BUNDLED / "manhattan_small.g2o").read_bytes().splitlines()
    left = render(injected.graph).data.splitlines()
    assert set(left) <= set(original)
    assert len(left) == len(original) - counts(injected)["drop_closures"]
    everything = inject(graph, InjectOptions(drop_closures=Amount(100.0, percent=True))).graph
    assert everything.edges == (~closures).sum()


@every_graph
@pytest.mark.parametrize("scale", ["all", "odometry", "closures"])
def test_scaled_information_scales_chi2(name: str, scale: str) -> None:
    graph = bundled(name)
    injected = inject(graph, InjectOptions(scale_information=3.0, scale=scale))
    for before, after in zip(graph.factors, injected.graph.factors, strict=True):
        chosen = {"odometry": is_odometry(graph, before), "closures": is_loop_closure(graph, before)}
        factor = np.where(chosen.get(scale, np.ones(len(before), dtype=bool)), 3.0, 1.0)
        np.testing.assert_allclose(after.chi2(graph.values), factor * before.chi2(graph.values), rtol=1e-12)
    assert injected.outlier_count == 0


@pytest.mark.parametrize("name", NAMES[:3])
def test_the_guess_is_moved_by_as_much_as_was_asked(name: str) -> None:
    """Five standard errors; the lowest pose, which the optimizer would hold, stays."""
    graph = bundled(name)
    moved = perturb(graph, 0.2, 0.05, np.random.default_rng(0))
    for kind_name, column in graph.variables.items():
        kind = column.kind
        step = kind.compose(kind.inverse(column.values), moved[kind_name].values)
        parts = [(step[:, : kind.space], 0.2)]
        if kind.is_pose:
            turn = step[:, 2:] if kind.space == 2 else so3.log(step[:, 3:])
            parts.append((turn, 0.05))
            assert np.abs(step[column.row_of(int(column.ids.min()))] - kind.identity).max() < 1e-15
        for values, sigma in parts:
            assert values.std() == pytest.approx(sigma, rel=5.0 / np.sqrt(2 * values.size))


def test_fixed_variables_and_those_without_a_guess_stay(tmp_path: Path) -> None:
    text = "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nVERTEX_XY 7 1 1\nFIX 1 7\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n"
    text += "EDGE_SE2 1 2 1 0 0 1 0 0 1 0 1\nEDGE_SE2_XY 0 7 1 1 1 0 1\n"
    graph = slamcli.read(str(write_file(tmp_path, text)))
    injected = inject(graph, InjectOptions(perturb=(1.0, 1.0)))
    assert counts(injected) == {"perturb": 1}
    changed = render(injected.graph).data.decode().splitlines()
    assert [k for k, row in enumerate(text.splitlines()) if row != changed[k]] == [0]


def test_false_observations() -> None:
    graph = bundled("landmarks_small.g2o")
    injected = inject(graph, InjectOptions(false_observations=Amount(15.0, percent=True), seed=2))
    total = sum(int(is_observation(f).sum()) for f in graph.factors)
    assert injected.outlier_count == counts(injected)["false_observations"] == int(np.floor(0.15 * total + 0.5))
    before = {name: column.ids for name, column in graph.variables.items()}
    original = {name: np.zeros(len(ids), dtype=int) for name, ids in before.items()}
    assert injected.reference is not None
    for old, new, mask in zip(graph.factors, injected.graph.factors, injected.outliers, strict=True):
        np.testing.assert_array_equal(new.measurements, old.measurements)
        np.testing.assert_array_equal(new.indices[:, 0], old.indices[:, 0])
        np.testing.assert_array_equal((new.indices[:, 1] != old.indices[:, 1]), mask)
        np.testing.assert_array_equal(new.lines, old.lines)
        if is_observation(new).any():
            assert (new.chi2(injected.reference.values)[mask] > 20.0).all()
            np.add.at(original[new.kind.variables[1].name], new.indices[~mask, 1], 1)
            assert len(np.unique(new.indices, axis=0)) == len(new)
    (points,) = [name for name in before if not graph.variables[name].kind.is_pose]
    assert original[points].min() >= 2


def test_observations_of_two_kinds_are_taken_from_both() -> None:
    graph = bundled("landmarks_small.g2o")
    k = next(k for k, f in enumerate(graph.factors) if is_observation(f).any())
    half = len(graph.factors[k]) // 2
    parts = [graph.factors[k].part(slice(0, half)), graph.factors[k].part(slice(half, None))]
    split = replace(graph, factors=[*graph.factors[:k], *parts, *graph.factors[k + 1 :]])
    injected = inject(split, InjectOptions(false_observations=Amount(30)))
    found = [int(mask.sum()) for mask in injected.outliers if mask.any()]
    assert len(found) == 3  # both halves, and the bearings
    assert sum(found) == 30


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        (NAMES[0], InjectOptions(drop_closures=Amount(10_000)), r"cannot choose 10000 of \d+ loop closures"),
        (NAMES[0], InjectOptions(corrupt_odometry=Amount(101.0, percent=True)), r"of \d+ odometry edges"),
        (NAMES[0], InjectOptions(false_observations=Amount(1)), "no observations"),
        (
            NAMES[0],
            InjectOptions(false_observations=Amount(1.0, percent=True)),
            "no observations of landmarks to take 1%",
        ),
        (NAMES[2], InjectOptions(false_observations=Amount(99.0, percent=True)), r"only \d+ of \d+ false observations"),
        (NAMES[0], InjectOptions(false_closures=Amount(1), information=(1.0, 2.0)), "1 or 3 numbers"),
    ],
)
def test_more_than_there_is(name: str, options: InjectOptions, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        inject(bundled(name), options)


def test_shares_of_nothing(tmp_path: Path) -> None:
    chain = "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 9 0 0\nVERTEX_SE2 2 18 0 0\n"
    chain += "EDGE_SE2 0 1 9 0 0 1 0 0 1 0 1\nEDGE_SE2 1 2 9 0 0 1 0 0 1 0 1\n"
    graph = slamcli.read(str(write_file(tmp_path, chain)))
    for options in ({"false_closures": Amount(10.0, percent=True)}, {"drop_closures": Amount(10.0, percent=True)}):
        with pytest.raises(UsageError, match="no loop closures to take 10%"):
            inject(graph, InjectOptions(**options))  # type: ignore[arg-type]
    assert inject(graph, InjectOptions(drop_closures=Amount(0.0, percent=True))).graph.edges == 2
    one = inject(graph, InjectOptions(false_closures=Amount(1))).graph  # with the odometry's information
    assert render(one).data.decode().startswith(chain + "EDGE_SE2 0 2 ")
    assert one.factors[0].information[2].tolist() == np.eye(3).tolist()


@pytest.mark.parametrize(
    "wrong",
    [
        {"policy": "worst"},
        {"scale": "some"},
        {"group_size": (3, 2)},
        {"group_size": (0, 2)},
        {"scale_information": 0.0},
        {"scale_information": float("nan")},
        {"magnitude": -1.0},
        {"perturb": (-0.1, 0.0)},
        {"information": (0.0,)},
    ],
)
def test_options_are_checked(wrong: dict[str, object]) -> None:
    with pytest.raises(UsageError):
        InjectOptions(**wrong)  # type: ignore[arg-type]


def test_pick_is_fair() -> None:
    masks = [np.array([True, False, True]), np.array([True])]
    hits = np.zeros(4)
    for seed in range(600):
        one = pick(masks, 1, np.random.default_rng(seed), "edges")
        hits += np.concatenate(one)
    assert hits[1] == 0
    assert hits.sum() == 600
    assert np.abs(hits[[0, 2, 3]] - 200).max() < 60
