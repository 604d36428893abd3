"""Axes with one scale in all directions, in a plane or in space, with the same few things to draw on them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from mpl_toolkits.mplot3d.proj3d import proj_transform

from slamcli.graph.columns import finite_rows
from slamcli.models.base import Array
from slamcli.reporting.plots import style

#: Axes of the world that a view shows.
VIEWS = {"xy": (0, 1), "xz": (0, 2), "yz": (1, 2), "3d": (0, 1, 2)}
#: From so many parts on, a layer of an SVG or PDF file is an image: the file stays small and opens at once.
_RASTERIZED = 3000
#: Inches that the box of a view in space may be high.
_TALLEST = 6.0


class Canvas(Protocol):
    """What a map is drawn on. Points are (n, 3) in the world; styles are matplotlib's."""

    axes: Any
    shown: tuple[int, ...]

    def line(self, points: Array, **look: Any) -> None:
        """A line through points, interrupted where they are NaN; or markers without one."""

    def segments(self, segments: Array, **look: Any) -> Any:
        """Lines of shape (m, k, 3), each of k points."""

    def outlines(self, loops: Array, **look: Any) -> None:
        """Lines of shape (m, k, 2 or 3), in the view's own axes."""

    def headings(self, points: Array, forward: Array, length: float, colour: str, zorder: float) -> None:
        """What shows where the body's x axis points."""

    def colour_bar(self, lines: Any, label: str, extend: str) -> None:
        """The scale of the colours of ``segments``."""

    def finish(self, title: str, subtitle: str, entries: Sequence[tuple[Any, str]], resize: bool) -> None:
        """Titles and legend. ``resize``: the figure may change its size to suit them."""


class Planar:
    """Two axes of the world, equally scaled."""

    def __init__(self, figure: Figure, shown: tuple[int, ...], low: Array, high: Array) -> None:
        self.figure, self.shown = figure, shown
        self.axes: Axes = figure.add_subplot()
        first, second = ("xyz"[axis] for axis in shown)
        self.axes.set_xlabel(f"{first} (m)")
        self.axes.set_ylabel(f"{second} (m)")
        # the limits give way, not the box: the figure is filled
        self.axes.set_aspect("equal", adjustable="datalim")
        self.axes.margins(0.0)
        self.axes.update_datalim([low[list(shown)], high[list(shown)]])
        self.axes.autoscale_view()
        self.axes.grid(True)

    def line(self, points: Array, **look: Any) -> None:
        """See ``Canvas``."""
        x, y = (points[:, axis] for axis in self.shown)
        self.axes.plot(x, y, scalex=False, scaley=False, rasterized=len(points) > _RASTERIZED, in_layout=False, **look)

    def segments(self, segments: Array, **look: Any) -> LineCollection:
        """See ``Canvas``."""
        return self._collect(segments[:, :, list(self.shown)], **look)

    def outlines(self, loops: Array, **look: Any) -> None:
        """See ``Canvas``."""
        self._collect(loops, **look)

    def headings(self, points: Array, forward: Array, length: float, colour: str, zorder: float) -> None:
        """Triangles with their tip ahead."""
        there, ahead = points[:, list(self.shown)], forward[:, list(self.shown)]
        across = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
        corners = np.stack(
            [there + 0.65 * length * ahead]
            + [there - 0.35 * length * ahead + side * 0.32 * length * across for side in (-1.0, 1.0)],
            axis=1,
        )
        corners = corners[finite_rows(corners)]
        shapes = PolyCollection(list(corners), facecolors=colour, edgecolors="white", linewidths=0.5, zorder=zorder)
        shapes.set_in_layout(False)
        self.axes.add_collection(shapes, autolim=False)

    def colour_bar(self, lines: Any, label: str, extend: str) -> None:
        """See ``Canvas``."""
        bar = self.figure.colorbar(lines, ax=self.axes, shrink=0.85, pad=0.02, aspect=28, extend=extend, label=label)
        bar.outline.set_linewidth(0.0)

    def finish(self, title: str, subtitle: str, entries: Sequence[tuple[Any, str]], resize: bool) -> None:
        """See ``Canvas``; the layout engine finds room for everything."""
        style.headline(self.axes, title, subtitle)
        style.legend(self.figure, entries)

    def _collect(self, lines: Array, **look: Any) -> LineCollection:
        collection = LineCollection(list(lines), rasterized=len(lines) > _RASTERIZED, in_layout=False, **look)
        self.axes.add_collection(collection, autolim=False)
        return collection


