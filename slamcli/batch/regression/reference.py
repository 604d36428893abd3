"""A fixed piece of work, to measure the speed of this machine at this moment.

What an optimizer does, in about the same parts: batched products of small matrices (numpy), and a supernodal Cholesky
factorization with its solves (CHOLMOD). Its time moves with the machine as that of slamcli does, and its code is not
that of slamcli: a ratio of the two shows changes of the latter. A change of this file makes all older ratios
meaningless: it changes ``VERSION``, which the baseline holds.
"""

from __future__ import annotations

import json
import time

import numpy as np

#: Of the work; a baseline with another one has no comparable ratios.
VERSION = 1
#: Side of the lattice whose Laplacian is factorized, size of its blocks; number of products.
_SIDE, _BLOCK, _PRODUCTS = 40, 3, 20_000
_RUNS = 9


def reference_seconds(runs: int = _RUNS) -> float:
    """Least time of several runs, in seconds; the first one, which loads libraries, does not count."""
    import cvxopt
    from cvxopt import cholmod

    n = _SIDE * _SIDE
    index = np.arange(n).reshape(_SIDE, _SIDE)
    pairs = np.concatenate(
        [
            np.stack([index[:, 1:], index[:, :-1]], -1).reshape(-1, 2),
            np.stack([index[1:], index[:-1]], -1).reshape(-1, 2),
        ]
    )
    blocks = np.arange(_BLOCK)
    rows = (pairs[:, 0, None, None] * _BLOCK + blocks[:, None] + 0 * blocks).ravel()
    columns = (pairs[:, 1, None, None] * _BLOCK + blocks + 0 * blocks[:, None]).ravel()
    diagonal = np.arange(n * _BLOCK)
    values = np.concatenate([np.full(len(rows), -0.25), np.full(len(diagonal), 5.0)])
    matrix = cvxopt.spmatrix(
        values.tolist(), np.concatenate([rows, diagonal]).tolist(), np.concatenate([columns, diagonal]).tolist()
    )
    right = cvxopt.matrix(1.0, (n * _BLOCK, 1))
    stack = np.linspace(-1.0, 1.0, _PRODUCTS * 36).reshape(_PRODUCTS, 6, 6)

    def work() -> float:
        started = time.perf_counter()
        np.matmul(stack, stack.transpose(0, 2, 1))
        factor = cholmod.symbolic(matrix)
        for _ in range(3):
            cholmod.numeric(matrix, factor)
            solution = +right
            cholmod.solve(factor, solution)
        return time.perf_counter() - started

    work()
    return min(work() for _ in range(runs))


if __name__ == "__main__":  # in a process of its own: one thread, as the commands that it stands beside
    print(json.dumps({"seconds": reference_seconds()}))
