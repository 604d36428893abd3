"""Lets the variants alternate: run 1 of each, run 2 of each, ...; every run is a process of its own.

On each graph every variant of slamcli runs once for nothing, which fills caches and shows what it costs. Then the
fastest setting with which each peer reaches the optimum is looked for, and the fewest iterations it needs, as if its
user knew them. Then they alternate. A variant that fails, or a peer that never reaches the optimum, is a row as well.
"""

from __future__ import annotations

import hashlib
import math
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import slamcli
from slamcli.batch.benchmark.grid import Variant
from slamcli.batch.benchmark.peers.settings import Setting, tried
from slamcli.batch.benchmark.processes import LOADING, answers
from slamcli.batch.benchmark.result import BenchResult, Data, Row, Run
from slamcli.batch.provenance import provenance
from slamcli.errors import InputError

Json = dict[str, Any]
#: A child's answers to a request: number of tasks, seconds for each, seconds to load, threads.
Ask = Callable[[Json, int, Callable[[], float], float, int], Iterator[Json]]
#: The search with a setting of a peer may take this many times the fastest run so far, and the least seconds: it has
#: four runs and more, so what is given up is slower than that.
PATIENCE, LEAST = 8.0, 3.0
#: Iterations that a peer may need on top of those of the search.
MORE = 3


def described(name: str, path: Path) -> Data:
    """A graph of the benchmark: its counts, its hash, and the optimum that the registry of data sets has for it.

    Raises
    ------
    InputError
        If it cannot be read or has nothing to optimize.
    """
    graph = slamcli.read(str(path))
    if not graph.edges:
        raise InputError(f"{path}: has no edge that slamcli can use: nothing to optimize")
    digest = graph.document.sha256 if graph.document else hashlib.sha256(path.read_bytes()).hexdigest()
    return Data(name, str(path), digest, graph.poses, graph.landmarks, graph.edges, _optimum(digest))


def _optimum(digest: str) -> float | None:
    """Of the data set with this hash, if its convention is ours."""
    from slamcli.batch.datasets.registry import load

    for entry in load().values():
        if not entry.is_folder and entry.sha256 == digest and entry.optimum is not None:
            # slamcli's chi2 of a file is that of its format, also of TORO's
            return entry.optimum.chi2 if entry.optimum.convention != "chordal" else None
    return None


def _ask(request: Json, count: int, limit: Callable[[], float], loading: float, threads: int) -> Iterator[Json]:
    return answers(request, count, limit, loading=loading, threads=threads)


def run(
    data: tuple[Data, ...],
    variants: tuple[Variant, ...],
    *,
    repeats: int = 5,
    time_limit: float = 120.0,
    threads: int = 1,
    ask: Ask = _ask,
    tick: Callable[[str], None] = lambda words: None,
) -> BenchResult:
    """Run a benchmark; an interruption ends it with what it has.

    Parameters
    ----------
    data, variants
        What is compared; the first variant is the reference of the ratios.
    repeats
        Runs of each variant on each graph.
    time_limit
        Seconds for each process.
    threads
        Of each process's libraries.
    ask
        Runs a child.
    tick
        Called before each piece of work with what it is; ``steps`` of them in all.
    """
    peers = [variant.tool for variant in variants if variant.is_peer]
    result = BenchResult(data, variants, [], repeats, time_limit, threads, provenance(peers))
    try:
        for one in data:
            with tempfile.TemporaryDirectory() as scratch:
                _Alternation(one, result, Path(scratch) / "reference.npz", ask, tick).run()
    except KeyboardInterrupt:
        result.interrupted = True
    return result


def steps(data: tuple[Data, ...], variants: tuple[Variant, ...], repeats: int) -> int:
    """How often ``run`` calls its ``tick``."""
    return len(data) * len(variants) * (1 + repeats)


