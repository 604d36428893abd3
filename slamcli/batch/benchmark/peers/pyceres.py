"""Ceres (the wheel pyceres) with slamcli's residuals and Jacobians, handed over edge by edge.

pyceres brings no cost function for edges of a graph, so each edge is a cost function in Python: what this peer times
is Ceres' minimizer and linear solver and, for the greater part, the interpreter, and the note beside the time says how
much of it. The cost is half of chi2, with the root of the information taken into the residual. On any graph whose
variables are poses, points and cameras.
"""

from __future__ import annotations

import math
import time
from itertools import pairwise
from typing import Any

import numpy as np
import pyceres

from slamcli.batch.benchmark.case import Case, Trial
from slamcli.batch.benchmark.peers.settings import Setting
from slamcli.geometry import quaternion
from slamcli.graph.columns import Factors, Values
from slamcli.models import VariableKind
from slamcli.models.base import Array
from slamcli.models.shared_intrinsics import INTRINSICS

#: A graph with more edges is left out: it would take minutes, and say nothing about Ceres.
EDGES = 10_000
#: Numbers of a spatial pose's parts: position and quaternion.
_POSITION, _QUATERNION = 3, 4


def parts(kind: VariableKind) -> tuple[int, ...]:
    """Sizes of the parameter blocks of a variable: those of a spatial pose are its position and its quaternion.

    Raises
    ------
    ValueError
        For a kind whose tangent step is not known here.
    """
    if kind.size >= _POSITION + _QUATERNION and kind.is_pose:
        rest = kind.size - _POSITION - _QUATERNION
        return (_POSITION, _QUATERNION, *([rest] if rest else []))
    if kind.space == 0 and kind not in INTRINSICS:
        raise ValueError(f"has no {kind.name} variables")
    return (kind.size,)


def ambient(kind: VariableKind, value: Array, jacobian: Array) -> list[Array]:
    """Jacobians with respect to the numbers of a value, one for each of its ``parts``.

    Parameters
    ----------
    kind
        Of the variable.
    value
        (size,).
    jacobian
        (d, k) with respect to the local tangent step: for poses dt = R delta_t and dq = q (delta_q, 0). The columns of
        that matrix of q are orthonormal, so its transpose takes one back to the other.
    """
    if len(parts(kind)) == 1:
        if not kind.is_pose:
            return [jacobian]
        cos, sin = math.cos(value[2]), math.sin(value[2])
        planar = jacobian.copy()
        planar[:, :2] = jacobian[:, :2] @ np.array([[cos, sin], [-sin, cos]])
        return [planar]
    x, y, z, w = value[_POSITION : _POSITION + _QUATERNION].tolist()
    left = np.array([[w, z, -y, -x], [-z, w, x, -y], [y, -x, w, -z]])  # rows: q (e_k, 0)
    rotation = np.array(quaternion.matrix_rows([x, y, z, w]))
    found = [jacobian[:, :3] @ rotation.T, jacobian[:, 3:6] @ left]
    if len(parts(kind)) == 3:
        rest = np.zeros((len(jacobian), parts(kind)[2]))
        rest[:, : jacobian.shape[1] - 6] = jacobian[:, 6:]
        found.append(rest)
    return found


def _roots(factors: Factors) -> Array:
    """(m, d, d) with root^T root the information, which may be singular."""
    eigenvalues, vectors = np.linalg.eigh(factors.information)
    return np.sqrt(np.maximum(eigenvalues, 0.0))[:, :, None] * np.swapaxes(vectors, 1, 2)


class EdgeCost(pyceres.CostFunction):  # type: ignore[misc]
    """One edge: slamcli's residual and Jacobians times the root of its information."""

    def __init__(self, factors: Factors, root: Array) -> None:
        super().__init__()
        self._factors, self._root = factors, root
        self._kinds = factors.kind.variables
        sizes = [size for kind in self._kinds for size in parts(kind)]
        ends = np.cumsum([0] + [len(parts(kind)) for kind in self._kinds]).tolist()
        self._slots = list(pairwise(ends))
        self.set_num_residuals(factors.kind.dimension)
        self.set_parameter_block_sizes(sizes)

    def Evaluate(self, parameters: list[Array], residuals: Array, jacobians: list[Array] | None) -> bool:
        """Called by Ceres; Jacobians are row-major, None for a block that is held."""
        factors = self._factors
        values = [np.concatenate(parameters[begin:end]) for begin, end in self._slots]
        x = tuple(value[None] for value in values)
        if jacobians is None:
            found = factors.kind.residual(x, factors.measurements, factors.parameters)
            residuals[:] = self._root @ found[0]
            return True
        found, local = factors.kind.linearize(x, factors.measurements, factors.parameters)
        residuals[:] = self._root @ found[0]
        for (begin, _), kind, value, one in zip(self._slots, self._kinds, values, local, strict=True):
            for k, block in enumerate(ambient(kind, value, self._root @ one[0])):
                if jacobians[begin + k] is not None:
                    jacobians[begin + k][:] = block.ravel()
        return True


