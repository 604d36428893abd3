"""chi2 over the iterations, or over their time, of one or several optimizations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from slamcli.reporting.plots import style
from slamcli.reporting.plots.inputs import Run
from slamcli.reporting.plots.style import FigureOptions
from slamcli.reporting.text import plural

AXES = ("iteration", "time")
#: From this ratio of the largest to the smallest chi2 on, the axis is logarithmic.
_LOGARITHMIC = 5.0


def draw_iterations(runs: Sequence[Run], x_axis: str = "iteration", options: FigureOptions | None = None) -> Figure:
    """Draw chi2 at the start and after each iteration.

    Parameters
    ----------
    runs
        At least one.
    x_axis
        One of ``AXES``.
    options
        Title, size, resolution.
    """
    options = options or FigureOptions()
    figure = style.new_figure(options.size or (7.2, 4.4))
    axes = figure.add_subplot()
    entries: list[tuple[Any, str]] = []
    brief = max(run.seconds[-1] for run in runs) < 1.0
    for number, run in enumerate(runs):
        x = run.seconds * (1e3 if brief else 1.0) if x_axis == "time" else np.arange(len(run.chi2))
        marked = len(run.chi2) <= 60
        look = style.look(number, len(runs), 1.4) | {
            "marker": style.marker(number) if marked else "none",
            "markersize": 4.5,
            "markeredgecolor": "white",
            "markeredgewidth": 0.5,
        }
        axes.plot(x, run.chi2, **look, zorder=3)
        if not run.accepted.all():
            stuck = ~run.accepted
            axes.plot(x[stuck], run.chi2[stuck], "x", color=style.INK, markersize=6.0, zorder=4)
        entries.append((Line2D([], [], **look), style.plain(f"{run.name}: {_outcome(run)}")))
    if any(not run.accepted.all() for run in runs):
        entries.append((Line2D([], [], linestyle="none", marker="x", color=style.INK), "no step accepted"))
    every = np.concatenate([run.chi2 for run in runs])
    every = every[np.isfinite(every)]
    if every.min() > 0.0 and every.max() > _LOGARITHMIC * every.min():
        axes.set_yscale("log")
    axes.set_ylabel("chi2 (no unit)")
    if x_axis == "time":
        axes.set_xlabel(f"time in iterations ({'ms' if brief else 's'})")
        axes.set_xlim(left=-0.015 * axes.get_xlim()[1])
    else:
        axes.set_xlabel("iteration")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(True)
    title = options.title if options.title is not None else ("chi2 of " + runs[0].name if len(runs) == 1 else "")
    style.headline(axes, title, "")
    style.legend(figure, entries)
    return figure


def _outcome(run: Run) -> str:
    """How a run ended, for the legend."""
    finite = run.chi2[np.isfinite(run.chi2)]
    ended = "" if run.status in (None, "converged") else f", {str(run.status).replace('_', ' ')}"
    return f"chi2 {finite[-1]:.6g} after {plural(len(run.chi2) - 1, 'iteration')}{ended}"
