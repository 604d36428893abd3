"""Spy plots: the blocks of H, and of L under each elimination order, coloured by what they stand for.

A matrix with more blocks than the panel has pixels is drawn as a raster: a pixel is tinted by how much of it is
filled, and has the hue of the kind that weighs most in it.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from slamcli.graph.columns import IndexArray
from slamcli.models.base import Array
from slamcli.reporting.plots import style
from slamcli.reporting.plots.style import FigureOptions
from slamcli.solver.ordering.changes import cell_keys
from slamcli.solver.ordering.comparison import Comparison, OrderCost
from slamcli.solver.pattern import BlockPattern
from slamcli.solver.symbolic import SymbolicAnalysis, analyze
from slamcli.solver.symbolic.cells import CLOSURE, LANDMARK, POSE, factor_blocks, factor_cells

#: Fill-in, blocks that a change brings, blocks that it takes away.
FILL, APPEARED, GONE = 3, 4, 5
COLOURS = {
    POSE: style.BLUE,
    LANDMARK: style.GREEN,
    CLOSURE: style.VERMILLION,
    FILL: "#9A9A9A",
    APPEARED: style.INK,
    GONE: style.PURPLE,
}
_LABELS = {
    POSE: "poses and odometry",
    LANDMARK: "landmarks and what sees them",
    CLOSURE: "loop closures",
    FILL: "fill-in of L",
    APPEARED: "appears with the change",
    GONE: "goes with the change",
}
#: How much a block counts for the hue of its pixel: few blocks of H must show among much fill-in.
_WEIGHT = {POSE: 4.0, LANDMARK: 4.0, CLOSURE: 6.0, FILL: 1.0, APPEARED: 1e6, GONE: 4.0}
#: The tint of a pixel with a single block in it, and how it rises to that of a full one.
_FAINTEST, _RISE = 0.45, 0.4
#: A factor with more blocks is not drawn, one with more is not compared block by block.
_MOST, _MOST_COMPARED = 60_000_000, 20_000_000
_PANEL, _ALONE = 2.7, 4.2  # inches, among others and of a single order
_ACROSS = 4
#: Below this many blocks, those that appear need no larger dots to be seen.
_SMALL = 150


def draw_spy(comparison: Comparison, options: FigureOptions | None = None) -> Figure:
    """Panels of H and, below, of L for each order: in the order of elimination, from the top left.

    Parameters
    ----------
    comparison
        At least one order.
    options
        Title, size, resolution.
    """
    options = options or FigureOptions()
    number = len(comparison.orders)
    across = min(number, _ACROSS)
    tiers = -(-number // across)
    panel = _PANEL if number > 1 else _ALONE
    size = options.size or (0.55 + panel * max(across, 1.15), 0.9 + tiers * (2.0 * panel - 0.05))
    figure = style.new_figure(size)
    grid = figure.subplots(2 * tiers, across, squeeze=False)
    pixels = int(min(size[0] / across, size[1] / (2 * tiers)) * 0.8 * options.dpi)
    shown: set[int] = set()
    for axes in grid.ravel():
        axes.set_visible(False)
    for k, cost in enumerate(comparison.costs):
        tier, place = divmod(k, across)
        order = comparison.orders[k].order
        upper, lower = grid[2 * tier, place], grid[2 * tier + 1, place]
        _hessian(upper, comparison, order, pixels, shown)
        _factor(lower, comparison, comparison.orders[k].analysis(comparison.pattern), pixels, shown)
        _frame(upper, comparison, f"H, {_name(cost)}", "", place == 0)
        _frame(lower, comparison, "L", _subtitle(cost), place == 0)
    title = options.title if options.title is not None else _title(comparison)
    if title:
        figure.suptitle(style.plain(title), x=0.01, ha="left", fontweight="bold", color=style.INK)
    style.legend(figure, [(Patch(facecolor=COLOURS[kind]), _LABELS[kind]) for kind in sorted(shown)])
    return figure


def _hessian(axes: Axes, comparison: Comparison, order: IndexArray, pixels: int, shown: set[int]) -> None:
    """Both triangles of H; after a change, with what appears and what goes."""
    pattern, kinds = comparison.pattern, comparison.kinds
    rows, columns = _placed(pattern, order)
    if comparison.change is not None:
        after = comparison.change.pattern
        count = len(pattern.sizes)
        new = ~np.isin(after.columns * count + after.rows, pattern.columns * count + pattern.rows)
        new_rows, new_columns = _placed(after, order)
        gone = comparison.change.gone
        kinds = np.where(gone[pattern.rows] | gone[pattern.columns], GONE, kinds)
        rows, columns = np.concatenate([rows, new_rows[new]]), np.concatenate([columns, new_columns[new]])
        kinds = np.concatenate([kinds, np.full(int(new.sum()), APPEARED)])
    raster = Raster(len(order), pixels)
    raster.add(rows, columns, kinds)
    raster.add(columns[rows != columns], rows[rows != columns], kinds[rows != columns])
    _show(axes, raster, shown)


def _factor(axes: Axes, comparison: Comparison, analysis: SymbolicAnalysis, pixels: int, shown: set[int]) -> None:
    """The lower triangle of L, of the changed pattern if there is a change."""
    pattern, order = comparison.pattern, analysis.order
    raster = Raster(len(order), pixels)
    gone = np.zeros(len(order), dtype=bool) if comparison.change is None else comparison.change.gone
    now, result = pattern, analysis
    if comparison.change is not None:
        now = comparison.change.pattern
        result = analyze(now, order)
    blocks = factor_blocks(now, result)
    if blocks > _MOST:
        note = f"L has {_large(blocks)} blocks:\ntoo many to draw"
        axes.text(0.5, 0.5, note, ha="center", va="center", transform=axes.transAxes, color=style.GREY)
        return
    for rows, columns in factor_cells(now, result):
        raster.add(rows, columns, FILL)
    rows, columns = _placed(pattern, order)
    there = ~(gone[pattern.rows] | gone[pattern.columns])
    raster.replace(rows[there], columns[there], comparison.kinds[there], FILL)
    raster.remove(np.flatnonzero(gone[order]), FILL)
    if comparison.change is not None and blocks + factor_blocks(pattern, analysis) <= _MOST_COMPARED:
        new = np.setdiff1d(cell_keys(now, result), cell_keys(pattern, analysis))
        columns, rows = np.divmod(new, len(order))
        raster.add(rows, columns, APPEARED)
    _show(axes, raster, shown)


class Raster:
    """Blocks counted by pixel and kind.

    Parameters
    ----------
    blocks
        Rows and columns of the matrix, in blocks.
    pixels
        Rows and columns of the picture, at most: never more than blocks.
    """

    def __init__(self, blocks: int, pixels: int) -> None:
        self.blocks, self.pixels = blocks, max(1, min(blocks, pixels))
        self.counts = np.zeros((len(COLOURS), self.pixels, self.pixels))
        self._pixel = np.arange(blocks) * self.pixels // blocks

    def add(self, rows: IndexArray, columns: IndexArray, kinds: IndexArray | int, times: float = 1.0) -> None:
        """Count blocks (k,) of one kind, or of kinds (k,)."""
        side = self.pixels
        cell = self._pixel[rows] * side + self._pixel[columns]
        if isinstance(kinds, int):
            self.counts[kinds] += times * np.bincount(cell, minlength=side * side).reshape(side, side)
            return
        found = np.bincount(kinds * side * side + cell, minlength=self.counts.size)
        self.counts += times * found.reshape(self.counts.shape)

    def replace(self, rows: IndexArray, columns: IndexArray, kinds: IndexArray, instead_of: int) -> None:
        """Count blocks (k,) as of these kinds that have been counted as of another."""
        self.add(rows, columns, kinds)
        self.add(rows, columns, instead_of, -1.0)

    def remove(self, diagonal: IndexArray, kind: int) -> None:
        """Take blocks of the diagonal out of a kind."""
        self.add(diagonal, diagonal, kind, -1.0)

    def image(self) -> Array:
        """(pixels, pixels, 4) colours."""
        total = self.counts.sum(axis=0)
        weights = self.counts * np.array([_WEIGHT[kind] for kind in range(len(COLOURS))])[:, None, None]
        tones = np.array([to_rgb(COLOURS[kind]) for kind in range(len(COLOURS))])
        hue = tones[weights.argmax(axis=0)]
        cells = np.square(np.ceil(self.blocks / self.pixels))
        tint = np.where(total > 0, _FAINTEST + (1 - _FAINTEST) * np.minimum(total / cells, 1.0) ** _RISE, 0.0)
        tint[self.counts[APPEARED] > 0] = 1.0
        return np.concatenate([hue, tint[:, :, None]], axis=2)


def _placed(pattern: BlockPattern, order: IndexArray) -> tuple[IndexArray, IndexArray]:
    """Row and column of each stored block in the order of elimination, row >= column."""
    position = np.empty(len(order), dtype=np.intp)
    position[order] = np.arange(len(order))
    a, b = position[pattern.rows], position[pattern.columns]
    return np.maximum(a, b), np.minimum(a, b)


def _show(axes: Axes, raster: Raster, shown: set[int]) -> None:
    extent = (0, raster.blocks, raster.blocks, 0)
    axes.imshow(raster.image(), extent=extent, interpolation="nearest", aspect="equal")
    shown.update(kind for kind in COLOURS if raster.counts[kind].any())
    appeared = np.argwhere(raster.counts[APPEARED])
    if raster.blocks > _SMALL and 0 < len(appeared) <= 400:  # single pixels are easily missed
        place = (appeared + 0.5) * raster.blocks / raster.pixels
        axes.plot(place[:, 1], place[:, 0], "s", markersize=1.8, color=COLOURS[APPEARED], markeredgewidth=0.0)


def _frame(axes: Axes, comparison: Comparison, title: str, subtitle: str, first: bool) -> None:
    axes.set_visible(True)
    blocks = len(comparison.ids)
    axes.set(xlim=(0, blocks), ylim=(blocks, 0), aspect="equal")
    axes.tick_params(length=2.0, labelsize=7.0)
    axes.locator_params(nbins=4, integer=True)
    axes.set_title(style.plain(title), loc="left", fontsize=9.5, color=style.INK, pad=3.0)
    if subtitle:
        axes.set_xlabel(subtitle, fontsize=8.0, color=style.GREY)
    if first:
        axes.set_ylabel("block, as eliminated", fontsize=8.0)


def _name(cost: OrderCost) -> str:
    return cost.name if cost.name == cost.found else f"{cost.name} ({cost.found})"


def _subtitle(cost: OrderCost) -> str:
    found = cost.changed
    if found is None:
        fill_in = style.number(round(cost.fill_in)) if cost.fill_in >= 100.0 else f"{cost.fill_in:.3g}"
        return f"{_large(cost.nnz_factor)} nonzeros, fill-in {fill_in}"
    appeared = "" if found.appeared is None else f", {found.appeared} appear"
    return f"{found.before} to {found.after} blocks{appeared}"


def _title(comparison: Comparison) -> str:
    pattern = comparison.pattern
    variables = f"{style.number(len(pattern.sizes))} block variable{'s' * (len(pattern.sizes) != 1)}"
    return f"H and L, {variables}, {style.number(pattern.dimension)} columns"


def _large(number: int) -> str:
    """A count to three digits: 187 thousand, 4.77 million."""
    for limit, word in ((10**9, "billion"), (10**6, "million"), (10**3, "thousand")):
        if number >= limit:
            return f"{number / limit:.3g} {word}"
    return str(number)
