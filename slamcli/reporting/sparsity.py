"""What ``slamcli sparsity`` prints: a table by elimination order, text and JSON."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from slamcli.graph import FactorGraph, Topology
from slamcli.reporting.documents import gauge_section, head, input_section
from slamcli.reporting.text import count, plural, seconds, table
from slamcli.solver.ordering.changes import BlockCounts
from slamcli.solver.ordering.comparison import Comparison, OrderCost
from slamcli.solver.symbolic.cells import CLOSURE, LANDMARK, POSE

_KINDS = {"pose": POSE, "landmark": LANDMARK, "closure": CLOSURE}
_HEADER = ("ordering", "nnz(L)", "fill-in", "flops", "height", "front", "order", "predicted", "measured")


def sparsity_summary(
    source: FactorGraph, topology: Topology, comparison: Comparison, files: dict[str, str]
) -> list[str]:
    """The table for people, and above it what it is about."""
    pattern = comparison.pattern
    held = comparison.gauge.held
    listed = ", ".join(str(i) for i in held[:8]) + (", ..." if len(held) > 8 else "")
    kinds = kind_counts(comparison)
    parts = [f"{kinds['pose']} of poses and odometry", f"{kinds['closure']} of loop closures"]
    others = " and ".join(["landmarks"] * (source.landmarks > 0) + ["switches"] * (source.switches > 0))
    if kinds["landmark"]:
        parts.append(f"{kinds['landmark']} with {others}")
    listed_others = f", {plural(source.landmarks, 'landmark')}" if source.landmarks else ""
    if source.switches:
        listed_others += f", {source.switches} switch{'es' * (source.switches != 1)}"
    rows = [
        ("graph", f"{source.space}-D, {plural(source.poses, 'pose')}{listed_others}, {plural(source.edges, 'edge')}"),
        ("gauge", f"{comparison.gauge.reason}: {listed}" if held else comparison.gauge.reason),
        (
            "hessian",
            f"{pattern.dimension} x {pattern.dimension}, {pattern.nnz} nonzeros in the triangle under every order, "
            f"density {density(comparison):.3%}",
        ),
        ("blocks", f"{len(pattern.rows)} in the triangle: {', '.join(parts)}"),
    ]
    if comparison.reduced is not None:
        reduced = comparison.reduced
        rows.append(
            (
                "reduced",
                f"poses alone, {plural(reduced.landmark_dimension, 'row')} of {others} eliminated: "
                f"{reduced.dimension} x {reduced.dimension}, {reduced.nnz} nonzeros in the triangle, "
                f"{plural(reduced.blocks, 'block')}",
            )
        )
    if comparison.calibration is not None:
        found = comparison.calibration
        code = "supernodal" if found.supernodal else "simplicial"
        rows.append(
            (
                "predicted",
                f"flops at {count(found.rate, 'flop/s')} (dense, CHOLMOD {code}) and {_nanoseconds(found.per_nonzero)} "
                f"for each nonzero of L (from {found.reference})",
            )
        )
    rows += [("left out", text) for text in comparison.left_out]
    lines = table(rows, "<<")
    cells = [_HEADER, *(_cells(cost, comparison.auto) for cost in comparison.costs)]
    lines += ["", *table(cells, "<" + ">" * (len(_HEADER) - 1))]
    if any(_marked(cost, comparison.auto) for cost in comparison.costs):
        lines.append("* what --ordering auto takes")
    if comparison.changed is not None:
        lines += ["", *_change_table(comparison)]
    if files:
        lines += ["", *table([(name, path) for name, path in files.items()], "<<")]
    return lines


def sparsity_document(
    source: FactorGraph, topology: Topology, comparison: Comparison, files: dict[str, str], time: dict[str, float]
) -> dict[str, Any]:
    """The document of ``slamcli sparsity --json``."""
    pattern = comparison.pattern
    return {
        **head("sparsity"),
        "input": input_section(source, topology.loop_closure_count, topology.component_count),
        "gauge": gauge_section(comparison.gauge),
        "hessian": {
            "dimension": pattern.dimension,
            "variables": len(pattern.sizes),
            "blocks": len(pattern.rows),
            "blocks_by_kind": kind_counts(comparison),
            "nnz": pattern.nnz,
            "density": density(comparison),
        },
        "reduced": None if comparison.reduced is None else asdict(comparison.reduced),
        "calibration": None if comparison.calibration is None else asdict(comparison.calibration),
        "orderings": [{**asdict(cost), "nnz_hessian": pattern.nnz} for cost in comparison.costs],
        "auto": comparison.auto,
        "left_out": comparison.left_out,
        "changed": None if comparison.changed is None else asdict(comparison.changed),
        "files": files,
        "time": time,
    }


def kind_counts(comparison: Comparison) -> dict[str, int]:
    """Blocks of the triangle of H by kind."""
    return {name: int(np.count_nonzero(comparison.kinds == kind)) for name, kind in _KINDS.items()}


def density(comparison: Comparison) -> float:
    """Share of the full square matrix that is not zero."""
    pattern = comparison.pattern
    return (2 * pattern.nnz - pattern.dimension) / float(pattern.dimension) ** 2


def _nanoseconds(value: float) -> str:
    return f"{1e9 * value:.2g} ns" if value < 1e-7 else f"{1e9 * value:.0f} ns"


def _marked(cost: OrderCost, auto: str) -> bool:
    return cost.name == auto


def _cells(cost: OrderCost, auto: str) -> tuple[str, ...]:
    name = cost.name if cost.name == cost.found else f"{cost.name} ({cost.found})"
    return (
        name + (" *" if _marked(cost, auto) else ""),
        str(cost.nnz_factor),
        f"{cost.fill_in:.2f}",
        count(cost.flops, "flop"),
        str(cost.tree_height),
        str(cost.largest_front),
        seconds(cost.order_time),
        "-" if cost.predicted_time is None else seconds(cost.predicted_time),
        "-" if cost.measured_time is None else seconds(cost.measured_time),
    )


def _change_table(comparison: Comparison) -> list[str]:
    assert comparison.changed is not None
    rows = [("blocks of", "before", "after", "appear"), ("H", *_numbers(comparison.changed))]
    rows += [(f"L, {cost.name}", *_numbers(cost.changed)) for cost in comparison.costs if cost.changed is not None]
    return table(rows, "<>>>")


def _numbers(found: BlockCounts) -> tuple[str, str, str]:
    return str(found.before), str(found.after), "-" if found.appeared is None else str(found.appeared)