class _Watch(pyceres.IterationCallback):  # type: ignore[misc]
    """Writes the course of chi2."""

    def __init__(self, course: list[float]) -> None:
        super().__init__()
        self.course = course

    def __call__(self, summary: Any) -> Any:
        if summary.iteration > 0:
            self.course.append(2.0 * summary.cost)
        return pyceres.CallbackReturnType.SOLVER_CONTINUE


class Peer:
    """Ceres on the graph; every run makes its problem anew, which is not timed."""

    def __init__(self, case: Case) -> None:
        if case.graph.edges > EDGES:
            raise ValueError(f"is left out above {EDGES} edges: it would call Python for each of {case.graph.edges}")
        self.case = case
        for kind in {kind.name: kind for factors in case.graph.factors for kind in factors.kind.variables}.values():
            parts(kind)
        self._edges = [
            (factors.part(slice(k, k + 1)), root, rows)
            for factors in case.graph.factors
            for k, (root, rows) in enumerate(zip(_roots(factors), factors.indices.tolist(), strict=True))
        ]

    def own_best(self, optimum: Values) -> None:
        """Its cost is half of ours."""

    def run(self, setting: Setting, count: int, course: list[float] | None) -> Trial:
        """One run; with a course until nothing changes any more."""
        start, seconds = self.case.initial(setting.start)
        values = {name: np.array(array) for name, array in start.items()}
        problem = self._problem(values)
        options = pyceres.SolverOptions()
        options.linear_solver_type = getattr(pyceres.LinearSolverType, setting.solver)
        options.trust_region_strategy_type = getattr(
            pyceres.TrustRegionStrategyType, {"lm": "LEVENBERG_MARQUARDT"}.get(setting.method, "DOGLEG")
        )
        options.max_num_iterations = count
        options.num_threads = 1
        options.function_tolerance = 1e-12 if course is not None else 0.0
        options.gradient_tolerance = options.parameter_tolerance = 0.0
        watch = _Watch([] if course is None else course)
        options.callbacks = [watch]
        summary = pyceres.SolverSummary()
        started = time.perf_counter()
        pyceres.solve(options, problem, summary)
        seconds += time.perf_counter() - started
        python = summary.residual_evaluation_time_in_seconds + summary.jacobian_evaluation_time_in_seconds
        note = f"{python * 1e3:.1f} ms of it in costs called in Python"
        ended = {name: column.kind.normalize(values[name]) for name, column in self.case.graph.variables.items()}
        return Trial(self.case, ended, seconds, len(watch.course), note=note)

    def _problem(self, values: Values) -> Any:
        problem = pyceres.Problem()
        blocks = {name: self._blocks(name, values[name]) for name in values}
        for factors, root, rows in self._edges:
            slots = zip(factors.kind.variables, rows, strict=True)
            joined = [block for kind, row in slots for block in blocks[kind.name][row]]
            problem.add_residual_block(EdgeCost(factors, root), None, joined)
        for name, held in self.case.held.items():
            for row, found in enumerate(blocks[name]):
                for k, block in enumerate(found):
                    if not problem.has_parameter_block(block):
                        continue
                    constant = k == 2 and self.case.graph.variables[name].kind.dimension == 6
                    if held[row] or constant:
                        problem.set_parameter_block_constant(block)
                    elif len(found) > 1 and k == 1:
                        problem.set_manifold(block, pyceres.EigenQuaternionManifold())
        return problem

    def _blocks(self, name: str, values: Array) -> list[list[Array]]:
        """Parameter blocks of each variable of a kind: views of its values."""
        bounds = list(pairwise(np.cumsum([0, *parts(self.case.graph.variables[name].kind)]).tolist()))
        return [[row[begin:end] for begin, end in bounds] for row in values]
