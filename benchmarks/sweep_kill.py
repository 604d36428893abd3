"""The same sweep in four ways, and whether the tables agree byte for byte: ``python -m benchmarks.sweep_kill``.

1. joblib on this machine. 2. The same, interrupted by Ctrl-C at a third and killed (SIGKILL) at two thirds, then
resumed. 3. Dask's LocalCluster, of whose workers one is killed (SIGKILL) at a third and one at two thirds.
4. As 3, but the sweep itself is killed as well, and resumed. Needs the extra ``dask``.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.tables import print_table

SWEEP = Path(__file__).parents[1] / "configs" / "sweeps" / "robust-manhattan.yaml"


class Run:
    """A sweep in a process of its own, and what is in its journal."""

    def __init__(self, folder: Path, words: list[str]) -> None:
        self.journal = folder / "journal.jsonl"
        line = [sys.executable, "-m", "slamcli", "sweep", str(SWEEP), "-o", str(folder), "--json", *words]
        self.started = time.perf_counter()
        self.process = subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def reached(self, count: int) -> None:
        """Wait until the journal has so many results."""
        while self.results() < count:
            if self.process.poll() is not None:
                sys.exit(f"the sweep ended before it was interrupted: {self.process.communicate()}")
            time.sleep(0.01)

    def results(self) -> int:
        """Number of lines of the journal but the first."""
        return max(0, self.journal.read_bytes().count(b"\n") - 1) if self.journal.exists() else 0

    def ended(self) -> tuple[int, float, str, str]:
        """Exit code, seconds, and what it printed."""
        out, err = self.process.communicate()
        return self.process.returncode, time.perf_counter() - self.started, out, err


def complete(folder: Path, words: list[str], *events: tuple[int, Callable[[Run], None]]) -> dict[str, float]:
    """Run a sweep to its end, with events at counts of results; start it again where one has ended it."""
    seconds, starts, left = 0.0, 0, list(events)
    while True:
        run = Run(folder, words)
        starts += 1
        while left and run.process.poll() is None:
            count, event = left.pop(0)
            run.reached(count)
            event(run)
            time.sleep(0.5)
        code, taken, out, err = run.ended()
        seconds += taken
        if code == 0:
            document = json.loads(out)
            return {"seconds": seconds, "starts": starts, "tasks": document["tasks"], "missing": document["missing"]}
        if code not in (130, -signal.SIGKILL):
            sys.exit(f"exit code {code}: {err}")


def interrupt(run: Run) -> None:
    """Ctrl-C."""
    run.process.send_signal(signal.SIGINT)


def kill(run: Run) -> None:
    """Without a chance to do anything."""
    run.process.kill()


def in_four_ways(folder: Path, jobs: int, tasks: int) -> list[tuple[str, Path, dict[str, float]]]:
    """Name, folder and figures of each."""
    from distributed import LocalCluster

    third, thirds = tasks // 3, 2 * tasks // 3
    local = ["--jobs", str(jobs)]
    out = [("joblib", folder / "joblib", complete(folder / "joblib", local))]
    name = "joblib, Ctrl-C and SIGKILL, resumed twice"
    out.append((name, folder / "resumed", complete(folder / "resumed", local, (third, interrupt), (thirds, kill))))
    with LocalCluster(n_workers=jobs, threads_per_worker=1, dashboard_address=None, silence_logs=50) as cluster:

        def kill_worker(run: Run) -> None:
            pids = [worker.pid for worker in cluster.workers.values() if worker.pid is not None]
            os.kill(pids[0], signal.SIGKILL)
            print(f"  killed worker {pids[0]} after {run.results()} results", file=sys.stderr)

        dask = ["--dask", cluster.scheduler_address]
        events = ((third, kill_worker), (thirds, kill_worker))
        out.append(("dask, two workers killed", folder / "dask", complete(folder / "dask", dask, *events)))
        events = ((third, kill_worker), (thirds, kill))
        name = "dask, a worker and the sweep killed, resumed"
        out.append((name, folder / "killed", complete(folder / "killed", dask, *events)))
    return out


def main() -> None:
    """Print a table; exit 1 if the tables of the sweep differ."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--tasks", type=int, default=1000, help="how many the sweep has: when things are killed")
    given = parser.parse_args()
    header = ("run", "s", "starts", "rows", "lines of the journal", "different keys", "sha256 of table.csv")
    rows, hashes = [], set()
    with tempfile.TemporaryDirectory() as folder:
        for name, place, figures in in_four_ways(Path(folder), given.jobs, given.tasks):
            content = (place / "table.csv").read_bytes()
            records = [json.loads(line) for line in (place / "journal.jsonl").read_text().splitlines()[1:]]
            keys = {record["key"] for record in records}
            digest = hashlib.sha256(content).hexdigest()
            hashes.add(digest)
            cells = (figures["starts"], content.count(b"\n") - 1, len(records), len(keys))
            rows.append((name, f"{figures['seconds']:.1f}", *map(str, cells), digest[:16]))
    print_table(f"A sweep of {given.tasks} tasks, {given.jobs} at a time", header, rows)
    sys.exit(len(hashes) > 1)


if __name__ == "__main__":
    main()
