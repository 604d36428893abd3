"""Errors of poses over time or over the distance driven, as ``slamcli evaluate --errors`` lists them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from slamcli.errors import InputError, UsageError
from slamcli.models.base import Array
from slamcli.reporting.plots import style
from slamcli.reporting.plots.inputs import ErrorSeries
from slamcli.reporting.plots.style import FigureOptions
from slamcli.reporting.plots.thinning import envelope

#: Columns that x may show: name of the choice, column, label.
AXES = {"time": ("time_s", "time (s)"), "distance": ("distance_m", "distance (m)")}
#: Columns that are drawn, each in a panel of its own.
PANELS = {
    "translation_error_m": "translation error (m)",
    "rotation_error_deg": "rotation error (°)",
    "nees": "NEES (no unit)",
}
_BINS = 2000


def draw_errors(series: Sequence[ErrorSeries], x_axis: str = "auto", options: FigureOptions | None = None) -> Figure:
    """Draw each kind of error in a panel, all series over each other.

    Parameters
    ----------
    series
        At least one.
    x_axis
        ``time``, ``distance`` or ``auto``: time where all series have it.
    options
        Title, size, resolution.

    Raises
    ------
    UsageError
        If a series lacks the column that x is to show.
    InputError
        If no error in the series is finite.
    """
    options = options or FigureOptions()
    if x_axis == "auto":
        x_axis = "time" if all(_has(one, AXES["time"][0]) for one in series) else "distance"
    column, label = AXES[x_axis]
    for one in series:
        if not _has(one, column):
            raise UsageError(f"{one.name}: has no {column} for the x axis", (f"  columns: {', '.join(one.columns)}",))
    panels = [name for name in PANELS if any(_has(one, name) for one in series)]
    if not panels:
        raise InputError(f"{series[0].name}: no error in it is finite")
    figure = style.new_figure(options.size or (7.2, 1.4 + 2.0 * len(panels)))
    all_axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    entries: list[tuple[Any, str]] = []
    for number, one in enumerate(series):
        look = style.look(number, len(series), 1.4 if len(one.columns[column]) <= 2000 else 0.8)
        for axes, name in zip(all_axes, panels, strict=True):
            if _has(one, name):
                x, y = _ordered(one.columns[column], one.columns[name])
                axes.plot(x, y, **look, rasterized=len(x) > 3000)
        entries.append((Line2D([], [], **(look | {"linewidth": 1.8})), style.plain(one.name)))
    for axes, name in zip(all_axes, panels, strict=True):
        axes.set_ylabel(PANELS[name])
        axes.grid(True)
        if name == "nees":
            axes.set_yscale("log", nonpositive="mask")
        else:
            axes.set_ylim(bottom=-0.02 * axes.get_ylim()[1])  # a line of zeros shows above the frame
    all_axes[-1].set_xlabel(label)
    figure.align_ylabels(all_axes)
    style.headline(all_axes[0], options.title or "", "")
    style.legend(figure, entries)
    return figure


def _has(series: ErrorSeries, name: str) -> bool:
    return name in series.columns and bool(np.isfinite(series.columns[name]).any())


def _ordered(x: Array, y: Array) -> tuple[Array, Array]:
    """By x, without poses that have none, and with no more points than can be seen."""
    rows = np.flatnonzero(np.isfinite(x))
    rows = rows[np.argsort(x[rows], kind="stable")]
    rows = rows[envelope(x[rows], y[rows], _BINS)]
    return x[rows], y[rows]
