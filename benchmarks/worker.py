"""One tool on one file in a process of its own: ``python -m benchmarks.worker TOOL FILE ITERATIONS``.

Prints one JSON document: seconds to load, seconds to solve (the second of two runs in the process, everything between
the loaded graph and the converged one), peak memory, and the poses it ended with in a file for us to check.
"""

from __future__ import annotations

import json
import sys
import time

#: Relative decrease of the cost at which tools with a termination test stop.
TOLERANCE = 1e-6


def slamcli(path: str, iterations: int, result: str) -> dict[str, float]:
    """Our Gauss-Newton with its own termination test."""
    from slamcli import optimize, read, write

    started = time.perf_counter()
    graph = read(path)
    load = time.perf_counter() - started
    if iterations == 0:
        return {"load": load}
    optimize(graph, method="gn", init="file", max_iterations=iterations, tolerance=TOLERANCE)
    started = time.perf_counter()
    outcome = optimize(graph, method="gn", init="file", max_iterations=iterations, tolerance=TOLERANCE)
    solve = time.perf_counter() - started
    write(outcome.graph, result)
    return {"load": load, "solve": solve, "iterations": outcome.iterations}


def g2opy(path: str, iterations: int, result: str) -> dict[str, float]:
    """g2o's Gauss-Newton, Eigen's sparse Cholesky (the wheel has no CHOLMOD), a given number of iterations."""
    import g2opy as g2o

    def optimizer() -> object:
        with open(path, "rb") as stream:
            spatial = b"SE3:QUAT" in stream.read(65536)
        made = g2o.SparseOptimizer()
        if spatial:
            solver = g2o.BlockSolverSE3(g2o.LinearSolverEigenSE3())
        else:
            solver = g2o.BlockSolverSE2(g2o.LinearSolverEigenSE2())
        made.set_algorithm(g2o.OptimizationAlgorithmGaussNewton(solver))
        return made

    for _ in range(2):
        current = optimizer()
        started = time.perf_counter()
        current.load(path)
        load = time.perf_counter() - started
        if iterations == 0:
            return {"load": load}
        current.vertex(min(current.vertices())).set_fixed(True)
        started = time.perf_counter()
        current.initialize_optimization()
        done = current.optimize(iterations)
        solve = time.perf_counter() - started
    current.save(result)
    current.compute_active_errors()
    return {"load": load, "solve": solve, "iterations": done, "chi2": current.active_chi2()}


def gtsam(path: str, iterations: int, result: str) -> dict[str, float]:
    """GTSAM's Gauss-Newton with METIS or COLAMD, whichever is faster, and its own termination test."""
    import gtsam

    with open(path, "rb") as stream:
        spatial = b"SE3:QUAT" in stream.read(65536)
    started = time.perf_counter()
    graph, initial = gtsam.readG2o(path, spatial)
    load = time.perf_counter() - started
    if iterations == 0:
        return {"load": load}
    size = 6 if spatial else 3
    origin = min(initial.keys())
    pose = initial.atPose3(origin) if spatial else initial.atPose2(origin)
    prior = gtsam.PriorFactorPose3 if spatial else gtsam.PriorFactorPose2
    graph.add(prior(origin, pose, gtsam.noiseModel.Isotropic.Sigma(size, 1e-6)))
    best: tuple[float, int, object] | None = None
    for ordering in ("COLAMD", "METIS"):
        parameters = gtsam.GaussNewtonParams()
        parameters.setMaxIterations(iterations)
        parameters.setRelativeErrorTol(TOLERANCE)
        parameters.setAbsoluteErrorTol(1e-9)
        parameters.setOrderingType(ordering)
        for _ in range(2):
            optimizer = gtsam.GaussNewtonOptimizer(graph, initial, parameters)
            started = time.perf_counter()
            values = optimizer.optimize()
            solve = time.perf_counter() - started
        if best is None or solve < best[0]:
            best = (solve, optimizer.iterations(), values)
    assert best is not None
    gtsam.writeG2o(graph, best[2], result)
    return {"load": load, "solve": best[0], "iterations": best[1]}


def main() -> None:
    """Run the tool that the command line names."""
    tool, path, iterations, result = sys.argv[1:5]
    outcome = {"slamcli": slamcli, "g2opy": g2opy, "gtsam": gtsam}[tool](path, int(iterations), result)
    with open("/proc/self/status", encoding="ascii") as stream:
        peak = next(line for line in stream if line.startswith("VmHWM"))
    outcome["memory_mb"] = float(peak.split()[1]) / 1024.0
    print(json.dumps(outcome))


if __name__ == "__main__":
    main()
