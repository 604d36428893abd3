"""What an update of the filter costs, beside one read and write of the triangle of its covariance."""

from __future__ import annotations

import statistics
import time

import numpy as np

from slamcli.filtering.blas import subtract_square
from slamcli.filtering.ekf import update
from slamcli.filtering.readings import Linearization
from slamcli.filtering.state import State

LANDMARKS = (100, 250, 500, 1000, 2000, 4000)


def update_costs(runs: int) -> list[tuple[str, ...]]:
    """Rows of a table: landmarks, both times in ms, their ratio; at last the exponents of the growth with N."""
    rows, medians = [], []
    for count in LANDMARKS:
        state, reading = _filter(count)
        triangle = np.eye(3 + 2 * count, order="F")
        vector = np.full((3 + 2 * count, 1), 1e-9, order="F")
        passes, updates = [], []
        for _ in range(runs * max(4000 // count, 1)):
            passes.append(_timed(lambda m=triangle, v=vector: subtract_square(m, v)))
            updates.append(_timed(lambda s=state, r=reading: update(s, r)))
        read, cost = statistics.median(passes), statistics.median(updates)
        medians.append((read, cost))
        rows.append((str(count), f"{read * 1e3:.3f}", f"{cost * 1e3:.3f}", f"{cost / read:.2f}"))
    exponents = np.polyfit(np.log(LANDMARKS), np.log(medians), 1)[0]
    rows.append(("exponent", f"{exponents[0]:.2f}", f"{exponents[1]:.2f}", ""))
    return rows


def _filter(count: int) -> tuple[State, Linearization]:
    """A filter with a map, and a range-bearing reading of one landmark."""
    state = State(np.zeros(3), np.eye(3), capacity=3 + 2 * count)
    state.size = 3 + 2 * count
    state.lower[:] = np.eye(state.size)
    where = 3 + 2 * (count // 2)
    jacobian = np.array([[-1.0, 0.0, 0.0, 1.0, 0.0], [0.0, -0.2, -1.0, 0.0, 0.2]])
    entries = np.array([0, 1, 2, where, where + 1])
    return state, Linearization(entries, jacobian, np.full(2, 1e-3), np.eye(2), [2], [])


def _timed(call: object) -> float:
    started = time.perf_counter()
    call()  # type: ignore[operator]
    return time.perf_counter() - started
