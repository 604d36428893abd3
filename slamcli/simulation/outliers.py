"""False loop closures, by the policies of Vertigo and by perceptual aliasing.

A policy proposes runs of pairs of poses (i + k, j + k), k = 0, 1, ...; a run of one pair is a single closure:

=================  =================================================================================================
``random``         any two poses
``local``          two poses at most 20 steps apart
``grouped``        a run of local pairs (Vertigo's local groups)
``random-grouped`` a run that begins with any two poses
``aliased``        a run between two stretches of path of the same shape, as if they were one place
=================  =================================================================================================

The first four claim that the poses of a pair coincide but for N(0, 0.3 m) along each axis and N(0, 10 deg) about each;
one draw serves the whole run (N. Suenderhauf and P. Protzel, "Switchable constraints for robust pose graph SLAM", IROS
2012, and their data set generator). An aliased run claims that one rigid transform S takes the second stretch onto
the first,

    z_k = A_k^-1 S B_k   and noise of the closures' own information,

with A_k and B_k the stretches' poses by dead reckoning: its closures agree with each other and with the odometry. S
makes the poses in the middle coincide but for N(0, 0.3 m) along each axis.

A run is taken only if each of its pairs is new to the graph and each claim contradicts the reference.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from slamcli.errors import InputError, UsageError
from slamcli.formats.dialect import decode_upper_triangle
from slamcli.formats.recognize import DIALECTS
from slamcli.geometry import so3
from slamcli.graph import FactorGraph, Factors
from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.graph.topology import is_loop_closure
from slamcli.models import SE2
from slamcli.models.base import Array
from slamcli.simulation.aliasing import alike_places
from slamcli.simulation.odometry_chain import OdometryChain, odometry_chain
from slamcli.simulation.portable import portable
from slamcli.simulation.reference import Reference

POLICIES = ("random", "local", "grouped", "random-grouped", "aliased")
GROUPED = ("grouped", "random-grouped", "aliased")

LOCAL_REACH = 20
TRANSLATION_SIGMA = 0.3
ROTATION_SIGMA = np.deg2rad(10.0)

#: A claim agrees with the reference up to this chi2: the 1 - 1e-6 quantile for 3 and for 6 degrees of freedom.
AGREEMENT = {3: 30.66, 6: 38.26}

_SHAPE_STEPS = 9  # stretches that are compared are at least this long
_ENUMERATED = 2**18  # so many pairs are shuffled as a whole; of more, random ones are drawn
_BATCH = 1024
_PATIENCE = 300_000  # pairs in a row that bring nothing; more than are enumerated

Runs = tuple[IndexArray, IndexArray]  # first pairs (c, 2), smaller number first, and lengths (c,)


@dataclass(frozen=True, eq=False)
class FalseClosures:
    """False closures, ready to be added to their graph.

    Attributes
    ----------
    factors
        (k,) of the kind and tag of the graph's closures; they have no line.
    run
        (k,) number of the run that each belongs to.
    """

    factors: Factors
    run: IndexArray


def false_closures(
    graph: FactorGraph,
    count: int,
    policy: str,
    rng: np.random.Generator,
    reference: Reference,
    *,
    group_size: tuple[int, int] = (10, 20),
    information: Array | None = None,
) -> FalseClosures:
    """Draw false loop closures for a graph.

    Parameters
    ----------
    graph
        The graph; it is not changed.
    count
        How many closures (not runs); the last run is cut to fit.
    policy
        One of ``POLICIES``.
    rng
        All randomness.
    reference
        What claims must contradict.
    group_size
        Smallest and largest length of a run, for the grouped policies.
    information
        (d, d) of the false closures; None: each takes that of a closure of the graph, drawn at random (of an
        odometry edge where there are no closures), so that nothing tells them apart.

    Raises
    ------
    UsageError
        If there are not as many as that.
    InputError
        If the graph has no edge whose information could be taken.
    """
    chain = odometry_chain(graph)
    pool = _Pool(graph, chain, information)
    sizes = group_size if policy in GROUPED else (1, 1)
    taken = _existing(graph, chain)
    ends: list[IndexArray] = []
    claims: list[Array] = []
    weights: list[Array] = []
    runs: list[IndexArray] = []
    found = barren = 0
    for first, lengths in _proposals(policy, chain, sizes, rng) if count else ():
        pairs, valid = _members(first, lengths, len(chain))
        drawn = pool.draw(pairs.shape[:2], rng)
        claimed = _claims(policy, chain, first, lengths, pairs.shape[1], rng)
        if policy == "aliased":
            rough = pool.information(drawn, claimed)
            claimed = _moved(chain, claimed, _noise(rough, rng.standard_normal(rough.shape[:-1])))
        omega = pool.information(drawn, claimed)
        fits = _contradicts(chain, reference, pairs, claimed, omega) & ~np.isin(_keys(pairs, chain), taken)
        good = (fits | ~valid).all(axis=1) & (first[:, 1] + lengths <= len(chain))
        good[good] = _disjoint(_keys(pairs[good], chain), valid[good])
        use = valid[good]
        barren = 0 if use.any() else barren + int(valid.sum())
        if use.any():
            ends.append(pairs[good][use])
            claims.append(claimed[good][use])
            weights.append(omega[good][use])
            runs.append(len(runs) * _ENUMERATED + np.repeat(np.arange(len(use)), use.sum(axis=1)))
            taken = np.concatenate([taken, _keys(ends[-1], chain)])
            found += len(ends[-1])
        if found >= count or barren >= _PATIENCE:
            break
    if found < count:
        raise UsageError(
            f"only {found} of {count} false closures of the policy {policy} could be placed in this graph",
            ("  each joins another pair of poses, contradicts the reference and lies on no edge of the graph",)
            + ("  few stretches of this path look alike: shorter runs (--group-size) find more",)
            * (policy == "aliased"),
        )
    joined = np.concatenate([np.empty((0, 2), dtype=np.intp), *ends])[:count]
    measured = np.concatenate([np.empty((0, chain.kind.size)), *claims])[:count]
    if _backward(graph):
        joined, measured = joined[:, ::-1], np.asarray(chain.kind.inverse(portable(measured)))
    factors = Factors(
        kind=chain.factor_kind,
        indices=chain.rows[joined],
        measurements=measured,
        information=np.concatenate([np.empty((0, *pool.shape)), *weights])[:count],
        tag=pool.tag,
        lines=np.zeros(count, dtype=np.intp),
    )
    numbers = np.concatenate([np.empty(0, dtype=np.intp), *runs])[:count]
    return FalseClosures(factors, np.unique(numbers, return_inverse=True)[1])


# -- where ---------------------------------------------------------------------------------------------------------


def _proposals(policy: str, chain: OdometryChain, sizes: tuple[int, int], rng: np.random.Generator) -> Iterator[Runs]:
    """Batches of runs, each with its length."""
    if policy == "aliased":
        least = max(sizes[0] - 1, _SHAPE_STEPS)
        for first, steps in alike_places(chain, least, max(sizes[1] - 1, least), rng):
            lengths = rng.integers(sizes[0], sizes[1] + 1, len(first))
            if len(first):
                yield first, np.minimum(lengths, steps + 1)
        return
    reach = LOCAL_REACH if policy in ("local", "grouped") else len(chain)
    if sizes[0] >= len(chain):
        return
    for first in _pairs(len(chain), reach, max(16, _BATCH // sizes[1]), rng):
        lengths = rng.integers(sizes[0], sizes[1] + 1, len(first))
        inside = first[:, 1] + lengths <= len(chain)
        if inside.any():
            yield first[inside], lengths[inside]


def _pairs(poses: int, reach: int, batch: int, rng: np.random.Generator) -> Iterator[IndexArray]:
    """Pairs of poses from 2 to ``reach`` steps apart, in random order; without end where there are very many."""
    reach = min(reach, poses - 1)
    if reach < 2:
        return
    if poses * reach <= _ENUMERATED:
        apart = np.repeat(np.arange(2, reach + 1), poses)
        first = np.tile(np.arange(poses), reach - 1)
        pairs = np.stack([first, first + apart], axis=1)
        pairs = rng.permutation(pairs[pairs[:, 1] < poses])
        for begin in range(0, len(pairs), batch):
            yield pairs[begin : begin + batch]
        return
    while True:
        first = rng.integers(0, poses, batch)
        second = rng.integers(0, poses, batch) if reach == poses - 1 else first + rng.integers(2, reach + 1, batch)
        pairs = np.sort(np.stack([first, second], axis=1), axis=1)
        yield pairs[(pairs[:, 1] < poses) & (pairs[:, 1] - pairs[:, 0] >= 2)]


def _members(first: IndexArray, lengths: IndexArray, poses: int) -> tuple[IndexArray, BoolArray]:
    """All pairs of the runs (c, longest, 2), and which of them belong to the run."""
    along = np.arange(int(lengths.max(initial=1)))
    pairs = np.minimum(first[:, None, :] + along[None, :, None], poses - 1)
    return pairs, along[None, :] < lengths[:, None]


def _keys(pairs: IndexArray, chain: OdometryChain) -> IndexArray:
    """One number for each pair."""
    return pairs.min(axis=-1) * len(chain) + pairs.max(axis=-1)


def _existing(graph: FactorGraph, chain: OdometryChain) -> IndexArray:
    """Keys of the pairs that edges join already."""
    joined = [
        chain.number[factors.indices[:, :2]]
        for factors in graph.factors
        if factors.kind.relative_pose and factors.kind.variables[0] is chain.kind
    ]
    return _keys(np.concatenate([np.empty((0, 2), dtype=np.intp), *joined]), chain)


def _disjoint(keys: IndexArray, valid: BoolArray) -> BoolArray:
    """Runs that share no pair with an earlier one."""
    flat = np.where(valid, keys, -1 - np.arange(keys.size).reshape(keys.shape)).ravel()
    first = np.zeros(len(flat), dtype=bool)
    first[np.unique(flat, return_index=True)[1]] = True
    return np.asarray(first.reshape(keys.shape).all(axis=1))


# -- what ----------------------------------------------------------------------------------------------------------


def _claims(
    policy: str,
    chain: OdometryChain,
    first: IndexArray,
    lengths: IndexArray,
    longest: int,
    rng: np.random.Generator,
) -> Array:
    """Claimed relative poses (c, longest, size)."""
    kind = chain.kind
    coincide = _near_identity(chain, len(first), rng)
    if policy != "aliased":
        return np.repeat(coincide[:, None], longest, axis=1)
    coincide[:, kind.space :] = kind.identity[kind.space :]  # stretches that cross at an angle would not look alike
    a, b = (portable(chain.path(first[:, slot], longest - 1)) for slot in (0, 1))
    rows, middle = np.arange(len(first)), lengths // 2
    one_place = kind.compose(kind.compose(a[rows, middle], portable(coincide)), kind.inverse(b[rows, middle]))
    return np.asarray(kind.normalize(kind.compose(kind.compose(kind.inverse(a), one_place[:, None]), b)))


def _moved(chain: OdometryChain, claimed: Array, noise: Array) -> Array:
    """Claims with noise in the residual's own coordinates."""
    return np.asarray(chain.kind.normalize(chain.kind.retract(portable(claimed), portable(noise))))


