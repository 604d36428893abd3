"""Elimination trees under several orders: what can be eliminated side by side, and what must wait for what."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array
from slamcli.reporting.plots import style
from slamcli.reporting.plots.style import FigureOptions
from slamcli.reporting.text import plural
from slamcli.solver.ordering.comparison import Comparison
from slamcli.solver.symbolic import SymbolicAnalysis, supernodes
from slamcli.solver.symbolic.elimination_tree import depths, postorder

#: Trees of up to so many block columns are drawn with a node for each; larger ones by supernodes.
_SMALL = 100
#: Nodes of up to so many in a tree have their ids beside them.
_NAMED = 45
_PANEL = (3.6, 3.4)  # inches
_ACROSS = 3


@dataclass(frozen=True, eq=False)
class _Tree:
    """Nodes (n,) in postorder: parents, scalar rows of the fronts, ids of what is eliminated (or none)."""

    parent: IndexArray
    front: IndexArray
    ids: list[str]


def draw_trees(comparison: Comparison, options: FigureOptions | None = None) -> Figure:
    """One tree for each order, roots on top; a node's size and colour tell the rows of its front."""
    options = options or FigureOptions()
    number = len(comparison.orders)
    across = min(number, _ACROSS)
    down = -(-number // across)
    size = options.size or (0.9 + _PANEL[0] * max(across, 1.5), 0.9 + _PANEL[1] * down)
    figure = style.new_figure(size)
    grid = figure.subplots(down, across, squeeze=False).ravel()
    trees = [_tree(comparison, found.analysis(comparison.pattern)) for found in comparison.orders]
    low = max(1, min(int(tree.front.min()) for tree in trees))
    high = max(int(tree.front.max()) for tree in trees)
    scale = LogNorm(low, high) if high > 10 * low else Normalize(low, max(high, low + 1))
    for axes in grid[number:]:
        axes.set_visible(False)
    for axes, tree, cost in zip(grid, trees, comparison.costs, strict=False):
        x, depth = _layout(tree.parent)
        _edges(axes, tree.parent, x, depth)
        area = 4.0 + 90.0 * (tree.front / high) ** 1.3 * (1.0 if len(tree.front) > _NAMED else 2.0)
        axes.scatter(
            x, depth, s=area, c=tree.front, cmap=style.severity(), norm=scale, linewidths=0.0, zorder=2, rasterized=True
        )
        for k, text in enumerate(tree.ids):
            axes.annotate(text, (x[k], depth[k]), (4.0, 2.0), textcoords="offset points", fontsize=6.5)
        axes.invert_yaxis()
        axes.set_xticks([])
        axes.margins(0.06)
        if depth.max() == 1:  # the limits of one depth would be fractions
            axes.set_ylim(2.0, 0.0)
        axes.locator_params(axis="y", nbins=6, integer=True)
        name = cost.name if cost.name == cost.found else f"{cost.name} ({cost.found})"
        kind = ("block column" if len(comparison.ids) <= _SMALL else "supernode") + "s" * (len(x) != 1)
        axes.set_title(style.plain(name), loc="left", fontsize=10.0, color=style.INK)
        tall = f"{style.number(len(x))} {kind}, height {int(depth.max())}"
        axes.set_xlabel(tall, fontsize=8.0, color=style.GREY)
    for axes in grid[:number:across]:
        axes.set_ylabel("depth below the root" if number == 1 else "depth", fontsize=8.0)
    mappable = grid[0].collections[-1]
    bar = figure.colorbar(mappable, ax=list(grid[:number]), shrink=0.7, aspect=30, pad=0.02)
    if not isinstance(scale, LogNorm):  # rows are whole
        bar.locator = MaxNLocator(nbins=6, integer=True)
        bar.update_ticks()
    bar.set_label("scalar rows of the front")
    if options.title is None or options.title:
        title = options.title or f"Elimination trees, {plural(len(comparison.ids), 'block variable')}"
        figure.suptitle(style.plain(title), x=0.01, ha="left", fontweight="bold", color=style.INK)
    return figure


def _tree(comparison: Comparison, analysis: SymbolicAnalysis) -> _Tree:
    if len(comparison.ids) > _SMALL:
        parts = supernodes(analysis)
        return _Tree(parts.parent, parts.front, [])
    post = np.array(postorder(analysis.parent.tolist()), dtype=np.intp)
    place = np.empty(len(post), dtype=np.intp)
    place[post] = np.arange(len(post))
    above = analysis.parent[post]
    ids = [str(i) for i in comparison.ids[analysis.order[post]]] if len(post) <= _NAMED else []
    return _Tree(np.where(above >= 0, place[above], -1), analysis.counts[post], ids)


def _layout(parent: IndexArray) -> tuple[Array, IndexArray]:
    """Abscissa of each node (leaves side by side in postorder, parents over the middle of their children), depth."""
    count = len(parent)
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    x, leaves = np.empty(count), 0
    for node, above in enumerate(parent.tolist()):
        if high[node] < 0:
            low[node] = high[node] = leaves
            leaves += 1
        x[node] = 0.5 * (low[node] + high[node])
        if above >= 0:
            low[above], high[above] = min(low[above], x[node]), max(high[above], x[node])
    return x, depths(parent)


def _edges(axes: object, parent: IndexArray, x: Array, depth: IndexArray) -> None:
    children = np.flatnonzero(parent >= 0)
    ends = np.stack([np.stack([x, depth], axis=1)[children], np.stack([x, depth], axis=1)[parent[children]]], axis=1)
    width = 0.8 if len(children) < 500 else 0.35
    lines = LineCollection(list(ends), colors=style.PALE, linewidths=width, zorder=1, rasterized=len(ends) > 3000)
    axes.add_collection(lines)  # type: ignore[attr-defined]
