"""The table of orders, its document, and what is in the pixels of spy plots and the nodes of trees."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import LineCollection, PathCollection
from support import BUNDLED, write_file

import slamcli
from slamcli.cli.main import main
from slamcli.graph import analyze
from slamcli.reporting.documents import dumps
from slamcli.reporting.plots import style
from slamcli.reporting.plots.elimination_trees import draw_trees
from slamcli.reporting.plots.spy import APPEARED, FILL, GONE, Raster, draw_spy
from slamcli.reporting.plots.style import FigureOptions
from slamcli.reporting.sparsity import kind_counts, sparsity_document, sparsity_summary
from slamcli.solver import symbolic
from slamcli.solver.ordering.comparison import Comparison, compare
from slamcli.solver.symbolic.cells import CLOSURE, LANDMARK, POSE

MANHATTAN, LANDMARKS = (slamcli.read(str(BUNDLED / name)) for name in ("manhattan_small.g2o", "landmarks_small.g2o"))


@pytest.fixture(scope="module")
def compared() -> Comparison:
    return compare(MANHATTAN, "natural,amd", time_limit=0.0)


@pytest.fixture(autouse=True)
def house() -> None:
    with style.house_style():
        yield


def panels(figure):
    """Images of the visible panels: H and L of each order, in turn."""
    return [axes.images[0].get_array() for axes in figure.axes if axes.get_visible() and axes.images]


# -- text and JSON -----------------------------------------------------------------------------------------------------


def test_the_table_has_a_row_for_each_order(compared: Comparison) -> None:
    lines = sparsity_summary(MANHATTAN, analyze(MANHATTAN), compared, {"spy": "spy.png"})
    cost = compared.costs[1]
    row = next(line for line in lines if line.startswith("amd *"))
    assert row.split()[2:4] == [str(cost.nnz_factor), f"{cost.fill_in:.2f}"]
    assert row.split()[-2:] == ["-", "-"], "nothing was measured"
    assert any(line.startswith("natural ") for line in lines)
    assert "* what --ordering auto takes" in lines
    assert lines[-1].split() == ["spy", "spy.png"]


def test_blocks_by_kind_are_those_of_the_graph(compared: Comparison) -> None:
    """399 free poses in a chain; each pair of poses that a closure joins, and no odometry, is one block."""
    pairs = np.concatenate([factors.indices for factors in MANHATTAN.factors])
    closures = {tuple(sorted(pair)) for pair in pairs.tolist() if abs(pair[0] - pair[1]) > 1 and 0 not in pair}
    assert kind_counts(compared) == {"pose": 399 + 398, "landmark": 0, "closure": len(closures)}


def test_the_document_can_be_read_back(compared: Comparison) -> None:
    document = json.loads(dumps(sparsity_document(MANHATTAN, analyze(MANHATTAN), compared, {}, {"load": 0.1})))
    assert document["command"] == "sparsity"
    assert [entry["name"] for entry in document["orderings"]] == ["natural", "amd"]
    assert document["hessian"]["nnz"] == compared.pattern.nnz == document["orderings"][0]["nnz_hessian"]
    assert document["changed"] is document["calibration"] is document["reduced"] is None


def test_changes_have_a_table() -> None:
    found = compare(LANDMARKS, "amd", time_limit=0.0, closures=[(3, 90)], marginalized=[40])
    lines = sparsity_summary(LANDMARKS, analyze(LANDMARKS), found, {})
    assert found.changed is not None
    heading = next(k for k, line in enumerate(lines) if line.startswith("blocks of"))
    assert lines[heading + 1].split() == ["H", *(str(n) for n in vars(found.changed).values())]
    assert lines[heading + 2].startswith("L, amd")


# -- rasters -----------------------------------------------------------------------------------------------------------


def test_a_pixel_for_each_block_where_there_is_room() -> None:
    raster = Raster(5, 100)
    raster.add(np.array([0, 3]), np.array([0, 1]), np.array([POSE, CLOSURE]))
    image = raster.image()
    assert image.shape == (5, 5, 4)
    assert np.argwhere(image[:, :, 3] > 0).tolist() == [[0, 0], [3, 1]]
    np.testing.assert_allclose(image[0, 0, :3], style.matplotlib.colors.to_rgb(style.BLUE))
    np.testing.assert_allclose(image[3, 1, :3], style.matplotlib.colors.to_rgb(style.VERMILLION))
    assert image[0, 0, 3] == 1.0


def test_a_large_matrix_keeps_its_outline_and_its_density() -> None:
    """Of 1000 blocks on 10 pixels: a full pixel is opaque, one with a single block is faint but there."""
    raster = Raster(1000, 10)
    rows, columns = (part.ravel() for part in np.mgrid[0:100, 0:100])
    raster.add(rows, columns, FILL)
    raster.add(np.array([950]), np.array([50]), FILL)
    raster.add(np.array([550]), np.array([450]), APPEARED)
    tint = raster.image()[:, :, 3]
    assert tint[0, 0] == 1.0 and 0.4 < tint[9, 0] < 0.6
    assert tint[5, 4] == 1.0, "what a change brings is not to be missed"
    assert np.count_nonzero(tint) == 3


def test_few_blocks_of_the_hessian_show_among_fill() -> None:
    raster = Raster(100, 10)
    raster.add(np.array([1]), np.array([0]), LANDMARK)
    raster.add(np.array([2, 3]), np.array([0, 1]), FILL)
    np.testing.assert_allclose(raster.image()[0, 0, :3], style.matplotlib.colors.to_rgb(style.GREEN))


# -- figures -----------------------------------------------------------------------------------------------------------


def test_spy_plots_show_the_pattern(compared: Comparison) -> None:
    figure = draw_spy(compared, FigureOptions(size=(30.0, 40.0)))  # more pixels than blocks
    images = panels(figure)
    count = len(compared.pattern.sizes)
    assert [image.shape[:2] for image in images] == [(count, count)] * 4
    for k, order in enumerate(compared.orders):
        hessian, factor = (images[j] for j in (k, 2 + k))
        filled = hessian[:, :, 3] > 0
        np.testing.assert_array_equal(filled, filled.T)
        assert filled.sum() == 2 * len(compared.pattern.rows) - count
        lower = factor[:, :, 3] > 0
        assert not np.triu(lower, 1).any()
        np.testing.assert_array_equal(np.tril(filled) & lower, np.tril(filled))
        numbers = type(compared.pattern)(np.ones(count, dtype=np.intp), compared.pattern.rows, compared.pattern.columns)
        assert lower.sum() == symbolic.analyze(numbers, order.order).nnz_factor
        grey = np.isclose(factor[:, :, :3], style.matplotlib.colors.to_rgb("#9A9A9A")).all(axis=2) & lower
        assert grey.sum() == lower.sum() - len(compared.pattern.rows), "all that is in L and not in H is fill-in"
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "poses and odometry",
        "loop closures",
        "fill-in of L",
    ]


def test_spy_plots_mark_what_a_change_brings_and_takes() -> None:
    found = compare(LANDMARKS, "natural", time_limit=0.0, closures=[(3, 90)], marginalized=[40])
    figure = draw_spy(found, FigureOptions(size=(30.0, 40.0)))
    hessian, factor = panels(figure)
    black, purple = (
        [np.isclose(image[:, :, :3], style.matplotlib.colors.to_rgb(tone)).all(axis=2) for image in (hessian, factor)]
        for tone in (style.INK, style.PURPLE)
    )
    visible = [image[:, :, 3] > 0 for image in (hessian, factor)]
    assert found.changed is not None and found.costs[0].changed is not None
    assert (black[0] & visible[0]).sum() == 2 * found.changed.appeared
    assert (black[1] & visible[1]).sum() == found.costs[0].changed.appeared
    assert visible[1].sum() == found.costs[0].changed.after
    place = int(np.flatnonzero(found.ids == 40)[0])
    assert purple[0][place, place] and not visible[1][place].any() and not visible[1][:, place].any()
    assert "goes with the change" in [text.get_text() for text in figure.legends[0].get_texts()]
    assert GONE > FILL


def test_trees_have_a_node_for_each_supernode_and_an_edge_to_each_parent(compared: Comparison) -> None:
    figure = draw_trees(compared)
    for axes, order in zip(figure.axes, compared.orders, strict=False):
        parts = symbolic.supernodes(order.analysis(compared.pattern))
        dots = next(c for c in axes.collections if isinstance(c, PathCollection))
        lines = next(c for c in axes.collections if isinstance(c, LineCollection))
        assert len(dots.get_offsets()) == len(parts)
        assert len(lines.get_segments()) == np.count_nonzero(parts.parent >= 0)
        assert dots.get_offsets()[:, 1].max() == parts.height
        for child, parent in lines.get_segments():
            assert child[1] == parent[1] + 1, "a parent is one level above"


def test_small_trees_name_their_variables() -> None:
    square = slamcli.read(str(BUNDLED / "square_toro.graph"))
    found = compare(square, "amd", time_limit=0.0)
    axes = draw_trees(found).axes[0]
    assert sorted(int(text.get_text()) for text in axes.texts) == sorted(found.ids.tolist())


def test_pictures_on_standard_output(capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    words = ["sparsity", str(BUNDLED / "square_toro.graph"), "--orderings", "amd", "--time-limit", "0", "--spy", "-"]
    assert main(words) == 0
    out, err = capfdbinary.readouterr()
    assert out.startswith(b"\x89PNG") and b"nnz(L)" in err


def test_the_same_input_gives_the_same_bytes(tmp_path) -> None:
    words = ["sparsity", str(BUNDLED / "landmarks_small.g2o"), "--orderings", "amd", "--time-limit", "0"]
    for name in ("a.svg", "b.svg"):
        assert main([*words, "--spy", str(tmp_path / name), "--tree", str(tmp_path / f"tree_{name}")]) == 0
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
    assert (tmp_path / "tree_a.svg").read_bytes() == (tmp_path / "tree_b.svg").read_bytes()


TWO = """\
VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1 0 0
EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1
"""
SWITCHED = """\
VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1 0 0
VERTEX_SE2 2 1 1 1.5
VERTEX_SWITCH 3 1
EDGE_SE2 0 1 1 0 0 10 0 0 10 0 10
EDGE_SE2 1 2 0 1 1.5 10 0 0 10 0 10
EDGE_SE2_SWITCHABLE 0 2 3 1 1 1.5 10 0 0 10 0 10
EDGE_SWITCH_PRIOR 3 1.0 1.0
"""


def test_the_tree_of_one_variable_has_whole_depths(tmp_path: Path) -> None:
    found = compare(slamcli.read(str(write_file(tmp_path, TWO))), "amd", time_limit=0.0)
    figure = draw_trees(found)
    figure.canvas.draw()
    for axes in figure.axes:
        ticks = axes.get_yticks()
        np.testing.assert_array_equal(ticks, np.round(ticks))
    assert "1 block variable" in figure.get_suptitle()
    assert "1 block column," in figure.axes[0].get_xlabel()
    assert "variables" not in figure.get_suptitle() + draw_spy(found).get_suptitle()


def test_switches_are_not_called_landmarks(tmp_path: Path) -> None:
    graph = slamcli.read(str(write_file(tmp_path, SWITCHED)))
    text = "\n".join(sparsity_summary(graph, analyze(graph), compare(graph, "amd", time_limit=0.0), {}))
    assert "3 poses, 1 switch, 4 edges" in text
    assert "2 with switches" in text
    assert "1 row of switches eliminated" in text
    assert "landmark" not in text


def test_no_picture_is_written_before_all_are_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As when drawing the second one is interrupted."""

    def interrupted(*given: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("slamcli.reporting.plots.elimination_trees.draw_trees", interrupted)
    source, first, second = write_file(tmp_path, TWO), tmp_path / "spy.png", tmp_path / "tree.png"
    words = ["sparsity", str(source), "--orderings", "amd", "--time-limit", "0"]
    assert main([*words, "--spy", str(first), "--tree", str(second)]) == 130
    assert not first.exists()
    assert not second.exists()


def test_a_single_order_has_a_pixel_for_each_of_some_hundred_blocks() -> None:
    figure = draw_spy(compare(MANHATTAN, "amd", time_limit=0.0))
    assert [len(image) for image in panels(figure)] == [399, 399]
    figure.canvas.draw()
    assert all(axes.get_window_extent().width * 150 / figure.dpi > 399 for axes in figure.axes)
