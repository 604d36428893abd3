"""Nonlinear factor recovery: a marginal over a blanket, written as factors of the kinds that files can hold.

Of all information matrices X_i of some links, those are taken with which S = sum J_i^T X_i J_i has the least
Kullback-Leibler divergence from the marginal N(., Lambda^-1) (Mazuran, Burgard, Tipaldi, "Nonlinear factor recovery
for long-term SLAM", IJRR 2016),

    2 KLD = tr(S Lambda^-1) - log det S + log det Lambda - n,

which is convex in the X_i. With Sigma = Lambda^-1 and T_i = J_i Sigma J_i^T, the covariance of what link i measures:

- Links that form a tree have X_i = T_i^-1, and 2 KLD = sum log det T_i + log det Lambda. The best tree is therefore the
  minimum spanning tree of log det T_i: the tree of Chow and Liu (1968), here over relative poses (Carlevaris-Bianco,
  Kaess, Eustice, T-RO 2014, and Kretzschmar and Stachniss, IJRR 2012, use it over absolute ones). The world, where it
  is known, is one more node, joined by priors.
- Other sets of links are found by descent over one link at a time, each step in closed form: with C_i = J_i S^-1 J_i^T,
  M = C_i^-1 - X_i what the others say about the measurement, and the eigenvalues m and vectors Q of
  T_i^1/2 M T_i^1/2, the best X_i >= 0 is T_i^-1/2 Q max(1 - m, 0) Q^T T_i^-1/2.

The marginal's gradient eta is kept as it is: the residuals of the links are J_i v with S v = eta. Where the estimate is
the optimum of the whole graph it therefore remains that of the reduced one.

A marginal that says nothing of some directions (a landmark says nothing of the headings of the poses that see it) has
no Lambda^-1. Both sides then get the information C of the kept factors among the blanket on top, and a weak prior where
that does not determine all of it either: what is minimized is the divergence of S + C from Lambda + C.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from slamcli.errors import InputError, NumericalError
from slamcli.models.base import Array
from slamcli.solver.marginalization import descent, topology
from slamcli.solver.marginalization.links import between
from slamcli.solver.marginalization.nodes import Nodes
from slamcli.solver.marginalization.quadratics import Piece

#: Eigenvalue, relative to the largest, below which a marginal says nothing; and the weak prior's share of the diagonal.
_WEAK, _PRIOR = 1e-12, 1e-6
#: Relative difference of S from Lambda that is rounding.
_EXACT = 1e-11
#: Information below this share of what is known about a measurement is left out.
_NOTHING = 1e-3
_REFINEMENTS = 24
_SHOWN = 5


@dataclass(frozen=True, eq=False)
class Recovered:
    """What stands for a marginal.

    Attributes
    ----------
    pieces
        One for each link.
    divergence
        KLD in nats; 0 where the links say the same as the marginal.
    weak
        Directions, beside those of the gauge, of which the marginal says nothing.
    """

    pieces: list[Piece]
    divergence: float
    weak: int = 0


def recover(nodes: Nodes, marginal: Piece, sparsification: str, around: Callable[[Sequence[int]], Array]) -> Recovered:
    """Factors for a marginal: ``none`` (all pairs), ``chow-liu`` (a tree) or ``subgraph`` (a tree and as much again).

    ``around`` gives the information of the kept factors among some variables.

    Raises
    ------
    InputError
        If no kinds of factor can say it: relative positions of points whose frame is unknown.
    NumericalError
        If its numbers do not allow it.
    """
    members = marginal.nodes
    if not members or not marginal.information.any():
        return Recovered([], 0.0)
    poses = [node for node in members if nodes.is_pose[node]]
    if len(members) == 1:
        return Recovered([marginal] if marginal.anchored else [], 0.0)
    if not (poses or marginal.anchored or marginal.translated):
        raise _only_points(nodes, members)
    if len(members) == 2 and not marginal.anchored and not (marginal.translated and poses):
        return Recovered([marginal], 0.0)  # relative to each other: one factor says it all
    try:
        with np.errstate(all="ignore"):
            found = _Recovery(nodes, marginal, sparsification, around).result()
    except np.linalg.LinAlgError:
        found = None
    if found is None or not all(np.isfinite(piece.information).all() for piece in found.pieces):
        raise _not_computable(nodes, members)
    return found


def _not_computable(nodes: Nodes, members: Sequence[int]) -> NumericalError:
    return NumericalError(
        f"what is removed leaves a marginal of {len(members)} variables that cannot be computed",
        (
            f"  they are {_names(nodes, members)}",
            "  are there edges without information, or of very different size? slamcli info shows their eigenvalues",
        ),
    )


def _names(nodes: Nodes, members: Sequence[int]) -> str:
    return ", ".join(nodes.name(node) for node in members[:_SHOWN]) + (", ..." if len(members) > _SHOWN else "")


def _only_points(nodes: Nodes, members: Sequence[int]) -> InputError:
    return InputError(
        f"what is removed joins {len(members)} landmarks in a frame that nothing kept or held knows: no factor of a "
        "graph file can say that",
        (f"  they are {_names(nodes, members)}", "  keep a pose that sees them, or hold one with a FIX line"),
    )


class _Recovery:
    """One marginal; ``result`` is the course."""

    def __init__(
        self, nodes: Nodes, marginal: Piece, sparsification: str, around: Callable[[Sequence[int]], Array]
    ) -> None:
        self.nodes, self.marginal, self.sparsification, self.around = nodes, marginal, sparsification, around
        sizes = nodes.dimension[list(marginal.nodes)]
        self.starts = np.concatenate([[0], np.cumsum(sizes)])
        anchored = marginal.anchored or (marginal.translated and bool(nodes.is_pose[list(marginal.nodes)].any()))
        held = 0 if anchored else int(np.argmax(nodes.is_pose[list(marginal.nodes)]))
        width = 0 if anchored else int(sizes[held])
        every = np.arange(int(self.starts[-1]))
        start = int(self.starts[held])
        self.free = every[(every < start) | (every >= start + width)]
        self.links = between(nodes, marginal.nodes, anchored)

    def result(self) -> Recovered:
        weak, context = self._context()
        if self.sparsification == "none":
            direct = self._direct()
            if self._differs(direct) <= _EXACT:
                return Recovered(self._pieces(direct, context, False), 0.0, weak)
        sigma = descent.padded_inverse(self.marginal.information + context, self.free)
        covariances = [links.covariance(sigma) for links in self.links]
        tree = topology.spanning_tree(self.nodes, self.marginal.nodes, self.links, covariances)
        information = [_inverse_stack(covariance) for covariance in covariances]
        chosen = [np.where(mask[:, None, None], x, 0.0) for mask, x in zip(tree, information, strict=True)]
        if weak:
            chosen = descent.descend(self.links, covariances, chosen, tree, self.free, context)
        if self.sparsification == "none":
            chosen = [0.95 * a + 0.05 * b for a, b in zip(direct, chosen, strict=True)]
            every = [np.ones(len(links), dtype=bool) for links in self.links]
            chosen = descent.descend(self.links, covariances, chosen, every, self.free, context)
        elif self.sparsification == "subgraph":
            count = len(self.marginal.nodes) - 1
            more = topology.add_links(self.links, covariances, chosen, tree, self.free, count, context)
            chosen = descent.descend(self.links, covariances, chosen, more, self.free, context)
        if weak:
            chosen = [_telling(x, t) for x, t in zip(chosen, covariances, strict=True)]
        return Recovered(self._pieces(chosen, context, True), self._divergence(chosen, covariances, context), weak)

    def _context(self) -> tuple[int, Array]:
        """How many directions the marginal says nothing of, and what is added for them, over the whole blanket."""
        index = np.ix_(self.free, self.free)
        context = np.zeros_like(self.marginal.information)
        weak = _count_weak(self.marginal.information[index])
        if weak:
            context = self.around(self.marginal.nodes)
            if _count_weak((self.marginal.information + context)[index]):
                diagonal = np.diagonal(self.marginal.information + context)
                blocks = np.maximum(diagonal, 1e-3 * diagonal.max())
                context = context + np.diag(_PRIOR * blocks)
        return weak, context

    def _direct(self) -> list[Array]:
        """X_i read off the blocks of Lambda beside the diagonal, J_a^T X J_b; priors from what is left on it.

        Where these blocks are symmetric in the frames of the links, and X_i >= 0, they are the marginal exactly.
        """
        rest = self.marginal.information.copy()
        out = []
        for links in self.links:
            width = links.jacobian.shape[2]
            if links.ends.shape[1] == 1:
                x = rest[links.columns[:, :, None], links.columns[:, None, :]]
            else:
                split = self.nodes.dimension[self.marginal.nodes[links.ends[0, 0]]]
                block = self.marginal.information[links.columns[:, :split, None], links.columns[:, None, split:]]
                first, second = links.jacobian[:, :, :split], links.jacobian[:, :, split:]
                x = np.linalg.pinv(first.transpose(0, 2, 1)) @ block @ np.linalg.inv(second)
            x = _positive(x)
            out.append(x)
            part = links.jacobian.transpose(0, 2, 1) @ x @ links.jacobian
            for columns, block in zip(links.columns, part, strict=True):
                rest[columns[:, None], columns] -= block.reshape(width, width)
        return out

    def _sum(self, information: list[Array]) -> Array:
        return descent.total(self.links, information, len(self.marginal.gradient))

    def _differs(self, information: list[Array]) -> float:
        """Largest relative difference of S from Lambda, beside the square roots of the diagonal."""
        scale = 1.0 / np.sqrt(np.maximum(np.diagonal(self.marginal.information), np.finfo(float).tiny))
        difference = scale[:, None] * (self._sum(information) - self.marginal.information) * scale
        return float(np.abs(difference).max())

    def _divergence(self, information: list[Array], covariances: list[Array], context: Array) -> float:
        index = np.ix_(self.free, self.free)
        total, wanted = self._sum(information) + context, self.marginal.information + context
        scale = 1.0 / np.sqrt(np.diagonal(wanted[index]))
        factors = [np.linalg.slogdet(scale[:, None] * matrix[index] * scale) for matrix in (total, wanted)]
        if factors[0][0] <= 0.0:
            return np.inf
        trace = sum(float((x * t).sum()) for x, t in zip(information, covariances, strict=True))
        if context.any():
            trace += float(np.trace(np.linalg.solve(wanted[index], context[index])))
        return max(0.0, 0.5 * (trace - float(factors[0][1] - factors[1][1]) - len(self.free)))

    def _pieces(self, information: list[Array], context: Array, approximate: bool) -> list[Piece]:
        """Pieces of the links, with gradients that add up to the marginal's as far as their information reaches."""
        v = np.zeros_like(self.marginal.gradient)
        total = self._sum(information)[np.ix_(self.free, self.free)]
        gradient = self.marginal.gradient[self.free]
        if context.any():
            wanted = self.marginal.information[np.ix_(self.free, self.free)]
            v[self.free] = (
                _solve_damped(total, gradient, wanted)
                if approximate
                else np.linalg.pinv(wanted, rcond=_WEAK, hermitian=True) @ gradient
            )
        else:
            v[self.free] = _solve(total, gradient)
        out = []
        for links, matrices in zip(self.links, information, strict=True):
            used = np.flatnonzero(matrices.any(axis=(1, 2)))
            if len(used) == 0:
                continue
            part, x = links.part(used), matrices[used]
            transposed = part.jacobian.transpose(0, 2, 1)
            hessians = transposed @ x @ part.jacobian
            gradients = np.matvec(hessians, v[part.columns])
            names = np.array(self.marginal.nodes)[part.ends].tolist()
            prior, difference = part.ends.shape[1] == 1, part.kind.name.startswith("point_difference")
            out += [
                Piece(tuple(ends), h, g, prior, difference)
                for ends, h, g in zip(names, hessians, gradients, strict=True)
            ]
        return out


