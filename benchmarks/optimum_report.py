"""The tables of the benchmark of the optimum, from the document of what was measured."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator
from typing import Any

from benchmarks.settings import CALIBRATION, LEFT_OUT, STATED, PoseGraph
from benchmarks.tables import ms, table
from slamcli.batch.benchmark.case import reaches
from slamcli.batch.benchmark.peers.settings import SETTINGS

Json = dict[str, Any]
#: Note beside settings that start from slamcli's chordal start, which is not counted.
BORROWED = "†"
_NOTES = f"""
Solve: everything between the loaded graph and the converged one, initialization and symbolic analysis included; median
milliseconds of alternating runs (range), each in a process of its own, the second of two runs in it. Each peer runs the
fewest iterations that reach the optimum, as if they were known. chi2 is slamcli's on the values that each tool ends
with, quaternions normalized. "own": at the optimum of the peer's own cost, which differs beyond the second order, and
polishing (not counted) gives the best known chi2. {BORROWED}: from slamcli's chordal start, which is not counted; such
settings count neither as the fastest peer nor for the goal.
"""


def outcome(answer: Json) -> str:
    """One answer in words, for progress and for the first pass."""
    if answer["solve"] is None:
        return str(answer["note"])
    cost = "-" if answer["chi2"] is None else f"{answer['chi2']:.10g}"
    mark = "reached" if answer["reached"] else "missed"
    return f"{answer['solve'] * 1e3:8.1f} ms, {answer['iterations']} iterations, chi2 {cost}, {mark} {answer['note']}"


def report(entries: dict[PoseGraph, Json], peers: list[str], versions: Json, settings: bool) -> str:
    """All tables in Markdown."""
    known = ", ".join(f"{peer} {versions[peer]}" for peer in peers)
    parts = [f"# Final chi2 and total time: slamcli and {known or 'no peers'}", _NOTES]
    parts += [f"{peer} is left out: {why}." for peer, why in LEFT_OUT.items()]
    ours = {str(entry["ours"]) for entry in entries.values() if entry.get("ours")}
    parts += [f"\nslamcli's options: {options}" for options in sorted(ours)]
    measured = {data: entry for data, entry in entries.items() if "runs" in entry}
    if measured:
        parts.append(_optimum(measured, peers))
        parts.append(_phases(measured))
        parts.append(_process(measured))
        parts.append(_stated(measured))
    if settings or not measured:
        parts.append(_first_pass(entries, peers))
    return "\n".join(part for part in parts if part)


def _solves(runs: list[Json]) -> list[float]:
    return [one["solve"] for one in runs if one["solve"] is not None]


def _reached(data: PoseGraph, chi2: float | None) -> bool:
    return chi2 is not None and reaches(chi2, data.best)


def ratio(ours: list[Json], theirs: list[Json]) -> float:
    """Median over the repetitions of our solve time over a peer's in the same one; NaN where there is none."""
    pairs = zip(ours, theirs, strict=False)
    ratios = [a["solve"] / b["solve"] for a, b in pairs if a["solve"] is not None and b["solve"] is not None]
    return statistics.median(ratios) if ratios else math.nan


def ranking(entry: Json, peer: str, *, borrowed: bool = False) -> list[str]:
    """Settings of a peer that reached the optimum in the alternating runs, fastest first."""
    runs = entry["runs"]["peers"].get(peer, {})
    starts = {setting.name: setting.borrowed for setting in SETTINGS[peer]}
    names = [
        n for n, r in runs.items() if starts.get(n) == borrowed and _solves(r) and all(one["reached"] for one in r)
    ]
    return sorted(names, key=lambda name: statistics.median(_solves(runs[name])))


