"""Filter against smoother: their paths and maps, how sure they are, and what a loop closure does to each pose."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from slamcli.batch.closing import Closing
from slamcli.batch.compare import Comparison, Method
from slamcli.evaluation.alignment import Alignment
from slamcli.geometry import so2
from slamcli.graph.columns import finite_rows
from slamcli.models.base import Array
from slamcli.reporting.plots import style
from slamcli.reporting.plots.regions import outlines
from slamcli.reporting.plots.style import FigureOptions
from slamcli.reporting.plots.thinning import envelope, spread, thin_path

#: Poses whose regions are drawn, and landmarks.
_POSE_REGIONS, _LANDMARK_REGIONS = 24, 400
#: Dead reckoning that leaves more than this many times the extent of the rest is cut off.
_WIDER = 1.6
_BINS = 1500
_LOOKS: dict[str, dict[str, Any]] = {
    "dead reckoning": {"color": style.GREY, "linestyle": (0, (1.2, 1.2)), "linewidth": 1.2},
    "filter": {"color": style.VERMILLION, "linestyle": "-", "linewidth": 1.3},
    "smoother": {"color": style.BLUE, "linestyle": (0, (5, 1.2)), "linewidth": 1.3},
}
_TRUTH: dict[str, Any] = {"color": style.INK, "linestyle": "-", "linewidth": 0.7}


def draw_comparison(comparison: Comparison, options: FigureOptions | None = None) -> Figure:
    """Draw a comparison in three panels.

    (a) paths of dead reckoning, filter (each pose as it was at its step), smoother and truth, with regions of 95 %
    probability of landmarks and of some poses; (b) the standard deviation of each position, the root of the summed
    variances of x and y; (c) metres by which the readings of the loop closure move each pose.
    """
    options = options or FigureOptions()
    figure = style.new_figure(options.size or (10.2, 5.6))
    closure = comparison.closure
    grid = figure.add_gridspec(2, 2, width_ratios=(1.2, 1.0)) if closure else figure.add_gridspec(1, 2)
    _map(figure.add_subplot(grid[:, 0]), comparison)
    style.headline(figure.axes[0], options.title or os.path.basename(comparison.log.source), "")
    above = figure.add_subplot(grid[0, 1])
    _uncertainty(above, comparison)
    if closure is None:
        above.set_xlabel("step")
    else:
        below = figure.add_subplot(grid[1, 1], sharex=above)
        _corrections(below, closure)
        above.tick_params(labelbottom=False)
        figure.align_ylabels([above, below])
        for axes in (above, below):
            axes.axvline(closure.step, color=style.PALE, linewidth=0.8, zorder=0)
    style.legend(figure, _entries(comparison))
    return figure


def _entries(c: Comparison) -> list[tuple[Any, str]]:
    entries = [(Line2D([], [], **_LOOKS[method.name]), method.name) for method in c.methods]
    if c.truth is not None:
        entries.append((Line2D([], [], **_TRUTH), "truth"))
    entries.append(
        (Line2D([], [], color=style.GREY, linestyle="none", marker="o", markerfacecolor="none"), "95 % region")
    )
    if c.closure is not None:
        entries.append((Line2D([], [], color=style.GREY, linestyle="none", marker="X", markersize=6.0), "loop closure"))
    return entries


def _map(axes: Axes, c: Comparison) -> None:
    moves = [_alignment(method) for method in c.methods]
    paths = [_moved(move, method.poses[:, :2]) for move, method in zip(moves, c.methods, strict=True)]
    points = [_moved(move, method.landmarks) for move, method in zip(moves, c.methods, strict=True)]
    shown = [*paths[1:], *points[1:]]
    if c.truth is not None:
        shown.append(c.truth.positions[:, :2])
    low, high = _limits(shown, paths[0])
    cell = 0.5 * float((high - low).max()) / 1000.0
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.0)
    axes.update_datalim([low, high])
    axes.autoscale_view()
    axes.set(xlabel="x (m)", ylabel="y (m)")
    axes.grid(True)
    for number, (method, path) in enumerate(zip(c.methods, paths, strict=True)):
        look = _LOOKS[method.name] | {"linewidth": 1.3 if len(path) < 2000 else 0.9, "zorder": 3 + number}
        rows = thin_path(path, cell)
        axes.plot(*path[rows].T, **look, rasterized=len(rows) > 3000, scalex=False, scaley=False)
    if c.truth is not None:
        path = c.truth.positions[thin_path(c.truth.positions[:, :2], cell)]
        axes.plot(path[:, 0], path[:, 1], **_TRUTH, zorder=7, scalex=False, scaley=False)
    for number in (1, 2):
        method, move = c.methods[number], moves[number]
        colour = _LOOKS[method.name]["color"]
        few = spread(len(method.landmarks), _LANDMARK_REGIONS)
        assert method.landmark_covariances is not None
        _regions(axes, points[number][few], _turned(move, method.landmark_covariances[few]), colour, 0.9, 6 + number)
        axes.plot(*points[number].T, ".", color=colour, markersize=2.5, zorder=6 + number, scalex=False, scaley=False)
    _pose_regions(axes, c, paths[1], moves[1])
    if c.closure is not None:
        at = paths[1][c.closure.step]
        look = {"marker": "X", "markersize": 8.0, "markeredgecolor": "white", "zorder": 10}
        axes.plot(*at, color=style.INK, **look, scalex=False, scaley=False)


def _pose_regions(axes: Axes, c: Comparison, path: Array, move: Alignment | None) -> None:
    """Regions of some of the filter's poses, each as it was at its step."""
    chosen = spread(len(path), _POSE_REGIONS)
    rotation = so2.to_matrix(c.run.poses[chosen, 2:3])
    local = c.run.covariances[chosen, :2, :2]
    world = rotation @ local @ rotation.transpose(0, 2, 1)
    _regions(axes, path[chosen], _turned(move, world), _LOOKS["filter"]["color"], 0.5, 5)