def _telling(information: Array, covariance: Array) -> Array:
    """Information matrices (m, d, d) without the directions in which they add next to nothing to what is known."""
    root, inverse = descent.roots(covariance)
    eigenvalues, vectors = np.linalg.eigh(root.transpose(0, 2, 1) @ information @ root)
    kept = np.where(eigenvalues > _NOTHING, eigenvalues, 0.0)
    back = inverse.transpose(0, 2, 1) @ vectors
    return (back * kept[:, None, :]) @ back.transpose(0, 2, 1)


def _count_weak(information: Array) -> int:
    """Directions of which an information matrix says nothing."""
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(information), np.finfo(float).tiny))
    eigenvalues = np.linalg.eigvalsh(scale[:, None] * information * scale)
    return int(np.count_nonzero(eigenvalues <= _WEAK * eigenvalues[-1]))


def _positive(matrices: Array) -> Array:
    """The nearest symmetric matrices (m, d, d) without negative eigenvalues."""
    eigenvalues, vectors = np.linalg.eigh(0.5 * (matrices + matrices.transpose(0, 2, 1)))
    return (vectors * np.maximum(eigenvalues, 0.0)[:, None, :]) @ vectors.transpose(0, 2, 1)


def _inverse_stack(covariance: Array) -> Array:
    """Inverses of covariances (m, d, d), symmetric and positive semidefinite whatever the rounding."""
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), np.finfo(float).tiny))
    outer = scale[:, :, None] * scale[:, None, :]
    eigenvalues, vectors = np.linalg.eigh(covariance * outer)
    eigenvalues = np.maximum(eigenvalues, 1e-15)
    return (vectors / eigenvalues[:, None, :]) @ vectors.transpose(0, 2, 1) * outer


