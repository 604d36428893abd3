"""Spoils what a graph already has: odometry, associations, closures, information, the guess."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamcli.errors import UsageError
from slamcli.geometry import so3
from slamcli.graph import FactorGraph, Factors, Variables
from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.models import SE2
from slamcli.models.base import Array
from slamcli.simulation.odometry_chain import is_observation
from slamcli.simulation.outliers import AGREEMENT
from slamcli.simulation.portable import portable
from slamcli.simulation.reference import Reference
from slamcli.solver import gauge

#: Bounds of a gross odometry error of magnitude 1: as shares of the step's length, and of a right angle.
STEP_ERROR = (0.5, 1.5)
TURN_ERROR = (1.0 / 3.0, 1.0)
RIGHT_ANGLE = 0.5 * np.pi

_SEEN_BY = 2  # so many observations stay with each landmark
_TRIES = 30
#: As in ``outliers``, for observations of 1 (bearings), 2 and 3 numbers.
_AGREEMENT = {1: 23.93, 2: 27.63, **AGREEMENT}

Masks = list[BoolArray]


def pick(masks: Masks, count: int, rng: np.random.Generator, what: str) -> Masks:
    """Draw ``count`` of the marked edges, without putting back.

    Raises
    ------
    UsageError
        If fewer are marked.
    """
    flat = np.concatenate([np.zeros(0, dtype=bool), *masks])
    eligible = np.flatnonzero(flat)
    if count > len(eligible):
        raise UsageError(f"cannot choose {count} of {len(eligible)} {what}")
    out = np.zeros_like(flat)
    out[rng.permutation(eligible)[:count]] = True
    return np.split(out, np.cumsum([len(mask) for mask in masks])[:-1]) if masks else []


def corrupt_odometry(factors: Factors, rows: IndexArray, magnitude: float, rng: np.random.Generator) -> Factors:
    """Gross errors on some relative poses.

    The translation is off by 0.5 to 1.5 times ``magnitude`` times the step (at least the median step of the
    column), in any direction; the rotation by a third to one right angle times ``magnitude`` (at most half a turn),
    in 2-D to either side, in 3-D about any axis. Both are uniform, and seen from the end of the step.
    """
    kind = factors.kind.variables[0]
    lengths = np.sqrt(np.square(factors.measurements[:, : kind.space]).sum(axis=1))
    step = np.maximum(lengths[rows], np.median(lengths)) if len(lengths) else lengths
    far = rng.uniform(*STEP_ERROR, len(rows)) * magnitude * step
    turn = np.minimum(rng.uniform(*TURN_ERROR, len(rows)) * magnitude * RIGHT_ANGLE, np.pi)
    offset = far[:, None] * _directions(len(rows), kind.space, rng)
    if kind is SE2:
        error = np.concatenate([offset, np.where(rng.random(len(rows)) < 0.5, -turn, turn)[:, None]], axis=1)
    else:
        axis = _directions(len(rows), 3, rng)
        error = np.concatenate([offset, np.asarray(so3.exp(portable(turn[:, None] * axis)))], axis=1)
    measurements = factors.measurements.copy()
    measurements[rows] = np.asarray(kind.normalize(kind.compose(portable(measurements[rows]), portable(error))))
    return replace(factors, measurements=measurements)


def _directions(count: int, space: int, rng: np.random.Generator) -> Array:
    """Unit vectors, uniform in direction (normalized normal draws)."""
    vectors = rng.standard_normal((count, space))
    return np.asarray(vectors / np.sqrt(np.square(vectors).sum(axis=1, keepdims=True)))


def false_observations(graph: FactorGraph, count: int, rng: np.random.Generator, reference: Reference) -> list[Factors]:
    """Give observations to the wrong landmark: wrong data association.

    Every landmark keeps two of its own observations (or as many as it had), a pose observes no landmark twice through
    this, and each false observation contradicts the reference.

    Returns
    -------
    list of Factors
        The columns of the graph, those of observations with other indices where they are false.

    Raises
    ------
    UsageError
        If there are not as many as that.
    """
    columns = [k for k, factors in enumerate(graph.factors) if is_observation(factors).any()]
    if not columns:
        if count:
            raise UsageError("the graph has no observations of landmarks")
        return list(graph.factors)
    owner = np.concatenate([np.full(len(graph.factors[k]), k) for k in columns])
    row = np.concatenate([np.arange(len(graph.factors[k])) for k in columns])
    landmark = np.concatenate([_landmarks(graph, graph.factors[k]) for k in columns])
    candidates = rng.permutation(len(owner))
    candidates = candidates[_spare(landmark[candidates])]
    out = list(graph.factors)
    todo = count
    for k in columns:
        mine = candidates[owner[candidates] == k]
        share = int(np.count_nonzero(owner[candidates[:count]] == k))
        out[k], done = _reassociated(graph, out[k], row[mine], share, rng, reference)
        todo -= done
    if todo:
        raise UsageError(
            f"only {count - todo} of {count} false observations can be made of this graph",
            (f"  each landmark keeps {_SEEN_BY} of its own, and no pose observes a landmark twice",),
        )
    return out


def _landmarks(graph: FactorGraph, factors: Factors) -> IndexArray:
    """One number for each observed landmark, also where there are several kinds of landmarks."""
    kinds = list(graph.variables)
    return factors.indices[:, 1] * len(kinds) + kinds.index(factors.kind.variables[1].name)


def _spare(landmark: IndexArray) -> BoolArray:
    """Which observations, in this order, their landmarks can lose."""
    order = np.argsort(landmark, kind="stable")
    _, start, size = np.unique(landmark[order], return_index=True, return_counts=True)
    turn = np.empty(len(landmark), dtype=np.intp)
    turn[order] = np.arange(len(landmark)) - np.repeat(start + size, size)  # -size, ..., -1
    return turn < -_SEEN_BY


def _reassociated(
    graph: FactorGraph,
    factors: Factors,
    rows: IndexArray,
    count: int,
    rng: np.random.Generator,
    reference: Reference,
) -> tuple[Factors, int]:
    """The column with up to ``count`` of the given observations at other landmarks, and how many they are."""
    landmarks = len(graph.variables[factors.kind.variables[-1].name])
    indices = factors.indices.copy()
    taken = set((indices[:, 0] * landmarks + indices[:, 1]).tolist())
    waiting, done = rows, 0
    for _ in range(_TRIES):
        if done == count or len(waiting) == 0 or landmarks < 2:
            break
        other = rng.integers(0, landmarks, len(waiting))
        wrong = _contradicts(factors, waiting, other, reference)
        keys = (indices[waiting, 0] * landmarks + other).tolist()
        placed = np.zeros(len(waiting), dtype=bool)
        for k, key in enumerate(keys):
            if wrong[k] and key not in taken and done < count:
                taken.add(key)
                placed[k] = True
                done += 1
        indices[waiting[placed], 1] = other[placed]
        waiting = waiting[~placed]
    return replace(factors, indices=indices), done


def _contradicts(factors: Factors, rows: IndexArray, other: IndexArray, reference: Reference) -> BoolArray:
    """Which observations cannot be of the other landmarks, by the reference."""
    part = factors.part(rows)
    part = replace(part, indices=np.stack([part.indices[:, 0], other], axis=1))
    known = [reference.known[kind.name][part.indices[:, slot]] for slot, kind in enumerate(part.kind.variables)]
    with np.errstate(all="ignore"):
        wrong = part.chi2(reference.values) > _AGREEMENT[part.kind.dimension]
    return np.asarray(wrong & known[0] & known[1])


def drop(factors: Factors, mask: BoolArray) -> Factors:
    """A column without some of its factors."""
    return factors.part(np.flatnonzero(~mask)) if mask.any() else factors


def scale_information(factors: Factors, mask: BoolArray, scale: float) -> Factors:
    """Information of some factors times ``scale``."""
    if not mask.any():
        return factors
    information = factors.information.copy()
    information[mask] *= scale
    return replace(factors, information=information)


def perturb(graph: FactorGraph, translation: float, rotation: float, rng: np.random.Generator) -> dict[str, Variables]:
    """Normal noise on the estimates.

    Parameters
    ----------
    graph
        The graph; what is fixed stays, as does the lowest id of a part of the graph without anything fixed and
        without a prior, which the optimizer would hold.
    translation
        Standard deviation in metres along each axis of a pose's own frame, and of the world for landmarks.
    rotation
        Standard deviation in radians about each axis of the pose's own frame (of the rotation vector).
    rng
        All randomness.
    """
    held = gauge.choose(graph)[1]
    out = {}
    for name, column in graph.variables.items():
        kind = column.kind
        if kind.space == 0:
            out[name] = column  # switches are no places
            continue
        moved = rng.normal(0.0, translation, (len(column), kind.space))
        if kind is SE2:
            moved = np.concatenate([moved, rng.normal(0.0, rotation, (len(column), 1))], axis=1)
        elif kind.is_pose:
            turn = rng.normal(0.0, rotation, (len(column), 3))
            rest = np.zeros((len(column), kind.size - 7))  # intrinsics of cameras stay
            moved = np.concatenate([moved, np.asarray(so3.exp(portable(turn))), rest], axis=1)
        rows = np.flatnonzero(column.known & ~column.fixed & ~held[name])
        values = column.values.copy()
        values[rows] = np.asarray(kind.normalize(kind.compose(portable(values[rows]), portable(moved[rows]))))
        out[name] = replace(column, values=values)
    return out
