"""Elimination orders of one graph beside each other: what each costs, predicted and measured."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from slamcli.errors import InputError, UsageError
from slamcli.graph import FactorGraph
from slamcli.graph.columns import IndexArray
from slamcli.solver import gauge
from slamcli.solver import pattern as patterns
from slamcli.solver.gauge import Gauge, Held
from slamcli.solver.options import ORDERINGS
from slamcli.solver.ordering import expand, nested_dissection
from slamcli.solver.ordering.adjacency import edges
from slamcli.solver.ordering.automatic import choose
from slamcli.solver.ordering.calibration import Calibration, calibrate, factorization_time
from slamcli.solver.ordering.changes import BlockCounts, Change, change, factor_counts, hessian_counts
from slamcli.solver.ordering.found import FoundOrder, named
from slamcli.solver.ordering.reduction import reduced_edges
from slamcli.solver.pattern import BlockPattern
from slamcli.solver.symbolic import supernodes
from slamcli.solver.symbolic.cells import hessian_kinds

#: What ``all`` stands for, from the least thought to the most.
_ALL = ("natural", "rcm", "amd", "colamd", "metis", "amd-landmarks-first", "amd-last-pose-last")
#: Factors with more entries are not made: 4 GB.
_MOST_ENTRIES = 500_000_000
#: Any pattern.
_CHAIN = BlockPattern(np.array([1, 1]), np.array([0, 0, 1]), np.array([0, 1, 1]))
#: A factorization that takes longer is measured once.
_LONG = 0.5


@dataclass(frozen=True)
class OrderCost:
    """What one elimination order costs.

    Attributes
    ----------
    name, found
        As asked for, and as found: they differ for ``auto``.
    nnz_factor, fill_in, flops
        Nonzeros of L, their ratio to those of the triangle of H, flops of the factorization.
    tree_height
        Block columns on the longest way from a leaf of the elimination tree to its root.
    supernodes, largest_front, assembly_height, stored
        Of CHOLMOD's relaxed supernodes: their number, scalar rows of the largest front, height of their tree, entries
        of all fronts, explicit zeros included.
    order_time, analysis_time
        Seconds to find the order, and to analyze it.
    predicted_time, measured_time
        Seconds of the numeric factorization; None where it was not done.
    changed
        Blocks of L before and after the change that was asked for.
    """

    name: str
    found: str
    nnz_factor: int
    fill_in: float
    flops: float
    tree_height: int
    supernodes: int
    largest_front: int
    assembly_height: int
    stored: int
    order_time: float
    analysis_time: float
    predicted_time: float | None = None
    measured_time: float | None = None
    changed: BlockCounts | None = None


@dataclass(frozen=True)
class Reduced:
    """The Schur complement on the poses: what eliminating all landmarks leaves of H.

    Attributes
    ----------
    dimension, landmark_dimension
        Rows of the reduced pose matrix, and of the landmarks' block that is eliminated.
    blocks, nnz
        Blocks and nonzeros of its triangle.
    """

    dimension: int
    landmark_dimension: int
    blocks: int
    nnz: int


@dataclass(eq=False)
class Comparison:
    """Orders of one graph, and what its figures need.

    Attributes
    ----------
    pattern, kinds
        Of H; kind of each stored block (see ``symbolic.cells``).
    ids
        (n,) id of the variable of each block.
    gauge
        What is held and why.
    orders, costs
        One for each order that was asked for.
    calibration
        Of the predicted times; None if nothing was measured.
    auto
        Name of the order that ``auto`` takes.
    left_out
        Orders that were not found, and why; factorizations that were not made, and why.
    change, changed
        What was asked to change, and the blocks of H before and after it.
    reduced
        For graphs with landmarks.
    """

    pattern: BlockPattern
    kinds: IndexArray
    ids: IndexArray
    gauge: Gauge
    orders: list[FoundOrder]
    costs: list[OrderCost]
    calibration: Calibration | None
    auto: str
    left_out: list[str]
    change: Change | None = None
    changed: BlockCounts | None = None
    reduced: Reduced | None = None


def names_of(text: str) -> tuple[list[str], bool]:
    """Names of orders from ``all`` or a list with commas; and whether they were named one by one.

    Raises
    ------
    UsageError
        If there is no such order.
    """
    if text == "all":
        return list(_ALL), False
    names = list(dict.fromkeys(part.strip() for part in text.split(",") if part.strip()))
    for name in names:
        if name not in ORDERINGS:
            raise UsageError(f"ordering {name!r} does not exist", (f"  all, or some of: {', '.join(ORDERINGS)}",))
    if not names:
        raise UsageError("--orderings names no ordering", (f"  all, or some of: {', '.join(ORDERINGS)}",))
    return names, True


def compare(
    graph: FactorGraph,
    orderings: str = "all",
    *,
    time_limit: float = 10.0,
    closures: Sequence[tuple[int, int]] = (),
    marginalized: Sequence[int] = (),
    tick: Callable[[], None] = lambda: None,
) -> Comparison:
    """Compare elimination orders of a graph under its own gauge.

    Parameters
    ----------
    graph
        The graph. Only its structure counts, no values.
    orderings
        ``all``, or names of ``options.ORDERINGS`` with commas.
    time_limit
        Seconds: a factorization that is predicted to take longer is not made. 0 makes none.
    closures, marginalized
        What would be added and removed, by ids.
    tick
        Called after each order.

    Raises
    ------
    UsageError
        If an order or an id does not exist, or pymetis is not installed although ``metis`` was named.
    InputError
        If the graph has no edges, or all of its variables are held.
    """
    names, explicit = names_of(orderings)
    if not graph.factors:
        raise InputError("the graph has no edge that slamcli can use: there is no H")
    reason, held = gauge.choose(graph)
    if all(mask.all() for mask in held.values()):
        raise InputError("all variables are held: H is empty")
    pattern, _ = patterns.build(graph, held)
    changed = change(graph, held, pattern, closures, marginalized) if closures or marginalized else None
    left_out: list[str] = []
    if not explicit:
        names = _useful(names, pattern, left_out)
    orders, costs = [], []
    for name in names:
        if name != "auto":
            named(name, _CHAIN)  # loads the library, which is no part of its time
        found, cost = _cost(name, pattern, changed)
        orders.append(found)
        costs.append(cost)
        tick()
    calibration = None
    if time_limit > 0.0:
        calibration, costs = _timed(pattern, orders, costs, time_limit, left_out)
    return Comparison(
        pattern=pattern,
        kinds=hessian_kinds(graph, held, pattern),
        ids=_ids(graph, held),
        gauge=reason,
        orders=orders,
        costs=costs,
        calibration=calibration,
        auto=choose(pattern, {found.name: found for found in orders}).name,
        left_out=left_out,
        change=changed,
        changed=None if changed is None else hessian_counts(pattern, changed),
        reduced=_reduced(pattern),
    )


def _useful(names: list[str], pattern: BlockPattern, left_out: list[str]) -> list[str]:
    """Of all orders those that can be had and are not the same as another."""
    out = []
    for name in names:
        if name == "metis" and not nested_dissection.is_installed():
            left_out.append("metis: pymetis is not installed (pip install pymetis)")
        elif name == "amd-landmarks-first" and (pattern.pose_rank is None or (pattern.pose_rank >= 0).all()):
            continue
        else:
            out.append(name)
    return out


def _cost(name: str, pattern: BlockPattern, changed: Change | None) -> tuple[FoundOrder, OrderCost]:
    start = time.perf_counter()
    found = choose(pattern) if name == "auto" else named(name, pattern)
    ordered = time.perf_counter()
    analysis = found.analysis(pattern)
    parts = supernodes(analysis)
    analyzed = time.perf_counter()
    return found, OrderCost(
        name=name,
        found=found.name,
        nnz_factor=analysis.nnz_factor,
        fill_in=analysis.nnz_factor / pattern.nnz,
        flops=analysis.flops,
        tree_height=analysis.height,
        supernodes=len(parts),
        largest_front=parts.largest_front,
        assembly_height=parts.height,
        stored=parts.stored,
        order_time=ordered - start,
        analysis_time=analyzed - ordered,
        changed=None if changed is None else factor_counts(pattern, analysis, changed),
    )


def _timed(
    pattern: BlockPattern, orders: list[FoundOrder], costs: list[OrderCost], limit: float, left_out: list[str]
) -> tuple[Calibration | None, list[OrderCost]]:
    """The costs with times: the order with the fewest flops is the reference, the others are predicted first."""
    best = min(range(len(orders)), key=lambda k: costs[k].flops)
    if costs[best].stored > _MOST_ENTRIES:
        left_out.append(f"no factorization: under {costs[best].name} L takes {costs[best].stored * 8e-9:.0f} GB")
        return None, costs
    measured, supernodal = factorization_time(pattern, expand(pattern, orders[best].order))
    calibration = calibrate(pattern, orders[best], measured, supernodal)
    out = []
    for k, (found, cost) in enumerate(zip(orders, costs, strict=True)):
        predicted = calibration.predict(found.analysis(pattern))
        taken: float | None = measured
        if k != best:
            taken = None
            if cost.stored > _MOST_ENTRIES:
                left_out.append(f"factorization under {cost.name}: L takes {cost.stored * 8e-9:.0f} GB")
            elif predicted > limit:
                left_out.append(f"factorization under {cost.name}: predicted to take {predicted:.1f} s (--time-limit)")
            else:
                permutation = expand(pattern, found.order)
                taken, _ = factorization_time(pattern, permutation, repeats=1 if predicted > _LONG else 3)
        out.append(replace(cost, predicted_time=predicted, measured_time=taken))
    return calibration, out


def _ids(graph: FactorGraph, held: Held) -> IndexArray:
    return np.concatenate([column.ids[~held[name]] for name, column in graph.variables.items()])


def _reduced(pattern: BlockPattern) -> Reduced | None:
    rank = pattern.pose_rank
    if rank is None or not (0 < (rank >= 0).sum() < len(rank)):
        return None
    low, high = reduced_edges(*edges(pattern), rank < 0)
    count = len(rank)
    keys = np.unique(high * count + low)
    high, low = np.divmod(keys, count)
    own = pattern.sizes[rank >= 0]
    nnz = int((pattern.sizes[low] * pattern.sizes[high]).sum() + (own * (own + 1) // 2).sum())
    return Reduced(int(own.sum()), pattern.dimension - int(own.sum()), len(keys) + len(own), nnz)