def _solve(matrix: Array, rhs: Array) -> Array:
    """Solution of a positive definite system, scaled by its diagonal first."""
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(matrix), np.finfo(float).tiny))
    return scale * np.linalg.solve(scale[:, None] * matrix * scale, scale * rhs)


def _solve_damped(matrix: Array, rhs: Array, damping: Array) -> Array:
    """Nearly the solution of a semidefinite system: what so many steps v += (S + M)^-1 (rhs - S v) come to.

    Along directions of which S says next to nothing beside the marginal M, v stays small: a residual of any size would
    be no residual of poses any more. Along the others v is the solution.
    """
    diagonal = np.diagonal(damping)
    damping = damping + _PRIOR * np.diag(np.maximum(diagonal, 1e-3 * diagonal.max()))
    lower = np.linalg.cholesky(matrix + damping)
    half = np.linalg.solve(lower, matrix)
    relative = np.linalg.solve(lower, half.T)
    eigenvalues, vectors = np.linalg.eigh(0.5 * (relative + relative.T))
    eigenvalues = np.clip(eigenvalues, np.finfo(float).eps, 1.0)
    share = (1.0 - (1.0 - eigenvalues) ** _REFINEMENTS) / eigenvalues
    return np.linalg.solve(lower.T, vectors @ (share * (vectors.T @ np.linalg.solve(lower, rhs))))