class _Alternation:
    """One graph."""

    def __init__(self, data: Data, result: BenchResult, reference: Path, ask: Ask, tick: Callable[[str], None]) -> None:
        self.data, self.result, self.reference, self.ask, self.tick = data, result, reference, ask, tick
        self.rows = [Row(data, variant) for variant in result.variants]
        self.counts: dict[str, int] = {}
        self.arrived: set[str] = set()
        self.best: float | None = None
        result.rows += self.rows

    def run(self) -> None:
        """Warm-up, the search for the peers' settings, the alternating runs."""
        lowest = [self.data.optimum] if self.data.optimum is not None else []
        for row in self.rows:
            if not row.variant.is_peer:
                self.tick(f"{self.data.name}: {row.variant.label}, warm-up")
                warm = self._once(row)
                lowest += [warm.chi2] if warm.chi2 is not None and row.variant.minimizes_chi2 else []
                if warm.solve is None:
                    row.remark = warm.note
        self.best = min(lowest, default=None)
        if any(row.variant.is_peer for row in self.rows):
            self._refer()
        for row in self.rows:
            if row.variant.is_peer:
                self._search(row)
        for number in range(self.result.repeats):
            for row in self.rows:
                if row.remark or (row.last is not None and row.last.solve is None):
                    self.tick("")
                    continue
                self.tick(f"{self.data.name}: {row.variant.label}, run {number + 1}")
                row.runs.append(self._counted(row))

    def _request(self, tool: str, tasks: list[Any]) -> Json:
        path = str(Path(self.data.path).resolve())
        return {"path": path, "peer": tool, "best": self.best, "reference": str(self.reference), "tasks": tasks}

    def _counted(self, row: Row) -> Run:
        """A run for the table; a peer that was at the optimum in the search gets there again.

        g2o's spanning tree depends on addresses in memory, and with it the number of iterations.
        """
        run = self._once(row)
        for _ in range(MORE if row.variant.tool in self.arrived else 0):
            if run.solve is None or self.best is None or run.reached(self.best):
                break
            self.counts[row.variant.tool] += 1
            run = self._once(row)
        return run

    def _once(self, row: Row) -> Run:
        """One process with one task."""
        task = [row.setting, self.counts[row.variant.tool]] if row.variant.is_peer else dict(row.variant.options)
        started = time.perf_counter()
        request, limit = self._request(row.variant.tool, [task]), self.result.time_limit
        (answer,) = self.ask(request, 1, lambda: limit, 0.0, self.result.threads)
        return Run.of(answer, time.perf_counter() - started)

    def _refer(self) -> None:
        """Values at the lowest chi2 that slamcli finds, for the peers' own cost there."""
        request = self._request("reference", [])
        del request["tasks"]
        (answer,) = self.ask(request, 1, lambda: max(300.0, self.result.time_limit), LOADING, self.result.threads)
        chi2 = answer["chi2"]
        if chi2 is not None and math.isfinite(chi2):
            self.best = chi2 if self.best is None else min(self.best, chi2)

    def _search(self, row: Row) -> None:
        """The setting of a peer that is fastest of those that reach the optimum, or comes lowest if none does.

        Damped methods are tried only where Gauss-Newton does not get there: their iterations are no cheaper.
        """
        peer, settings = row.variant.tool, tried(row.variant.tool)
        self.tick(f"{self.data.name}: {peer}, looking for its fastest setting")
        found: list[tuple[Setting, Json]] = []

        def limit() -> float:
            fastest = [one["solve"] for _, one in found if one["reached"]]
            return min([self.result.time_limit, *(max(LEAST, PATIENCE * solve) for solve in fastest)])

        plain = [setting for setting in settings if setting.method == "gn"]
        for stage in (plain, [setting for setting in settings if setting.method != "gn"]):
            if not stage or any(answer["reached"] for _, answer in found):
                continue
            request = self._request(peer, [[setting.name, None] for setting in stage])
            replies = self.ask(request, len(stage), limit, LOADING, self.result.threads)
            for setting, answer in zip(stage, replies, strict=True):
                found.append((setting, answer))
        solved = [pair for pair in found if pair[1]["solve"] is not None and pair[1]["chi2"] is not None]
        if not solved:
            notes = list(dict.fromkeys(str(one["note"]) for _, one in found))
            row.remark = "; ".join(notes[:2]) or "no setting gave a result"
            return
        reached = [pair for pair in solved if pair[1]["reached"]]
        setting, chosen = (
            min(reached, key=lambda pair: float(pair[1]["solve"]))
            if reached
            else min(solved, key=lambda pair: float(pair[1]["chi2"]) if math.isfinite(pair[1]["chi2"]) else math.inf)
        )
        row.setting = setting.name
        self.arrived |= {peer} if reached else set()
        self.counts[peer] = max(int(chosen["iterations"]), 1)