def _near_identity(chain: OdometryChain, count: int, rng: np.random.Generator) -> Array:
    """Vertigo's claims that two poses coincide: normal in each coordinate and angle."""
    translation = rng.normal(0.0, TRANSLATION_SIGMA, (count, chain.kind.space))
    if chain.kind is SE2:
        angle = rng.normal(0.0, ROTATION_SIGMA, (count, 1))
        return chain.kind.normalize(np.concatenate([translation, angle], axis=1))
    angles = rng.normal(0.0, ROTATION_SIGMA, (count, 3))
    return np.concatenate([translation, np.asarray(so3.from_euler(portable(angles)))], axis=1)


def _noise(omega: Array, normal: Array) -> Array:
    """Draws of covariance Omega^-1 from standard normal ones: C^T x = n with Omega = C C^T.

    Written out, since the factors of a numerical library differ from machine to machine. Where the information is
    zero there is no noise.
    """
    dimension = omega.shape[-1]
    root = np.zeros_like(omega)
    out = np.zeros_like(normal)
    informed = np.zeros(normal.shape, dtype=bool)
    for k in range(dimension):
        rest = omega[..., k:, k].copy()
        for m in range(k):
            rest -= root[..., k:, m] * root[..., k, m, None]
        informed[..., k] = rest[..., 0] > 1e-12 * omega[..., k, k]
        pivot = np.sqrt(np.where(informed[..., k], rest[..., 0], 1.0))
        root[..., k:, k] = np.where(informed[..., k, None], rest / pivot[..., None], 0.0)
    for k in reversed(range(dimension)):
        value = normal[..., k].copy()
        for m in range(k + 1, dimension):
            value -= root[..., m, k] * out[..., m]
        out[..., k] = np.where(informed[..., k], value / np.where(informed[..., k], root[..., k, k], 1.0), 0.0)
    return out