def _regions(axes: Axes, points: Array, covariances: Array, colour: str, width: float, zorder: float) -> None:
    if not len(points):
        return
    padded = np.zeros((len(points), 3, 3))
    padded[:, :2, :2] = covariances
    loops = outlines(np.pad(points, ((0, 0), (0, 1))), padded, (0, 1))
    lines = LineCollection(list(loops), colors=colour, linewidths=width, alpha=0.9, zorder=zorder)
    axes.add_collection(lines, autolim=False)


def _limits(shown: list[Array], reckoned: Array) -> tuple[Array, Array]:
    """What the view shows: everything, but of dead reckoning no more than a margin around the rest."""
    points = np.concatenate([part[finite_rows(part)] for part in shown])
    low, high = points.min(axis=0), points.max(axis=0)
    room = 0.5 * (_WIDER - 1.0) * float((high - low).max())
    low = np.maximum(np.minimum(low, reckoned.min(axis=0)), low - room)
    high = np.minimum(np.maximum(high, reckoned.max(axis=0)), high + room)
    margin = max(0.06 * float((high - low).max()), 1e-6)
    return low - margin, high + margin


def _uncertainty(axes: Axes, c: Comparison) -> None:
    highest = 0.0
    for method in c.methods:
        covariances, steps = method.covariances, c.sampled
        if method.name == "filter":
            covariances, steps = c.run.covariances, np.arange(len(c.log))
        deviation = np.sqrt(np.maximum(covariances[:, 0, 0] + covariances[:, 1, 1], 0.0))
        rows = envelope(steps.astype(np.float64), deviation, _BINS)
        axes.plot(steps[rows], deviation[rows], **_LOOKS[method.name], rasterized=len(rows) > 3000)
        if method.name != "dead reckoning":
            highest = max(highest, float(deviation.max()))
    axes.set_ylim(-0.03 * highest, 1.15 * max(highest, 1e-12))
    axes.set_xlim(0, max(len(c.log) - 1, 1))
    axes.set_ylabel("deviation of the position (m)")
    axes.grid(True)


def _corrections(axes: Axes, closure: Closing) -> None:
    steps = np.arange(closure.step + 1)
    for name, correction in (("smoother", closure.smoother), ("filter", closure.filter)):
        rows = envelope(steps.astype(np.float64), correction.metres, _BINS)
        axes.plot(steps[rows], correction.metres[rows], **_LOOKS[name], rasterized=len(rows) > 3000)
    end: dict[str, Any] = {"marker": "X", "markersize": 7.0, "markeredgecolor": "white", "clip_on": False, "zorder": 5}
    axes.plot(closure.step, closure.filter.metres[-1], color=_LOOKS["filter"]["color"], **end)
    highest = max(closure.filter.largest, closure.smoother.largest, 1e-12)
    axes.set_ylim(-0.04 * highest, 1.15 * highest)
    axes.set_ylabel("moved by the closure (m)")
    axes.set_xlabel("step")
    axes.grid(True)


def _alignment(method: Method) -> Alignment | None:
    return None if method.against_truth is None else method.against_truth.alignment


def _moved(move: Alignment | None, points: Array) -> Array:
    """Points (n, 2) in the frame of the truth."""
    if move is None:
        return points
    return move.points(np.pad(points, ((0, 0), (0, 1))))[:, :2]


def _turned(move: Alignment | None, covariances: Array) -> Array:
    """Covariances (n, 2, 2) in the frame of the truth."""
    if move is None:
        return covariances
    turn = move.rotation[:2, :2]
    return turn @ covariances @ turn.T
