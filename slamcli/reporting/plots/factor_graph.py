"""The factor graph drawn bipartite: circles are variables, squares factors; the steps of an elimination as a strip."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke

from slamcli.graph.bipartite import CLOSURE, MARGINAL, OBSERVATION, ODOMETRY, PRIOR, Bipartite, Step, Variable
from slamcli.models.base import Array
from slamcli.reporting.plots import style

_COLOURS = {
    ODOMETRY: style.INK,
    CLOSURE: style.BLUE,
    OBSERVATION: style.GREEN,
    PRIOR: style.ORANGE,
    MARGINAL: style.VERMILLION,
}
#: Panels of a strip in one row.
_ROW = 4
#: Around the variables, as a share of the larger extent: wide for few, whose circles and priors beside them are large.
_FEW, _WIDE_MARGIN, _MARGIN = 12, 0.2, 0.12
#: Points of the smallest label that can be read, and up to how many variables labels stand beside circles that are too
#: small for them.
_READABLE, _LABELLED = 5.5, 60

#: Outline of what was eliminated before.
_GONE = "#C4C4C4"

Places = dict[int, Array]


def draw(
    graph: Bipartite,
    places: dict[int, tuple[float, float]],
    title: str,
    subtitle: str,
    metric: bool,
    gone: Sequence[Variable] = (),
) -> Figure:
    """One picture of a graph.

    Parameters
    ----------
    graph
        What to draw.
    places
        Positions of all its variables, and of those that are gone.
    title, subtitle
        Above it.
    metric
        Whether positions are metres, which the axes then show.
    gone
        Variables that were eliminated: shown where they were.
    """
    at = _arrays(places)
    ratio = _ratio(at)
    width = min(7.4, 7.6 / ratio)
    figure = style.new_figure((width, width * ratio + 1.1))
    axes = figure.add_subplot()
    _frame(axes, at, metric)
    _draw(axes, graph, at, _diameter(at, 0.9 * width), gone=gone)
    style.headline(axes, title, subtitle)
    entries = _entries(graph, ())
    if gone:
        ring = Line2D([], [], marker="o", linestyle="", markersize=6.0, markeredgecolor=_GONE, markerfacecolor="white")
        entries.append((ring, "past pose, eliminated"))
    style.legend(figure, entries)
    return figure


def draw_steps(
    start: Bipartite, steps: list[Step], places: dict[int, tuple[float, float]], title: str, subtitle: str
) -> Figure:
    """A strip: the start, then the graph after each step with what the step took away and what it filled in."""
    at = _arrays(places)
    panels = len(steps) + 1
    columns = min(_ROW, panels)
    rows = math.ceil(panels / columns)
    width = min(3.0, 3.4 / _ratio(at))
    figure = style.new_figure((max(width * columns, 6.0) + 0.2, (width * _ratio(at) + 0.35) * rows + 1.0))
    grid = figure.subplots(rows, columns, squeeze=False)
    diameter = _diameter(at, 0.95 * width)
    for number, axes in enumerate(grid.ravel()):
        _frame(axes, at, metric=False)
        if number >= panels:
            axes.set_axis_off()
        elif number == 0:
            _draw(axes, start, at, diameter)
            axes.set_title("start", loc="left", fontsize=9.0)
        else:
            step = steps[number - 1]
            _draw(axes, step.graph, at, diameter, step, _gone(steps[: number - 1]))
            fill = f"fill-in {len(step.fill_in)}" if step.fill_in else "no fill-in"
            axes.set_title(f"{number}: {step.variable.label} goes, {fill}", loc="left", fontsize=9.0)
    figure.suptitle(
        style.plain(f"{title} ({subtitle})"), x=0.01, ha="left", fontweight="bold", fontsize=11.0, color=style.INK
    )
    figure.get_layout_engine().set(h_pad=0.06, w_pad=0.06)
    style.legend(figure, _entries(start, steps))
    return figure


def _gone(steps: list[Step]) -> list[Variable]:
    return [step.variable for step in steps]


def _arrays(places: dict[int, tuple[float, float]]) -> Places:
    return {key: np.array(place) for key, place in places.items()}


def _extent(at: Places) -> tuple[Array, Array]:
    """Lower corner and size of what is shown."""
    every = np.array(list(at.values()))
    low, high = every.min(axis=0), every.max(axis=0)
    largest = float((high - low).max())
    # what stands in one place, but for rounding, gets a box of a metre
    span = np.maximum(high - low, 0.25 * largest if largest > 1e-9 * max(1.0, float(np.abs(every).max())) else 1.0)
    return 0.5 * (low + high - span), span


def _margin(at: Places) -> float:
    """Free space around what is shown, in its unit."""
    return (_WIDE_MARGIN if len(at) <= _FEW else _MARGIN) * float(_extent(at)[1].max())


def _ratio(at: Places) -> float:
    """Height of the box by its width."""
    span = _extent(at)[1] + 2.0 * _margin(at)
    return float(span[1] / span[0])


def _diameter(at: Places, width: float) -> tuple[float, float]:
    """Points of a circle, as large as the distances between neighbours allow, and the metres that these are."""
    every = np.array(list(at.values()))
    span = _extent(at)[1]
    points = 72.0 * width / float(span[0] + 2.0 * _margin(at))
    if len(every) < 2:
        return 26.0, 26.0 / points
    apart = np.sqrt(np.square(every[:, None] - every[None]).sum(axis=2))
    np.fill_diagonal(apart, np.inf)
    nearest = float(np.median(apart.min(axis=1)))
    diameter = float(np.clip(0.42 * nearest * points, 7.0, 26.0))
    return diameter, diameter / points


def _frame(axes: Axes, at: Places, metric: bool) -> None:
    low, span = _extent(at)
    margin = _margin(at)
    axes.set_xlim(low[0] - margin, low[0] + span[0] + margin)
    axes.set_ylim(low[1] - margin, low[1] + span[1] + margin)
    axes.set_aspect("equal", adjustable="box")
    if metric:
        axes.set_xlabel("x (m)")
        axes.set_ylabel("y (m)")
        return
    axes.set_xticks([])
    axes.set_yticks([])
    for side in axes.spines.values():
        side.set_color("#D8D8D8")


def _draw(
    axes: Axes,
    graph: Bipartite,
    at: Places,
    circle: tuple[float, float],
    step: Step | None = None,
    gone: Sequence[Variable] = (),
) -> None:
    """Lines, then squares, then circles; ``circle`` is their diameter in points and in metres."""
    diameter, metres = circle
    square = max(4.0, 0.36 * diameter)
    if step is not None:
        for a, b in step.fill_in:
            ends = np.stack([at[a.key], at[b.key]])
            axes.plot(ends[:, 0], ends[:, 1], color=style.VERMILLION, linestyle=(0, (3, 2)), linewidth=1.6, zorder=2)
    for members, role, place in _factor_places(graph, at, metres):
        colour = _COLOURS[role]
        for key in members:
            axes.plot([place[0], at[key][0]], [place[1], at[key][1]], color=style.GREY, linewidth=0.9, zorder=1)
        axes.plot(*place, marker="s", markersize=square, color=colour, markeredgewidth=0.0, zorder=3)
    named = len(graph.variables) <= _LABELLED or diameter >= 11.0
    for variable in graph.variables.values():
        _circle(axes, variable, at[variable.key], diameter, style.INK, "-", label=named)
    for variable in gone:
        _circle(axes, variable, at[variable.key], 0.6 * diameter, _GONE, "-", label=False)
    if step is not None:
        _circle(axes, step.variable, at[step.variable.key], diameter, style.VERMILLION, "--")


def _circle(
    axes: Axes, variable: Variable, place: Array, diameter: float, colour: str, line: str, label: bool = True
) -> None:
    """An open circle, doubled for fixed variables; landmarks are tinted."""
    face = "white" if variable.is_pose else "#E3F3EC"
    look: dict[str, Any] = {"edgecolors": colour, "linewidths": 1.2, "linestyles": line}
    axes.scatter(*place, s=diameter**2, facecolors=face, zorder=4, **look)
    if variable.fixed:
        axes.scatter(*place, s=(0.8 * diameter) ** 2, facecolors="none", zorder=4, **look)
    if label:
        _label(axes, variable.label, place, diameter, colour)


def _label(axes: Axes, text: str, place: Array, diameter: float, colour: str) -> None:
    """The name of a variable: in its circle if it can be read there, else beside it."""
    size = min(8.5, 1.25 * diameter / max(2, len(text)))
    if size >= _READABLE:
        axes.text(*place, text, ha="center", va="center", fontsize=size, color=colour, zorder=5)
        return
    axes.annotate(
        text,
        place,
        xytext=(0.4 * diameter, 0.4 * diameter),
        textcoords="offset points",
        fontsize=6.5,
        color=colour,
        zorder=5,
        path_effects=[withStroke(linewidth=2.0, foreground="white")],
    )


def _factor_places(graph: Bipartite, at: Places, circle: float) -> list[tuple[tuple[int, ...], str, Array]]:
    """Where the squares stand: between their variables or beside one, and aside where something else stands there.

    ``circle`` is the diameter of a variable's circle.
    """
    taken = [at[key] for key in graph.variables]
    centre = np.mean(list(at.values()), axis=0)
    out = []
    for factor in sorted(graph.factors, key=lambda factor: factor.role == CLOSURE):  # closures give way to odometry
        members = tuple(sorted(set(factor.variables)))
        middle = np.mean([at[key] for key in members], axis=0)
        if len(members) == 1:
            away = middle - centre
            angle = math.atan2(away[1], away[0]) if float(np.hypot(*away)) > 1e-9 * circle else 0.5 * math.pi
            turns = [angle + 0.9 * k for k in range(7)]
            choices = [middle + 1.05 * circle * np.array([math.cos(turn), math.sin(turn)]) for turn in turns]
        else:
            along = at[members[1]] - at[members[0]]
            across = np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-12)
            choices = [middle + 0.75 * circle * shift * across for shift in (0, 1, -1, 2, -2, 3, -3)]
        free = [min(float(np.hypot(*(choice - other))) for other in taken) for choice in choices]
        best = next((k for k, gap in enumerate(free) if gap > 0.6 * circle), int(np.argmax(free)))
        taken.append(choices[best])
        out.append((members, factor.role, choices[best]))
    return out


def _entries(graph: Bipartite, steps: Sequence[Step]) -> list[tuple[Any, str]]:
    """What the legend explains: only what occurs."""
    poses = any(variable.is_pose for variable in graph.variables.values())
    others = [variable for variable in graph.variables.values() if not variable.is_pose]
    out: list[tuple[Any, str]] = []
    ring: dict[str, Any] = {"marker": "o", "linestyle": "", "markeredgecolor": style.INK, "markersize": 9.0}
    if poses:
        out.append((Line2D([], [], markerfacecolor="white", **ring), "pose"))
    if others:
        names = {"switch" if variable.is_switch else "landmark" for variable in others}
        out.append((Line2D([], [], markerfacecolor="#E3F3EC", **ring), " or ".join(sorted(names))))
    roles = {factor.role for factor in graph.factors}
    for step in steps:
        roles |= {factor.role for factor in step.graph.factors}
    for role, colour in _COLOURS.items():
        if role in roles:
            out.append((Line2D([], [], marker="s", linestyle="", color=colour, markersize=6.0), role))
    if steps:
        dashed = {**ring, "markeredgecolor": style.VERMILLION}
        out.append((Line2D([], [], markerfacecolor="white", **dashed), "eliminated in this step"))
        out.append((Line2D([], [], color=style.VERMILLION, linestyle=(0, (3, 2)), linewidth=1.6), "fill-in"))
    return out
