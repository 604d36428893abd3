"""Why a linear system cannot be solved: which edge, which variable, which part of the graph."""

from __future__ import annotations

import numpy as np

from slamcli.graph import FactorGraph, Factors
from slamcli.graph.columns import BoolArray, finite_rows
from slamcli.graph.topology import component_labels, node_columns, prior_dimensions
from slamcli.models import Projection
from slamcli.models.base import Array, norm
from slamcli.models.information import eigenvalue_range, indefinite
from slamcli.solver.backends import NotPositiveDefiniteError
from slamcli.solver.gauge import Held
from slamcli.solver.linear_system import LinearSystem
from slamcli.solver.problem import SHIFTS, Problem

_SHOWN = 5
_LEAST_SHARE = 0.005  # of a direction: variables that move less are not named


def edge_name(graph: FactorGraph, factors: Factors, row: int) -> str:
    """A factor as its file names it: tag, ids and, if it has one, the line."""
    ids = " ".join(str(i) for i in factors.variable_ids(graph.variables)[row])
    line = f" (line {factors.lines[row]})" if len(factors.lines) and factors.lines[row] else ""
    return f"{factors.tag or factors.kind.name} {ids}{line}"


def indefinite_information(graph: FactorGraph) -> tuple[str, tuple[str, ...]] | None:
    """Reason and details if information matrices are indefinite, which leaves chi2 without a lower bound."""
    total, details = 0, []
    for factors in graph.factors:
        bad = np.flatnonzero(indefinite(factors.information))
        total += len(bad)
        if len(bad) == 0:
            continue
        low, high = eigenvalue_range(factors.information[bad])
        worst = np.argsort(low, kind="stable")[:_SHOWN]
        details.append(f"{len(bad)} of {len(factors)} {factors.tag or factors.kind.name}, the worst:")
        details += [
            f"  {edge_name(graph, factors, int(bad[k]))}: eigenvalues from {low[k]:.3g} to {high[k]:.3g}" for k in worst
        ]
    if total == 0:
        return None
    details.append("the information must be the inverse of a covariance: is its order that of the format,")
    details.append("upper triangle, row by row? With such edges chi2 has no minimum.")
    what = "1 information matrix is" if total == 1 else f"{total} information matrices are"
    return f"{what} indefinite: chi2 is unbounded below", tuple(details)


def not_finite(graph: FactorGraph, system: LinearSystem) -> tuple[str, tuple[str, ...]]:
    """Reason and details if chi2, gradient or H hold a NaN or an infinity."""
    details, overflows = [], []
    for factors in graph.factors:
        with np.errstate(all="ignore"):
            residual, jacobians = factors.linearize(system.values)
        bad = ~finite_rows(residual)
        for jacobian in jacobians:
            bad |= ~finite_rows(jacobian)
        details += [
            f"  {edge_name(graph, factors, int(k))}: residual or Jacobian is not finite"
            for k in np.flatnonzero(bad)[:_SHOWN]
        ]
        huge = np.flatnonzero(~bad & ~np.isfinite(factors.chi2(system.values)))
        overflows += [
            f"  {edge_name(graph, factors, int(k))}: chi2 overflows, its residual is {np.abs(residual[k]).max():.3g}"
            for k in huge[:_SHOWN]
        ]
    reason = "chi2 or its derivatives are not finite"
    measured = ", or a measurement is wrong" if overflows else ""
    diverged = f"  the values have diverged{measured}: try --method lm, or another --init"
    return reason, tuple(details) or (*overflows, diverged)


def not_positive_definite(
    graph: FactorGraph, held: Held, problem: Problem, system: LinearSystem
) -> tuple[str, tuple[str, ...]]:
    """Reason and details if H is singular or indefinite: a direction in which chi2 does not rise, by its variables."""
    details = _gauge_freedom(graph, held) if len(problem.frozen) == 0 else []
    direction = _flat_direction(problem, system)
    if direction is not None:
        curvature = problem.pattern.quadratic_form(system.hessian, direction)
        relative = curvature / (float(problem.diagonal(system).max()) or 1.0)  # no information at all
        shown = f"{relative:.1e}" if abs(relative) > 1e-15 else "0"
        details.append(f"chi2 does not rise (relative curvature {shown}) along a direction that moves mostly:")
        details += _largest_movers(graph, held, direction)
    other = "" if problem.options.method == "lm" else ", or --method lm"
    cameras = any(isinstance(factors.kind, Projection) for factors in graph.factors)
    first = "--gauge first, " if cameras and len(problem.frozen) == 0 else ""
    details.append(f"what helps: {first}--fix ID, a prior, more edges at these variables{other}")
    return "the Hessian is not positive definite: the edges do not determine all variables", tuple(details)


def _gauge_freedom(graph: FactorGraph, held: Held) -> list[str]:
    """Components that are held by partial priors only."""
    label, columns = component_labels(graph), node_columns(graph)
    prior_rows = prior_dimensions(graph, label)
    anchored = np.zeros(len(prior_rows), dtype=bool)
    anchored[label[np.concatenate([held[name] for name in columns])]] = True
    needed = 6 if graph.space == 3 else 3
    ids = np.concatenate([column.ids for column in columns.values()])
    return [
        f"gauge freedom: the component of {ids[label == k][0]} ({np.count_nonzero(label == k)} variables) is tied to "
        f"the world by {prior_rows[k]} prior dimensions, fewer than {needed}, and nothing in it is held"
        for k in np.flatnonzero(~anchored & (prior_rows < needed))[:_SHOWN]
    ]


def _flat_direction(problem: Problem, system: LinearSystem) -> Array | None:
    """Unit vector of the smallest eigenvalue of H, by inverse iteration with the smallest shift that factorizes."""
    largest = float(problem.diagonal(system).max(initial=0.0)) or 1.0
    direction = np.random.default_rng(0).standard_normal(len(system.gradient))
    for shift in SHIFTS:
        damping = np.full_like(direction, shift * largest)
        try:
            for _ in range(4):
                probe = LinearSystem(system.values, system.chi2, system.hessian, -direction)
                direction = problem.solve(probe, damping)
                with np.errstate(all="ignore"):  # numbers may overflow
                    direction = direction / norm(direction)
            return direction if np.isfinite(direction).all() else None
        except NotPositiveDefiniteError:
            continue
    return None


def _largest_movers(graph: FactorGraph, held: Held, direction: Array) -> list[str]:
    """The variables with the largest parts of a direction, with their largest component."""
    lines: list[tuple[float, str]] = []
    start = 0
    for name, column in graph.variables.items():
        free: BoolArray = ~held[name]
        dimension = column.kind.dimension
        stop = start + int(np.count_nonzero(free)) * dimension
        part = np.abs(direction[start:stop].reshape(-1, dimension))
        share = np.square(part).sum(axis=1)
        ids = column.ids[free]
        for k in [k for k in np.argsort(-share, kind="stable")[:_SHOWN].tolist() if share[k] >= _LEAST_SHARE]:
            component = column.kind.components[int(part[k].argmax())]
            lines.append((float(share[k]), f"  {column.kind.name} {ids[k]}, mostly {component} ({share[k]:.0%} of it)"))
        start = stop
    return [text for _, text in sorted(lines, key=lambda line: -line[0])[:_SHOWN]]
