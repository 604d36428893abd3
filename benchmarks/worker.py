"""One tool that reads a file in a process of its own: ``python -m benchmarks.worker TOOL FILE``.

Prints one JSON document: seconds to load and peak memory.
"""

from __future__ import annotations

import json
import sys
import time

from slamcli.batch.memory import peak_memory


def slamcli(path: str) -> float:
    """Our reader."""
    from slamcli import read

    started = time.perf_counter()
    graph = read(path)
    seconds = time.perf_counter() - started
    assert graph.edges
    return seconds


def g2opy(path: str) -> float:
    """g2o's reader; the second of two runs."""
    import g2opy as g2o

    for _ in range(2):
        optimizer = g2o.SparseOptimizer()
        started = time.perf_counter()
        optimizer.load(path)
        seconds = time.perf_counter() - started
    return seconds


def gtsam(path: str) -> float:
    """GTSAM's reader."""
    import gtsam

    with open(path, "rb") as stream:
        spatial = b"SE3:QUAT" in stream.read(65536)
    started = time.perf_counter()
    gtsam.readG2o(path, spatial)
    return time.perf_counter() - started


def main() -> None:
    """Run the tool that the command line names."""
    tool, path = sys.argv[1:3]
    load = {"slamcli": slamcli, "g2opy": g2opy, "gtsam": gtsam}[tool](path)
    print(json.dumps({"load": load, "memory_mb": peak_memory()}))


if __name__ == "__main__":
    main()
