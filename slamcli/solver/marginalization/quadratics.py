"""Quadratic pieces of chi2 on a few variables each, and the elimination of variables from their sum.

A piece says chi2(delta) = const + 2 g^T delta + delta^T H delta of the tangent steps of its variables. Eliminating the
variables G that some pieces touch leaves one piece on the other variables B of those pieces, the Markov blanket of G:

    Lambda = H_BB - H_BG H_GG^-1 H_GB,    eta = g_B - H_BG H_GG^-1 g_G

(the Schur complement), which is the minimum of chi2 over the steps of G. Eliminating one variable after the other is
multifrontal Cholesky factorization (Duff and Reid 1983) with fronts of one variable.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass

import numpy as np

from slamcli.graph.columns import BoolArray, Values
from slamcli.models.base import Array
from slamcli.solver.marginalization.nodes import Nodes

#: An eliminated direction with less than this share of the diagonal is one that nothing determines.
_SINGULAR = 1e-13


@dataclass(eq=False, slots=True)
class Piece:
    """A quadratic form.

    Attributes
    ----------
    nodes
        Its variables.
    information
        H in their tangent steps, in this order.
    gradient
        g, likewise.
    anchored
        Whether it ties the variables to the world: it comes from a prior or from a held variable.
    translated
        Whether it fixes directions of the world: it comes from a difference of points.
    """

    nodes: tuple[int, ...]
    information: Array
    gradient: Array
    anchored: bool = False
    translated: bool = False


class Quadratics:
    """Pieces that can be found by their variables.

    Parameters
    ----------
    nodes
        Of the graph.
    """

    def __init__(self, nodes: Nodes) -> None:
        self._dimension: list[int] = nodes.dimension.tolist()
        self._pieces: dict[int, Piece] = {}
        self._at: dict[int, set[int]] = {}
        self._next = 0
        self.undetermined = 0

    def add(self, piece: Piece) -> None:
        """Add a piece."""
        self._pieces[self._next] = piece
        for node in piece.nodes:
            self._at.setdefault(node, set()).add(self._next)
        self._next += 1

    def pieces(self) -> Iterable[Piece]:
        """All pieces that are there."""
        return self._pieces.values()

    def blanket(self, group: Collection[int]) -> list[int]:
        """The other variables of the pieces that touch a group, ascending."""
        keys = {key for node in group for key in self._at.get(node, ())}
        return sorted({node for key in keys for node in self._pieces[key].nodes}.difference(group))

    def eliminate(self, group: Collection[int]) -> Piece:
        """Take all pieces that touch a group out and return what they say about its blanket."""
        keys = sorted({key for node in group for key in self._at.get(node, ())})
        taken = [self._pieces.pop(key) for key in keys]
        for key, piece in zip(keys, taken, strict=True):
            for node in piece.nodes:
                self._at[node].discard(key)
        members = set(group)
        blanket = sorted({node for piece in taken for node in piece.nodes}.difference(members))
        start, total = {}, 0
        for node in [*group, *blanket]:
            start[node] = total
            total += self._dimension[node]
        split = total - sum(self._dimension[node] for node in blanket)
        hessian, gradient = np.zeros((total, total)), np.zeros(total)
        for piece in taken:
            self._accumulate(hessian, gradient, piece, start)
        information, eta = self._schur(hessian, gradient, split)
        anchored, translated = any(p.anchored for p in taken), any(p.translated for p in taken)
        return Piece(tuple(blanket), information, eta, anchored, translated)

    def within(self, members: Collection[int]) -> Array:
        """Sum of the information of the pieces that join none but some variables and not the world."""
        start, total = {}, 0
        for node in members:
            start[node] = total
            total += self._dimension[node]
        hessian, gradient = np.zeros((total, total)), np.zeros(total)
        for key in sorted({key for node in members for key in self._at.get(node, ())}):
            piece = self._pieces[key]
            if not piece.anchored and all(node in start for node in piece.nodes):
                self._accumulate(hessian, gradient, piece, start)
        return hessian

    def _accumulate(self, hessian: Array, gradient: Array, piece: Piece, start: dict[int, int]) -> None:
        """Add a piece to the sums; neighbouring variables go in one slice."""
        runs: list[list[int]] = []  # first in the sum, first in the piece, length
        at = 0
        for node in piece.nodes:
            first, size = start[node], self._dimension[node]
            if runs and runs[-1][0] + runs[-1][2] == first:
                runs[-1][2] += size
            else:
                runs.append([first, at, size])
            at += size
        if len(runs) > 4:
            index = np.concatenate([np.arange(a, a + size) for a, _, size in runs])
            hessian[np.ix_(index, index)] += piece.information
            gradient[index] += piece.gradient
            return
        for a, p, size in runs:
            gradient[a : a + size] += piece.gradient[p : p + size]
            for b, q, width in runs:
                hessian[a : a + size, b : b + width] += piece.information[p : p + size, q : q + width]

    def _schur(self, hessian: Array, gradient: Array, split: int) -> tuple[Array, Array]:
        """Schur complement onto the rows from ``split`` on; where H_GG is singular, with its pseudo-inverse."""
        own = hessian[:split, :split]
        coupling = np.concatenate([hessian[:split, split:], gradient[:split, None]], axis=1)
        try:
            factor = np.linalg.cholesky(own)
            if (np.square(np.diagonal(factor)) <= _SINGULAR * np.diagonal(own)).any():
                raise np.linalg.LinAlgError
            half = np.linalg.solve(factor, coupling)
        except np.linalg.LinAlgError:
            scale = 1.0 / np.sqrt(np.where(np.diagonal(own) > 0.0, np.diagonal(own), 1.0))
            eigenvalues, vectors = np.linalg.eigh(scale[:, None] * own * scale)
            kept = eigenvalues > _SINGULAR * split * eigenvalues[-1]
            self.undetermined += int(np.count_nonzero(~kept))
            half = (vectors[:, kept] / np.sqrt(eigenvalues[kept])).T @ (scale[:, None] * coupling)
        information = hessian[split:, split:] - half[:, :-1].T @ half[:, :-1]
        return 0.5 * (information + information.T), gradient[split:] - half[:, :-1].T @ half[:, -1]


def of_factors(nodes: Nodes, values: Values, gone: BoolArray, conditioned: BoolArray, among_kept: bool) -> list[Piece]:
    """The pieces of the factors that join a removed variable, or of those that join none.

    Parameters
    ----------
    nodes
        Of the graph.
    values
        Where the factors are linearized.
    gone
        (n,) removed variables.
    conditioned
        (n,) variables that are held: their steps are zero, so they are in no piece.
    among_kept
        Which of both are wanted.
    """
    out = []
    for factors in nodes.graph.factors:
        kinds = factors.kind.variables
        joined = np.stack([nodes.offsets[k.name] + factors.indices[:, s] for s, k in enumerate(kinds)], axis=1)
        proper = np.ones(len(factors), dtype=bool)
        for slot in range(1, len(kinds)):
            proper &= joined[:, slot] != joined[:, 0]  # an edge from a variable to itself is constant
        rows = np.flatnonzero((gone[joined].any(axis=1) != among_kept) & proper)
        if len(rows) == 0:
            continue
        part, joined = factors.part(rows), joined[rows]
        residual, jacobians = part.linearize(values)
        jacobian = np.concatenate(jacobians, axis=2)
        weighted = np.matmul(part.information, np.concatenate([jacobian, residual[:, :, None]], axis=2))
        products = np.matmul(jacobian.transpose(0, 2, 1), weighted)
        ends = np.cumsum([0, *(kind.dimension for kind in kinds)]).tolist()
        prior = len(kinds) == 1
        translated = len(kinds) == 2 and not any(kind.is_pose for kind in kinds)
        for k, members in enumerate(joined.tolist()):
            held = [bool(conditioned[node]) for node in members]
            hessian, gradient = products[k, :, :-1], products[k, :, -1]
            if any(held):
                free = [slot for slot in range(len(members)) if not held[slot]]
                index = np.concatenate([np.empty(0, np.intp), *(np.arange(ends[s], ends[s + 1]) for s in free)])
                members = [members[slot] for slot in free]
                hessian, gradient = hessian[np.ix_(index, index)], gradient[index]
            if members:
                out.append(Piece(tuple(members), hessian, gradient, prior or any(held), translated))
    return out
