"""Marginalizes variables out of a graph: groups, Schur complements, recovered factors, the reduced graph."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from slamcli.errors import InputError, NumericalError, UsageError
from slamcli.formats.reduction import without
from slamcli.graph import FactorGraph, Factors
from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.graph.topology import component_labels, connected_components, node_pairs, prior_dimensions
from slamcli.models import SE2, SE3, XY, XYZ
from slamcli.models.base import Array
from slamcli.solver import diagnosis, gauge
from slamcli.solver.marginalization.fill_in import Blocks, block_counts
from slamcli.solver.marginalization.nodes import Nodes
from slamcli.solver.marginalization.quadratics import Piece, Quadratics, of_factors
from slamcli.solver.marginalization.recovery import Recovered, recover
from slamcli.solver.marginalization.write_factors import factors_of

SPARSIFICATIONS = ("none", "chow-liu", "subgraph")
#: Groups of at most so many variables are eliminated in one dense step; larger ones one variable at a time.
_AT_ONCE = 150
#: Largest blanket that is written as one marginal: with all its pairs, and as a sparse approximation.
LARGEST_DENSE, LARGEST_SPARSE = 80, 32
#: Largest blanket of a single variable: time grows with its cube (half a minute for 800), memory with its square.
LARGEST_ALONE = 1000


@dataclass(frozen=True, eq=False)
class Reduction:
    """A graph without the variables that were marginalized out.

    Attributes
    ----------
    graph
        The reduced graph; kept factors come from the source with their lines.
    removed
        One mask for each kind of variable of the source.
    conditioned
        Ids of removed variables that were held, not marginalized: FIX lines, and the frame of landmarks alone.
    groups, largest_group, largest_blanket
        Groups of removed variables that factors join, the most variables of one, the most variables that the
        removal of one joins.
    detached
        Removed variables that nothing kept is joined to.
    blocks
        Blocks of H beside its diagonal.
    kept_edges, recovered_edges
        Factors of the result: from the source, and made here.
    approximated
        Marginals that their factors say only nearly, and ...
    divergence
        ... the sum of their Kullback-Leibler divergences in nats.
    undetermined
        Eliminated directions that no factor determines.
    weak
        Directions of blankets, beside those of the gauge, of which the marginals say nothing.
    sparsification
        As asked for.
    """

    graph: FactorGraph
    removed: dict[str, BoolArray]
    conditioned: tuple[int, ...]
    groups: int
    largest_group: int
    largest_blanket: int
    detached: int
    blocks: Blocks
    kept_edges: int
    recovered_edges: int
    approximated: int
    divergence: float
    undetermined: int
    weak: int
    sparsification: str


def marginalize(
    graph: FactorGraph,
    removed: dict[str, BoolArray],
    *,
    sparsification: str = "none",
    largest_blanket: int | None = None,
    on_removed: Callable[[], None] = lambda: None,
) -> Reduction:
    """Marginalize variables out of a graph at its values.

    Parameters
    ----------
    graph
        All variables of which have an estimate.
    removed
        What goes, one mask for each kind of variable.
    sparsification
        ``none``, ``chow-liu`` or ``subgraph``.
    largest_blanket
        With ``none``, groups that join more variables than this are refused. Otherwise, they are taken apart, one
        variable after the other, each of whose marginals is made sparse at once. None for the defaults.
    on_removed
        Called for each variable that has gone.

    Raises
    ------
    UsageError
        If an option does not exist, or a group joins too many variables.
    InputError
        If a variable has no estimate, or a marginal cannot be said by factors of a graph file.
    NumericalError
        If an information matrix is indefinite, or chi2 or its derivatives are not finite.
    """
    if sparsification not in SPARSIFICATIONS:
        names = ", ".join(SPARSIFICATIONS)
        raise UsageError(f"sparsification {sparsification!r} does not exist", (f"  one of: {names}",))
    if largest_blanket is None:
        largest_blanket = LARGEST_DENSE if sparsification == "none" else LARGEST_SPARSE
    _require_linearizable(graph)
    return _Marginalization(graph, removed, sparsification, largest_blanket, on_removed).result()


def _require_linearizable(graph: FactorGraph) -> None:
    others = [name for name, column in graph.variables.items() if column.kind not in (SE2, SE3, XY, XYZ)]
    if others:
        raise InputError(
            f"the graph has variables of kind {', '.join(others)}: only poses and points can be marginalized",
            ("  switches and cameras have no kinds of factor that a marginal could be written with",),
        )
    without_estimate = sum(int(np.count_nonzero(~column.known)) for column in graph.variables.values())
    if without_estimate:
        raise InputError(
            f"{without_estimate} variables have no estimate: there is nothing to linearize at",
            ("  slamcli optimize --init odometry -o FILE makes one",),
        )
    defect = diagnosis.indefinite_information(graph)
    if defect is not None:
        raise NumericalError(*defect)
    if not np.isfinite(graph.chi2()):
        raise NumericalError("chi2 is not finite at these values: nothing is marginalized")


class _Marginalization:
    """State of one run; ``result`` is its course."""

    def __init__(
        self,
        graph: FactorGraph,
        removed: dict[str, BoolArray],
        sparsification: str,
        largest: int,
        on_removed: Callable[[], None],
    ) -> None:
        self.graph, self.removed, self.sparsification, self.largest = graph, removed, sparsification, largest
        self.on_removed = on_removed
        self.nodes = Nodes(graph)
        self.gone: BoolArray = np.concatenate([removed[name] for name in graph.variables])
        self.pairs = node_pairs(graph)
        self.conditioned = self._conditioned()
        self.quadratics = Quadratics(self.nodes)
        self.recovered: list[Recovered] = []

    def result(self) -> Reduction:
        for piece in of_factors(self.nodes, self.graph.values, self.gone, self.conditioned, False):
            self.quadratics.add(piece)
        groups = self._groups()
        blankets = [self.quadratics.blanket(group) for group in groups]
        if self.sparsification == "none":
            self._refuse_large(groups, blankets)
        for group, blanket in zip(groups, blankets, strict=True):
            self._remove(group, len(blanket))
        reduced, kept = self._reduced_graph()
        ids = np.concatenate([column.ids for column in self.graph.variables.values()])
        after = block_counts(self.pairs, self.gone, blankets, node_pairs(reduced), len(self.nodes))
        return Reduction(
            graph=reduced,
            removed=self.removed,
            conditioned=tuple(ids[self.conditioned].tolist()),
            groups=len(groups),
            largest_group=max(map(len, groups), default=0),
            largest_blanket=max(map(len, blankets), default=0),
            detached=sum(len(group) for group, blanket in zip(groups, blankets, strict=True) if not blanket),
            blocks=after,
            kept_edges=kept,
            recovered_edges=reduced.edges - kept,
            approximated=sum(part.divergence > 0.0 for part in self.recovered),
            divergence=float(sum(part.divergence for part in self.recovered)),
            undetermined=self.quadratics.undetermined,
            weak=sum(part.weak for part in self.recovered),
            sparsification=self.sparsification,
        )

    def _conditioned(self) -> BoolArray:
        """Removed variables that are held: by FIX lines, or as the frame of landmarks that have no other."""
        fixed = np.concatenate([column.fixed for column in self.graph.variables.values()])
        label = component_labels(self.graph)
        count = int(label.max(initial=-1)) + 1
        known = prior_dimensions(self.graph, label) > 0
        known[label[fixed]] = True
        known[label[~self.gone & self.nodes.is_pose]] = True
        has_kept = np.bincount(label[~self.gone], minlength=count) > 0
        held = np.concatenate(list(gauge.choose(self.graph)[1].values()))
        return self.gone & (fixed | (held & self.nodes.is_pose & has_kept[label] & ~known[label]))

    def _groups(self) -> list[list[int]]:
        """Removed variables in groups that factors join."""
        free = self.gone & ~self.conditioned
        number = np.cumsum(free) - 1
        inner = self.pairs[free[self.pairs].all(axis=1)]
        members = np.flatnonzero(free)
        label = connected_components(len(members), number[inner])
        order = np.argsort(label, kind="stable")
        bounds = np.flatnonzero(np.diff(label[order])) + 1
        return [part.tolist() for part in np.split(members[order], bounds)] if len(members) else []

    def _refuse_large(self, groups: list[list[int]], blankets: list[list[int]]) -> None:
        worst = max(range(len(groups)), key=lambda k: len(blankets[k]), default=0)
        if groups and len(blankets[worst]) > self.largest:
            size = len(blankets[worst])
            raise UsageError(
                f"removing {len(groups[worst])} variables that edges join makes {size} kept ones depend on each other, "
                f"in {size * (size - 1) // 2} pairs",
                (
                    "  --sparsify chow-liu or subgraph approximates that, and says how well",
                    "  keep the ends of loop closures, which join the parts between kept poses",
                    f"  --largest-blanket {size} does it nevertheless (the limit is {self.largest})",
                ),
            )

    def _remove(self, group: list[int], blanket: int) -> None:
        """Eliminate a group, and put factors for what it says about its blanket in its place."""
        if not blanket:  # it says nothing of what is kept, and need not be determined
            determined = self.quadratics.undetermined
            self.quadratics.eliminate(group)
            self.quadratics.undetermined = determined
            return
        apart = self.sparsification != "none" and blanket > self.largest
        if not apart and len(group) <= _AT_ONCE:
            self._recover(self.quadratics.eliminate(group))
            for _ in group:
                self.on_removed()
            return
        queue = [(len(self.quadratics.blanket([node])), node) for node in group]
        heapq.heapify(queue)
        left = len(group)
        while queue:  # the smallest blanket first: minimum degree
            degree, node = heapq.heappop(queue)
            now = len(self.quadratics.blanket([node]))
            if now > degree:
                heapq.heappush(queue, (now, node))
                continue
            self._refuse_hub(node, now)
            marginal = self.quadratics.eliminate([node])
            left -= 1
            if apart or left == 0:
                self._recover(marginal)
            elif marginal.nodes:
                self.quadratics.add(marginal)
            self.on_removed()

    def _refuse_hub(self, node: int, blanket: int) -> None:
        """Refuse a variable that even alone joins too many others."""
        if blanket > max(LARGEST_ALONE, self.largest):
            raise UsageError(
                f"removing {self.nodes.name(node)} makes {blanket} variables depend on each other: "
                f"more than the {LARGEST_ALONE} of one marginal",
                ("  keep it, or less of the others", f"  --largest-blanket {blanket} tries it nevertheless"),
            )

    def _recover(self, marginal: Piece) -> None:
        found = recover(self.nodes, marginal, self.sparsification, self._around)
        self.recovered.append(found)
        for piece in found.pieces:
            self.quadratics.add(piece)

    def _around(self, members: Collection[int]) -> Array:
        """Information of the kept factors among some variables."""
        return self._kept.within(members)

    @cached_property
    def _kept(self) -> Quadratics:
        out = Quadratics(self.nodes)
        for piece in of_factors(self.nodes, self.graph.values, self.gone, self.conditioned, True):
            out.add(piece)
        return out

    def _reduced_graph(self) -> tuple[FactorGraph, int]:
        """The source without what goes and with the recovered factors, and how many of its edges it keeps."""
        dialect = self.graph.report.format if self.graph.report is not None else "g2o"
        made = factors_of(self.nodes, self.quadratics.pieces(), dialect)
        needs_offset = any(factors.kind.parameter is not None for factors in made)
        identity = np.array(SE3.identity) if needs_offset else None
        reduced, parameter = without(self.graph, self.removed, identity)
        place = {name: np.cumsum(~mask) - 1 for name, mask in self.removed.items()}
        columns = [_renumbered(factors, place, parameter) for factors in made]
        return replace(reduced, factors=[*reduced.factors, *columns]), reduced.edges


def _renumbered(factors: Factors, place: dict[str, IndexArray], parameter: int) -> Factors:
    """Factors with the rows of the reduced graph."""
    kinds = factors.kind.variables
    indices = np.stack([place[kind.name][factors.indices[:, s]] for s, kind in enumerate(kinds)], axis=1)
    ids = None if factors.kind.parameter is None else np.full(len(factors), parameter, dtype=np.int64)
    return replace(factors, indices=indices, parameter_ids=ids)
