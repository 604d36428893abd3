"""Blocks read and written by pieces, and memory that is used again."""

from dataclasses import replace

import numpy as np
import pytest
from bundle_scenes import perturbed, ring

from slamcli.solver import gauge
from slamcli.solver.block_pieces import BlockPieces
from slamcli.solver.options import OptimizeOptions
from slamcli.solver.pattern import BlockPattern
from slamcli.solver.problem import Problem
from slamcli.solver.stopwatch import Stopwatch

# A column of three blocks: 2 x 3 and 4 x 3 above the diagonal one.
PATTERN = BlockPattern(np.array([2, 4, 3]), np.array([0, 1, 0, 1, 2]), np.array([0, 1, 2, 2, 2]))
TALL = 3  # which of its blocks is 4 x 3


def matrix(values: np.ndarray) -> np.ndarray:
    out = np.zeros((9, 9))
    out[PATTERN.scalar_rows, PATTERN.scalar_columns] = values
    return out


@pytest.mark.parametrize("flipped", [False, True])
def test_reads_a_block_or_its_transpose(flipped: bool) -> None:
    values = np.arange(float(PATTERN.stored))
    block = matrix(values)[2:6, 6:9]
    shape = (3, 4) if flipped else (4, 3)
    pieces = BlockPieces(PATTERN, np.array([TALL]), shape, np.array([flipped]))
    assert pieces.read(values)[0] == pytest.approx(block.T if flipped else block, abs=0.0)


def test_reads_blocks_of_both_sorts_and_none() -> None:
    values = np.arange(float(PATTERN.stored))
    pieces = BlockPieces(PATTERN, np.array([4, -1, 4]), (3, 3), np.array([True, False, False]))
    block = matrix(values)[6:, 6:]
    assert np.array_equal(pieces.read(values), [block.T, np.zeros((3, 3)), block])


@pytest.mark.parametrize("flipped", [False, True])
def test_writes_what_it_reads(flipped: bool) -> None:
    shape = (3, 4) if flipped else (4, 3)
    pieces = BlockPieces(PATTERN, np.array([TALL]), shape, np.array([flipped]))
    wanted = np.random.default_rng(1).normal(size=shape)
    values = np.full(PATTERN.stored, 7.0)
    pieces.write(values, wanted[:, :, None])
    assert np.array_equal(pieces.read(values)[0], wanted)
    assert np.count_nonzero(values == 7.0) == PATTERN.stored - 12


def test_adds_blocks_that_occur_twice() -> None:
    pieces = BlockPieces(PATTERN, np.array([TALL, TALL]), (4, 3), np.zeros(2, dtype=bool))
    values = np.ones(PATTERN.stored)
    one, two = np.random.default_rng(2).normal(size=(2, 4, 3))
    pieces.add(values, np.stack([one, two], axis=2))
    assert pieces.read(values)[0] == pytest.approx(1.0 + one + two, rel=1e-15)


def test_a_system_that_is_kept_stays_as_it_is() -> None:
    scene = perturbed(ring(cameras=4, points=20, share=1.0))
    _, held = gauge.choose(scene)
    problem = Problem(scene, held, OptimizeOptions(method="lm", init="file"), Stopwatch())
    kept = problem.linearize(scene.values)
    hessian, gradient = kept.hessian.copy(), kept.gradient.copy()
    delta = problem.solve(kept, 1e-4 * problem.diagonal(kept))
    moved = problem.retract(scene.values, delta)
    for _ in range(3):  # the memory of these is used again
        other = problem.linearize(moved)
    assert not np.array_equal(other.hessian, hessian)
    assert np.array_equal(kept.hessian, hessian)
    assert np.array_equal(kept.gradient, gradient)


def test_an_observation_that_occurs_twice_counts_twice() -> None:
    scene = ring(cameras=4, points=40, share=1.0)
    (factors,) = scene.factors
    rows = np.arange(len(factors))
    twice = replace(scene, factors=[factors.part(np.concatenate([rows, rows]))])
    _, held = gauge.choose(scene)
    options = OptimizeOptions(method="lm", init="file")
    one, two = (Problem(g, held, options, Stopwatch()).linearize(scene.values) for g in (scene, twice))
    assert two.hessian == pytest.approx(2.0 * one.hessian, rel=1e-12, abs=1e-9 * np.abs(one.hessian).max())
    assert two.gradient == pytest.approx(2.0 * one.gradient, rel=1e-9, abs=1e-9 * np.abs(one.gradient).max())