def _optimum(entries: dict[PoseGraph, Json], peers: list[str]) -> str:
    rows, missed = [], 0
    for data, entry in entries.items():
        runs, ours = entry["runs"], entry["runs"]["slamcli"]
        size = f"{entry['reference']['vertices']}/{entry['reference']['edges']}"
        cells, ratios = [], {}
        for peer in peers:
            best, lent = ranking(entry, peer), ranking(entry, peer, borrowed=True)
            if best:
                ratios[peer] = ratio(ours, runs["peers"][peer][best[0]])
            cells.append(
                "<br>".join(_peer_cell(entry, peer, name) for name in best[:1] + lent[:1]) or "does not reach it"
            )
        fastest = max(ratios.values(), default=math.nan)
        reached = all(_reached(data, one["chi2"]) for one in ours)
        met = _met(data, reached, fastest, _open(entry, peers))
        missed += met.startswith("**")
        times = _solves(ours)
        mine = f"{ms(times)}, {ours[-1]['iterations']} it." if times else str(ours[-1]["note"])
        chi2 = "-" if ours[-1]["chi2"] is None else f"{ours[-1]['chi2']:.10g}"
        shown = ", ".join(f"{peer} {value:.2f}" for peer, value in ratios.items())
        goal = "" if data.goal is None else f"{data.goal}"
        rows.append((data.name, size, f"{data.best:.9g}", chi2, mine, *cells, shown, goal, met))
    header = ("set", "V/E", "best known chi2", "slamcli: chi2", "slamcli: solve, ms", *peers)
    words = f"\n\n{missed} of {len(entries)} sets miss the optimum or the goal." if missed else ""
    return table("Optimum and solve time", (*header, "slamcli / peer", "goal", "met"), rows) + words


def _peer_cell(entry: Json, peer: str, name: str) -> str:
    runs = entry["runs"]["peers"][peer][name]
    setting = next(setting for setting in SETTINGS[peer] if setting.name == name)
    own = " (own)" if runs[-1]["note"] else ""
    mark = f" {BORROWED}" if setting.borrowed else ""
    return f"{ms(_solves(runs))}, {name}{mark}, {runs[-1]['iterations']} it., {runs[-1]['chi2']:.10g}{own}"


def _open(entry: Json, peers: list[str]) -> int:
    """Settings that the first pass has not tried, or stopped, so that nobody knows whether they reach the optimum."""
    passes = [(entry["first_pass"].get(peer, {}), SETTINGS[peer]) for peer in peers]
    return sum(one.name not in found or "stopped" in found[one.name] for found, tried in passes for one in tried)


def _met(data: PoseGraph, reached: bool, fastest: float, unknown: int) -> str:
    """``fastest`` is the ratio to the fastest peer, the largest of all."""
    if not reached:
        return "**chi2 missed**"
    if data.goal is None:
        return "chi2 reached"
    if math.isnan(fastest):
        return f"open: {unknown} settings not tried to the end" if unknown else "yes: no peer reaches it"
    if fastest > data.goal:
        return f"**no: {fastest:.2f}**"
    return f"yes, but {unknown} settings not tried to the end" if unknown else "yes"


def _phases(entries: dict[PoseGraph, Json]) -> str:
    """Where slamcli's solve time goes."""
    names = ("init", "pattern", "order", "analyze", "linearize", "assemble", "factorize", "solve", "retract")
    rows = []
    for data, entry in entries.items():
        ours = [one for one in entry["runs"]["slamcli"] if one["solve"] is not None]
        if not ours:
            continue
        medians = {
            name: statistics.median(one["phases"].get(name, 0.0) for one in ours)
            for name in (*names, *_others(ours, names))
        }
        whole = statistics.median(_solves(ours))
        cold = statistics.median(one["cold"] for one in ours)
        shown = [f"{medians[name] * 1e3:.1f}" for name in names]
        other = ", ".join(f"{name} {value * 1e3:.1f}" for name, value in medians.items() if name not in names)
        rest = f"{(whole - sum(medians.values())) * 1e3:.1f}"
        rows.append((data.name, ours[-1]["start"], *shown, other, rest, f"{whole * 1e3:.1f}", f"{cold * 1e3:.1f}"))
    header = ("set", "start", *names, "other phases", "rest", "all", "first run in the process")
    return table("Where slamcli's solve time goes, ms", header, rows)