class Spatial:
    """All three axes of the world, equally scaled, seen in perspective."""

    shown: tuple[int, ...] = (0, 1, 2)

    def __init__(self, figure: Figure, low: Array, high: Array) -> None:
        figure.set_layout_engine("none")  # it takes the empty corners around the box for part of it
        axes: Any = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d", computed_zorder=False)
        axes.patch.set_visible(False)
        self.figure, self.axes = figure, axes
        self.bar: Any = None
        extent = high - low
        flat = np.maximum(0.08 * extent.max() - extent, 0.0)  # a box without height could not be drawn
        low, high = low - 0.5 * flat, high + 0.5 * flat
        self.corners = np.stack(np.meshgrid(*np.stack([low, high], axis=1)), axis=-1).reshape(-1, 3)
        digits = len(f"{max(np.abs(low).max(), np.abs(high).max()):.0f}")
        pad = min(6.0 + 1.5 * digits, 20.0)  # the names stand beyond the tick labels
        axes.set_xlabel("x (m)", labelpad=pad)
        axes.set_ylabel("y (m)", labelpad=pad)
        axes.set_zlabel("z (m)", labelpad=5.0)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
        shape = (high - low) / (high - low).max()
        axes.set_box_aspect(shape)
        axes.view_init(elev=28.0, azim=-58.0)
        for axis, share in zip((axes.xaxis, axes.yaxis, axes.zaxis), shape, strict=True):
            axis.set_major_locator(MaxNLocator(max(2, round(7 * share))))
            axis.set_pane_color((1.0, 1.0, 1.0, 1.0))
            axis.line.set_color("#9A9A9A")

    def line(self, points: Array, **look: Any) -> None:
        """See ``Canvas``."""
        many = len(points) > _RASTERIZED
        self.axes.plot(points[:, 0], points[:, 1], points[:, 2], rasterized=many, in_layout=False, **look)

    def segments(self, segments: Array, **look: Any) -> Line3DCollection:
        """See ``Canvas``."""
        many = len(segments) > _RASTERIZED
        collection = Line3DCollection(list(segments), rasterized=many, in_layout=False, **look)
        self.axes.add_collection3d(collection, autolim=False)
        return collection

    def outlines(self, loops: Array, **look: Any) -> None:
        """See ``Canvas``."""
        self.segments(loops, **look)

    def headings(self, points: Array, forward: Array, length: float, colour: str, zorder: float) -> None:
        """Ticks along the body's x axis."""
        ticks = np.stack([points, points + length * forward], axis=1)
        ticks = ticks[finite_rows(ticks)]
        self.segments(ticks, colors=colour, linewidths=1.4, zorder=zorder)
        self.line(points, linestyle="none", marker="o", markersize=3.5, color=colour, zorder=zorder)

    def colour_bar(self, lines: Any, label: str, extend: str) -> None:
        """See ``Canvas``."""
        self.bar = self.figure.add_axes((0.9, 0.3, 0.02, 0.4))
        bar = self.figure.colorbar(lines, cax=self.bar, extend=extend, label=label)
        bar.outline.set_linewidth(0.0)

    def finish(self, title: str, subtitle: str, entries: Sequence[tuple[Any, str]], resize: bool) -> None:
        """See ``Canvas``; the drawn box, seen in perspective, fills the space between titles, labels and legend."""
        foot = 0.2 * style.legend(self.figure, entries) + 0.1
        head = 0.28 * bool(title) + 0.2 * bool(subtitle) + 0.1
        # inches that tick labels and names of axes take outside the box
        left, right, bottom = 0.55, 0.85 + 0.95 * (self.bar is not None), foot + 0.55
        x, y, _ = proj_transform(*self.corners.T, self.axes.get_proj())
        box = self.axes.transLimits.transform(np.stack([x, y], axis=1))  # as shares of the axes, which are square
        start, extent = box.min(axis=0), np.ptp(box, axis=0)
        width, height = self.figure.get_size_inches()
        side = (width - left - right) / extent[0]
        if resize:
            side = min(side, _TALLEST / extent[1])
            height = side * extent[1] + bottom + head
            self.figure.set_size_inches(width, height)
        side = max(min(side, (height - bottom - head) / extent[1]), 0.1)
        free = np.array([width - left - right, height - bottom - head]) - side * extent
        corner = np.array([left, bottom]) + 0.5 * free - side * start
        self.axes.set_position((corner[0] / width, corner[1] / height, side / width, side / height))
        if self.bar is not None:
            self.bar.set_position(((width - 0.85) / width, 0.3, 0.16 / width, 0.45))
        if title:
            at = (0.12 / width, 1.0 - 0.26 / height)
            self.figure.text(*at, style.plain(title), fontsize=11.0, fontweight="bold", color=style.INK)
        if subtitle:
            at = (0.12 / width, 1.0 - (head - 0.1) / height)
            self.figure.text(*at, style.plain(subtitle), fontsize=8.5, color=style.GREY)
