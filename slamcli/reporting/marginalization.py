"""What ``slamcli marginalize`` says: the summary, the warnings and the JSON document."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from slamcli.graph import FactorGraph, Topology
from slamcli.reporting.documents import head, input_section
from slamcli.reporting.text import plural, seconds, table
from slamcli.solver.marginalization import Comparison, Reduction
from slamcli.solver.marginalization.comparison import LARGEST

#: Standard deviations by which kept positions may move without a warning.
_NOTICED = 0.5


def marginalize_summary(
    source: FactorGraph, reduction: Reduction, comparison: Comparison | None, output: str | None, time: dict[str, float]
) -> list[str]:
    """What ``slamcli marginalize`` prints at the end."""
    reduced, blocks = reduction.graph, reduction.blocks
    count = sum(int(mask.sum()) for mask in reduction.removed.values())
    method = "" if reduction.sparsification == "none" else f", {reduction.sparsification}"
    rows = [
        ("graph", f"{_counts(source)} -> {_counts(reduced)}"),
        (
            "removed",
            f"{plural(count, 'variable')} in {plural(reduction.groups, 'group')}; "
            f"the largest has {reduction.largest_group}, the most kept ones joined by one are "
            f"{reduction.largest_blanket}",
        ),
        ("edges", f"{reduction.kept_edges} kept as they are, {reduction.recovered_edges} recovered{method}"),
        (
            "blocks",
            f"{blocks.before} pairs in H; of the kept {blocks.among_kept} before, {blocks.dense} in the marginal "
            f"(fill-in {blocks.fill_in}), {blocks.result} in the result",
        ),
        ("chi2", f"{source.chi2():.6f} -> {reduced.chi2():.6f} at these values"),
        *_comparison_rows(reduction, comparison),
    ]
    if reduction.conditioned:
        ids = ", ".join(str(i) for i in reduction.conditioned[:8]) + (", ..." if len(reduction.conditioned) > 8 else "")
        rows.append(("held", f"{ids}: removed, but not marginalized"))
    written = {"-": "standard output", None: "nothing (-o FILE keeps the reduced graph)"}.get(output, str(output))
    rows += [("written", written), ("time", f"{seconds(time['total'])}, {seconds(time['marginalize'])} of it removing")]
    return table(rows, "<<")


def marginalize_warnings(
    source: FactorGraph, reduction: Reduction, comparison: Comparison | None, saved: int
) -> list[str]:
    """What may not be as expected: for standard error."""
    out = []
    if saved:
        verb, it = ("stays", "id to remove it") if saved == 1 else ("stay", "ids to remove them")
        out.append(f"{plural(saved, 'fixed variable')} would go by this rule and {verb}: name the {it}")
    if comparison is not None and not comparison.at_optimum(source.chi2()):
        out.append(
            f"the values are no optimum: a Gauss-Newton step would lower chi2 by {comparison.predicted_decrease:.3g}; "
            "the marginal is that of the linearization here (slamcli optimize first)"
        )
    elif comparison is not None and comparison.shift_sigmas > _NOTICED:
        out.append(
            f"the optimum is not kept: kept positions move by up to {comparison.shift:.3g} m, "
            f"{comparison.shift_sigmas:.3g} of their standard deviations"
        )
    if reduction.detached:
        out.append(f"{plural(reduction.detached, 'removed variable')} had no connection to a kept one")
    if reduction.undetermined:
        out.append(f"{plural(reduction.undetermined, 'direction')} of removed variables that no edge determines")
    if comparison is None and reduction.approximated:
        out.append(
            f"{plural(reduction.approximated, 'marginal')} approximated, and not compared with the full graph: one of "
            "both is singular"
        )
    return out


def marginalize_document(
    source: FactorGraph, topology: Topology, reduction: Reduction, comparison: Comparison | None, time: dict[str, float]
) -> dict[str, Any]:
    """The document of ``slamcli marginalize --json``."""
    reduced = reduction.graph
    ratios = None
    if comparison is not None and comparison.sigma_ratio is not None:
        ratios = dict(zip(("smallest", "median", "largest"), comparison.sigma_ratio, strict=True))
    return {
        **head("marginalize"),
        "input": input_section(source, topology.loop_closure_count, topology.component_count),
        "removed": sum(int(mask.sum()) for mask in reduction.removed.values()),
        "conditioned": list(reduction.conditioned),
        "poses": reduced.poses,
        "landmarks": reduced.landmarks,
        "kept_edges": reduction.kept_edges,
        "recovered_edges": reduction.recovered_edges,
        "groups": reduction.groups,
        "largest_group": reduction.largest_group,
        "largest_blanket": reduction.largest_blanket,
        "detached": reduction.detached,
        "undetermined": reduction.undetermined,
        "sparsification": reduction.sparsification,
        "approximated": reduction.approximated,
        "blocks": {**asdict(reduction.blocks), "fill_in": reduction.blocks.fill_in},
        "initial_chi2": source.chi2(),
        "reduced_chi2": reduced.chi2(),
        "divergence": None if comparison is None else comparison.divergence,
        "dimension": None if comparison is None else comparison.dimension,
        "shift": None if comparison is None else comparison.shift,
        "shift_sigmas": None if comparison is None else comparison.shift_sigmas,
        "sigma_ratio": ratios,
        "predicted_decrease": None if comparison is None else comparison.predicted_decrease,
        "time": time,
    }


def _counts(graph: FactorGraph) -> str:
    parts = [plural(graph.poses, "pose")] if graph.poses else []
    if graph.landmarks:
        parts.append(plural(graph.landmarks, "landmark"))
    return ", ".join([*parts, plural(graph.edges, "edge")])


def _comparison_rows(reduction: Reduction, comparison: Comparison | None) -> list[tuple[str, str]]:
    how = f"{plural(reduction.approximated, 'marginal')} approximated" if reduction.approximated else "exact"
    if comparison is None:
        return [("marginals", f"{how}; not compared with the full graph")]
    rows = [("marginals", how)]
    if comparison.divergence is None or comparison.sigma_ratio is None:
        rows.append(("KLD", f"not computed: {comparison.dimension} dimensions are more than {LARGEST}"))
    else:
        each = comparison.divergence / max(comparison.dimension, 1)
        low, middle, high = comparison.sigma_ratio
        rows += [
            (
                "KLD",
                f"{comparison.divergence:.6g} nats from the full graph's marginal, {each:.3g} for each of "
                f"{comparison.dimension} dimensions",
            ),
            (
                "sigmas",
                f"of the kept positions, to those of the full graph: {low:.4g} to {high:.4g}, median {middle:.4g}",
            ),
        ]
    shift = (
        f"{comparison.shift:.3g} m at most of the kept positions by a Gauss-Newton step, "
        f"{comparison.shift_sigmas:.3g} standard deviations"
    )
    return [*rows, ("shift", shift)]
