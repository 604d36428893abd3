"""The order to take where none is asked for: minimum degree, or nested dissection where that is worth the look."""

from __future__ import annotations

from slamcli.solver.ordering import nested_dissection
from slamcli.solver.ordering.found import FoundOrder, named
from slamcli.solver.pattern import BlockPattern

#: METIS is tried where the factorization under AMD takes more flops than this for each node and each end of an edge,
#: which is what METIS' time is proportional to.
_WORTH_A_LOOK = 40_000.0


def choose(pattern: BlockPattern, made: dict[str, FoundOrder] | None = None) -> FoundOrder:
    """Minimum degree, or nested dissection where its factorization takes fewer flops.

    Nested dissection wins on large graphs and loses a little on small ones, and it takes ten times as long to find.

    Parameters
    ----------
    pattern
        The pattern.
    made
        Orders that have been found already, by name.
    """
    made = made or {}
    first = made.get("amd") or named("amd", pattern)
    count = len(pattern.sizes)
    work = count + 2 * (len(pattern.rows) - count)
    if not nested_dissection.is_installed() or first.analysis(pattern).flops < _WORTH_A_LOOK * work:
        return first
    second = made.get("metis") or named("metis", pattern)
    return min(first, second, key=lambda found: found.analysis(pattern).flops)
