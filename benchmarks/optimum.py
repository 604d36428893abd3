"""Final chi2 and total time of slamcli and its peers: ``python -m benchmarks.optimum [SET ...]``.

A first pass tries every setting of every peer once; those that reach the best known optimum are candidates. The fastest
of each peer then alternate with slamcli in processes of their own, and with whole runs of ``slamcli optimize``. With
``--json FILE`` everything is kept: a later run goes on with the settings that the first pass has not tried yet and
measures the alternating part anew (``--resume`` keeps that, too). Needs the standard data sets (SLAMCLI_DATASETS).
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

from benchmarks import optimum_report
from benchmarks.settings import CALIBRATION, LEFT_OUT, POSE_GRAPHS, STATED, PoseGraph
from slamcli.batch.benchmark.peers.settings import SETTINGS, Setting
from slamcli.batch.benchmark.processes import answers

Json = dict[str, Any]
#: Settings this near to the fastest of a peer in the first pass alternate as well, so many of them at most.
NEAR, CANDIDATES = 1.25, 2


class Benchmark:
    """One run: what the command line asks for, and the document of everything measured."""

    def __init__(self, options: argparse.Namespace, folders: list[Path], scratch: Path) -> None:
        self.options, self.folders, self.scratch = options, folders, scratch
        self.ours = {key: value for key in ("init", "method") if (value := getattr(options, key)) is not None}
        self.document: Json = {"versions": {}, "sets": {}}
        if options.json is not None and options.json.exists():
            self.document = json.loads(options.json.read_text(encoding="utf-8"))
        for peer in options.peers:
            now = version(peer)
            if self.document["versions"].setdefault(peer, now) != now:
                for entry in self.document["sets"].values():
                    entry["first_pass"].pop(peer, None)
                self.document["versions"][peer] = now

    def path(self, data: PoseGraph) -> Path | None:
        """Where a set is."""
        return next((folder / data.path for folder in self.folders if (folder / data.path).is_file()), None)

    def run(self, data: PoseGraph) -> None:
        """Both parts on one set; what is done is saved."""
        path = self.path(data)
        if path is None:
            say(f"{data.path}: not at hand, left out")
            return
        entry = self.document["sets"].setdefault(data.path, {"first_pass": {}})
        say(data.path)
        self._reference(data, path, entry)
        for peer in self.options.peers:
            self._first_pass(data, path, entry, peer)
        if self.options.repeats and not (self.options.resume and entry.get("ours") == self.ours and "runs" in entry):
            self._alternate(data, path, entry)
            entry["ours"] = self.ours
            self._save()

    def _reference(self, data: PoseGraph, path: Path, entry: Json) -> None:
        """Values at the optimum, for the peers' own cost there."""
        at = self.scratch / f"{data.name}.npz"
        request = {"path": str(path), "peer": "reference", "best": data.best, "reference": str(at)}
        untried = any(self._untried(entry, peer) for peer in self.options.peers)
        if untried or self.options.repeats:
            (found,) = answers(request, 1, lambda: 300.0)
            entry["reference"] = found

    def _limit(self, found: Json) -> float:
        """Seconds for a setting: what is far slower than the fastest so far needs no end."""
        solves = [one["solve"] for one in found.values() if one["reached"]]
        return min([self.options.limit, *(max(5.0, 20.0 * solve) for solve in solves)])

    def _untried(self, entry: Json, peer: str) -> list[Setting]:
        """Settings that the first pass has not tried, or with a shorter limit than it would have now."""
        found = entry["first_pass"].get(peer, {})
        limit = self._limit(found)
        return [
            setting
            for setting in SETTINGS[peer]
            if set(self.options.only) <= set(setting.name.split())
            and (setting.name not in found or found[setting.name].get("stopped", limit) < 0.9 * limit)
        ]

    def _first_pass(self, data: PoseGraph, path: Path, entry: Json, peer: str) -> None:
        found = entry["first_pass"].setdefault(peer, {})
        tasks = [[setting.name, None] for setting in self._untried(entry, peer)]

        request = self._request(data, path, peer, tasks)
        for (name, _), answer in zip(tasks, answers(request, len(tasks), lambda: self._limit(found)), strict=True):
            found[name] = answer
            say(f"  {peer:6} {name:28} {optimum_report.outcome(answer)}")
            self._save()

    def _request(self, data: PoseGraph, path: Path, peer: str, tasks: list[Any]) -> Json:
        reference = str(self.scratch / f"{data.name}.npz")
        return {"path": str(path), "peer": peer, "best": data.best, "reference": reference, "tasks": tasks}

    def _candidates(self, data: PoseGraph, entry: Json, peer: str) -> list[str]:
        """Settings to alternate: the fastest, from slamcli's chordal start as well, and the one that calibrates."""
        settings = {setting.name: setting for setting in SETTINGS[peer]}
        reached = {name: one for name, one in entry["first_pass"][peer].items() if one["reached"] and name in settings}
        names = sorted(reached, key=lambda name: reached[name]["solve"])
        own = [name for name in names if not settings[name].borrowed]
        chosen = [name for name in own if reached[name]["solve"] <= NEAR * reached[own[0]]["solve"]][:CANDIDATES]
        chosen += [name for name in names if settings[name].borrowed][:1]
        if peer == "gtsam" and any(one.path == data.path and one.tool == peer for one in STATED):
            chosen += [name for name in own if name in CALIBRATION][:1]
        return list(dict.fromkeys(chosen))

    def _alternate(self, data: PoseGraph, path: Path, entry: Json) -> None:
        chosen = [(peer, name) for peer in self.options.peers for name in self._candidates(data, entry, peer)]
        runs: Json = {"slamcli": [], "process": [], "peers": {peer: {} for peer in self.options.peers}}
        for _ in range(self.options.repeats):
            (one,) = answers(self._request(data, path, "slamcli", [self.ours]), 1, lambda: 300.0)
            runs["slamcli"].append(one)
            for peer, name in chosen:
                count = entry["first_pass"][peer][name]["iterations"]
                (one,) = answers(self._request(data, path, peer, [[name, count]]), 1, lambda: 300.0)
                runs["peers"][peer].setdefault(name, []).append(one)
            runs["process"].append(self._process(path))
        entry["runs"] = runs
        say(f"  slamcli {optimum_report.outcome(runs['slamcli'][-1])}")

    def _process(self, path: Path) -> Json:
        """``slamcli optimize FILE -o OUT`` from start to end."""
        command = [str(Path(sys.executable).with_name("slamcli")), "optimize", str(path), "--json", "--quiet"]
        command += ["-o", str(self.scratch / "out.g2o")]
        command += [word for key, value in self.ours.items() for word in (f"--{key}", str(value))]
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
        started = time.perf_counter()
        done = subprocess.run(command, capture_output=True, text=True, env=environment)
        wall = time.perf_counter() - started
        try:
            told = json.loads(done.stdout)
        except json.JSONDecodeError:
            return {"wall": wall, "exit_code": done.returncode, "error": done.stderr.strip()[-200:]}
        init = told["phases"].get("init", 0.0)
        return {"wall": wall, "exit_code": done.returncode, "init": init, "chi2": told["final_chi2"]} | told["time"]

    def _save(self) -> None:
        if self.options.json is None:
            return
        part = self.options.json.with_suffix(".part")
        part.write_text(json.dumps(self.document, indent=1), encoding="utf-8")
        part.replace(self.options.json)


