"""Spoils a graph on purpose and keeps the account: which operations, how many edges, which edges are outliers.

The operations, in the order in which they are applied: false closures, false observations, corrupted odometry,
dropped closures, scaled information, perturbed guess. Each draws from a stream of random numbers of its own and
chooses among the edges of the graph as it came, so that adding an operation does not change what the others do.
Only the scaling sees what came before: it covers the false edges as well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from slamcli.errors import UsageError
from slamcli.graph import FactorGraph, Factors
from slamcli.graph.columns import BoolArray
from slamcli.graph.topology import is_loop_closure
from slamcli.models.base import Array
from slamcli.simulation import corruption
from slamcli.simulation.corruption import Masks
from slamcli.simulation.odometry_chain import is_observation, is_odometry, odometry_chain
from slamcli.simulation.outliers import GROUPED, POLICIES, false_closures
from slamcli.simulation.reference import Reference, from_graph

#: One stream of random numbers for each, in this order; new ones go to the end.
STREAMS = ("false_closures", "false_observations", "corrupt_odometry", "drop_closures", "perturb")
SCALES = ("all", "odometry", "closures")
LONGEST = 1000  # run of false closures


@dataclass(frozen=True)
class Amount:
    """So many, or so many percent of what there is."""

    value: float
    percent: bool = False

    def of(self, total: int, what: str) -> int:
        """The number that is meant; percentages are rounded to the nearest, halves up.

        Raises
        ------
        UsageError
            For a share of nothing.
        """
        if not self.percent:
            return int(self.value)
        if total == 0 and self.value > 0.0:
            raise UsageError(f"the graph has no {what} to take {self} of", ("  give a number instead",))
        return int(np.floor(self.value / 100.0 * total + 0.5))

    def __str__(self) -> str:
        return f"{self.value:g}%" if self.percent else f"{self.value:g}"


@dataclass(frozen=True)
class InjectOptions:
    """What to do to a graph; None leaves an operation out.

    Attributes
    ----------
    false_closures
        How many; percentages are of the graph's loop closures.
    policy, group_size, information
        See ``outliers.false_closures``; ``information`` is its diagonal (one number: all of it).
    false_observations
        How many; percentages are of the graph's observations of landmarks.
    corrupt_odometry, magnitude
        How many, percentages are of its odometry edges; how much (see ``corruption.corrupt_odometry``).
    drop_closures
        How many; percentages are of the loop closures.
    scale_information, scale
        A positive factor, and for which edges.
    perturb
        Standard deviations in metres and radians.
    seed
        Of all random numbers.
    """

    false_closures: Amount | None = None
    policy: str = "random"
    group_size: tuple[int, int] = (10, 20)
    information: tuple[float, ...] | None = None
    false_observations: Amount | None = None
    corrupt_odometry: Amount | None = None
    magnitude: float = 1.0
    drop_closures: Amount | None = None
    scale_information: float | None = None
    scale: str = "all"
    perturb: tuple[float, float] | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if self.policy not in POLICIES:
            raise UsageError(f"unknown policy {self.policy!r}", (f"  one of: {', '.join(POLICIES)}",))
        if self.scale not in SCALES:
            raise UsageError(f"unknown edges to scale: {self.scale!r}", (f"  one of: {', '.join(SCALES)}",))
        if not 1 <= self.group_size[0] <= self.group_size[1] <= LONGEST:
            raise UsageError(f"group_size must be whole numbers 1 <= LOW <= HIGH <= {LONGEST}, got {self.group_size}")
        if self.scale_information is not None and not 0.0 < self.scale_information < np.inf:
            raise UsageError(f"scale_information must be a positive finite number, got {self.scale_information:g}")
        if not 0.0 < self.magnitude < np.inf:
            raise UsageError(f"magnitude must be a positive finite number, got {self.magnitude:g}")
        if self.perturb is not None and not all(0.0 <= sigma < np.inf for sigma in self.perturb):
            raise UsageError("perturb must be finite numbers that are not negative")
        if self.information is not None and not all(0.0 < value < np.inf for value in self.information):
            raise UsageError("information must be positive finite numbers")


@dataclass(frozen=True)
class Operation:
    """What one operation did.

    Attributes
    ----------
    name
        As the option.
    count
        Edges (variables, for ``perturb``) that it made, changed or removed.
    of
        How many there were to choose from; for ``false_closures``, the true ones.
    details
        Settings and results of this operation.
    """

    name: str
    count: int
    of: int
    details: dict[str, object] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Injected:
    """A spoiled graph.

    Attributes
    ----------
    graph
        The graph.
    outliers
        Which of its edges are outliers, one mask for each column of factors.
    operations
        What was done, in order.
    reference
        What decided whether false edges are false; None where nothing needed one.
    """

    graph: FactorGraph
    outliers: Masks
    operations: list[Operation]
    reference: Reference | None

    @property
    def outlier_count(self) -> int:
        """Number of edges that are outliers."""
        return sum(int(np.count_nonzero(mask)) for mask in self.outliers)


def inject(
    graph: FactorGraph, options: InjectOptions, reference: Callable[[FactorGraph], Reference] = from_graph
) -> Injected:
    """Spoil a graph.

    Parameters
    ----------
    graph
        The graph; it is not changed.
    options
        What to do.
    reference
        Makes the reference that false edges must contradict; it is called only where one is needed.

    Raises
    ------
    UsageError
        If an operation asks for more than the graph can give.
    """
    return _Injection(graph, options, reference).run()


class _Injection:
    """The account of one run; every method named after an operation does it."""

    def __init__(
        self, graph: FactorGraph, options: InjectOptions, reference: Callable[[FactorGraph], Reference]
    ) -> None:
        self.source = graph
        self.options = options
        self.factors = list(graph.factors)
        self.variables = graph.variables
        self.outliers: Masks = [np.zeros(len(factors), dtype=bool) for factors in graph.factors]
        self.operations: list[Operation] = []
        self.closures: Masks = [is_loop_closure(graph, factors) for factors in graph.factors]
        self.odometry: Masks = [is_odometry(graph, factors) for factors in graph.factors]
        children = np.random.SeedSequence(options.seed).spawn(len(STREAMS))
        self.stream = {
            name: np.random.Generator(np.random.PCG64(child)) for name, child in zip(STREAMS, children, strict=True)
        }
        wants_reference = options.false_closures is not None or options.false_observations is not None
        self.reference = reference(graph) if wants_reference else None

    def run(self) -> Injected:
        added = self._false_closures()
        self._false_observations()
        self._corrupt_odometry()
        dropped = self._drop_closures()
        for k, mask in enumerate(dropped):
            self.factors[k] = corruption.drop(self.factors[k], mask)
            self.outliers[k] = self.outliers[k][~mask]
        if added is not None:
            self._append(added)
        self._scale_information()
        self._perturb()
        kept = [k for k, factors in enumerate(self.factors) if len(factors)]
        result = replace(self.source, variables=self.variables, factors=[self.factors[k] for k in kept])
        return Injected(result, [self.outliers[k] for k in kept], self.operations, self.reference)

    def _false_closures(self) -> Factors | None:
        options = self.options
        if options.false_closures is None:
            return None
        assert self.reference is not None
        total = _total(self.closures)
        count = options.false_closures.of(total, "loop closures")
        drawn = false_closures(
            self.source,
            count,
            options.policy,
            self.stream["false_closures"],
            self.reference,
            group_size=options.group_size,
            information=_diagonal(options.information, odometry_chain(self.source).factor_kind.dimension),
        )
        details: dict[str, object] = {"policy": options.policy, "runs": int(drawn.run.max(initial=-1)) + 1}
        if options.policy in GROUPED:
            details["group_size"] = list(options.group_size)
        self.operations.append(Operation("false_closures", count, total, details))
        return drawn.factors if count else None

    def _false_observations(self) -> None:
        if self.options.false_observations is None:
            return
        assert self.reference is not None
        total = _total([is_observation(factors) for factors in self.source.factors])
        count = self.options.false_observations.of(total, "observations of landmarks")
        changed = corruption.false_observations(self.source, count, self.stream["false_observations"], self.reference)
        for k, factors in enumerate(changed):
            if factors is not self.source.factors[k]:
                self.outliers[k] = (factors.indices != self.source.factors[k].indices).any(axis=1)
                self.factors[k] = factors
        self.operations.append(Operation("false_observations", count, total))

    def _corrupt_odometry(self) -> None:
        amount, rng = self.options.corrupt_odometry, self.stream["corrupt_odometry"]
        if amount is None:
            return
        total = _total(self.odometry)
        what = "odometry edges"
        masks = corruption.pick(self.odometry, amount.of(total, what), rng, what)
        for k, mask in enumerate(masks):
            if mask.any():
                rows = np.flatnonzero(mask)
                self.factors[k] = corruption.corrupt_odometry(self.factors[k], rows, self.options.magnitude, rng)
                self.outliers[k] = self.outliers[k] | mask
        details: dict[str, object] = {"magnitude": self.options.magnitude}
        self.operations.append(Operation("corrupt_odometry", _total(masks), total, details))

    def _drop_closures(self) -> Masks:
        amount = self.options.drop_closures
        if amount is None:
            return [np.zeros(len(factors), dtype=bool) for factors in self.factors]
        total = _total(self.closures)
        what = "loop closures"
        masks = corruption.pick(self.closures, amount.of(total, what), self.stream["drop_closures"], what)
        self.operations.append(Operation("drop_closures", _total(masks), total))
        return masks

    def _append(self, added: Factors) -> None:
        """Put new factors behind the column of their tag."""
        for k, factors in enumerate(self.factors):
            if factors.kind is added.kind and factors.tag == added.tag:
                self.factors[k] = _joined(factors, added)
                self.outliers[k] = np.concatenate([self.outliers[k], np.ones(len(added), dtype=bool)])
                return
        self.factors.append(added)
        self.outliers.append(np.ones(len(added), dtype=bool))

    def _scale_information(self) -> None:
        factor = self.options.scale_information
        if factor is None:
            return
        chosen = {"all": _every, "odometry": is_odometry, "closures": is_loop_closure}[self.options.scale]
        masks = [chosen(self.source, factors) for factors in self.factors]
        self.factors = [
            corruption.scale_information(factors, mask, factor)
            for factors, mask in zip(self.factors, masks, strict=True)
        ]
        details: dict[str, object] = {"factor": factor, "edges": self.options.scale}
        self.operations.append(Operation("scale_information", _total(masks), _total(masks), details))

    def _perturb(self) -> None:
        sigma = self.options.perturb
        if sigma is None:
            return
        self.variables = corruption.perturb(self.source, *sigma, self.stream["perturb"])
        moved = sum(
            int(np.count_nonzero((column.values != self.source.variables[name].values).any(axis=1)))
            for name, column in self.variables.items()
        )
        details: dict[str, object] = {"translation_sigma": sigma[0], "rotation_sigma": sigma[1]}
        self.operations.append(Operation("perturb", moved, self.source.poses + self.source.landmarks, details))


def _joined(factors: Factors, added: Factors) -> Factors:
    """A column of relative poses with another one behind it."""
    lines = factors.lines if len(factors.lines) else np.zeros(len(factors), dtype=np.intp)
    return replace(
        factors,
        indices=np.concatenate([factors.indices, added.indices]),
        measurements=np.concatenate([factors.measurements, added.measurements]),
        information=np.concatenate([factors.information, added.information]),
        lines=np.concatenate([lines, added.lines]),
    )


def _every(graph: FactorGraph, factors: Factors) -> BoolArray:
    return np.ones(len(factors), dtype=bool)


def _total(masks: Masks) -> int:
    return sum(int(np.count_nonzero(mask)) for mask in masks)


def _diagonal(values: Sequence[float] | None, dimension: int) -> Array | None:
    """A diagonal information matrix.

    Raises
    ------
    UsageError
        If there are neither one nor ``dimension`` numbers.
    """
    if values is None:
        return None
    if len(values) not in (1, dimension):
        raise UsageError(f"information needs 1 or {dimension} numbers for this graph, got {len(values)}")
    return np.diag(np.broadcast_to(np.asarray(values, dtype=np.float64), dimension))
