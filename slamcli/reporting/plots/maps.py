"""Maps: trajectories, loop closures, landmarks and uncertainty, in a plane or in space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from slamcli.errors import InputError
from slamcli.graph.columns import finite_rows
from slamcli.models.base import Array
from slamcli.reporting.plots import style
from slamcli.reporting.plots.canvas import VIEWS, Canvas, Planar, Spatial
from slamcli.reporting.plots.regions import Regions, outlines
from slamcli.reporting.plots.scene import CLOSURE, FEW, OBSERVATION, Edges, Estimate
from slamcli.reporting.plots.style import FigureOptions
from slamcli.reporting.plots.thinning import spread, thin_path
from slamcli.reporting.text import plural

#: Layers from below.
_OBSERVATIONS, _CLOSURES, _EDGES, _PATH, _REGIONS, _LANDMARKS, _TRUTH, _POSES, _MARKS = range(1, 10)
#: More lines of one kind than that make a grey carpet, and the figure slow.
MOST_CLOSURES, MOST_OBSERVATIONS, MOST_COLOURED = 5000, 5000, 30_000
#: Poses whose uncertainty is drawn.
MOST_POSE_REGIONS = 25
#: Paths of more poses are drawn without dashes and thinner, still thinner.
_DENSE, _VERY_DENSE = 1500, 20_000
#: Metres; squares of it and of its inverse are still doubles.
_FARTHEST = 1e100
#: What chi2 spans on the colour scale at most.
_DECADES = 3.0


@dataclass(frozen=True)
class MapOptions(FigureOptions):
    """What a map shows.

    Attributes
    ----------
    view
        ``auto`` (in space if an input is), or a key of ``VIEWS``.
    color_by
        ``none``, or ``chi2`` for the edges of a single graph.
    closures
        Whether to draw loop closures and observations of landmarks; None: if there is a single graph.
    """

    view: str = "auto"
    color_by: str = "none"
    closures: bool | None = None


def draw_map(
    estimates: Sequence[Estimate],
    truth: Estimate | None = None,
    regions: Regions | None = None,
    options: MapOptions | None = None,
) -> Figure:
    """Draw estimates over each other, in the colours of their order, with the truth dashed on top.

    Parameters
    ----------
    estimates
        At least one; each has a finite position.
    truth
        Drawn dark and dashed.
    regions
        Uncertainty to draw.
    options
        What to show.

    Raises
    ------
    InputError
        If positions are too far away to be drawn.
    """
    return _Map(estimates, truth, regions, options or MapOptions()).figure


class _Map:
    """One map while it is drawn: the canvas, and the entries of the legend."""

    def __init__(
        self, estimates: Sequence[Estimate], truth: Estimate | None, regions: Regions | None, options: MapOptions
    ) -> None:
        self.estimates, self.truth, self.options = estimates, truth, options
        self.single = len(estimates) == 1
        self.coloured = options.color_by == "chi2"
        everything = [*estimates, truth] if truth is not None else list(estimates)
        low, high = _bounds(everything)
        view = options.view
        if view == "auto":
            view = "3d" if max(estimate.space for estimate in everything) == 3 else "xy"
        shown = VIEWS[view]
        self.figure = style.new_figure(options.size or _suitable_size((high - low)[list(shown)], self.coloured))
        self.canvas: Canvas = Spatial(self.figure, low, high) if view == "3d" else Planar(self.figure, shown, low, high)
        pixels = options.dpi * float(max(self.figure.get_size_inches()))
        self.cell = 0.5 * float((high - low)[list(shown)].max()) / pixels
        self.reach = float((high - low).max())
        self.entries: list[tuple[Any, str]] = []
        self._draw(regions)

    def _draw(self, regions: Regions | None) -> None:
        with_edges = self.single if self.options.closures is None else self.options.closures
        for number, estimate in enumerate(self.estimates):
            self._path(estimate, number)
            if self.coloured:
                self._coloured_edges(estimate.edges, with_edges)
            elif with_edges:
                self._edges(estimate.edges, number)
        for number, estimate in enumerate(self.estimates):
            self._landmarks(estimate, number)
        if self.truth is not None:
            self._truth(self.truth)
        if regions is not None:
            self._regions(regions)
        self._ends()
        title = self.options.title
        if title is None:
            title = self.estimates[0].name if self.single else ""
        self.canvas.finish(title, self._subtitle(), self.entries, resize=self.options.size is None)

    def _path(self, estimate: Estimate, number: int) -> None:
        path = estimate.path
        if not len(path):
            return
        dense = len(path) > _DENSE
        width = 1.5 if not dense else 1.0 if len(path) <= _VERY_DENSE else 0.6
        look = style.look(number, len(self.estimates), width) | {"zorder": _PATH}
        if dense:
            look["linestyle"] = "-"  # dashes of a path that fills the figure are noise
        if self.coloured:
            look = {"color": style.PALE, "linewidth": 0.8, "zorder": _OBSERVATIONS - 1}
        rows = thin_path(path[:, list(self.canvas.shown)], self.cell)
        self.canvas.line(path[rows], **look, solid_joinstyle="round")
        if len(path) <= FEW:
            self._poses(path, estimate.forward, "#8A8A8A" if self.coloured else look["color"])
        if not self.coloured:
            label = estimate.name
            if self.single:
                label = "trajectory"
            elif estimate.chi2 is not None:
                label = f"{label} (chi2 {estimate.chi2:.6g})"
            handle = Line2D([], [], **look)
            if len(estimate.landmarks) and not self.single:
                handle.set(marker=style.marker(number, style.STARS), markersize=7.0, markeredgewidth=0.0)
            self._entry(handle, label)

    def _poses(self, path: Array, forward: Array, colour: str) -> None:
        """Each pose of a short path with its heading, as large as the steps between them allow."""
        steps = np.sqrt(np.square(np.diff(path, axis=0)).sum(axis=1))
        steps = steps[np.isfinite(steps) & (steps > 0.0)]
        step = float(np.median(steps)) if len(steps) else self.reach
        length = float(np.clip(0.4 * step, 0.012 * self.reach, 0.035 * self.reach))
        self.canvas.headings(path, forward, length, colour, _POSES)

    def _edges(self, edges: Edges, number: int) -> None:
        """Loop closures and observations, thin below the path."""
        tint = style.VERMILLION if self.single else self._colour(number)
        false = edges.outlier
        tone = style.SKY if false.any() else tint
        labelled = "true loop closure" if false.any() else "loop closure"
        self._thin_lines(
            edges.segments[(edges.role == CLOSURE) & ~false], tone, labelled, MOST_CLOSURES, _CLOSURES, self.single
        )
        observed = edges.segments[(edges.role == OBSERVATION) & ~false]
        self._thin_lines(observed, style.GREEN, "observation", MOST_OBSERVATIONS, _OBSERVATIONS, self.single, 0.4)
        if false.any():
            self._thin_lines(
                edges.segments[false], style.VERMILLION, "false edge", MOST_CLOSURES, _CLOSURES + 0.5, True, 1.0
            )

    def _thin_lines(
        self, segments: Array, colour: str, noun: str, most: int, zorder: float, named: bool, width: float = 0.6
    ) -> None:
        if not len(segments):
            return
        drawn = segments[spread(len(segments), most)]
        alpha = float(np.clip(12.0 / np.sqrt(len(drawn)), 0.2, 0.75)) * min(width / 0.6, 1.2)
        self.canvas.segments(drawn, colors=colour, linewidths=width, alpha=alpha, zorder=zorder)
        if named or len(drawn) < len(segments):
            handle = Line2D([], [], color=colour, linewidth=1.0, alpha=max(alpha, 0.6))
            self._entry(handle, _count(noun, len(drawn), len(segments)))

    def _coloured_edges(self, edges: Edges, with_closures: bool) -> None:
        """Edges in the colour of their chi2, the worst on top and widest."""
        usable = np.isfinite(edges.chi2) & (with_closures | (edges.role < CLOSURE))
        rows = np.flatnonzero(usable)
        rows = rows[np.argsort(edges.chi2[rows], kind="stable")]
        total = len(rows)
        rows = rows[-MOST_COLOURED:]
        if not total:
            return
        chi2 = edges.chi2[rows]
        top = float(chi2[-1]) if chi2[-1] > 0.0 else 1.0
        floor = max(top * 10.0**-_DECADES, float(chi2[chi2 > 0.0].min(initial=top)))
        if floor >= top:
            floor = 0.1 * top
        scale = LogNorm(floor, top)
        shares = np.log(np.maximum(chi2, floor) / floor) / np.log(top / floor)
        few = total <= 3000
        lines = self.canvas.segments(
            edges.segments[rows],
            array=np.maximum(chi2, floor),
            cmap=style.severity(),
            norm=scale,
            linewidths=(0.8 if few else 0.4) + (2.2 if few else 1.2) * shares**3,
            zorder=_EDGES,
            capstyle="round",
        )
        below = bool((chi2 < floor).any())
        self.canvas.colour_bar(lines, "chi2 of the edge (no unit)", "min" if below else "neither")
        noun = "edge" if with_closures else "odometry edge"
        label = f"{_counted(total, noun)} by chi2" if len(rows) == total else ""
        label = label or f"the {style.number(len(rows))} worst of {style.number(total)} {noun}s by chi2"
        self._entry(Line2D([], [], color=style.severity()(0.7), linewidth=2.0), label)

    def _landmarks(self, estimate: Estimate, number: int) -> None:
        count = len(estimate.landmarks)
        if not count:
            return
        colour = style.GREEN if self.single else self._colour(number)
        look: dict[str, Any] = {
            "linestyle": "none",
            "marker": style.marker(number, style.STARS),
            "markersize": _marker_size(count, 8.5 if number == 0 else 5.5),
            "markerfacecolor": colour,
            "markeredgecolor": "white",
            "markeredgewidth": 0.4,
        }
        self.canvas.line(estimate.landmarks, **look, zorder=_LANDMARKS)
        if self.single:
            self._entry(Line2D([], [], **(look | {"markersize": 8.5})), plural(count, "landmark"))

    def _truth(self, truth: Estimate) -> None:
        look: dict[str, Any] = {"color": style.INK, "linestyle": (0, (4, 2)), "linewidth": 1.1}
        if len(truth.path):
            if len(truth.path) > _DENSE:
                look["linewidth"] = 0.7
            rows = thin_path(truth.path[:, list(self.canvas.shown)], self.cell)
            self.canvas.line(truth.path[rows], **look, zorder=_TRUTH)
            self._entry(Line2D([], [], **(look | {"linewidth": 1.2})), f"truth: {truth.name}")
        if len(truth.landmarks):
            mark: dict[str, Any] = {"linestyle": "none", "marker": "+", "color": style.INK, "markeredgewidth": 0.8}
            size = _marker_size(len(truth.landmarks), 6.0)
            self.canvas.line(truth.landmarks, **mark, markersize=size, zorder=_TRUTH)
            self._entry(Line2D([], [], **mark, markersize=6.0), plural(len(truth.landmarks), "true landmark"))

    def _regions(self, regions: Regions) -> None:
        chosen = spread(len(regions.poses), MOST_POSE_REGIONS)
        for points, covariances, colour in (
            (regions.poses[chosen], regions.pose_covariances[chosen], style.INK),
            (regions.landmarks, regions.landmark_covariances, style.GREEN),
        ):
            if len(points):
                loops = outlines(points, covariances, self.canvas.shown)
                self.canvas.outlines(loops, colors=colour, linewidths=0.8, alpha=0.9, zorder=_REGIONS)
        if len(chosen):
            handle = Line2D([], [], color=style.INK, linewidth=0.8)
            self._entry(handle, _count("pose", len(chosen), len(regions.poses)).replace(" drawn", "") + ": 95 % region")
        if len(regions.landmarks):
            handle = Line2D([], [], color=style.GREEN, linewidth=0.8)
            self._entry(handle, f"{plural(len(regions.landmarks), 'landmark')}: 95 % region")

    def _ends(self) -> None:
        """Where each path starts and ends: a ring and, smaller, so that both show in one place, a square."""
        start: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 9.0, "markerfacecolor": "none"}
        end: dict[str, Any] = {"linestyle": "none", "marker": "s", "markersize": 5.5}
        moved = False
        for number, estimate in enumerate(self.estimates):
            placed = estimate.path[finite_rows(estimate.path)]
            if not len(placed):
                continue
            colour = style.INK if self.single else self._colour(number)
            for tone, width in (("white", 3.0), (colour, 1.6)):  # the rim shows it on dark edges
                self.canvas.line(placed[:1], **start, markeredgecolor=tone, markeredgewidth=width, zorder=_MARKS)
            if len(placed) > 1:
                look = {"markerfacecolor": colour, "markeredgecolor": "white", "markeredgewidth": 0.6}
                self.canvas.line(placed[-1:], **end, **look, zorder=_MARKS)
                moved = True
        if any(len(estimate.path) for estimate in self.estimates):
            tone = style.INK if self.single else style.GREY
            self._entry(Line2D([], [], **start, markeredgecolor=tone, markeredgewidth=1.4), "start")
            if moved:
                self._entry(Line2D([], [], **end, markerfacecolor=tone, markeredgecolor="white"), "end")

    def _subtitle(self) -> str:
        """What is drawn, where one line can say it for all inputs."""
        first = self.estimates[0]
        if any(estimate.counts != first.counts for estimate in self.estimates):
            return ""
        counts = first.counts
        parts = [_counted(counts["poses"], "pose")]
        if counts.get("landmarks"):
            parts.append(_counted(counts["landmarks"], "landmark"))
        if "edges" in counts:
            closures = f" ({_counted(counts['closures'], 'loop closure')})" if counts["closures"] else ""
            parts.append(_counted(counts["edges"], "edge") + closures)
        if self.single and first.chi2 is not None:
            parts.append(f"chi2 {first.chi2:.6g}")
        return ", ".join(parts)

    def _colour(self, number: int) -> str:
        return str(style.look(number, len(self.estimates), 1.0)["color"])

    def _entry(self, handle: Any, label: str) -> None:
        self.entries.append((handle, style.plain(label)))


def _bounds(everything: Sequence[Estimate]) -> tuple[Array, Array]:
    """Lowest and highest coordinates with a margin, so that no extent is zero."""
    low = np.min([estimate.points.min(axis=0) for estimate in everything], axis=0)
    high = np.max([estimate.points.max(axis=0) for estimate in everything], axis=0)
    farthest = float(max(np.abs(low).max(), np.abs(high).max()))
    if farthest > _FARTHEST:
        widest = max(everything, key=lambda estimate: float(np.abs(estimate.points).max()))
        raise InputError(
            f"{widest.name}: a position is {farthest:.3g} m from the origin, too far to be drawn",
            ("  slamcli info prints the extent; did the optimization that wrote it diverge?",),
        )
    # in proportion to the coordinates too: doubles do not tell apart what is closer
    margin = max(0.015 * float((high - low).max()), 1e-9 * farthest)
    if margin < 1.0 / _FARTHEST:
        margin = 1.0
    return low - margin, high + margin


def _counted(number: int, noun: str) -> str:
    return f"{style.number(number)} {noun}" + ("" if number == 1 else "s")


def _count(noun: str, drawn: int, total: int) -> str:
    """How many of a kind are drawn."""
    if drawn == total:
        return _counted(total, noun)
    return f"{style.number(drawn)} of {_counted(total, noun)} drawn"


def _marker_size(count: int, largest: float) -> float:
    """Diameter in points: smaller where there are many."""
    return float(np.clip(largest * (60.0 / max(count, 1)) ** 0.25, 0.3 * largest, largest))


def _suitable_size(extent: Array, with_bar: bool) -> tuple[float, float]:
    """A figure in which axes of this extent, equally scaled, fill the space beside labels and legend."""
    if len(extent) == 3:
        return 7.4, 6.6
    beside, above = 0.85 + 0.95 * with_bar, 1.45
    ratio = float(extent[1] / extent[0])
    wide = 7.4 - beside
    height = float(np.clip(wide * ratio, 2.6, 6.6))
    wide = float(np.clip(height / ratio, 3.6, wide))
    return wide + beside, height + above
