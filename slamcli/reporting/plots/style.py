"""What all figures share: palette, line styles, sizes, titles, legends.

The colours are those of Okabe and Ito, Color Universal Design (2008), without the yellow that fades on white: people
with any of the usual colour deficiencies tell them apart. Line styles and widths tell lines apart without colours.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILLION = "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00"
INK, GREY, PALE = "#1A1A1A", "#6B6B6B", "#B8B8B8"
#: One colour, line style, relative width and marker for each of several inputs, in their order. The first two, often
#: before and after, are both solid: they differ in lightness, and the first is wider where the second covers it.
COLOURS = (ORANGE, BLUE, GREEN, PURPLE, SKY, VERMILLION)
LINES: tuple[Any, ...] = ("-", "-", (0, (5, 1.2)), (0, (4, 1.2, 1, 1.2)), (0, (1.5, 0.9)), (0, (9, 1.5)))
WIDTHS = (1.3, 0.9, 1.0, 1.0, 1.0, 1.0)
MARKERS = ("o", "s", "^", "D", "v", "P")
#: Markers of landmarks; circles and squares mark the ends of paths.
STARS = ("*", "^", "D", "v", "P", "X")

_RC: dict[str, Any] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same picture everywhere
    "font.size": 9.0,
    "axes.titlesize": 11.0,
    "axes.labelsize": 9.0,
    "axes.labelcolor": INK,
    "axes.edgecolor": GREY,
    "axes.linewidth": 0.7,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-5, 8),  # coordinates of a national grid have seven digits
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "grid.color": "#E6E6E6",
    "grid.linewidth": 0.6,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "figure.constrained_layout.use": True,
    "svg.hashsalt": "slamcli",  # ids of SVG elements are random without it
    "pdf.fonttype": 42,
    "agg.path.chunksize": 20000,  # long lines overflow Agg's cell buffer in one piece
}
_LONGEST = 72


@dataclass(frozen=True)
class FigureOptions:
    """What holds for every kind of figure.

    Attributes
    ----------
    title
        Above the figure; None for one made of the names of the files.
    size
        Width and height in inches; None for one that suits what is drawn.
    dpi
        Pixels per inch: of PNG files, and of the rasterized layers of the others.
    """

    title: str | None = None
    size: tuple[float, float] | None = None
    dpi: int = 150


@contextmanager
def house_style() -> Iterator[None]:
    """Drawn and rendered in here, a figure does not depend on the user's matplotlibrc."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_RC)
        yield


def look(number: int, of: int, width: float) -> dict[str, Any]:
    """Colour, line style and width of one of so many inputs; a single one is blue.

    The colours repeat after six; the line styles, shifted with each round, do not go with them.
    """
    if of == 1:
        return {"color": BLUE, "linestyle": "-", "linewidth": width}
    turn = number % len(COLOURS)
    line = LINES[(number + number // len(COLOURS)) % len(LINES)]
    return {"color": COLOURS[turn], "linestyle": line, "linewidth": width * WIDTHS[turn]}


def marker(number: int, of: tuple[str, ...] = MARKERS) -> str:
    """Marker of an input."""
    return of[(number + number // len(COLOURS)) % len(of)]


def severity() -> LinearSegmentedColormap:
    """Pale to dark, evenly: the largest values stand out on white, in colour and in grey."""
    stops = ["#F3D9A4", "#F0B45B", "#DD7F35", "#B8472F", "#7E1E3A", "#33082E"]
    return LinearSegmentedColormap.from_list("severity", stops)


def number(value: int) -> str:
    """A count with thin spaces between groups of three digits."""
    return f"{value:,}".replace(",", "\N{THIN SPACE}") if value >= 10_000 else str(value)


def plain(text: str) -> str:
    """Text that matplotlib shows as it is: no formulas between dollar signs, no entry hidden by an underscore."""
    shown = text if len(text) <= _LONGEST else f"{text[: _LONGEST // 2 - 2]} … {text[-_LONGEST // 2 + 2 :]}"
    controls = ("Cc", "Cn", "Cs")  # line breaks among them
    shown = "".join("\N{REPLACEMENT CHARACTER}" if unicodedata.category(c) in controls else c for c in shown)
    shown = shown.replace("$", r"\$")
    return f"\N{ZERO WIDTH SPACE}{shown}" if shown.startswith("_") else shown


def new_figure(size: tuple[float, float]) -> Figure:
    """A figure of so many inches."""
    return Figure(figsize=size)


def headline(axes: Axes, title: str, subtitle: str) -> None:
    """A title, and below it in grey what the figure is made of."""
    axes.set_title(plain(title), loc="left", color=INK, pad=18.0 if subtitle else 6.0, fontweight="bold")
    if subtitle:
        place: dict[str, Any] = {"xycoords": "axes fraction", "textcoords": "offset points", "annotation_clip": False}
        axes.annotate(plain(subtitle), (0.0, 1.0), (0.0, 5.0), color=GREY, fontsize=8.5, **place)


def legend(figure: Figure, entries: Sequence[tuple[Any, str]]) -> int:
    """Handles and labels at the foot of a figure, where they cover no data.

    Returns
    -------
    int
        Number of rows: as few as the width allows.
    """
    if not entries:
        return 0
    handles, labels = zip(*entries, strict=True)
    widest = max(len(label) for label in labels)
    fitting = max(1, int(figure.get_figwidth() * 72.0 / (4.9 * widest + 40.0)))
    rows = -(-len(labels) // fitting)
    columns = -(-len(labels) // rows)  # as even as the rows allow
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, handlelength=2.6, columnspacing=1.6)
    return rows