def _others(ours: list[Json], names: tuple[str, ...]) -> Iterator[str]:
    return (name for name in ours[-1]["phases"] if name not in names)


def _process(entries: dict[PoseGraph, Json]) -> str:
    """The whole process and its parts."""
    rows = []
    for data, entry in entries.items():
        told = [one for one in entry["runs"]["process"] if "total" in one]
        if not told:
            rows.append((data.name, *("-",) * 7, " ".join(str(entry["runs"]["process"][-1].get("error")).split())))
            continue

        def median(name: str, told: list[Json] = told) -> float:
            return statistics.median(one[name] for one in told)

        other = statistics.median(
            one["wall"] - one["load"] - one["setup"] - one["iterate"] - one["write"] for one in told
        )
        cells = [median("load"), median("init"), median("setup") - median("init"), median("iterate"), median("write")]
        ended = "" if told[-1]["exit_code"] == 0 else f"exit code {told[-1]['exit_code']}"
        shown = [f"{cell * 1e3:.0f}" for cell in (other, *cells)]
        rows.append((data.name, ms([one["wall"] for one in told]), *shown, ended))
    header = (
        "set",
        "wall",
        "interpreter, imports, report",
        "load",
        "init",
        "rest of setup",
        "iterate",
        "write",
        "note",
    )
    return table("The whole process `slamcli optimize FILE -o OUT`, ms", header, rows)


def _stated(entries: dict[PoseGraph, Json]) -> str:
    """Times of tools that no wheel brings, scaled by what GTSAM takes now over what it took there."""
    here: dict[str, float] = {}
    for data, entry in entries.items():
        runs = entry["runs"]["peers"].get("gtsam", {})
        times = [statistics.median(_solves(runs[name])) for name in CALIBRATION if name in runs and _solves(runs[name])]
        if times:
            here[data.path] = min(times)
    factors = [here[one.path] * 1e3 / one.solve for one in STATED if one.tool == "gtsam" and one.path in here]
    factor = statistics.geometric_mean(factors) if factors else None
    rows = []
    for data, entry in entries.items():
        ours = _solves(entry["runs"]["slamcli"])
        for one in STATED:
            if one.path != data.path or not ours:
                continue
            mine = statistics.median(ours) * 1e3
            cells = ("-", "-") if factor is None else (f"{one.solve * factor:.1f}", f"{mine / one.solve / factor:.2f}")
            now = f"{here[one.path] * 1e3:.1f}" if one.tool == "gtsam" and one.path in here else ""
            rows.append((data.name, one.tool, one.setting, f"{one.solve:g}", now, *cells))
    if not rows:
        return ""
    words = "none: neither sphere2500 nor torus3D was run with gtsam" if factor is None else f"{factor:.2f}"
    header = ("set", "tool", "setting", "there, ms", "now, ms", "there, calibrated", "slamcli / calibrated")
    note = f"Measured once on a machine of this kind; calibration (GTSAM's chordal start and GN, now / there): {words}."
    return table("Times stated for tools that cannot be rerun here", header, rows) + "\n\n" + note


def _first_pass(entries: dict[PoseGraph, Json], peers: list[str]) -> str:
    """Every setting that was tried, the fastest first, what missed last."""
    rows = []
    for data, entry in entries.items():
        for peer in peers:
            found = entry["first_pass"].get(peer, {})
            for name in sorted(found, key=lambda n, f=found: (not f[n]["reached"], f[n]["solve"] or math.inf)):
                one = found[name]
                time = "-" if one["solve"] is None else f"{one['solve'] * 1e3:.1f}"
                chi2 = "-" if one["chi2"] is None else f"{one['chi2']:.10g}"
                mark = f" {BORROWED}" if name.endswith(" chordal") else ""
                reached = "yes" if one["reached"] else "no"
                rows.append((data.name, peer, name + mark, time, str(one["iterations"]), chi2, reached, one["note"]))
    header = ("set", "peer", "setting", "solve, ms", "iterations", "chi2", "reached", "note")
    return table("First pass: each setting once", header, rows)