def _contradicts(
    chain: OdometryChain, reference: Reference, pairs: IndexArray, claimed: Array, omega: Array
) -> BoolArray:
    """Which claims the reference rules out, (c, longest); none where it does not know the poses."""
    rows = chain.rows[pairs].reshape(-1, 2)
    values, known = reference.values[chain.kind.name], reference.known[chain.kind.name]
    kind = chain.factor_kind
    residual = kind.residual((values[rows[:, 0]], values[rows[:, 1]]), claimed.reshape(len(rows), -1), None)
    chi2 = np.vecdot(residual, np.matvec(omega.reshape(-1, *omega.shape[-2:]), residual))
    wrong = (chi2 > AGREEMENT[kind.dimension]) & known[rows].all(axis=1)
    return np.asarray(wrong.reshape(pairs.shape[:2]))


# -- after whose model ---------------------------------------------------------------------------------------------


class _Pool:
    """The information that false closures take over, in the notation of their file.

    In a dialect that states the information in another frame than the residual's (TORO), equal numbers in the file
    are another matrix for each measurement.
    """

    def __init__(self, graph: FactorGraph, chain: OdometryChain, diagonal: Array | None) -> None:
        columns = [f for f in graph.factors if f.kind is chain.factor_kind and len(f)]
        if not columns:
            raise InputError("the graph has no relative poses whose information false closures could take")
        closures = [is_loop_closure(graph, factors) for factors in columns]
        best = max(range(len(columns)), key=lambda k: int(closures[k].sum()))
        donors = columns[best].part(np.flatnonzero(closures[best])) if closures[best].any() else columns[best]
        self.kind, self.tag = donors.kind, donors.tag
        self.shape = donors.information.shape[1:]
        dialect = DIALECTS[graph.report.format] if graph.report is not None else None
        self.record = next((r for r in dialect.edges if r.tag == self.tag), None) if dialect else None
        if self.record is None or self.record.decode is decode_upper_triangle or diagonal is not None:
            self.record = None
            self.matrices = donors.information if diagonal is None else diagonal[None]
        else:
            self.numbers = self.record.encode(self.kind, donors.measurements, donors.information)[1]

    def draw(self, shape: tuple[int, ...], rng: np.random.Generator) -> IndexArray:
        """Donors, at random."""
        return rng.integers(0, len(self.matrices if self.record is None else self.numbers), shape)

    def information(self, drawn: IndexArray, measurements: Array) -> Array:
        """The donors' information for other measurements, (..., d, d)."""
        if self.record is None:
            return self.matrices[drawn]
        flat = measurements.reshape(drawn.size, -1)
        numbers = self.numbers[drawn.ravel()]
        told = self.record.encode(self.kind, flat, np.zeros((len(flat), *self.shape)))[0]
        return self.record.decode(self.kind, told, numbers)[1].reshape(*drawn.shape, *self.shape)


def _backward(graph: FactorGraph) -> bool:
    """Whether most closures of the graph run from the later to the earlier pose."""
    forward = backward = 0
    for factors in graph.factors:
        if factors.kind.relative_pose:
            rank = graph.variables[factors.kind.variables[0].name].rank[factors.indices[:, :2]]
            apart = rank[:, 1] - rank[:, 0]
            forward, backward = forward + int((apart > 1).sum()), backward + int((apart < -1).sum())
    return backward > forward