def say(words: str) -> None:
    """Progress, on standard error."""
    print(words, file=sys.stderr, flush=True)


def chosen_sets(words: list[str]) -> list[PoseGraph]:
    """The sets whose paths contain one of the words, or all."""
    unknown = [word for word in words if not any(word in data.path for data in POSE_GRAPHS)]
    if unknown:
        sys.exit(f"no such set: {', '.join(unknown)}; there are {', '.join(data.name for data in POSE_GRAPHS)}")
    return [data for data in POSE_GRAPHS if not words or any(word in data.path for word in words)]


def arguments() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sets", nargs="*", metavar="SET", help="parts of paths of data sets (default: all)")
    parser.add_argument("--repeats", type=int, default=5, help="alternating runs; 0: first pass only (default 5)")
    parser.add_argument("--peers", default="gtsam,g2opy", help="which of gtsam, g2opy, ceres (default gtsam,g2opy)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="keep what is measured, and go on from it")
    parser.add_argument("--export", type=Path, metavar="FILE", help="write the tables to a Markdown file as well")
    parser.add_argument(
        "--limit", type=float, default=60.0, help="seconds for a setting in the first pass (default 60)"
    )
    parser.add_argument(
        "--only", action="append", default=[], metavar="WORD", help="settings with this word (gn, METIS)"
    )
    parser.add_argument("--resume", action="store_true", help="keep the alternating runs that are there")
    parser.add_argument("--settings", action="store_true", help="print the first pass, setting by setting, as well")
    parser.add_argument("--more-data", type=Path, action="append", default=[], help="another folder with data sets")
    parser.add_argument("--init", help="slamcli's start (default: its own)")
    parser.add_argument("--method", help="slamcli's method (default: its own)")
    return parser.parse_args()


def main() -> None:
    """Measure what the command line names and print the tables."""
    options = arguments()
    wanted = [peer for peer in options.peers.split(",") if peer]
    for peer in wanted:
        if peer not in SETTINGS:
            say(f"{peer} is left out: {LEFT_OUT.get(peer, 'there is no such peer')}")
        elif importlib.util.find_spec(peer) is None:
            say(f"{peer} is left out: it is not installed")
    options.peers = [peer for peer in wanted if peer in SETTINGS and importlib.util.find_spec(peer)]
    folder = Path(os.environ.get("SLAMCLI_DATASETS") or "/nonexistent")
    sets = chosen_sets(options.sets)
    with tempfile.TemporaryDirectory() as scratch:
        benchmark = Benchmark(options, [folder, *options.more_data], Path(scratch))
        try:
            for data in sets:
                benchmark.run(data)
        except KeyboardInterrupt:
            say("interrupted: the tables hold what is done")
    entries = {data: benchmark.document["sets"][data.path] for data in sets if data.path in benchmark.document["sets"]}
    report = optimum_report.report(entries, options.peers, benchmark.document["versions"], options.settings)
    print(report)
    if options.export is not None:
        options.export.write_text(report + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
